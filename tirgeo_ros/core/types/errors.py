"""The errors that tirgeo raises: one root, one child a subject.

Each carries a message of one line that names the file, key or topic and says what to do; the
command line prints it and nothing else. What a message quotes may come from anywhere: it is shown
as one line of a bounded length.
"""

from __future__ import annotations

from tirgeo_ros.core.types.quoted_text import shown


class TirgeoError(Exception):
    """Root of all errors that tirgeo raises on purpose."""

    def __str__(self) -> str:
        """Return the message as one line."""
        return shown(super().__str__())


class ConfigError(TirgeoError):
    """A parameter is unknown, of the wrong type or out of its range."""


class BagError(TirgeoError):
    """A bag cannot be read or written, or lacks a needed topic."""


class MessageError(TirgeoError):
    """A message cannot be decoded or lacks what it must hold: count it and go on."""


class MapError(TirgeoError):
    """A map file cannot be read or makes no sense as a map."""


class ElevationError(TirgeoError):
    """An elevation model cannot be read, or makes no sense as one."""


class CameraError(TirgeoError):
    """A camera's calibration cannot be used."""


class SurveyError(TirgeoError):
    """A survey or an observation file cannot be read."""


class ScenarioError(TirgeoError):
    """A scenario of the simulator cannot be flown."""


class CalibrationError(TirgeoError):
    """A calibration or an evaluation cannot be made of what is given."""


class VideoError(TirgeoError):
    """A video file cannot be written."""


class GraphError(TirgeoError):
    """The node graph did not start, stopped early or gave nothing."""


class DjiError(TirgeoError):
    """A capture, a table of packages, a key or the link to the aircraft cannot be used."""
