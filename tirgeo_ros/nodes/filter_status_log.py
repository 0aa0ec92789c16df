"""Log the estimator's states and resets, each change once."""

from __future__ import annotations

from typing import Any

from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus

_BEST_FIRST = (
    FilterState.RUNNING,
    FilterState.DEGRADED,
    FilterState.DEAD_RECKONING,
    FilterState.ALIGNING,
    FilterState.WAITING,
    FilterState.LOST,
)


class StateLog:
    """Log changes of the estimator's status."""

    def __init__(self, logger: Any) -> None:
        self._logger = logger
        self._state: FilterState | None = None
        self._reason = ""
        self._resets: dict[str, int] = {}

    def note(self, status: NavigationStatus) -> bool:
        """Log a new state (a worse one as a warning) and resets; return whether there was any."""
        moved = status.state is not self._state
        if moved:
            rank, before = _BEST_FIRST.index, self._state
            worse = before is not None and rank(status.state) > rank(before)
            self._log_state(status, worse=worse)
        reset = [name for name, n in status.resets.items() if n > self._resets.get(name, 0)]
        if reset:
            text = f"reset by {', '.join(reset)}: {status.last_reset}"
            self._logger.warning(text)
        self._resets = status.resets
        return moved or bool(reset)

    def note_reason(self, status: NavigationStatus) -> None:
        """Log a new reason for the same state.

        Do not call this for each sample: a reason may contain a number, so it would log each time.
        """
        if status.reason != self._reason:
            self._log_state(status)

    def _log_state(self, status: NavigationStatus, *, worse: bool = False) -> None:
        self._state, self._reason = status.state, status.reason
        reason = f": {status.reason}" if status.reason else ""
        text = f"{status.method}: {status.state.value}{reason}"
        # Two separate calls: rclpy raises if one line of code logs with two severities.
        if worse:
            self._logger.warning(text)
        else:
            self._logger.info(text)
