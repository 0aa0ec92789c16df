"""Write layers for a GIS as a GeoPackage, with the styles in which QGIS shows them."""
