"""Encode targets, aircraft and their cameras as Cursor-on-Target events."""
