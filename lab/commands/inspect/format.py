"""How numbers of a nominal model are told: as plain values and in print."""

from typing import Any

import numpy as np

from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Parameter
from lab.render.units import display_unit

__all__ = [
    "coefficient",
    "joint_kind",
    "joint_limits",
    "limits_and_speed",
    "per_person",
    "printed",
    "tidy",
    "with_joint",
]


def tidy(value: float) -> float:
    """Without the last digits of a unit's conversion, and without minus zero."""
    return round(float(value), 9) + 0.0


def printed(value: float) -> str:
    """As numbers of a nominal model are printed: whole numbers without a point, a true minus sign."""
    return f"{value:.6g}".replace("-", "−")


def coefficient(parameter: Parameter, other: Parameter, value: float) -> str:
    """What an error of one parameter looks like in another, in the units that a person reads."""
    (per, unit, _), (factor, into, _) = display_unit(parameter), display_unit(other)
    number = f"{value * factor / per:+.4g}".replace("-", "−")
    return f"{other.name} ({number})" if unit == into else f"{other.name} ({number} {into} per {unit})"


def per_person(parameter: Parameter, value: float) -> str:
    """A change of a parameter in the unit that a person reads."""
    factor, unit, _ = display_unit(parameter)
    return f"{factor * value:+.3g} {unit}".replace("-", "−")


def joint_kind(joints: JointSpec, i: int) -> dict[str, Any]:
    """A joint's name, kind and sign."""
    kind = "prismatic" if joints.prismatic[i] else "revolute"
    return {"name": joints.joint_names[i], "type": kind, "sign": int(joints.sign[i])}


def joint_limits(joints: JointSpec, i: int) -> dict[str, Any]:
    """A joint's limits and largest speed, mm or degrees."""
    unit, scale = ("mm", 1e3) if joints.prismatic[i] else ("deg", 180 / np.pi)
    return {
        f"lower_{unit}": tidy(joints.lower[i] * scale),
        f"upper_{unit}": tidy(joints.upper[i] * scale),
        f"speed_{unit}_per_s": tidy(joints.speed[i] * scale) if np.isfinite(joints.speed[i]) else None,
    }


def limits_and_speed(joint: dict[str, Any]) -> tuple[str, str]:
    """A joint's limits and largest speed, printed."""
    unit = "mm" if joint["type"] == "prismatic" else "deg"
    speed = joint[f"speed_{unit}_per_s"]
    limits = f"{printed(joint[f'lower_{unit}'])} … {printed(joint[f'upper_{unit}'])}"
    return limits, "–" if speed is None else printed(speed)


def with_joint(joint: str, sign: int, offset: float) -> str:
    """A value to which a joint's position adds, by its sign: the joint and the offset."""
    position = joint if sign > 0 else f"−{joint}"
    return position if offset == 0 else f"{position} {'−' if offset < 0 else '+'} {printed(abs(offset))}"
