"""Mallem 2011: geometric and kinematic models of serial and parallel robots, and trajectories."""
