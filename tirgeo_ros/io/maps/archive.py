"""Read the members of a zip, of a bounded size; any damage raises ValueError."""

from __future__ import annotations

import io
import zipfile
import zlib

MAGIC = b"PK\x03\x04"
#: A map of a million vertices has a tenth of it; text of coordinates shrinks to a fifth or so.
_LARGEST_BYTES = 1 << 28
_MOST_SHRUNK = 100
_SMALL_BYTES = 1 << 20  # a smaller member may have any compression ratio


class Archive:
    """Read the members of a zip file. Raises ValueError if it is none."""

    def __init__(self, content: bytes) -> None:
        try:
            self._zip = zipfile.ZipFile(io.BytesIO(content))
        except (zipfile.BadZipFile, ValueError, OSError, NotImplementedError) as error:
            raise ValueError(f"a damaged zip: {error}") from None

    def names(self, suffix: str) -> list[str]:
        """Return the members with a suffix, in any case, the least nested first."""
        files = [n for n in self._zip.namelist() if not n.startswith("__MACOSX/")]
        return sorted(
            (name for name in files if name.lower().endswith(suffix)),
            key=lambda name: (name.count("/"), name),
        )

    def read(self, name: str) -> bytes:
        """Return a member's content.

        Raises ValueError if it is damaged, encrypted or too large.
        """
        info = self._zip.getinfo(name)
        shrunk = info.file_size > _SMALL_BYTES + _MOST_SHRUNK * info.compress_size
        if shrunk or info.file_size > _LARGEST_BYTES:
            raise ValueError(f"{name} in the zip would unpack to {info.file_size} bytes")
        try:
            with self._zip.open(info) as member:
                return member.read(info.file_size)
        except RuntimeError:
            raise ValueError(f"{name} in the zip is locked with a password") from None
        except (zipfile.BadZipFile, zlib.error, EOFError, OSError, NotImplementedError) as error:
            raise ValueError(f"{name} in the zip is damaged: {error}") from None
