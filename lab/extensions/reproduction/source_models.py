"""Sample the sources' robots at random positions, compare matrices entry by entry, and draw arms."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.reproduction.answer import ComparedValue, formula, number
from lab.extensions.reproduction.formulas import Variables
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.serial.chain import Chain, Convention
from lab.kinematics.serial.serial_arm import SerialArm
from lab.report.document import Picture
from lab.report.scene import placement_picture, skeleton
from lab.robots.load_robot import load_robot

__all__ = [
    "SAMPLES",
    "Sampled",
    "arm_sketch",
    "as_row",
    "link_matrices",
    "matrix_formulas",
    "matrix_numbers",
    "nominal_chain",
    "nominal_mechanism",
    "placements",
    "sampled",
    "serial",
]

SAMPLES = 20  # random positions at which a formula is compared


@dataclass(frozen=True)
class Sampled:
    """A serial arm at random joint positions within its limits.

    Attributes:
        values: parameters ``(p,)`` of the nominal model, SI; the target is the last frame's origin.
        joints: ``(n, joints)`` rad or m.
        unit: number of the source's units of length in one metre.
    """

    arm: SerialArm
    values: Array
    joints: Array
    unit: float

    @property
    def variables(self) -> dict[str, Array]:
        """Joint positions q1 ... in rad and the source's units of length."""
        scale = np.where(self.arm.chain.prismatic, self.unit, 1.0)
        return {f"q{i + 1}": column for i, column in enumerate((self.joints * scale).T)}

    def between(self, first: int, last: int) -> Array:
        """Return poses ``(n, 4, 4)`` of one frame in another, lengths in the source's unit."""
        Ts = np.tile(np.eye(4), (len(self.joints), 1, 1))
        for link in np.moveaxis(self.arm.links(self.joints, self.values)[:, first:last], 1, 0):
            Ts = Ts @ link
        Ts[:, :3, 3] *= self.unit
        return Ts

    def jacobian(self) -> Array:
        """Return Jacobians ``(n, 6, joints)`` of the last frame's origin in the base, lengths in the source's unit."""
        found = self.arm.tool(self.joints, self.values)[1].copy()
        found[:, :3] *= self.unit
        found[..., list(self.arm.chain.prismatic)] /= self.unit
        return found


def nominal_chain(name: str) -> Chain:
    """Return a shipped robot's nominal Denavit-Hartenberg chain: every serial arm of the sources is made of one."""
    return load_robot(name).serial_model.chain


def nominal_mechanism(name: str) -> Mechanism:
    """Return a shipped robot's nominal mechanism with loops: every parallel robot of the sources is made of one."""
    chain = load_robot(name).chain
    assert isinstance(chain, Mechanism)
    return chain


@cache
def serial(name: str, *, at_tool: bool = False) -> tuple[SerialArm, Array]:
    """Return a shipped robot's nominal arm with one target, and its parameters.

    Args:
        at_tool: the target is the robot's own tool point, else the last frame's origin.
    """
    arm = SerialArm(nominal_chain(name), ("p1",))
    return arm, arm.nominal({"p1": load_robot(name).tool["p1"] if at_tool else np.zeros(3)})


@cache
def sampled(name: str, unit: float = 1.0, *, at_tool: bool = False) -> Sampled:
    """Return a shipped robot at random joint positions."""
    arm, values = serial(name, at_tool=at_tool)
    return Sampled(arm, values, arm.chain.random_joints(SAMPLES, rng_for(0, "structure")), unit)


def link_matrices(convention: Convention, theta: Array, d: Array, a: Array, alpha: Array) -> Array:
    """Return the lab's matrices ``(n, 4, 4)`` of links with these Denavit-Hartenberg parameters ``(n,)``."""
    one = nominal_chain("course2r").first(1)
    found = []
    for row in np.stack([theta, d, a, alpha, np.zeros_like(theta)], axis=1):
        arm = SerialArm(replace(one, convention=convention, table=row[None], parallel=(False,)))
        found.append(arm.links(np.zeros((1, 1)), arm.nominal())[0, 0])
    return np.array(found)


def matrix_formulas(
    name: str,
    printed: str,
    exact: Array,
    variables: Variables,
    right: Mapping[str, str] | None = None,
    errata: Mapping[str, str] | None = None,
) -> tuple[ComparedValue, ...]:
    """Compare each entry of a printed matrix with the model's at random positions.

    Args:
        printed: rows divided by ``;``, entries by ``|``; "" where the source leaves the matrix to the reader.
        exact: ``(n, rows, columns)``.
        right: correct entries, by the places ``(1,2)`` of wrong or unprinted ones.
        errata: reasons, by place.
    """
    right, errata = right or {}, errata or {}
    rows = _entries(printed) if printed else [[""] * exact.shape[2] for _ in range(exact.shape[1])]
    return tuple(
        replace(
            formula(
                f"{name}({i + 1},{j + 1})", text, exact[:, i, j], variables,
                right=right.get(f"({i + 1},{j + 1})", ""), erratum=errata.get(f"({i + 1},{j + 1})", ""),
            ),
            place=(name, i + 1, j + 1),
        )
        for i, row in enumerate(rows)
        for j, text in enumerate(row)
    )  # fmt: skip


def matrix_numbers(name: str, printed: str, exact: Array, units: Sequence[str] = ()) -> tuple[ComparedValue, ...]:
    """Compare each entry of a printed matrix of numbers; ``units`` are those of its columns."""
    return tuple(
        replace(
            number(f"{name}({i + 1},{j + 1})", text, float(exact[i, j]), units[j] if units else ""),
            place=(name, i + 1, j + 1),
        )
        for i, row in enumerate(_entries(printed))
        for j, text in enumerate(row)
    )


def as_row(name: str, answers: Iterable[ComparedValue]) -> tuple[ComparedValue, ...]:
    """Return answers as the row of a table, shown on one line."""
    return tuple(replace(answer, place=(name, 1, column)) for column, answer in enumerate(answers, 1))


def _entries(printed: str) -> list[list[str]]:
    return [[entry.strip() for entry in row.split("|")] for row in printed.split(";")]


def arm_sketch(name: str, positions: Sequence[float]) -> tuple[Picture, ...]:
    """Draw a shipped robot with its frames at joint positions in ° and mm: x, y and z are red, green and blue."""
    arm, values = serial(name)
    scale = np.where(arm.chain.prismatic, MM.to_si(1.0), np.pi / 180)
    return placements(arm, values, ("",), np.array([positions], dtype=np.float64) * scale)


def placements(arm: SerialArm, values: Array, titles: Sequence[str], joints: Array) -> tuple[Picture, ...]:
    """Draw the arm as lines with its frames, for each row of joint positions ``(n, joints)``."""
    lines = skeleton(arm, values, joints).lines
    base = np.tile(np.eye(4), (len(joints), 1, 1))
    frames = np.stack([base, *(arm.frame(joints, values, size) for size in range(1, arm.chain.size + 1))], axis=1)
    return tuple(placement_picture(i, title, lines, frames) for i, title in enumerate(titles))
