"""Gravity torques and rigid-body loads."""
