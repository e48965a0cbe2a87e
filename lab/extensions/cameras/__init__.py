"""Cameras as a sensor: boards in pictures, their files, closed forms, observation, simulation and detection."""
