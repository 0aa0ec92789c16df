"""Write each frame as an orthophoto, and all of them as one mosaic."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.io.files.whole_files import made_folder
from tirgeo_ros.tools.export.frames import ExportFrame
from tirgeo_ros.tools.export.rasters import RasterSetup, TiledRaster


class Orthophotos:
    """Write ``NNNNNN.tif`` into a folder for each frame, by its number; a Product."""

    def __init__(self, folder: Path, setup: RasterSetup) -> None:
        self._folder, self._setup = made_folder(folder, MapError), setup
        self._files = self._blank = 0

    def take(self, frame: ExportFrame) -> None:
        """Write the orthophoto of a frame; raise MapError."""
        raster = TiledRaster(self._setup, self._folder, hard=True)
        raster.add(frame)
        if not raster.size[0]:
            self._blank += 1
            return
        tags = {
            "TIFFTAG_DATETIME": f"{_utc(frame.pose.stamp_ns):%Y:%m:%d %H:%M:%S}",
            "EXPOSURE": _utc(frame.pose.stamp_ns).isoformat(),
            "PICTURE": str(frame.number),
            "STAMP_NS": str(frame.stamp_ns),
        }
        raster.write(self._folder / f"{frame.number:06d}.tif", tags)
        self._files += 1

    def finish(self) -> dict[str, object]:
        """Return the number of files, and of frames that see no ground."""
        return {"folder": str(self._folder), "files": self._files, "without_ground": self._blank}


class Mosaic:
    """Write ``mosaic.tif``; a Product."""

    def __init__(self, folder: Path, setup: RasterSetup) -> None:
        self._folder = folder
        self._raster = TiledRaster(setup, folder, hard=setup.options.nearest)
        self._first_ns = self._last_ns = 0

    def take(self, frame: ExportFrame) -> None:
        """Blend a frame in."""
        self._raster.add(frame)
        self._first_ns = self._first_ns or frame.pose.stamp_ns
        self._last_ns = frame.pose.stamp_ns

    def finish(self) -> dict[str, object]:
        """Write the file; raise MapError. Without a frame that sees ground there is none."""
        width, height = self._raster.size
        if not width:
            return {"width": 0, "height": 0}
        path = self._folder / "mosaic.tif"
        first, last = _utc(self._first_ns), _utc(self._last_ns)
        tags = {
            "TIFFTAG_DATETIME": f"{first:%Y:%m:%d %H:%M:%S}",
            "EXPOSURES": f"{first.isoformat()}/{last.isoformat()}",
        }
        self._raster.write(path, tags)
        return {"file": str(path), "width": width, "height": height}


def _utc(stamp_ns: int) -> datetime:
    return datetime.fromtimestamp(stamp_ns * 1e-9, timezone.utc)
