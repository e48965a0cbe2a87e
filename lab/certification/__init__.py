"""What a calibration is worth, as a certificate says it: an uncertainty budget, ISO 9283, a statement of conformity."""
