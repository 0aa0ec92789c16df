"""Read vector maps: GeoJSON, GeoPackage, Shapefile, KML, KMZ and whatever else GDAL reads.

A third coordinate is taken as the height above the WGS84 ellipsoid in metres. If the format or its
coordinate reference system says that heights are of another kind, they are left out.
"""

from tirgeo_ros.io.maps.layers import map_files
from tirgeo_ros.io.maps.map_process import load_layers

__all__ = ["load_layers", "map_files"]
