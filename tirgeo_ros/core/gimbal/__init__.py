"""Compose the camera's pose from the body's pose and the gimbal's angles."""
