"""The parameters of dji_node and of ``tirgeo import``."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tirgeo_ros.core.config.aircraft import AircraftConfig
from tirgeo_ros.core.config.renamed import NodeParameters
from tirgeo_ros.core.config.schema import group, param

#: Codes of the broadcast rates: 0 Hz, 1, 10, 50, 100, as it is, 200, 400.
RATE_CODES = 8


@dataclass(frozen=True, slots=True)
class DjiHeadingConfig:
    """What is believed of the heading of the two RTK antennas."""

    sigma_deg: float = param(
        0.6, "standard deviation of a heading in whole degrees", unit="deg", low=1e-3, high=180
    )


@dataclass(frozen=True, slots=True)
class DjiRtkConfig:
    """What is believed of an RTK fix, which DJI gives no accuracy with."""

    fixed_sigma_m: tuple[float, ...] = param(
        (0.01, 0.02),
        "horizontal and vertical standard deviation of a fixed position",
        unit="m",
        low=1e-4,
        high=100,
        sizes=(2,),
    )
    velocity_sigma_m_s: float = param(
        0.03, "standard deviation of a velocity, per axis", unit="m/s", low=1e-4, high=100
    )
    delay_s: float = param(
        0.0,
        "time from measurement to the aircraft's message; negative for stamps that are early",
        unit="s",
        low=-2,
        high=2,
    )


@dataclass(frozen=True, slots=True)
class DjiDelayConfig:
    """How old the other values are when the aircraft sends them; negative as ``rtk.delay_s``."""

    imu_s: float = param(0.0, "of acceleration, rate and attitude", unit="s", low=-2, high=2)
    gps_s: float = param(0.0, "of the ordinary GPS", unit="s", low=-2, high=2)
    gimbal_s: float = param(0.0, "of the gimbal's angles", unit="s", low=-2, high=2)


@dataclass(frozen=True, slots=True)
class DjiClockConfig:
    """From the aircraft's clock to this computer's."""

    window_s: float = param(
        20.0, "the offset is the smallest of so long", unit="s", low=0.5, high=3600
    )
    max_drift_ppm: float = param(
        100.0, "fastest drift between the two clocks", unit="ppm", low=0, high=1e4
    )


@dataclass(frozen=True, slots=True)
class DjiHostConfig:
    """What is asked of the aircraft; nothing by default: the node only listens."""

    app_id: int = param(
        0, "DJI application id to activate with; 0 = no activation", low=0, high=2**31 - 1
    )
    broadcast_rates: tuple[float, ...] = param(
        (),
        "a rate code for each of the 16 parts of the broadcast (0: off, 1: 1 Hz, 2: 10, 3: 50, "
        "4: 100, 5: as it is, 6: 200, 7: 400); empty = leave them",
        low=0,
        high=RATE_CODES - 1,
        sizes=(0, 16),
    )
    subscribe: bool = param(
        False, "ask for the subscription packages (after activation), old ones are reset"
    )


@dataclass(frozen=True, slots=True)
class DjiConfig(NodeParameters):
    """Parameters of dji_node."""

    source: str = param(
        "serial",
        "serial (the UART of an A3 or M600) or psdk (the topics of psdk_ros2)",
        choices=("serial", "psdk"),
    )
    port: str = param("/dev/ttyUSB0", "serial port")
    baud: int = param(921600, "bits per second, as set in DJI Assistant 2", low=1200, high=4000000)
    key: str = param(
        "", "application key, 64 hexadecimal digits, for encrypted frames; empty = none"
    )
    packages: str = param(
        "", "YAML file that says what the subscription packages hold; empty = the usual five"
    )
    psdk_prefix: str = param("psdk_ros2", "name in front of psdk_ros2's topics")
    geoid_undulation_m: float = param(
        math.nan,
        "height of the sea level above the ellipsoid where it flies; unset = 0, with a warning",
        unit="m",
        low=-120,
        high=100,
    )
    acceleration_unit: str = param(
        "auto",
        "of the broadcast's acceleration: auto (told by its size), g or m/s2",
        choices=("auto", "g", "m/s2"),
    )
    gimbal_reference: str = param(
        "north",
        "what the gimbal's yaw counts from: north (Zenmuse) or body (Ronin-MX)",
        choices=("north", "body"),
    )
    heading: DjiHeadingConfig = group(DjiHeadingConfig)
    rtk: DjiRtkConfig = group(DjiRtkConfig)
    delay: DjiDelayConfig = group(DjiDelayConfig)
    clock: DjiClockConfig = group(DjiClockConfig)
    host: DjiHostConfig = group(DjiHostConfig)
    aircraft: AircraftConfig = group(AircraftConfig)
