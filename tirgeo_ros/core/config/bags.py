"""The parameters of what plays and records bags."""

from __future__ import annotations

from dataclasses import dataclass

from tirgeo_ros.core.config.aircraft import AircraftConfig
from tirgeo_ros.core.config.renamed import NodeParameters
from tirgeo_ros.core.config.schema import group, param
from tirgeo_ros.core.types.joint_orders import JOINT_ORDERS, USUAL_ORDER


@dataclass(frozen=True, slots=True)
class SimulatedAircraftConfig:
    """What an aircraft is like that says over a serial line what a flight recorded."""

    geoid_undulation_m: float = param(
        0.0,
        "height of the sea level above the ellipsoid, by which it reports heights",
        unit="m",
        low=-120,
        high=100,
    )
    gimbal: str = param(
        "joints",
        "the gimbal's angles: joints (its own attitude with the recorded encoder angles, where "
        "there are some) or reported (the recorded gimbal/attitude)",
        choices=("joints", "reported"),
    )
    joint_order: str = param(
        USUAL_ORDER,
        "the joints of those angles from the aircraft to the camera",
        choices=JOINT_ORDERS,
    )
    layout: str = param(
        "modern",
        "of the broadcast: modern (firmware 3.2.41) or legacy (3.2.15.62)",
        choices=("modern", "legacy"),
    )
    clock_start_ms: int = param(
        60_000, "what its clock shows at the start", unit="ms", low=0, high=2**32 - 1
    )
    clock_drift_ppm: float = param(
        0.0, "by how much its clock is fast", unit="ppm", low=-1e4, high=1e4
    )
    pushes: bool = param(
        False, "the usual subscription packages as well, as a host left them that went away"
    )


@dataclass(frozen=True, slots=True)
class BagPlayerConfig(NodeParameters):
    """Parameters of bag_player."""

    bag: str = param("", "the MCAP file to play")
    rate: float = param(1.0, "speed, times real time", low=0.01, high=100)
    start_offset_s: float = param(0.0, "where in the bag to begin", unit="s", low=0, high=1e6)
    loop: bool = param(False, "begin again at the end")
    clock_rate_hz: float = param(100.0, "rate of /clock", unit="Hz", low=1, high=100)
    wait_timeout_s: float = param(
        30.0, "longest wait for subscribers before the first message", unit="s", low=0, high=3600
    )
    wait_for: str = param(
        "",
        "topics, separated by commas, that need a subscriber before the start; empty = any topic",
    )
    topics: str = param(
        "",
        "topics to play, separated by commas; empty = all that the graph does not make itself",
    )
    live: bool = param(
        False, "every header's stamp is shifted so that the bag begins now; no /clock"
    )
    serial_port: str = param(
        "",
        "with live: the aircraft's topics are played as DJI's serial protocol, on a "
        "pseudo-terminal of this path; empty = as topics",
    )
    simulated_aircraft: SimulatedAircraftConfig = group(SimulatedAircraftConfig)
    aircraft: AircraftConfig = group(AircraftConfig)


@dataclass(frozen=True, slots=True)
class RecorderConfig(NodeParameters):
    """Parameters of recorder."""

    output: str = param("", "the MCAP file to write")
    topics: str = param("", "topics to record, separated by commas")
