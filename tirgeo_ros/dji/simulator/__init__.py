"""Simulate an aircraft: send a recorded flight in DJI's serial protocol.

This reverses the conversion from bytes to samples (``dji.link.framing``, ``dji.sources.serial``,
``dji.interpret``), to test that conversion, and for a demonstration without hardware.
"""
