"""Descriptions of mechanisms."""

CRANK = """\
name = "crank"
platform = "coupler"

[[joint]]
name = "turn"
lower_deg = -180
upper_deg = 180

[[frame]]
name = "crank"
path = [{ rz_deg = 0, joint = "turn" }]

[[frame]]
name = "knee"
on = "crank"
path = [{ x_mm = 100 }]

[[frame]]
name = "coupler"
on = "knee"
path = [{ rz_deg = 10, passive = true }]

[[frame]]
name = "end"
on = "coupler"
path = [{ x_mm = 300 }]

[[frame]]
name = "slider"
path = [{ x_mm = 380, passive = true }]

[[pin]]
name = "joint_of_both"
between = ["end", "slider"]
along = "xy"
"""
