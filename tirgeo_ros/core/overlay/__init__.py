"""Draw the map, the click markers and the status text on the video."""
