"""Experiments that only scripts run."""
