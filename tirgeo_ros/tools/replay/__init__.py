"""Replay a recorded flight through the core: process, check and locate."""

from tirgeo_ros.tools.replay.check_setting import CheckSetting, setting_of
from tirgeo_ros.tools.replay.finding_lines import finding_items, finding_lines
from tirgeo_ros.tools.replay.flight_checks import FlightChecks

__all__ = ["CheckSetting", "FlightChecks", "finding_items", "finding_lines", "setting_of"]
