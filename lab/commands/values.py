"""Plain values that the results of several commands hold: numbers that JSON can say, statistics of errors."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Parameter
from lab.render.units import display_unit

__all__ = [
    "ErrorStatistics",
    "coefficient",
    "error_statistics",
    "exit_code_of",
    "joint_kind",
    "joint_limits",
    "joint_values",
    "limits_and_speed",
    "number",
    "per_person",
    "plain_numbers",
    "printed",
    "tidy",
    "with_joint",
]


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of lengths, mm, and of how many."""

    mean: float
    rms: float
    p95: float
    max: float
    count: int

    def to_dict(self) -> dict[str, float | int]:
        """The statistics by name."""
        return asdict(self)


def error_statistics(errors: Array) -> ErrorStatistics:
    """Statistics of errors in m; NaN is left out."""
    lengths = 1e3 * errors[np.isfinite(errors)]
    return ErrorStatistics(
        float(lengths.mean()),
        float(np.sqrt(np.mean(lengths**2))),
        float(np.percentile(lengths, 95)),
        float(lengths.max()),
        int(lengths.size),
    )


def exit_code_of(verdict: str, require: str | None) -> int:
    """Return the exit code of a verdict: 1 where it is bad, 3 where it is not the required one, else 0."""
    if verdict == "bad":
        return 1
    return 0 if require in (None, verdict) else 3


def joint_values(prismatic: Sequence[bool], joints: Array) -> Array:
    """Joint positions or rates ``(..., n)`` (rad, m of a slide) as a person reads them: degrees, mm of a slide."""
    return np.asarray(joints * np.where(prismatic, 1e3, 180 / np.pi))


def number(value: float) -> float | None:
    """The value, or None where it is not finite."""
    return float(value) if np.isfinite(value) else None


def plain_numbers(values: Array | float) -> Any:
    """An array as nested lists, a number as it is; None where not finite."""
    array = np.asarray(values, dtype=np.float64)
    return number(float(array)) if array.ndim == 0 else [plain_numbers(part) for part in array]


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
