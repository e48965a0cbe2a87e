"""Simulation in MuJoCo: a true robot with errors, measured with noise."""
