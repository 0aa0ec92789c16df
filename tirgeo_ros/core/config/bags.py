"""The parameters of what plays and records bags."""

from __future__ import annotations

from dataclasses import dataclass

from tirgeo_ros.core.parameter import param


@dataclass(frozen=True, slots=True)
class BagPlayerConfig:
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


@dataclass(frozen=True, slots=True)
class RecorderConfig:
    """Parameters of recorder."""

    output: str = param("", "the MCAP file to write")
    topics: str = param("", "topics to record, separated by commas")
