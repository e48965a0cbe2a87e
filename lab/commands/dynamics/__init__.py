"""`lab dynamics`."""
