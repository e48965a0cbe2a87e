"""Velocity profiles and joint trajectories."""
