"""Validate a fit and judge it, by named steps."""
