"""The aircraft's counters as times, where a file does not tell when its bytes arrived."""

from __future__ import annotations

from tirgeo_ros.dji.clocks.running_counter import LONGEST_EXTRA_NS, RunningCounter

_SECOND_NS = 1_000_000_000
#: Counters closer than this at the same place of a file show the same clock.
_SAME_NS = _SECOND_NS
#: A message that is older than the one before by more is another count, not disorder.
_LATE_NS = _SECOND_NS
#: A pause that long is believed at the second message that says so.
_LONG_NS = 60 * _SECOND_NS
#: What two messages in a row may differ by that both show the same new count.
_AGREE_NS = _SECOND_NS
#: Time between the last stamp before a counter starts again and the first after.
RESTART_NS = _SECOND_NS


class CaptureTimeline:
    """What the counters of one file have in common: where in time they lie.

    Stamps are the aircraft's time since power-up plus ``shift_ns``; with ``start_ns`` the shift
    is the one that gives the first message this stamp. ``place`` of a clock sets it as well.
    """

    def __init__(self, start_ns: int | None = None, shift_ns: int = 0) -> None:
        self._start_ns = start_ns
        self.shift_ns = shift_ns
        self.restarts = 0  # after each of them the time that passed is not known
        self.number = 0  # of clocks that have begun
        self.newest_ns: int | None = None  # newest stamp, without the shift
        self.aircraft_ns = 0  # the same by its counter

    def clock(
        self, tick_ns: int = 1_000_000, bits: int = 32, *, resets_alone: bool = False
    ) -> CaptureClock:
        """Another counter of the same file."""
        return CaptureClock(self, tick_ns, bits, resets_alone=resets_alone)

    @property
    def now_ns(self) -> int:
        """The newest stamp: about when what has no time of its own stands in the file."""
        return (self.newest_ns or 0) + self.shift_ns

    def take(self, stamp_ns: int, aircraft_ns: int) -> int:
        """Take a message of any of the clocks; returns its stamp with the shift."""
        if self._start_ns is not None:
            self.place(stamp_ns, self._start_ns)
        if self.newest_ns is None or stamp_ns >= self.newest_ns:
            self.newest_ns, self.aircraft_ns = stamp_ns, aircraft_ns
        return stamp_ns + self.shift_ns

    def place(self, stamp_ns: int, utc_ns: int) -> None:
        """Shift the stamps to come so that this one, without the shift, is that time."""
        self._start_ns = None
        self.shift_ns = utc_ns - stamp_ns


