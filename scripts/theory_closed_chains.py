"""A closed chain: what its measured joints show of its parameters."""

import lab

for name in ("rpr2", "rpr3", "delta"):
    robot = lab.load_robot(name)
    shown = robot.identifiability()
    print(
        f"{name}: {len(robot.inputs())} measured joints, {len(shown.parameters)} parameters, {shown.rank} identifiable"
    )
