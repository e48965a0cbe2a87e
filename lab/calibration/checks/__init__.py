"""Checks of measurements and of a fit: numbers, no sentences."""
