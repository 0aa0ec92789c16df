"""Draw the map, clicks and words on the video."""
