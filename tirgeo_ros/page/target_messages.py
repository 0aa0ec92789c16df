"""Write targets as the page gets them: coordinates in all forms, ellipse and its outline."""

from __future__ import annotations

import functools
import math
from typing import Any

from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.io.coordinates.written import written
from tirgeo_ros.io.targets.store import TargetStore

_CORNERS = 36


def targets_message(store: TargetStore, undulation_m: float) -> dict[str, Any]:
    """Return the message ``targets``: the whole list, without deleted ones."""
    revision, open_ = store.revision, store.alternatives()
    return {
        "type": "targets",
        "revision": revision,
        "targets": [
            target_fields(target, undulation_m) | {"alternatives": open_[target.id]}
            for target in store.all()
        ],
    }


@functools.lru_cache(maxsize=4096)  # one target changes, and the others are sent again
def target_fields(target: Target, undulation_m: float) -> dict[str, Any]:
    """Return a target as the page gets it; without ``undulation_m`` no height above sea level."""
    place = target.place
    ellipse = place.ellipse
    texts = written(place.latitude_deg, place.longitude_deg)
    known = math.isfinite(undulation_m)
    return {
        "id": target.id,
        "number": target.number,
        "name": target.name,
        "kind": target.kind,
        "note": target.note,
        "aircraft": target.aircraft,
        "created_ns": str(target.created_ns),
        "changed_ns": str(target.changed_ns),
        "latitude_deg": place.latitude_deg,
        "longitude_deg": place.longitude_deg,
        "height_m": place.height_m,
        "height_msl_m": place.height_m - undulation_m if known else None,
        "coordinates": {
            "decimal": texts.decimal,
            "dms": texts.dms,
            "mgrs": texts.mgrs,
            "utm": texts.utm,
        },
        "ellipse": {
            "major_m": ellipse.major_m,
            "minor_m": ellipse.minor_m,
            "azimuth_deg": math.degrees(ellipse.azimuth_rad),
        },
        "outline": [[round(x, 8) for x in corner] for corner in place.outline(_CORNERS)],
        "clicks": len(target.fixings),
        "clicks_agree": target.clicks_agree,
    }
