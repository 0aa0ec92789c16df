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
"""Check the parameters of Cursor-on-Target, and convert them to PyTAK's settings."""

from __future__ import annotations

import ipaddress
import ssl
from configparser import RawConfigParser, SectionProxy
from pathlib import Path
from urllib.parse import SplitResult, parse_qsl, urlsplit

import pytak
from pytak.client_functions import get_ssl_ctx, get_tls_config

from tirgeo_ros.core.config.viewer_parameters import ViewerConfig
from tirgeo_ros.core.types.errors import ConfigError, shown

#: Port of each scheme where none is written: those of TAK's programs.
_PORTS = {"tcp": 8087, "tls": 8089, "udp": 6969}
#: What may follow the port, as ``?name=takserver``.
_OPTIONS = {"tls": "name", "udp": "interface"}
_EXAMPLES = "write tcp://HOST:8087, tls://HOST:8089 or udp://239.2.3.1:6969"
#: Waits between attempts (s): short, because a team in the field is waiting.
_FIRST_WAIT_S, _LONGEST_WAIT_S, _SETTLED_S = 1, 15, 10


def pytak_settings(config: ViewerConfig) -> SectionProxy:
    """Return PyTAK's settings; raise ConfigError that names the parameter and says what to do."""
    url = _checked(config.cot)
    host, port = url.hostname, url.port or _PORTS[url.scheme]
    only = "+wo" if url.scheme == "udp" else ""  # to receive would need this computer's port
    settings = {
        "COT_URL": f"{url.scheme}{only}://{host}:{port}",
        "TAK_PROTO": "0",
        "PYTAK_RECONNECT_INITIAL": str(_FIRST_WAIT_S),
        "PYTAK_RECONNECT_MAX": str(_LONGEST_WAIT_S),
        "PYTAK_RECONNECT_RESET": str(_SETTLED_S),
    }
    options = dict(parse_qsl(url.query, keep_blank_values=True))
    if unknown := [name for name in options if name != _OPTIONS.get(url.scheme)]:
        allowed = f"only ?{_OPTIONS[url.scheme]}=..." if url.scheme in _OPTIONS else "nothing"
        raise ConfigError(f"cot: {url.scheme}:// takes {allowed} after the port, not {unknown[0]}")
    if "interface" in options:
        try:
            ipaddress.IPv4Address(options["interface"])
        except ValueError:
            raise ConfigError(
                "cot: ?interface= is the IPv4 address of this computer in the team's network, "
                f"not {options['interface']!r}"
            ) from None
        settings["PYTAK_MULTICAST_LOCAL_ADDR"] = options["interface"]
    if url.scheme == "tls":
        settings |= _tls_settings(config, options.get("name"))
    elif config.cot_certificate or config.cot_key or config.cot_ca:
        raise ConfigError(
            f"cot: {url.scheme}:// does not encrypt, and takes no certificate: write tls://, or "
            "leave cot_certificate, cot_key and cot_ca empty"
        )
    parser = RawConfigParser()
    parser["cot"] = settings
    if url.scheme == "tls":
        _check_files(config, parser["cot"])
    return parser["cot"]


def _checked(cot: str) -> SplitResult:
    """Return the parts of an address; raise ConfigError if it is not valid."""
    try:
        # urlsplit leaves out line breaks silently.
        url = urlsplit(cot if cot.isprintable() and " " not in cot else "")
        valid = url.scheme in _PORTS and bool(url.hostname) and url.port != 0
    except ValueError:  # a port that is no number, or too large
        valid = False
    if not valid or url.username or url.fragment or url.path.strip("/"):
        raise ConfigError(f"cot: {shown(cot, 200)!r} is no address: {_EXAMPLES}")
    if ":" in (url.hostname or ""):
        raise ConfigError(f"cot: {shown(cot, 200)!r}: write the host's name or IPv4 address")
    return url


def _tls_settings(config: ViewerConfig, name: str | None) -> dict[str, str]:
    if not config.cot_certificate:
        raise ConfigError(
            "cot_certificate: tls:// needs the certificate (.p12 or .pem) that the owner of the "
            "TAK server made for this computer"
        )
    for key in ("cot_certificate", "cot_key", "cot_ca"):
        path = getattr(config, key)
        if path and not Path(path).is_file():
            raise ConfigError(f"{key}: there is no file {path}")
    settings = {
        "PYTAK_TLS_CLIENT_CERT": config.cot_certificate,
        "PYTAK_TLS_CLIENT_KEY": config.cot_key or config.cot_certificate,
        "PYTAK_TLS_CLIENT_CAFILE": config.cot_ca or ssl.get_default_verify_paths().cafile or "",
        # Without a password PyTAK fails at a .p12, and OpenSSL asks for a PEM's on the terminal.
        "PYTAK_TLS_CLIENT_PASSWORD": config.cot_password or ViewerConfig().cot_password,
        "PYTAK_TLS_CLIENT_CIPHERS": "DEFAULT",  # PyTAK's own choice takes weak ones too
        "PYTAK_TLS_SERVER_EXPECTED_HOSTNAME": name or "",
    }
    # PyTAK reads these through an interpolating parser.
    return {key: text.replace("%", "%%") for key, text in settings.items() if text}


def _check_files(config: ViewerConfig, settings: SectionProxy) -> None:
    """Load the certificates as a connection does; raise ConfigError if that fails."""
    try:
        if config.cot_ca:
            ssl.create_default_context(cafile=config.cot_ca)
    except (OSError, ValueError) as error:  # SSLError is an OSError
        raise ConfigError(
            f"cot_ca: {config.cot_ca} is no certificate in PEM ({error}): give the authority's"
        ) from None
    try:
        get_ssl_ctx(get_tls_config(settings))
    except (ValueError, OSError, SyntaxError, SystemError, AttributeError) as error:
        reason = error.__cause__ or error
        raise ConfigError(
            f"cot_certificate: {config.cot_certificate} cannot be used ({reason}); give a file "
            "named *.p12 and its cot_password (it must have one), or PEM files for "
            "cot_certificate and cot_key"
        ) from None


def endpoint(settings: SectionProxy) -> str:
    """Return the server's address, for a person: ``tls://HOST:PORT``."""
    host, port = pytak.parse_url(settings["COT_URL"])
    return f"{settings['COT_URL'].partition(':')[0].removesuffix('+wo')}://{host}:{port}"
