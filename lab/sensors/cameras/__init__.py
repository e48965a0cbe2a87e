"""Cameras and boards: geometry, files, closed forms, the observation, its simulation, pictures and detection."""
