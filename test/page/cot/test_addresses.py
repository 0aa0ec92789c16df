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
"""Parameters of Cursor-on-Target: what is refused at the start, and with which words."""

from __future__ import annotations

import re
import socket
import ssl

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.serialization import pkcs12
from signed_certificates import certificate

from tirgeo_ros.core.config import ViewerConfig
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.page.cot.address import endpoint, pytak_settings
from tirgeo_ros.page.cot.link import words_of


@pytest.mark.parametrize(
    ("cot", "where"),
    [
        ("tcp://tak.example", "tcp://tak.example:8087"),
        ("tcp://10.0.0.5:9000/", "tcp://10.0.0.5:9000"),
        ("udp://239.2.3.1", "udp://239.2.3.1:6969"),
        ("udp://239.2.3.1:6970?interface=10.0.0.2", "udp://239.2.3.1:6970"),
    ],
)
def test_an_address_needs_no_port(cot, where):
    assert endpoint(pytak_settings(ViewerConfig(cot=cot))) == where


@pytest.mark.parametrize(
    ("cot", "words"),
    [
        ("", "write tcp://HOST:8087, tls://HOST:8089 or udp://239.2.3.1:6969"),
        ("tak.example:8087", "is no address"),
        ("http://tak.example", "is no address"),
        ("tcp://h\r\nx:1", "is no address"),
        ("tcp://tak example", "is no address"),
        ("tcp://tak.example:65536", "is no address"),
        ("tcp://user:secret@tak.example", "is no address"),
        ("tcp://tak.example/path", "is no address"),
        ("tcp://[::1]:8087", "name or IPv4 address"),
        ("tcp://tak.example?name=other", "takes nothing after the port"),
        ("udp://239.2.3.1?ttl=5", r"takes only \?interface="),
        ("udp://239.2.3.1?interface=eth0", "IPv4 address of this computer"),
        ("tls://tak.example", "cot_certificate: tls:// needs the certificate"),
    ],
)
def test_a_wrong_address_is_refused(cot, words):
    with pytest.raises(ConfigError, match=words):
        pytak_settings(ViewerConfig(cot=cot))


def test_a_certificate_without_tls_is_refused_as_nothing_would_be_encrypted():
    with pytest.raises(ConfigError, match="does not encrypt"):
        pytak_settings(ViewerConfig(cot="tcp://tak.example", cot_certificate="mine.p12"))


@pytest.mark.parametrize("key", ["cot_certificate", "cot_key", "cot_ca"])
def test_absent_and_broken_files_are_named(key, tmp_path):
    broken = tmp_path / "100%.pem"
    broken.write_text("no certificate")
    files = {name: str(broken) for name in ("cot_certificate", "cot_key", "cot_ca")}
    absent = files | {key: str(tmp_path / "absent")}
    with pytest.raises(ConfigError, match=f"{key}: there is no file"):
        pytak_settings(ViewerConfig(cot="tls://tak.example", **absent))
    for ca, named in ((str(broken), "cot_ca"), ("", "cot_certificate")):
        with pytest.raises(ConfigError, match=rf"{named}: .*100%\.pem"):
            pytak_settings(ViewerConfig(cot="tls://tak.example", **files | {"cot_ca": ca}))


def locked(folder, *, pem):
    """A certificate with its key under a password, as PEM or PKCS#12."""
    signed, key = (path.read_bytes() for path in certificate(folder))
    own = serialization.load_pem_private_key(key, None)
    by = serialization.BestAvailableEncryption(b"secret")
    if pem:
        form = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8
        return signed + own.private_bytes(*form, by)
    return pkcs12.serialize_key_and_certificates(
        b"own", own, x509.load_pem_x509_certificate(signed), None, by
    )


@pytest.mark.parametrize("password", ["", "not this one"])
@pytest.mark.parametrize("ending", [".p12", ".pem", ".pfx"])
def test_a_key_that_does_not_open_is_refused_without_asking(tmp_path, ending, password):
    own = tmp_path / f"own{ending}"
    own.write_bytes(locked(tmp_path, pem=ending == ".pem"))
    with pytest.raises(
        ConfigError, match=rf"cot_certificate: .*own\{ending} .*and its cot_password "
    ):
        pytak_settings(
            ViewerConfig(cot="tls://h", cot_certificate=str(own), cot_password=password)
        )


WRONG_NAME = ssl.SSLCertVerificationError(1, "certificate verify failed: Hostname mismatch")
WRAPPED = SyntaxError("Bypass with PYTAK_TLS_DONT_VERIFY=1")
WRAPPED.__cause__ = WRONG_NAME


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ConnectionRefusedError(111, "refused"), "refused; is the TAK server running"),
        (TimeoutError("no answer"), "no answer; is this computer in the team's network"),
        (socket.gaierror(-2, "unknown"), "unknown; write its IP address in cot"),
        (WRAPPED, "Hostname mismatch.*; check cot_ca, cot_certificate, .*=THAT_NAME"),
        (OSError(71, "\x1b[31mdenied"), "denied; is this computer"),
        (RuntimeError("odd"), "odd$"),
    ],
)
def test_failures_are_one_line_with_what_to_do(error, words):
    text = words_of(error, "tls://tak.example:8089")
    assert re.search(words, text)
    assert text.startswith("tls://tak.example:8089: ")
    assert "PYTAK" not in text
    assert text.isprintable()
