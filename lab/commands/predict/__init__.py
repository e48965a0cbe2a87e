"""`lab predict`."""
