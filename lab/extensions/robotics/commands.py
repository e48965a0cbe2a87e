"""Register the commands ``lab kinematics``, ``lab workspace`` and ``lab trajectory``."""

from lab.commands.registry import Command

__all__ = ["KINEMATICS", "TRAJECTORY", "WORKSPACE"]

KINEMATICS = Command(
    "kinematics",
    "Place a robot: direct, inverse (all solutions) and differential models, matrices, singularities.",
    "lab.extensions.robotics.kinematics.options:KinematicsOptions",
    "lab.extensions.robotics.kinematics.run:solve_kinematics",
    writes_on_request=True,
)

WORKSPACE = Command(
    "workspace",
    "Measure what robots reach: volume, sections, voids, and in how many orientations.",
    "lab.extensions.robotics.workspace.options:WorkspaceOptions",
    "lab.extensions.robotics.workspace.run:workspace",
    writes_on_request=True,
    resumed=True,
)

TRAJECTORY = Command(
    "trajectory",
    "Move a robot through points: by its joints, or along lines and circles, within the limits of its joints.",
    "lab.extensions.robotics.trajectory.options:TrajectoryOptions",
    "lab.extensions.robotics.trajectory.run:trajectory",
    "trajectory-{robot}-{points}",
)
