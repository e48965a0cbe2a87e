"""What the files of a calibrated arm say of a link besides its place: mass, and numbers in full."""

import numpy as np

from lab import frames
from lab.frames import Array
from lab.geometry.links import Link
from lab.study.robots import Robot

PLACEHOLDER_KG = 1e-3
_GYRATION_M = 0.05


def mass_and_centre(robot: Robot, link: Link) -> tuple[float, Array]:
    """Mass (kg) and its centre ``(3,)`` (m) in the frame of a moving link: the drawing's, or a placeholder."""
    assert link.joint is not None
    mass = 0.0 if robot.loads is None else float(robot.loads.mass_kg[link.joint])
    if robot.loads is None or mass <= 0:
        return PLACEHOLDER_KG, np.zeros(3)
    return mass, frames.transform(link.T_link_frame, robot.loads.centre_m[link.joint][None])[0]


def placeholder_inertia(mass_kg: float) -> float:
    """A moment of inertia (kg m^2) about every axis, for readers that refuse a moving link without one."""
    return mass_kg * _GYRATION_M**2


def masses_note(robot: Robot) -> str:
    """What of the masses is known, for a comment in the file."""
    if robot.loads is None:
        return "Masses and inertias are placeholders: the robot's are not known."
    return "Masses and their centres are the drawing's (1 g where it has none); inertias are placeholders."


def numbers(vector: Array) -> str:
    """Every digit of a vector, with spaces between; zero without a sign."""
    return " ".join(repr(float(value) + 0.0) for value in vector)
