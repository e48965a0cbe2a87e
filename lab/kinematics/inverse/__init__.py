"""Inverse kinematics: numeric, and all its branches."""
