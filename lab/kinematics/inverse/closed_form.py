"""Say what a closed form of an arm's inverse offers, and find the one that an extension registers for an arm."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.se3 import Array
from lab.extension_points import load_all
from lab.kinematics.serial.arm import SerialArm
from lab.kinematics.serial.chain import Chain

__all__ = [
    "EXACT",
    "Axes",
    "Candidates",
    "ClosedForm",
    "Determinant",
    "Factor",
    "Solutions",
    "Term",
    "closed_form_of",
    "determinant",
    "in_plane",
    "meeting_point",
    "plane_across",
    "real_part",
]

NONE = 1e-12  # of a coefficient (m): it is left out
DIGITS = 6  # of a number in a text


@dataclass(frozen=True)
class Term:
    """A coefficient times the sine or the cosine of a sum of joint positions, times the joint positions of slides.

    Attributes:
        coefficient: m, or without a unit where there is a slide.
        function: of the angle; empty where there is none.
        angle: how each joint position counts in the angle, by joint: +1 or -1, or a multiple.
        slides: the joints whose joint positions are factors.
    """

    coefficient: float
    function: Literal["", "sin", "cos"] = ""
    angle: tuple[tuple[int, float], ...] = ()
    slides: tuple[int, ...] = ()

    def at(self, joints: Array) -> Array:
        """Values ``(...)`` at joint positions ``(..., n)``."""
        angle = sum((sign * joints[..., joint] for joint, sign in self.angle), start=np.zeros(joints.shape[:-1]))
        turned = np.sin(angle) if self.function == "sin" else np.cos(angle)  # cos 0 where there is no function
        return np.asarray(self.coefficient * turned * joints[..., list(self.slides)].prod(axis=-1))

    def text(self, names: tuple[str, ...]) -> str:
        """Its size for a person, without the coefficient's sign; empty for 1."""
        factors = [] if abs(self.size - 1) < NONE and (self.function or self.slides) else [number(self.size)]
        factors += [names[joint] for joint in self.slides]
        if self.function:
            parts = [("+" if sign > 0 else "-", "" if abs(sign) == 1 else f"{abs(sign):g} * ", names[joint])
                     for joint, sign in self.angle]  # fmt: skip
            angle = "".join(map("".join, parts)).removeprefix("+")
            alone = len(self.angle) == 1 and abs(self.angle[0][1]) == 1
            factors.append(f"{self.function} {angle}" if alone else f"{self.function}({angle})")
        return " ".join(factors)

    @property
    def size(self) -> float:
        """Magnitude of the coefficient."""
        return abs(self.coefficient)


@dataclass(frozen=True)
class Factor:
    """A sum of terms that is zero at one kind of singularity.

    Attributes:
        name: of the singularity, for people.
        names: the joints'.
    """

    name: str
    terms: tuple[Term, ...]
    names: tuple[str, ...]

    def at(self, joints: Array) -> Array:
        """Values ``(...)`` at joint positions ``(..., n)``: m, or the sine of an angle."""
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
    """A sign, lengths (m) and factors, whose product it is."""

    sign: float
    lengths: tuple[float, ...]
    factors: tuple[Factor, ...]

    def at(self, joints: Array) -> Array:
        """Values ``(...)`` at joint positions ``(..., n)``."""
        constant = self.sign * np.prod(self.lengths)
        return np.asarray(constant * np.prod([factor.at(joints) for factor in self.factors], axis=0))

    @property
    def text(self) -> str:
        """Formula, like ``-0.27 (0.302 cos q3 + 0.07 sin q3) sin q5``."""
        factors = [f"({factor.text})" if len(factor.terms) > 1 else factor.text for factor in self.factors]
        words = [part for part in (" * ".join(number(length) for length in self.lengths), *factors) if part]
        return ("-" if self.sign < 0 else "") + " ".join(words)


def determinant(
    names: tuple[str, ...], sign: float, lengths: Iterable[float], factors: Iterable[tuple[str, Iterable[Term]]]
) -> Determinant:
    """The product tidied: no term without a coefficient, none that begins with a minus, and numbers in front."""
    numbers, tidied = list(lengths), []
    for name, terms in factors:
        retained = tuple(term for term in terms if term.size > NONE)
        if retained:
            scale = np.sign(retained[0].coefficient) * (retained[0].size if len(retained) == 1 else 1.0)
            sign *= np.sign(scale)
            numbers.append(abs(float(scale)))
            retained = tuple(Term(t.coefficient / scale, t.function, t.angle, t.slides) for t in retained)
        tidied.append(Factor(name, retained, names))
    return Determinant(sign, tuple(length for length in numbers if abs(length - 1) > NONE), tuple(tidied))


def real_part(number: complex, turning: Iterable[tuple[int, float]], slides: tuple[int, ...] = ()) -> list[Term]:
    """Re(number exp(i angle)), for an angle that is the sum of some joint positions, each times its sign."""
    angle = tuple(turning)
    if not angle:
        return [Term(number.real, slides=slides)]
    first = angle[0][1]  # the angle's first joint position counts positive, so that texts are alike
    angle = tuple((joint, first * sign) for joint, sign in angle)
    return [Term(-first * number.imag, "sin", angle, slides), Term(number.real, "cos", angle, slides)]


def number(value: float) -> str:
    """A length for a person, m."""
    return f"{value:.{DIGITS}g}"


# Some poses, and positions (k, 5, n) along the axes that may reach them, with which joints are free there
Candidates = tuple[slice | NDArray[np.int_], Array, NDArray[np.bool_]]
EXACT = 1e-9  # m or rad: by how much a nominal model may miss the shape that is asked for


