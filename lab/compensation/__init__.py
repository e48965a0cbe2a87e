"""Correct targets for a calibrated arm."""
