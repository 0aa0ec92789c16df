"""Convert the estimator's status to texts for people."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from tirgeo_ros.core.types.errors import MessageError, cut
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus, Outcome

OK, WARN, ERROR = 0, 1, 2
_LEVELS = {FilterState.RUNNING: OK, FilterState.LOST: ERROR}  # all others are warnings
_COUNT, _RATIO, _RESET, _CLIPPED, _NIS = "count", "test_ratio", "reset", "clipped", "nis"
_NEXT = "; "  # between warnings, which do not contain it


@dataclass(frozen=True, slots=True)
class DiagnosticItem:
    """Hold one status of a ``diagnostic_msgs/DiagnosticArray``."""

    name: str
    level: int  # 0 OK, 1 WARN, 2 ERROR, 3 STALE
    message: str
    values: dict[str, str] = field(default_factory=dict)

    @property
    def aircraft(self) -> str:
        """Return the namespace in ``/uav1/node: subject``, and ``aircraft`` where it has none."""
        return self.name.partition(":")[0].rpartition("/")[0].strip("/") or "aircraft"


def navigation_item(name: str, status: NavigationStatus) -> DiagnosticItem:
    """Convert the estimator's status: OK if it runs without warnings, an error once it is lost."""
    values = {
        "method": status.method,
        "state": status.state.value,
        "state_time_s": repr(float(status.state_s)),
        "reason": status.reason,
        "began_again": status.began_again.value if status.began_again else "",
        "rtk_status": status.rtk_status.name.lower(),
        "heading_sigma_deg": repr(math.degrees(status.heading_sigma_rad)),
        "last_reset": status.last_reset,
    }
    values |= {f"{_COUNT}.{a}.{b}": str(n) for (a, b), n in sorted(status.counts.items())}
    values |= {f"{_RATIO}.{a}": repr(float(r)) for a, r in sorted(status.test_ratios.items())}
    values |= {f"{_RESET}.{a}": str(n) for a, n in sorted(status.resets.items())}
    values |= {f"{_NIS}.{a}": repr(float(n)) for a, n in sorted(status.nis.items())}
    values["process_noise"] = status.process_noise
    values["vibration"] = " ".join(f"{density:.3g}" for density in status.vibration)
    values |= {f"{_CLIPPED}.{name}": str(n) for name, n in sorted(status.clipped.items())}
    warnings = values["warnings"] = _NEXT.join(status.warnings)
    warned = warnings if status.state is FilterState.RUNNING else ""
    level = WARN if warned else _LEVELS.get(status.state, WARN)
    text = f"{status.state.value}: {warned or status.reason}".removesuffix(": ")
    return DiagnosticItem(name, level, text, values)


def navigation_status(msg: Any) -> NavigationStatus:
    """Decode the estimator's ``diagnostic_msgs/DiagnosticStatus``, the inverse of the encoder.

    Where a recording lacks the keys of time in the state, resets, clipped samples or warnings,
    these are 0 or empty. Texts are cut. Raises MessageError if it is no such status.
    """
    values = {cut(item.key): cut(item.value) for item in msg.values}
    try:
        return _status(values)
    except (KeyError, ValueError) as error:
        raise MessageError(f"diagnostics: {msg.name!r} is no navigation status: {error}") from None


def diagnostic_level(msg: Any) -> int:
    """Return the level of a ``diagnostic_msgs/DiagnosticStatus``, which rclpy gives as bytes."""
    return msg.level[0] if isinstance(msg.level, bytes) else int(msg.level)


def _status(values: dict[str, str]) -> NavigationStatus:
    parts = [(key.split("."), value) for key, value in values.items()]
    again = values.get("began_again", "")
    return NavigationStatus(
        method=values["method"],
        state=FilterState(values["state"]),
        reason=values["reason"],
        began_again=Outcome(again) if again else None,
        rtk_status=FixStatus[values["rtk_status"].upper()],
        heading_sigma_rad=math.radians(float(values["heading_sigma_deg"])),
        counts={(k[1], k[2]): int(v) for k, v in parts if k[0] == _COUNT and len(k) == 3},
        test_ratios={k[1]: float(v) for k, v in parts if k[0] == _RATIO and len(k) == 2},
        state_s=float(values.get("state_time_s", "0")),
        resets={k[1]: int(v) for k, v in parts if k[0] == _RESET and len(k) == 2},
        last_reset=values.get("last_reset", ""),
        clipped={k[1]: int(v) for k, v in parts if k[0] == _CLIPPED and len(k) == 2},
        nis={k[1]: float(v) for k, v in parts if k[0] == _NIS and len(k) == 2},
        process_noise=values.get("process_noise", ""),
        vibration=tuple(map(float, values.get("vibration", "").split())),
        warnings=tuple(filter(None, values.get("warnings", "").split(_NEXT))),
    )
