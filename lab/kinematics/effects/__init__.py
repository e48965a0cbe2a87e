"""What is not geometry: compliance, gears, backlash, drift."""
