"""`lab kinematics`."""
