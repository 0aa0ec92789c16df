"""Turn changes of targets and aircraft into what goes to the team."""

from __future__ import annotations

import math
import threading
import time
import uuid
from collections import deque
from collections.abc import Sequence

from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.io.cot.aircraft_events import AircraftState, aircraft_event, looks_at_event
from tirgeo_ros.io.cot.target_events import (
    deletion_event,
    target_event,
    target_uid,
    withdrawn_event,
)
from tirgeo_ros.page.cot.outbox import Outbox

#: An aircraft that reports faster is sent once a second.
_LEAST_STEP_S = 0.8
#: Deletions that are said again each minute, for those who missed them.
_DELETIONS_KEPT = 100


class TeamPicture:
    """Put what changed into an outbox; safe in all threads."""

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self._lock = threading.Lock()
        self._targets: dict[str, Target] | None = None
        self._deleted: deque[str] = deque()
        self._flown_s: dict[str, float] = {}

    def targets(self, targets: Sequence[Target]) -> None:
        """Take the whole list of targets, at each change of one."""
        now = {target_uid(target): target for target in targets}
        with self._lock:
            if self._targets is None:  # the team may have them from an earlier run
                self._outbox.assume_sent(now)
            before, self._targets = self._targets or {}, now
            for uid, target in now.items():
                if before.get(uid) != target:
                    self._changed(uid, target)
            for uid in before.keys() - now.keys():
                self._gone(uid, before[uid])

    def _changed(self, uid: str, target: Target) -> None:
        self._outbox.forget(_deletion(uid))  # an undone one
        self._outbox.put(uid, lambda now_ns: target_event(target, now_ns), keep=True)

    def _gone(self, uid: str, target: Target) -> None:
        if not self._outbox.was_sent(uid):
            self._outbox.forget(uid)
            return
        self._outbox.put(uid, lambda now_ns: withdrawn_event(target, now_ns), keep=False)
        deletion = _deletion(uid)
        self._outbox.put(deletion, lambda now_ns: deletion_event(target, now_ns), keep=True)
        self._deleted.append(deletion)
        if len(self._deleted) > _DELETIONS_KEPT:
            self._outbox.keep_no_more(self._deleted.popleft())

    def aircraft(self, aircraft: str, state: AircraftState) -> None:
        """Take an aircraft's newest state, which is that of now; one without a place is left."""
        place = state.latitude_deg, state.longitude_deg, state.height_m
        now_s = time.monotonic()
        with self._lock:
            soon = now_s - self._flown_s.get(aircraft, -math.inf) < _LEAST_STEP_S
            if soon or not all(map(math.isfinite, place)):
                return
            self._flown_s[aircraft] = now_s
        # Its time is that of the state, also if it waits for the network.
        uid, now_ns = aircraft_uid(aircraft), time.time_ns()
        self._outbox.put(uid, lambda _: aircraft_event(uid, state, now_ns), keep=False)
        looks_at = looks_at_event(uid, state, now_ns)
        if looks_at is not None:
            self._outbox.put(f"{uid}-looks-at", lambda _: looks_at, keep=False)


def aircraft_uid(aircraft: str) -> str:
    """Return an aircraft's uid: the same in each run, and of this computer alone."""
    return f"tirgeo-{uuid.uuid5(uuid.NAMESPACE_OID, f'{uuid.getnode()}/{aircraft}')}"


def _deletion(uid: str) -> str:
    return f"{uid}-deleted"
