"""The seam: all that identification, observability and assessment ever need of an arm."""

from typing import Protocol

import numpy as np

from lab.frames import Array

_UNITS = dict.fromkeys(("x", "y", "z", "d", "a", "offset"), "m")
_UNITS |= dict.fromkeys(("rx", "ry", "rz", "theta", "alpha", "beta"), "rad")


def unit_of(parameter: str, slide: bool = False) -> str:
    """The SI unit of a parameter, by its name: m, rad, or that of an effect's parameter (of a slide's)."""
    group, _, last = parameter.rpartition(".")
    unit = _UNITS.get(last)
    if group == "drift":
        return f"{unit}/h" if unit else "1/h"
    if unit is not None:
        return unit
    kind = last.rstrip("0123456789")
    if slide and kind in ("compliance", "backlash"):
        return {"compliance": "m/N", "backlash": "m"}[kind]
    return {"compliance": "rad/Nm", "sin": "rad", "cos": "rad", "backlash": "rad", "mass": "kg"}.get(kind, "")


def is_angle(parameter: str) -> bool:
    """Whether a parameter is in rad, by its name."""
    return unit_of(parameter) == "rad"


class Model(Protocol):
    """Joints and parameters in, positions and their derivatives out.

    A chain is one (``serial.SerialArm``); a chain with joint effects or a closed chain can be
    another, and nothing above asks which. Parameters named ``base.*`` (place and rotation
    vector in the tracker's frame) and ``tool.*`` (a target's place in the last frame) are
    located with no initial guess; all others start at the drawing's values.
    """

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters, in the order of every ``values`` (m, rad)."""

    @property
    def targets(self) -> tuple[str, ...]:
        """The measured points."""

    @property
    def conditions(self) -> tuple[str, ...]:
        """What it asks of a pose beside the readings: columns of ``Measurements.conditions``, after the joints."""

    def observe(self, settings: Array, values: Array) -> tuple[Array, Array]:
        """Observations ``(n, k, d)`` at settings ``(n, joints + conditions)``; derivatives ``(n, k, d, p)``.

        Of points they are positions (m, in the tracker's frame), d = 3.
        """

    def points(self, settings: Array, values: Array) -> Array:
        """The observations alone."""

    def preferred(self) -> tuple[int, ...]:
        """All parameters in the order in which they are kept if they can be told apart."""

    def structural(self, values: Array) -> Array:
        """``values`` where the rank is decided: exactly as the drawing means them."""

    def structure_joints(self, count: int, rng: np.random.Generator) -> Array:
        """Settings ``(count, joints + conditions)`` spread over the limits, at which the rank is decided."""
