"""Replay a recorded flight through the core: process, check and locate."""
