"""What makes a real arm stand elsewhere than its geometry and its readings say, as one value with physical units.

``TrueRobot.points`` composes what is the same at every visit, ``track`` adds what is not. An effect is off at zero.
A slide's entries are in m where a hinge's are in rad, and in N where those are in Nm. Rates are per hour (h).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.measurements import SESSION
from lab.core.se3 import Array
from lab.kinematics.effects.groups import HOUR_S

BUMPED = SESSION + "2"  # the condition of the rows after a bump
HARMONICS = ("sin1", "cos1", "sin2", "cos2")
NOTHING_SET: Mapping[str, Array] = MappingProxyType({})
_AXES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True)
class Effects:
    """The effects of one arm with n joints; ``Effects.none(n)`` has none.

    Attributes:
        compliance_rad_per_nm: ``(n,)``; a joint gives way by this times the weight's torque about it.
        gear: ``(n,)``; the joint moves by 1 + gear where its reading says 1.
        harmonics_rad: ``(n, 4)``, runout of encoder or gear: coefficients of sin q, cos q, sin 2q, cos 2q of the
            joint's own reading q. Zero for a slide.
        coupling: ``(n, n)``; joint i moves by coupling[i, j] where joint j's reading says 1. Zero diagonal.
        backlash_rad: ``(n,)`` full widths; the joint stands half of it above its reading at approach +1, below at -1.
        repeatability_rad: ``(n,)`` standard deviation of a joint's stand from one visit to the next.
        lag: share of the last move that a reading still lacks when it is taken, in [0, 1).
        bending_rad_per_nm: ``(n,)``; the link that carries jointed body i (the stand of the arm for i = 0) bends
            where that body sits, by this times the moment there of the weight of all that is carried. Zero for a
            slide.
        drift_per_h: ``(6,)`` motion of the tracker in its own frame in an hour, m and rad, steady.
        bump: ``(6,)`` motion of the tracker in its own frame, m and rad, all at once in the middle of a campaign.
        growth_per_h: how much all lengths of the arm grow about its foot in an hour, relative.
        bad_share: how likely a pose's reading is bad: all of its points displaced alike.
        bad_range_m: least and largest displacement of a bad reading; log-uniform between, in any direction.
        payload_at_m: ``(3,)``, payloads' centre of mass in the last frame.
    """

    compliance_rad_per_nm: Array
    gear: Array
    harmonics_rad: Array
    coupling: Array
    backlash_rad: Array
    repeatability_rad: Array
    lag: float
    bending_rad_per_nm: Array
    drift_per_h: Array
    bump: Array
    growth_per_h: float
    bad_share: float
    bad_range_m: tuple[float, float]
    payload_at_m: Array

    def __post_init__(self) -> None:
        n = len(self.gear)
        vectors = ("compliance_rad_per_nm", "gear", "backlash_rad", "repeatability_rad", "bending_rad_per_nm")
        shapes = dict.fromkeys(vectors, (n,)) | {
            "harmonics_rad": (n, 4),
            "coupling": (n, n),
            "drift_per_h": (6,),
            "bump": (6,),
            "payload_at_m": (3,),
        }
        for name, shape in shapes.items():
            value = getattr(self, name)
            if value.shape != shape or not np.isfinite(value).all():
                raise LabError(f"effects of {n} joints: {name} is to be finite numbers of shape {shape}")
        if np.diag(self.coupling).any():
            raise LabError("effects: coupling of a joint with itself is its gear error; give that instead")
        for name in ("compliance_rad_per_nm", "backlash_rad", "repeatability_rad", "bending_rad_per_nm"):
            if (getattr(self, name) < 0).any():
                raise LabError(f"effects: {name} has a negative entry; give zero or more")
        if not 0 <= self.lag < 1 or not 0 <= self.bad_share <= 1 or not np.isfinite(self.growth_per_h):
            raise LabError("effects: lag is to be in [0, 1), bad_share in [0, 1], growth_per_h finite")
        if not 0 < self.bad_range_m[0] <= self.bad_range_m[1] < np.inf:
            raise LabError(f"effects: bad_range_m {self.bad_range_m} is to be a least and a largest length above zero")

    @classmethod
    def none(cls, joints: int) -> "Effects":
        """No effect at all on an arm of so many joints."""
        zero = np.zeros(joints)
        return cls(
            compliance_rad_per_nm=zero,
            gear=zero,
            harmonics_rad=np.zeros((joints, 4)),
            coupling=np.zeros((joints, joints)),
            backlash_rad=zero,
            repeatability_rad=zero,
            lag=0.0,
            bending_rad_per_nm=zero,
            drift_per_h=np.zeros(6),
            bump=np.zeros(6),
            growth_per_h=0.0,
            bad_share=0.0,
            bad_range_m=(1e-3, 1e-3),
            payload_at_m=np.zeros(3),
        )

    @property
    def yielding(self) -> bool:
        """Whether the arm gives way under its load."""
        return bool(self.compliance_rad_per_nm.any() or self.bending_rad_per_nm.any())

    def columns(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        """Names of the conditions that matter to these effects."""
        load = ("payload_kg",) if self.yielding else ()
        approach = [f"approach_{name}" for name, width in zip(joint_names, self.backlash_rad, strict=True) if width]
        time = ("time_s",) if self.drift_per_h.any() or self.growth_per_h else ()
        return (*load, *approach, *time, *((BUMPED,) if self.bump.any() else ()))

    def driven(self, joints: Array, approach: Array) -> Array:
        """Where the motors put the joints without a load: ``(m, n)`` from readings and approaches ``(m, n)``."""
        off: Array = self.gear * joints + joints @ self.coupling.T + self.backlash_rad / 2 * approach
        if self.harmonics_rad.any():
            sin1, cos1, sin2, cos2 = self.harmonics_rad.T
            off += sin1 * np.sin(joints) + cos1 * np.cos(joints) + sin2 * np.sin(2 * joints) + cos2 * np.cos(2 * joints)
        return joints + off

    def shown(self, joints: Array) -> Array:
        """The readings that lag behind where they would settle, ``(m, n)`` in the order visited; the first is there."""
        shown: Array = joints - self.lag * np.diff(joints, axis=0, prepend=joints[:1])
        return shown

    def grown(self, points: Array, foot: Array, time_s: Array) -> Array:
        """Points of the arm ``(m, k, 3)`` after it grew about its foot ``(3,)``, same frame, at times ``(m,)``."""
        if not self.growth_per_h:
            return points
        scale = 1 + self.growth_per_h * time_s / HOUR_S
        grown: Array = foot + scale[:, None, None] * (points - foot)
        return grown

    def drifted(self, points: Array, time_s: Array) -> Array:
        """Points ``(m, k, 3)`` of the tracker's first frame in its frame at times ``(m,)``."""
        if not self.drift_per_h.any():
            return points
        return _seen_after(points, self.drift_per_h * (time_s / HOUR_S)[:, None])

    def bumped(self, points: Array, after: Array) -> Array:
        """Points ``(m, k, 3)`` as the tracker sees them, where ``after`` ``(m,)`` is 1 with its new stand."""
        return _seen_after(points, self.bump * after[:, None]) if self.bump.any() else points

    def scatter(self, poses: int, rng: np.random.Generator) -> Array:
        """How far the joints stand off by chance, ``(poses, n)``."""
        drawn: Array = self.repeatability_rad * rng.standard_normal((poses, len(self.gear)))
        return drawn

    def displacements(self, poses: int, rng: np.random.Generator) -> tuple[Array, NDArray[np.bool_]]:
        """What bad readings add to all points of a pose, ``(poses, 3)`` m, and which poses are bad, ``(poses,)``."""
        chance, size, height, turn = rng.random((poses, 4)).T
        bad = chance < self.bad_share
        least, largest = np.log(self.bad_range_m)
        z, radius = 2 * height - 1, 2 * np.sqrt(height * (1 - height))
        direction = np.stack([radius * np.cos(2 * np.pi * turn), radius * np.sin(2 * np.pi * turn), z], axis=1)
        return (bad * np.exp(least + (largest - least) * size))[:, None] * direction, bad


