"""Convert the estimator's status to texts for people."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus

OK, WARN, ERROR = 0, 1, 2
_LEVELS = {FilterState.RUNNING: OK, FilterState.LOST: ERROR}  # all others are warnings


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
    values |= {f"count.{a}.{b}": str(n) for (a, b), n in sorted(status.counts.items())}
    values |= {f"test_ratio.{a}": repr(float(r)) for a, r in sorted(status.test_ratios.items())}
    values |= {f"reset.{a}": str(n) for a, n in sorted(status.resets.items())}
    values |= {f"nis.{a}": repr(float(n)) for a, n in sorted(status.nis.items())}
    values["process_noise"] = status.process_noise
    values["vibration"] = " ".join(f"{density:.3g}" for density in status.vibration)
    values |= {f"clipped.{name}": str(n) for name, n in sorted(status.clipped.items())}
    warnings = values["warnings"] = "; ".join(status.warnings)
    warned = warnings if status.state is FilterState.RUNNING else ""
    level = WARN if warned else _LEVELS.get(status.state, WARN)
    text = f"{status.state.value}: {warned or status.reason}".removesuffix(": ")
    return DiagnosticItem(name, level, text, values)