class CaptureClock:
    """Places one counter of the aircraft on a file's timeline.

    The counter is believed, wraps included. Where two messages in a row show that it has gone
    back by more than a second it has started again: the stream goes on ``RESTART_NS`` after its
    newest stamp, since the file does not tell how long the aircraft was off. One such message
    alone, or one that is a minute ahead, gets the newest stamp. Stamps of increasing counts do
    not decrease, unless ``place`` comes between them.

    Of the counters of a file, those that show about the same are of the same clock. One that
    shows something else is placed by the order of the messages: a message is not older than what
    other clocks' messages before it say. So is, from its reset on, one that ``resets_alone``: a
    command sets it to zero while the others go on.
    """

    def __init__(
        self,
        timeline: CaptureTimeline | None = None,
        tick_ns: int = 1_000_000,
        bits: int = 32,
        *,
        resets_alone: bool = False,
    ) -> None:
        self._resets_alone = resets_alone
        self._timeline = CaptureTimeline() if timeline is None else timeline
        self._counter = RunningCounter(tick_ns, bits)
        self._is_begun = self._is_placed = False
        self._is_apart = False  # placed by the order of the messages
        self._offset_ns = 0  # from the counter to the timeline
        self._newest_ns = 0  # by the counter
        self._stray_ns: int | None = None  # by the counter, of the message before
        self._counts = {"resets": 0, "stray counts": 0, "bad fractions": 0}

    def stamp_ns(self, ticks: int, arrival_ns: int = 0, extra_ns: int = 0) -> int:  # noqa: ARG002
        """Time of a message. ``arrival_ns`` is there for the signature; it is not looked at."""
        if not 0 <= extra_ns <= LONGEST_EXTRA_NS:
            self._counts["bad fractions"] += 1
            extra_ns = 0
        if not self._is_begun:
            self._begin(self._counter.begin(ticks) + extra_ns)
        tick_ns = self._counter.time_ns(ticks)
        aircraft_ns = tick_ns + extra_ns
        step_ns = aircraft_ns - self._newest_ns
        if not (self._is_placed or -_LATE_NS <= step_ns <= _LONG_NS):
            if self._is_stray(aircraft_ns):
                return self._timeline.now_ns
            if step_ns < 0:
                self._start_again(ticks, extra_ns)
                tick_ns, aircraft_ns = self._newest_ns - extra_ns, self._newest_ns
        self._stray_ns = None
        if step_ns > 0 or self._is_placed:
            self._counter.go_on(ticks, tick_ns)
            self._newest_ns = aircraft_ns
            self._is_placed = False
            self._keep_order(aircraft_ns)
        return self._timeline.take(aircraft_ns + self._offset_ns, aircraft_ns)

    def place(self, ticks: int, utc_ns: int) -> None:
        """Say that the counter stood at ``ticks`` at this time; moves all clocks of the file.

        Before the first message ``ticks`` may be of any message to come.
        """
        if not self._is_begun:
            self._begin(self._counter.begin(ticks))
            self._is_placed = True
        self._timeline.place(self._counter.time_ns(ticks) + self._offset_ns, utc_ns)

    @property
    def diagnostics(self) -> dict[str, str]:
        """What befell the counter, as texts."""
        texts = {"clock wraps": str(self._counter.wraps)}
        return texts | {f"clock {name}": str(count) for name, count in self._counts.items()}

    def _begin(self, aircraft_ns: int) -> None:
        """Set the offset at the first message."""
        line, now_ns = self._timeline, self._timeline.newest_ns
        self._is_begun, self._newest_ns = True, aircraft_ns
        line.number += 1
        if now_ns is not None:
            self._is_apart = abs(aircraft_ns - line.aircraft_ns) >= _SAME_NS
            self._offset_ns = now_ns - (aircraft_ns if self._is_apart else line.aircraft_ns)

    def _is_stray(self, aircraft_ns: int) -> bool:
        """Whether a count that does not go on is not confirmed by the one before."""
        known_ns, self._stray_ns = self._stray_ns, aircraft_ns
        if known_ns is not None and abs(aircraft_ns - known_ns) <= _AGREE_NS:
            return False
        self._counts["stray counts"] += 1
        return True

    def _start_again(self, ticks: int, extra_ns: int) -> None:
        """Set the offset anew: as another clock has it that has started again before, or later."""
        line, newest_ns = self._timeline, self._newest_ns + self._offset_ns
        self._counts["resets"] += 1
        self._newest_ns = aircraft_ns = self._counter.begin(ticks) + extra_ns
        if abs(aircraft_ns - line.aircraft_ns) < _SAME_NS:
            earliest_ns = line.now_ns - line.shift_ns + aircraft_ns - line.aircraft_ns
            self._offset_ns = max(earliest_ns, newest_ns) - aircraft_ns
        elif self._resets_alone and line.number > 1:
            self._is_apart = True
            self._offset_ns = line.now_ns - line.shift_ns - aircraft_ns
        else:
            line.restarts += 1
            earliest_ns = line.now_ns - line.shift_ns + RESTART_NS
            self._offset_ns = earliest_ns - aircraft_ns

    def _keep_order(self, aircraft_ns: int) -> None:
        """A clock apart is not behind what stands before it."""
        now_ns = self._timeline.newest_ns
        if self._is_apart and now_ns is not None:
            self._offset_ns = max(self._offset_ns, now_ns - aircraft_ns)
