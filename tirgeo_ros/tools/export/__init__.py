"""Do the work of `tirgeo export`: products of a flight for GIS, photogrammetry and players."""

#: The products by the names that ``--only`` takes; ``export.py`` makes them.
PRODUCTS = ("ortho", "mosaic", "stills", "vectors", "subtitles")
#: Those of them that need rasterio and the ground.
RASTERS = ("ortho", "mosaic")
