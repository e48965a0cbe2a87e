"""Make sentences from checks."""
