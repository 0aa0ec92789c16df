"""Write videos: files that every player shows, and streams with metadata for video systems."""
