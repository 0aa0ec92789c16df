"""The checks of a recorded flight: what feeds them, and what they say to people."""

from tirgeo_ros.tools.checks.flight_checks import FlightChecks
from tirgeo_ros.tools.checks.setting import CheckSetting, setting_of
from tirgeo_ros.tools.checks.words import finding_items, finding_lines

__all__ = ["CheckSetting", "FlightChecks", "finding_items", "finding_lines", "setting_of"]
