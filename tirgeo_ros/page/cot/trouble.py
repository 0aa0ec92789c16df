"""Say in plain words why Cursor-on-Target does not get through, and what to do."""

from __future__ import annotations

import errno
import socket
import ssl

from tirgeo_ros.core.types.errors import shown

_NO_WAY = {errno.ENETUNREACH, errno.ENETDOWN, errno.EHOSTUNREACH, errno.EADDRNOTAVAIL}
_IN_NETWORK = "is this computer in the team's network?"
_CLOCK = "is the clock of this computer right?"
_OUT_OF_DATE = ("expired", "not yet valid")
_WORDS = {
    socket.gaierror: "no computer of this name is known here; write its IP address in cot",
    PermissionError: "this computer may not send there; to all in a network: udp://239.2.3.1:6969",
    ConnectionRefusedError: "nobody answers; is the TAK server running, is the port right?",
    ConnectionError: "the server ended the connection; is it running, is it tcp or tls there?",
    TimeoutError: f"no answer; {_IN_NETWORK}",
}


def words_of(error: BaseException, endpoint: str) -> str:
    """Return one line for the operator: what is wrong, and with which parameter."""
    # PyTAK wraps a certificate that it distrusts.
    cause = error.__cause__ if isinstance(error.__cause__, ssl.SSLError) else error
    return f"{endpoint}: {_words(cause)}"


def _words(error: BaseException) -> str:
    if isinstance(error, ssl.SSLCertVerificationError):
        return _distrusted(error)
    if isinstance(error, ssl.SSLError):
        return _refused(error)
    if isinstance(error, OSError) and error.errno in _NO_WAY:
        return f"no way there; {_IN_NETWORK}"
    known = (words for kind, words in _WORDS.items() if isinstance(error, kind))
    return next(known, shown(error, 200))


def _distrusted(error: ssl.SSLCertVerificationError) -> str:
    if "mismatch" in error.verify_message:
        return (
            "the server's certificate has another name; write in cot the name that it has, or "
            "add ?name=THAT_NAME"
        )
    if any(words in error.verify_message for words in _OUT_OF_DATE):
        return f"the server's certificate: {error.verify_message}; {_CLOCK}"
    return (
        f"the server's certificate is not trusted ({error.verify_message}); cot_ca must be that "
        "of the authority that signed it"
    )


def _refused(error: ssl.SSLError) -> str:
    reason = (getattr(error, "reason", None) or str(error)).lower().replace("_", " ")
    if "expired" in reason:
        return f"cot_certificate has expired; its server's owner makes a new one; {_CLOCK}"
    if "alert" in reason or "certificate" in reason:
        return (
            f"the server refuses cot_certificate ({reason}); it must be one that the server's own "
            "authority made"
        )
    return f"no TLS there ({reason}); is the port right?"
