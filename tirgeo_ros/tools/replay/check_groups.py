"""Define the groups of checks that a flight runs through: those of the nodes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tirgeo_ros.core.checks.gimbal_checks import GimbalChecks
from tirgeo_ros.core.checks.map_checks import MapChecks
from tirgeo_ros.core.checks.navigation_checks import NavigationChecks
from tirgeo_ros.core.checks.picture_checks import PictureChecks
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.tools.replay.check_setting import CheckSetting


@dataclass(frozen=True)
class Groups:
    """Hold one object for each group of checks."""

    navigation: NavigationChecks
    gimbal: GimbalChecks
    pictures: PictureChecks
    map: MapChecks

    def findings(self) -> list[Finding]:
        """Return the findings of all groups."""
        groups = (self.navigation, self.gimbal, self.pictures, self.map)
        return [finding for group in groups for finding in group.findings()]


def groups_of(setting: CheckSetting) -> Groups:
    """Return new check groups for a setting."""
    return Groups(
        NavigationChecks(setting.ekf, setting.given),
        GimbalChecks(setting.gimbal, setting.given),
        PictureChecks(setting.overlay, setting.ground, setting.given),
        MapChecks(math.nan if setting.ground is None else setting.ground),
    )
