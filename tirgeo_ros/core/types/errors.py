# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Define the errors that tirgeo raises: one root class, and one child class for each subject.

Each error carries a message of one line. The message names the file, key or topic and says what
to do; the command line prints it and nothing else. A message may quote text from outside, so it
is always returned as one printable line of limited length.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

_LISTED = 40  # most names that a message lists
MOST = 2000  # most characters in one line (a reason, a name or a path)


def cut(text: str, most: int = MOST) -> str:
    """Return the text; if it is too long, its beginning and an ellipsis, ``most`` characters."""
    return text if len(text) <= most else text[: most - 1] + "\u2026"


def shown(text: object, most: int = MOST) -> str:
    """Return a text cut to ``most`` characters, with unprintable ones escaped as in ``repr``.

    Line breaks, terminal escape sequences and lone surrogates from outside then do no harm in a
    log. The escapes may make the line longer than ``most``.
    """
    short = cut(str(text), most)
    if short.isprintable():
        return short
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in short)


def nearest(name: str, candidates: Iterable[str]) -> str:
    """Return the end of a message: the most similar of the known names, or all if they are few."""
    names = [*map(str, candidates)]
    near = difflib.get_close_matches(name, names, n=1)
    if near:
        return f" (did you mean {near[0]}?)"
    return f" (known: {', '.join(names)})" if 0 < len(names) <= _LISTED else ""


class TirgeoError(Exception):
    """Serve as the root of all errors that tirgeo raises on purpose."""

    def __str__(self) -> str:
        """Return the message as one printable line of limited length."""
        return shown(super().__str__())


class ConfigError(TirgeoError):
    """Report a parameter that is unknown, of the wrong type or out of its range."""


class BagError(TirgeoError):
    """Report a bag that cannot be read or written, or that lacks a required topic."""


class MessageError(TirgeoError):
    """Report a message that cannot be decoded or lacks required data."""


class MapError(TirgeoError):
    """Report a map file that cannot be read or whose contents are not a valid map."""


class ElevationError(TirgeoError):
    """Report an elevation model that cannot be read or whose contents are not valid."""


class CameraError(TirgeoError):
    """Report a camera calibration that cannot be used."""


class SurveyError(TirgeoError):
    """Report a survey file or an observation file that cannot be read."""


class TargetError(TirgeoError):
    """Report a target file, a target or a change of a target that is not valid."""


class ScenarioError(TirgeoError):
    """Report a scenario that the simulator cannot fly."""


class CalibrationError(TirgeoError):
    """Report data from which a calibration or an evaluation cannot be computed."""


class VideoError(TirgeoError):
    """Report a video file that cannot be written."""


class PictureError(TirgeoError):
    """Report pictures that could not be drawn."""


class ExportError(TirgeoError):
    """Report a product of a flight that cannot be written."""


class GraphError(TirgeoError):
    """Report a node graph that did not start, stopped early or produced no output."""


class DjiError(TirgeoError):
    """Report a capture, a package table, a key or an aircraft link that cannot be used."""


class LogError(TirgeoError):
    """Report a log of another maker that cannot be read, or that lacks needed information."""


class ManyFlightsError(TirgeoError):
    """Report flights that cannot be processed together, or a cluster that cannot process them."""


class PageError(TirgeoError):
    """Report an operator's page that cannot be served with its parameters."""


class TableError(TirgeoError):
    """Report a table of samples that lacks a column or whose column cannot be used."""


class PoseError(TirgeoError):
    """Report a time at which a pose is needed but not available."""
