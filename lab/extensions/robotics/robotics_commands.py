"""Register the commands ``lab kinematics``, ``lab workspace`` and ``lab trajectory``."""

from lab.options.command import Command, OptionGroup

__all__ = ["KINEMATICS", "TRAJECTORY", "WORKSPACE"]

_KINEMATICS_GROUPS = (
    OptionGroup("joints and poses", ("joints", "pose", "file", "orientation"), ("coordinates", "tool_mm", "of")),
    OptionGroup("velocities", ("rates", "twist"), ("frame", "inverse_jacobian")),
    OptionGroup("models", ("matrices", "symbolic"), ("between", "symbolic_inverse")),
    OptionGroup(
        "a rotation, without a robot",
        ("angles", "axis", "angle", "quaternion"),
        ("matrix", "order", "fixed", "radians"),
    ),
)
_TRAJECTORY_GROUPS = (
    OptionGroup("robot and cell", ("robot", "run", "cell"), ("tool_mm", "payload_kg", "load", "no_check")),
    OptionGroup("joint motion", ("law", "speeds", "accelerations"), ("blend_mm", "blend_deg", "step_ms")),
    OptionGroup("lines and circles", ("feed_mm_s", "feed_mm_s2"), ("turn_deg_s", "orientation")),
    OptionGroup("program", ("controller",), ("force", "accept_edited")),
)

KINEMATICS = Command(
    "kinematics",
    "Place a robot: direct, inverse (all solutions) and differential models, singularities. Or convert a rotation.",
    "lab.extensions.robotics.kinematics.kinematics_options:KinematicsOptions",
    "lab.extensions.robotics.kinematics.solve_kinematics:kinematics_of",
    writes_on_request=True,
    examples=("irb120 --joints 0,30,-40,0,60,0 --matrices", "--angles 30,90,10"),
    groups=_KINEMATICS_GROUPS,
    group="learn",
)

WORKSPACE = Command(
    "workspace",
    "Measure what robots reach: volume, sections, voids, and in how many orientations.",
    "lab.extensions.robotics.workspace.workspace_options:WorkspaceOptions",
    "lab.extensions.robotics.workspace.measure_workspace:workspace",
    writes_on_request=True,
    examples=("irb120", "carriers --out runs/carriers"),
    group="learn",
)

TRAJECTORY = Command(
    "trajectory",
    "Move a robot through points: by its joints, or along lines and circles, within the limits of its joints.",
    "lab.extensions.robotics.trajectory.trajectory_options:TrajectoryOptions",
    "lab.extensions.robotics.trajectory.plan_trajectory:trajectory",
    "trajectory-{robot}-{points}",
    examples=("points.csv --robot irb120", "points.csv --run runs/day --payload-kg 3"),
    groups=_TRAJECTORY_GROUPS,
    group="learn",
)
