"""Certificate of a calibration: an uncertainty budget, ISO 9283, a statement of conformity."""
