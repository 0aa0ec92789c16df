"""Keep targets in a GeoPackage; write and read them in the formats of others."""
