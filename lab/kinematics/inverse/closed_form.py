"""Closed forms of inverse kinematics: their protocol, and the one that an extension registers for an arm."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.extension_points import load_all
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = [
    "EXACT",
    "ClosedForm",
    "Determinant",
    "Factor",
    "Solutions",
    "Term",
    "ZeroAxes",
    "closed_form_of",
    "determinant",
    "in_plane",
    "meeting_point",
    "plane_across",
    "real_part",
]

_NONE = 1e-12  # m: smaller coefficients are zero


@dataclass(frozen=True)
class Term:
    """A coefficient times the sine or cosine of a sum of joint positions, times positions of slides.

    Attributes:
        coefficient: m, or without a unit beside a slide.
        function: of the angle; empty without one.
        angle: factor of each joint position in the angle: +1, -1, or a multiple.
        slides: joints whose positions are factors.
    """

    coefficient: float
    function: Literal["", "sin", "cos"] = ""
    angle: tuple[tuple[int, float], ...] = ()
    slides: tuple[int, ...] = ()

    def at(self, joints: Array) -> Array:
        """Return values ``(...)`` at joint positions ``(..., n)``."""
        angle = sum((sign * joints[..., joint] for joint, sign in self.angle), start=np.zeros(joints.shape[:-1]))
        turned = np.sin(angle) if self.function == "sin" else np.cos(angle)  # cos 0 where there is no function
        return np.asarray(self.coefficient * turned * joints[..., list(self.slides)].prod(axis=-1))

    def text(self, names: tuple[str, ...]) -> str:
        """Return the formula without the coefficient's sign; empty for 1."""
        factors = [] if abs(self.size - 1) < _NONE and (self.function or self.slides) else [_number(self.size)]
        factors += [names[joint] for joint in self.slides]
        return " ".join([*factors, self._function_text(names)] if self.function else factors)

    def _function_text(self, names: tuple[str, ...]) -> str:
        """Return the function of the angle, like ``cos(q2 + q3)``; without brackets of a single joint's."""
        parts = [("+" if sign > 0 else "-", "" if abs(sign) == 1 else f"{abs(sign):g} * ", names[joint])
                 for joint, sign in self.angle]  # fmt: skip
        angle = "".join(map("".join, parts)).removeprefix("+")
        alone = len(self.angle) == 1 and abs(self.angle[0][1]) == 1
        return f"{self.function} {angle}" if alone else f"{self.function}({angle})"

    @property
    def size(self) -> float:
        """Magnitude of the coefficient."""
        return abs(self.coefficient)


@dataclass(frozen=True)
class Factor:
    """A sum of terms that is zero at one kind of singularity.

    Attributes:
        name: of the singularity.
        names: the joints'.
    """

    name: str
    terms: tuple[Term, ...]
    names: tuple[str, ...]

    def at(self, joints: Array) -> Array:
        """Return values ``(...)`` at joint positions ``(..., n)``: m, or the sine of an angle."""
        return sum((term.at(joints) for term in self.terms), start=np.zeros(joints.shape[:-1]))

    @property
    def text(self) -> str:
        """Formula, like ``0.302 cos q3 + 0.07 sin q3``."""
        text = ""
        for term in self.terms:
            sign = ("" if term.coefficient > 0 else "-") if not text else (" + " if term.coefficient > 0 else " - ")
            text += sign + term.text(self.names)
        return text or "0"


@dataclass(frozen=True)
class Determinant:
    """A product of a sign, lengths (m) and factors."""

    sign: float
    lengths: tuple[float, ...]
    factors: tuple[Factor, ...]

    def at(self, joints: Array) -> Array:
        """Return values ``(...)`` at joint positions ``(..., n)``."""
        constant = self.sign * np.prod(self.lengths)
        return np.asarray(constant * np.prod([factor.at(joints) for factor in self.factors], axis=0))

    @property
    def text(self) -> str:
        """Formula, like ``-0.27 (0.302 cos q3 + 0.07 sin q3) sin q5``."""
        factors = [f"({factor.text})" if len(factor.terms) > 1 else factor.text for factor in self.factors]
        words = [part for part in (" * ".join(_number(length) for length in self.lengths), *factors) if part]
        return ("-" if self.sign < 0 else "") + " ".join(words)


