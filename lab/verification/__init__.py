"""Test whether a calibrated arm is unchanged."""
