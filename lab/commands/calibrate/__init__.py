"""`lab calibrate` and `lab identify`: one campaign, on a virtual or a measured arm."""
