"""Do the work of `tirgeo export`: products of a flight for GIS, photogrammetry and players."""
