"""The identified arm, and the error to be expected where it works."""
