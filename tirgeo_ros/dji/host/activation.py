"""Ask the aircraft for its version and activate an application.

Without an activated application the aircraft only broadcasts.
"""

from __future__ import annotations

from tirgeo_ros.dji.host.requests import Dialogue, NoAnswerError, Pause, ask, ask_code
from tirgeo_ros.dji.protocol.commands import (
    NOT_ACTIVATED,
    Activate,
    GetVersion,
    VersionAck,
    decode_version_ack,
    explain,
)

_DONE, _NEW_DEVICE = 0, 3
#: At a new device's first try DJI GO fetches the permission from DJI; the second try finds it.
_SECOND_TRY_S = 1.0


class Activation:
    """Activate the application ``app_id``; with 0 only ask whether one is activated."""

    def __init__(self, app_id: int) -> None:
        self._app_id = app_id
        self.version: VersionAck | None = None
        self.is_done = False

    def forget(self) -> None:
        """Forget the aircraft: it may be another one or may have been switched off."""
        self.version, self.is_done = None, False

    def run(self) -> Dialogue[str]:
        """Activate; return "" or the reason why it is not activated.

        Raises NoAnswerError if the aircraft does not answer.
        """
        request = GetVersion()
        self.version = decode_version_ack((yield from ask(request)))
        if self.version is None:
            raise NoAnswerError(request)
        if not self._app_id:
            self.is_done = self.version.code != NOT_ACTIVATED
            return "" if self.is_done else f"it is {explain(request, self.version.code)}"
        activate = Activate(self._app_id, self.version.firmware or (0, 0, 0, 0))
        code = yield from ask_code(activate)
        if code == _NEW_DEVICE:
            yield Pause(_SECOND_TRY_S)
            code = yield from ask_code(activate)
        self.is_done = code == _DONE
        return "" if self.is_done else f"activation failed, {explain(activate, code)}"

    @property
    def aircraft(self) -> str:
        """Return hardware and firmware in words; "" as long as they are not known."""
        if self.version is None:
            return ""
        if self.version.firmware is None:
            return "aircraft of unknown firmware"
        return f"{self.version.hardware} with firmware {'.'.join(map(str, self.version.firmware))}"
