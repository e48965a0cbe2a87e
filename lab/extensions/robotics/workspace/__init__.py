"""Compute a robot's workspace: reach, volume, boundary, voids, and share of orientations."""
