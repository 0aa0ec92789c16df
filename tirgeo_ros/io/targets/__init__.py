"""Keep targets in a GeoPackage; write them in the formats of other programs."""
