"""Do the work of `tirgeo export`: products of a flight for GIS, photogrammetry and players."""

#: The products by the names that ``--only`` takes; ``export.py`` makes them.
PRODUCTS = ("ortho", "mosaic", "stills", "vectors", "subtitles")
#: The products that need rasterio and the height of the ground.
RASTERS = ("ortho", "mosaic")
