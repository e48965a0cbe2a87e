"""What a point shows of an arm: the rank by counting, and by the singular values."""

import numpy as np

import lab

robot = lab.load_robot("irb120")
for targets in (("p1",), ("p1", "p2"), ("p1", "p2", "p3")):
    shown = robot.identifiability(targets=targets)
    count = 4 * 6 + 3 * len(targets)
    print(f"{len(targets)} targets: {shown.rank} of {len(shown.parameters)} identifiable, {count} by count")

# An error of a parameter that is not identifiable goes into the others. No point moves.
shown = robot.identifiability()
names = list(shown.parameters)
change = np.zeros(len(names))
change[names.index("link2.d")] = 1e-3
for name, share in shown.aliases["link2.d"].items():
    change[names.index(name)] = -1e-3 * share
joints = np.random.default_rng(0).uniform(-1, 1, (100, 6))
moved = robot.points(joints, robot.parameter_values() + change) - robot.points(joints)
print(
    f"link2.d = 1 mm goes into {', '.join(shown.aliases['link2.d'])}: points move by {1e3 * np.abs(moved).max():.0e} mm"
)
