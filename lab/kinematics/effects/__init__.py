"""Non-geometric effects: compliance, gears, backlash, drift."""