def determinant(
    names: tuple[str, ...], sign: float, lengths: Iterable[float], factors: Iterable[tuple[str, Iterable[Term]]]
) -> Determinant:
    """Return the product without zero terms, with positive first terms, and numbers in front."""
    numbers, tidied = list(lengths), []
    for name, terms in factors:
        retained = tuple(term for term in terms if term.size > _NONE)
        if retained:
            scale = np.sign(retained[0].coefficient) * (retained[0].size if len(retained) == 1 else 1.0)
            sign *= np.sign(scale)
            numbers.append(abs(float(scale)))
            retained = tuple(Term(t.coefficient / scale, t.function, t.angle, t.slides) for t in retained)
        tidied.append(Factor(name, retained, names))
    return Determinant(sign, tuple(length for length in numbers if abs(length - 1) > _NONE), tuple(tidied))


def real_part(number: complex, turning: Iterable[tuple[int, float]], slides: tuple[int, ...] = ()) -> list[Term]:
    """Return the terms of Re(number exp(i angle)), for a signed sum of joint positions."""
    angle = tuple(turning)
    if not angle:
        return [Term(number.real, slides=slides)]
    first = angle[0][1]  # the angle's first joint position counts positive, so that texts are alike
    angle = tuple((joint, first * sign) for joint, sign in angle)
    return [Term(-first * number.imag, "sin", angle, slides), Term(number.real, "cos", angle, slides)]


def _number(value: float) -> str:
    return f"{value:.6g}"


EXACT = 1e-9  # m or rad: tolerance of a nominal model's shape


@dataclass(frozen=True)
class Solutions:
    """IK solutions of some poses.

    Attributes:
        joints: ``(n, k, joints)`` joint positions, a hinge's between -pi and pi.
        gap_m: ``(n, k)`` distance of the target out of reach; the joints are then nearest, but for a bend of the elbow
            (``BEND`` in ``first_joints``).
        tilt_rad: ``(n, k)`` rotation error of arms with fewer than six joints, at the nearest rotation.
        free: ``(n, k, joints)``, joints that are free at a singularity.
    """

    joints: Array
    gap_m: Array
    tilt_rad: Array
    free: NDArray[np.bool_]


class ClosedForm(Protocol):
    """An arm whose inverse has a closed form."""

    @property
    def branches(self) -> int:
        """Number of solutions of a pose, some of which may be out of reach or equal."""

    @property
    def by_point(self) -> bool:
        """True if only the position of a point is solved for: the rotation is ignored."""

    @property
    def exact_only(self) -> bool:
        """True if solutions are candidates only: unreachable poses do not get the nearest one."""

    @property
    def numbered(self) -> bool:
        """True if a branch keeps its number as the pose moves."""

    @property
    def determinant(self) -> Determinant:
        """Determinant of the Jacobian, in factors that are zero at the arm's singularities."""

    @property
    def moved(self) -> str:
        """Description of the motions of the determinant; all six for six joints."""

    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """Return all solutions for poses ``(n, 4, 4)`` of the last frame in frame 0.

        Args:
            reference: joint positions ``(n, joints)`` of free joints.
        """

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """Return the possible rotations ``(n, 3, 3)`` of the last frame nearest to given ones."""