@dataclass(frozen=True)
class Solutions:
    """Ways to reach some poses.

    Attributes:
        joints: ``(n, k, joints)`` joint positions, a hinge's between -pi and pi.
        gap_m: ``(n, k)`` how far the target is out of reach, zero where it is reached; else the joints are those that
            come nearest, but for a bend of the elbow (``BEND`` in ``first_joints``).
        tilt_rad: ``(n, k)`` by how much the rotation is out of reach of arms with fewer than six joints, which come as
            near to it as they can; zero with six.
        free: ``(n, k, joints)``, joints that could have any joint position, because the arm is singular there.
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
        """True if only the position of a point is solved for: the rotation is ignored, and may be missed."""

    @property
    def exact_only(self) -> bool:
        """True if unreachable poses do not get the nearest solution: their solutions are candidates."""

    @property
    def numbered(self) -> bool:
        """True if a branch keeps its number as the pose moves: false where branches are roots in no lasting order."""

    @property
    def determinant(self) -> Determinant:
        """Determinant of the Jacobian, in the factors that are zero at the arm's singularities."""

    @property
    def moved(self) -> str:
        """Description of the motions that the determinant covers; all six for six joints."""

    def solve(self, Ts_frame0_last: Array, reference: Array | float = 0.0) -> Solutions:
        """Return all solutions for poses ``(n, 4, 4)`` of the last frame in frame 0.

        Args:
            reference: joint positions ``(n, joints)`` that a free joint takes.
        """

    def nearest_rotations(self, Rs_frame0_last: Array) -> Array:
        """The rotations ``(n, 3, 3)`` of the last frame nearest to given ones that the arm can take."""


@dataclass(frozen=True)
class Axes:
    """An arm's joints in frame 0 at zero joint positions.

    Attributes:
        names: the joints'.
        prismatic: which of them slide.
        sign: ``(n,)`` how their joint positions count along the axes.
        directions: ``(n, 3)`` unit vectors along the axes, whatever the joint positions' signs.
        origins: ``(n, 3)`` m, a point on each hinge's axis; zero of a slide.
        T_frame0_last: pose ``(4, 4)`` of the last frame.
    """

    names: tuple[str, ...]
    prismatic: tuple[bool, ...]
    sign: Array
    directions: Array
    origins: Array
    T_frame0_last: Array

    @classmethod
    def of(cls, chain: Chain) -> "Axes":
        """The axes of a nominal model."""
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

    @property
    def backwards(self) -> "Axes":
        """The arm held at its last frame: its joints in the reverse order, and its frame 0 as the last one."""
        back = se3.inverse(self.T_frame0_last)
        origins = np.where(np.array(self.prismatic)[:, None], 0.0, se3.transform(back, self.origins))
        directions = -self.directions @ back[:3, :3].T
        return Axes(
            self.names[::-1], self.prismatic[::-1], self.sign[::-1], directions[::-1], origins[::-1], back
        )  # fmt: skip

    def first(self, count: int) -> "Axes":
        """The first joints alone, with a last frame that stands as frame 0 does."""
        kinds, places = (self.names[:count], self.prismatic[:count]), (self.directions[:count], self.origins[:count])
        return Axes(*kinds, self.sign[:count], *places, np.eye(4))

    def carried(self, joint: int, amount: Array, points: Array) -> Array:
        """Points ``(3, ...)`` carried by one joint, by amounts ``(...)`` along its axis."""
        axis = self.directions[joint]
        if self.prismatic[joint]:
            return np.asarray(points + np.multiply.outer(axis, amount))
        origin = self.origins[joint].reshape(3, *(1,) * (points.ndim - 1))
        lever = points - origin
        along = np.multiply.outer(axis, np.tensordot(axis, lever, 1))
        across = np.cross(axis, lever, axisb=0, axisc=0)
        return np.asarray(origin + along + np.cos(amount) * (lever - along) + np.sin(amount) * across)

    def jacobian(self, joints: Array, point: Array) -> Array:
        """Geometric ``(6, n)`` of a point ``(3,)`` of the last frame at joint positions ``(n,)``, in frame 0."""
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
        """Decide whether two axes are parallel."""
        return bool(np.linalg.norm(np.cross(self.directions[i], self.directions[j])) <= EXACT)

    def square(self, i: int, j: int) -> bool:
        """Decide whether two axes are at right angles."""
        return bool(abs(self.directions[i] @ self.directions[j]) <= EXACT)


def plane_across(normal: Array, first: Array | None = None) -> Array:
    """Unit vectors as rows ``(3, 3)``, right-handed: two across a unit vector, the first as given, and itself."""
    if first is None:
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first = first - normal * (normal @ first)
    first = first / np.linalg.norm(first)
    return np.array([first, np.cross(normal, first), normal])


def in_plane(plane: Array, vector: Array) -> complex:
    """A vector ``(3,)`` along the first two rows of a plane, as a complex number."""
    x, y = plane[:2] @ vector
    return complex(x, y)


def meeting_point(origins: Array, axes: Array) -> tuple[Array, float]:
    """The point ``(3,)`` nearest to some lines, and how far the farthest one misses it."""
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    point = np.linalg.lstsq(across.reshape(-1, 3), (across @ origins[:, :, None]).ravel(), rcond=None)[0]
    return np.asarray(point, dtype=np.float64), float(
        np.linalg.norm(across @ (point - origins)[:, :, None], axis=1).max()
    )


def closed_form_of(chain: Chain, point: Array | None = None) -> ClosedForm | None:
    """Return the closed form of a nominal model's inverse; None where no registered one suits its shape.

    Args:
        point: ``(3,)`` m of the last frame that an arm of two or three joints brings somewhere; by default its origin.
    """
    place = np.zeros(3) if point is None else point
    forms: Iterator[ClosedForm | None] = (find(chain, place) for find in load_all("lab.inverses").values())
    return next((form for form in forms if form is not None), None)
