"""`lab migrate`."""