@dataclass(frozen=True)
class ZeroAxes:
    """Joint axes in frame 0 at zero joint positions.

    Attributes:
        names: the joints'.
        prismatic: flags of slides.
        sign: ``(n,)`` directions of the joint positions along the axes.
        directions: ``(n, 3)`` unit vectors along the axes, without the signs.
        origins: ``(n, 3)`` m, a point on each hinge's axis; zero for a slide.
        T_frame0_last: pose ``(4, 4)`` of the last frame.
    """

    names: tuple[str, ...]
    prismatic: tuple[bool, ...]
    sign: Array
    directions: Array
    origins: Array
    T_frame0_last: Array

    @classmethod
    def of(cls, chain: Chain) -> "ZeroAxes":
        """Return the axes of a nominal model."""
        arm = SerialArm(chain)
        moving = [motion for motion in arm.motions(arm.nominal()) if motion.joint is not None]
        origins = [np.zeros(3) if motion.origin is None else motion.origin[:3, 0] for motion in moving]
        directions = np.array([motion.axis[:3, 0] for motion in moving])
        T = arm.flange(np.zeros((1, chain.size)), arm.nominal())[0]
        return cls(chain.joint_names, chain.prismatic, chain.sign, directions, np.array(origins), T)

    @property
    def size(self) -> int:
        """Number of joints."""
        return len(self.names)

    def carried(self, joint: int, amount: Array, points: Array) -> Array:
        """Move points ``(3, ...)`` by one joint, by amounts ``(...)`` along its axis."""
        axis = self.directions[joint]
        if self.prismatic[joint]:
            return np.asarray(points + np.multiply.outer(axis, amount))
        origin = self.origins[joint].reshape(3, *(1,) * (points.ndim - 1))
        lever = points - origin
        along = np.multiply.outer(axis, np.tensordot(axis, lever, 1))
        across = np.cross(axis, lever, axisb=0, axisc=0)
        return np.asarray(origin + along + np.cos(amount) * (lever - along) + np.sin(amount) * across)

    def jacobian(self, joints: Array, point: Array) -> Array:
        """Return the geometric Jacobian ``(6, n)`` of a point ``(3,)`` of the last frame, in frame 0."""
        columns, end, turns = list[Array](), se3.transform(self.T_frame0_last, point[None])[0], np.eye(3)
        origins, directions = list[Array](), list[Array]()
        for i in range(self.size):
            origin = self.origins[i]
            for j in range(i - 1, -1, -1):
                origin = self.carried(j, np.asarray(self.sign[j] * joints[j]), origin)
            origins.append(origin)
            directions.append(turns @ self.directions[i])
            if not self.prismatic[i]:
                turns = turns @ se3.exp(self.sign[i] * joints[i] * self.directions[i])
        for j in range(self.size - 1, -1, -1):
            end = self.carried(j, np.asarray(self.sign[j] * joints[j]), end)
        for i, slides in enumerate(self.prismatic):
            axis = self.sign[i] * directions[i]
            columns.append(np.concatenate([axis, np.zeros(3)] if slides else [np.cross(axis, end - origins[i]), axis]))
        return np.stack(columns, axis=1)

    def parallel(self, i: int, j: int) -> bool:
        """Check whether two axes are parallel."""
        return bool(np.linalg.norm(np.cross(self.directions[i], self.directions[j])) <= EXACT)

    def square(self, i: int, j: int) -> bool:
        """Check whether two axes are orthogonal."""
        return bool(abs(self.directions[i] @ self.directions[j]) <= EXACT)


def plane_across(normal: Array, first: Array | None = None) -> Array:
    """Return right-handed unit vectors ``(3, 3)`` as rows: two across a unit vector, and itself."""
    if first is None:
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first = first - normal * (normal @ first)
    first = first / np.linalg.norm(first)
    return np.array([first, np.cross(normal, first), normal])


def in_plane(plane: Array, vector: Array) -> complex:
    """Return a vector ``(3,)`` along the first two rows of a plane, as a complex number."""
    x, y = plane[:2] @ vector
    return complex(x, y)


def meeting_point(origins: Array, axes: Array) -> tuple[Array, float]:
    """Return the point ``(3,)`` nearest to some lines, and the largest distance of a line."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    point = np.linalg.lstsq(across.reshape(-1, 3), (across @ origins[:, :, None]).ravel(), rcond=None)[0]
    distances = np.linalg.norm(across @ (point - origins)[:, :, None], axis=1)
    return np.asarray(point, dtype=np.float64), float(distances.max())


def closed_form_of(chain: Chain, point: Array | None = None) -> ClosedForm | None:
    """Return the registered closed form for a nominal model's inverse, or None.

    Args:
        point: ``(3,)`` m in the last frame, the target of an arm of two or three joints; its origin by default.
    """
    place = np.zeros(3) if point is None else point
    forms: Iterator[ClosedForm | None] = (find(chain, place) for find in load_all("lab.inverses").values())
    return next((form for form in forms if form is not None), None)