def _seen_after(points: Array, moved: Array) -> Array:
    """Points ``(m, k, 3)`` in a frame that has moved by ``(m, 6)``, m and rad, in itself."""
    Ts_first_now = se3.pose(se3.exp(moved[:, 3:]), moved[:, :3])
    return se3.transform(se3.inverse(Ts_first_now), points)


def condition(conditions: Mapping[str, Array], name: str, poses: int) -> Array:
    """One column ``(poses,)`` of the conditions; zero, that is no load, no approach and time zero, where missing.

    Raises:
        LabError: the column has another length, or a value that is not finite.
    """
    column = conditions.get(name)
    if column is None:
        return np.zeros(poses)
    if column.shape != (poses,) or not np.isfinite(column).all():
        raise LabError(f"condition {name}: give one finite number for each of {poses} poses")
    return column


def true_parameters(effects: Effects) -> dict[str, float]:
    """What an identifier should find, by its parameters' names; joints count from 1.

    A joint's compliance has its carrier's bending in it, which about the joint's axis is the same to first order.
    ``drift.*`` is how what is measured moves in an hour, ``p' = exp(w t) (p + v t)``: the tracker's motion
    reversed. Growth about the foot shifts and stretches it as well, so while it is on only the turns are in.
    """
    truth: dict[str, float] = {}
    compliance = effects.compliance_rad_per_nm + effects.bending_rad_per_nm
    for i in range(len(effects.gear)):
        joint = f"joint{i + 1}"
        truth |= {f"{joint}.compliance": float(compliance[i]), f"{joint}.gear": float(effects.gear[i])}
        truth |= {f"{joint}.{name}": float(effects.harmonics_rad[i, k]) for k, name in enumerate(HARMONICS)}
        others = (j for j in range(len(effects.gear)) if j != i)
        truth |= {f"{joint}.coupling{j + 1}": float(effects.coupling[i, j]) for j in others}
        truth[f"{joint}.backlash"] = float(effects.backlash_rad[i])
    drift = dict(zip(_AXES, -effects.drift_per_h, strict=True)) | {"scale": 0.0}
    known = _AXES[3:] if effects.growth_per_h else drift
    truth |= {f"session.2.{axis}": float(value) for axis, value in zip(_AXES, -effects.bump, strict=True)}
    return truth | {f"drift.{axis}": float(drift[axis]) for axis in known}
