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
"""Define the parameters of viewer_node, which serves the operator's page."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from tirgeo_ros.core.config.schema import param
from tirgeo_ros.core.types.errors import ConfigError

_ADDRESS = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+):([0-9]{1,5})", re.ASCII)
_NAMESPACE = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)
_TOKEN = re.compile(r"[A-Za-z0-9._~-]{12,200}", re.ASCII)
#: Environment variable from which the page derives the tokens that no parameter sets. With the
#: same value after a restart, the page's users stay logged in.
TOKEN_SEED = "TIRGEO_TOKEN_SEED"  # noqa: S105  the variable's name


def address_of(listen: str) -> tuple[str, int]:
    """Return host and port of ``HOST:PORT``; the brackets of an IPv6 address are removed.

    Raises ConfigError for any other text.
    """
    fault = _address_fault(listen)
    if fault:
        raise ConfigError(f"{listen!r} {fault}")
    host, _, port = listen.rpartition(":")
    return host.strip("[]"), int(port)


def split_namespaces(text: str) -> list[str]:
    """Split a text at its commas into namespaces, without slashes at their ends."""
    return [name.strip().strip("/") for name in text.split(",") if name.strip()]


def _address_fault(text: str) -> str:
    match = _ADDRESS.fullmatch(text)
    is_address = match is not None and int(match[2]) <= 65535
    return "" if is_address else "is not HOST:PORT, such as 127.0.0.1:8080 or 0.0.0.0:8080"


def _token_fault(text: str) -> str:
    is_token = not text or _TOKEN.fullmatch(text)
    return "" if is_token else "is no token: write 12 to 200 letters, digits or -._~"


def _namespaces_fault(text: str) -> str:
    names = split_namespaces(text)
    wrong = [name for name in names if not _NAMESPACE.fullmatch(name)]
    if wrong:
        return "is not a list of namespaces: use letters, digits, _ and /, such as uav1,uav2"
    return "names an aircraft twice: remove one" if len({*names}) < len(names) else ""


@dataclass(frozen=True, slots=True)
class GroundConfig:
    """The ground under the video."""

    dem: str = param(
        "",
        "elevation model, as in overlay_node; empty = level ground at the footprint's height, or "
        "unknown ground",
    )
    dem_undulation_m: float = param(
        0.0,
        "height of the DEM's zero above the ellipsoid, as in overlay_node",
        ("m", -120, 100),
    )
    geoid_undulation_m: float = param(
        math.nan,
        "height of the geoid (sea level) above the ellipsoid; unset = no heights above sea level",
        ("m", -120, 100),
    )


@dataclass(frozen=True, slots=True)
class ViewerConfig(GroundConfig):
    """Parameters of viewer_node."""

    listen: str = param(
        "127.0.0.1:8080",
        "address at which the page is served; with 0.0.0.0:8080, or this computer's own address, "
        "other computers reach it, with a token",
        fault=_address_fault,
    )
    token: str = param(
        "",
        "secret of operators, who may change targets; empty = a new one is shown at each start",
        fault=_token_fault,
        secret=True,
    )
    token_file: str = param("", "file that contains token, instead of token")
    viewer_token: str = param(
        "",
        "secret of viewers, who may only look; empty = a new one is shown at each start",
        fault=_token_fault,
        secret=True,
    )
    viewer_token_file: str = param("", "file that contains viewer_token, instead of viewer_token")
    certificate: str = param("", "certificate (PEM) of the page, for https; empty = http")
    key: str = param("", "private key (PEM) of certificate")
    targets: str = param("targets.gpkg", "file of the targets (GeoPackage), created if absent")
    map: str = param("", "map under the targets, as in overlay_node; several separated by commas")
    tiles: str = param("", "background of the page's map (MBTiles); empty = the map alone")
    namespaces: str = param(
        "",
        "namespaces of the aircraft, separated by commas; empty = the node's own namespace",
        fault=_namespaces_fault,
    )
    rewind_mb: float = param(
        192.0,
        "size of the file that keeps each aircraft's newest pictures, to go back to: 120 s of "
        "640x512 take 50 at 10 Hz, 150 at 30 Hz",
        ("MB", 16, 4096),
    )
    record_to: str = param("recordings", "folder of the recordings that are started on the page")
    least_free_gb: float = param(
        2.0, "free space of its disk below which a recording ends", ("GB", 0, 1e4)
    )
    cot: str = param(
        "",
        "where Cursor-on-Target is sent: tcp://HOST:PORT, tls://HOST:PORT or udp://HOST:PORT; "
        "empty = nowhere",
    )
    cot_certificate: str = param("", "certificate of this client for tls (.p12 or PEM)")
    cot_key: str = param("", "private key (PEM) of cot_certificate; empty = in the same file")
    cot_ca: str = param("", "certificate (PEM) of the server's certificate authority, for tls")
    cot_password: str = param(
        "atakatak", "password of the key; the default is the usual one of TAK servers", secret=True
    )
    cot_password_file: str = param("", "file that contains cot_password, instead of cot_password")
    stream: str = param(
        "",
        "where the video is sent as MPEG-TS with MISB metadata: udp://HOST:PORT; each further "
        "aircraft uses the next port; empty = nowhere",
    )


@dataclass(frozen=True, slots=True)
class VideoWriterConfig(GroundConfig):
    """Parameters of video_writer, which viewer_node starts for recordings and for the stream."""

    output: str = param("", "file to write (.ts); empty = none")
    stream: str = param("", "where the video is sent: udp://HOST:PORT; empty = nowhere")
    platform: str = param("", "name of the aircraft in the metadata")
