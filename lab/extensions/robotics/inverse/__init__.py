"""Inverse kinematics in closed form."""
