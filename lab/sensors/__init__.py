"""Sensors: one module each for what it observes, its derivative, its columns, its simulation and its wording."""
