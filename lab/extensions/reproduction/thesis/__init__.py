"""Mahdadi and Bouafia 2020: observability indices for the calibration of an IRB 120."""
