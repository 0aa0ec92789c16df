"""Simulate an aircraft: say in DJI's serial protocol what a flight recorded.

This is the reverse of the way from bytes to samples (``dji.link.framing``, ``dji.sources.serial``,
``dji.interpret``), for tests of that way and for a demonstration without hardware.
"""

from tirgeo_ros.dji.simulator.aircraft import Aircraft, Outgoing, frames_of

__all__ = ["Aircraft", "Outgoing", "frames_of"]
