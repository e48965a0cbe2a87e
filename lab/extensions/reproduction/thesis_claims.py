"""Test statements of chapters I and II of Mahdadi and Bouafia 2020 on the lab's robots and virtual arms.

Figure I.4 and table I.1, "errors grow from the base to the effector" (section III.1), the ranking of error sources
(section V.3, after Judd and Knasinski 1990 and Damak 1996), and the contradiction of O1 to O3 (chapter II, section I.4,
after Nahvi and Hollerbach 1996). Sizes that the thesis leaves open are stated beside each result. An interval is one of
95 % on the logarithm: over virtual arms by Student's t, over poses by the bootstrap.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from lab.core.probability import beta_ppf, t_isf
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.reproduction.thesis_case import thesis_case
from lab.extensions.robotics.workspace.measure import Workspace, workspace_of
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.gauge import base_set_of
from lab.kinematics.model import RigidArm
from lab.kinematics.parameter import TOLERANCE_M, TOLERANCE_RAD
from lab.kinematics.reach import reach_from_axis
from lab.kinematics.serial.serial_arm import SerialArm
from lab.pose_selection.criteria import indices
from lab.robots.load_robot import load_robot
from lab.simulation.true_robot import random_table

__all__ = [
    "PAIRS",
    "RANKED",
    "WORKSPACE_ARMS",
    "Contradiction",
    "EffectSizes",
    "ErrorGrowth",
    "Interval",
    "KindOfRobot",
    "Machine",
    "contradiction",
    "error_sources",
    "growth_along",
    "machine",
    "paired_ratio",
    "ratio_of",
    "serial_over_parallel",
    "thesis_arm_sources",
    "wrist_workspace",
]

_TAIL, _RESAMPLES = 0.025, 400


@dataclass(frozen=True)
class Interval:
    """An estimate with its 95 % interval."""

    value: float
    lower: float
    upper: float

    @property
    def side(self) -> int:
        """+1 if the interval is above one, -1 if it is below, 0 if one is inside."""
        return int(self.lower > 1) - int(self.upper < 1)

    def scaled(self, factor: float) -> "Interval":
        """Return the interval times a positive number."""
        return Interval(factor * self.value, factor * self.lower, factor * self.upper)

    def __str__(self) -> str:
        return f"{self.value:.2f} ({self.lower:.2f} to {self.upper:.2f})"


def paired_ratio(first: Array, second: Array) -> Interval:
    """Return the geometric mean of ``first / second`` over arms ``(arms,)`` that have both."""
    logs = np.log(first / second)
    half = float(t_isf(_TAIL, len(logs) - 1)) * float(logs.std(ddof=1)) / np.sqrt(len(logs))
    mean = float(logs.mean())
    return Interval(*np.exp([mean, mean - half, mean + half]).tolist())


def ratio_of(first: Array, second: Array, weights: tuple[Array, Array] | None = None) -> Interval:
    """Return the ratio of the root mean squares of independent samples ``(n,)`` and ``(m,)``, by the bootstrap.

    Args:
        weights: of each sample's poses, by importance sampling.
    """
    w = (np.ones(len(first)), np.ones(len(second))) if weights is None else weights
    rng = rng_for(0, "bootstrap")
    logs = []
    for values, weight in zip((first, second), w, strict=True):
        drawn = rng.multinomial(len(values), np.full(len(values), 1 / len(values)), size=_RESAMPLES)
        counts = np.concatenate([np.ones((1, len(values))), drawn]) * weight
        logs.append(0.5 * np.log((counts @ values**2) / counts.sum(axis=1)))
    ratio = np.exp(logs[0] - logs[1])
    return Interval(float(ratio[0]), *np.quantile(ratio[1:], (_TAIL, 1 - _TAIL)).tolist())


def _share(flags: NDArray[np.bool_]) -> Interval:
    """Return the share of true flags with the exact interval of Clopper and Pearson (1934)."""
    n, k = len(flags), int(flags.sum())
    lower = float(beta_ppf(_TAIL, k, n - k + 1)) if k else 0.0
    upper = float(beta_ppf(1 - _TAIL, k + 1, n - k)) if k < n else 1.0
    return Interval(k / n, lower, upper)


WORKSPACE_ARMS: Mapping[str, float] = {"irb140": 0.065, "irb2400": 0.085}  # m from the wrist's centre to the flange


def wrist_workspace(name: str, places: int = 1024) -> tuple[float, Workspace]:
    """Return the reach (m) of the wrist's centre from axis 1, and its workspace within the joint limits."""
    arm = load_robot(name).serial_arm(("p1",))
    wrist = np.array([0.0, 0.0, -WORKSPACE_ARMS[name]])
    space = workspace_of(arm, arm.nominal({"p1": wrist}), places, rng_for(0, "poses"))
    return reach_from_axis(arm.chain, wrist), space


@dataclass(frozen=True)
class KindOfRobot:
    """A robot of table I.1.

    Attributes:
        robot: its name.
        length_m: the parts of one leg laid end to end, from the middle of the base to the tool; of a serial arm from
            its second axis, since a column moves nothing.
        plane: whether it moves in the plane x, y.
    """

    robot: str
    length_m: float
    plane: bool


PAIRS: Mapping[str, tuple[KindOfRobot, KindOfRobot]] = {  # serial, parallel; alike in joints and in freedoms
    "plane": (KindOfRobot("planar3r", 0.4 + 0.3 + 0.15, True), KindOfRobot("rrr3", 0.4 + 0.25 + 0.3 + 0.1, True)),
    "space": (
        KindOfRobot("carrier/anthropomorphic", 1.0 + 1.0, False),
        KindOfRobot("delta", 0.163678801315 + 0.524 + 1.244 + 0.043878620458, False),
    ),
}
_JOINT_SIGMA = 1e-5  # rad, of each joint at every visit
_NOISE_SIGMA = 8e-6 / np.sqrt(3)  # m, of the thesis' instrument
_POSES, _FRESH = 30, 200  # of a calibration


@dataclass(frozen=True)
class Machine:
    """A robot scaled so that a leg is one metre long, at random joint positions within its limits.

    Attributes:
        size: m² or m³ of the workspace, and its standard error.
        jacobians: ``(n, d, joints)`` m per rad, of the tool's point; d is 2 in the plane.
        weights: ``(n,)`` that make the poses uniform over the workspace.
        rates: ``(n, d, p)`` by all parameters, m per m and m per rad.
        links: ``(p,)`` flags of parameters that are neither of the base nor of the tool.
        angles: ``(p,)`` flags of angles.
        identifiable: indices of a complete and minimal set.
    """

    kind: KindOfRobot
    size: tuple[float, float]
    jacobians: Array
    weights: Array
    rates: Array
    links: NDArray[np.bool_]
    angles: NDArray[np.bool_]
    identifiable: tuple[int, ...]

    @property
    def dimensions(self) -> int:
        """Dimensions of the workspace."""
        return int(self.jacobians.shape[1])

    @property
    def gains(self) -> Array:
        """Root mean square position errors ``(n,)`` m per rad of independent joint errors."""
        return np.asarray(np.sqrt((self.jacobians**2).sum(axis=(1, 2))))

    def uncalibrated(self, arms: int, seed: int = 0) -> Array:
        """Simulate virtual arms with equal errors of their link parameters: the position's RMS ``(arms,)`` m."""
        sigma = np.where(self.angles, TOLERANCE_RAD, TOLERANCE_M)[self.links]
        drawn = sigma * rng_for(seed, "arm").standard_normal((arms, len(sigma)))
        errors = np.einsum("ndp,ap->and", self.rates[..., self.links], drawn)
        return np.asarray(np.sqrt(((errors**2).sum(axis=2) @ self.weights) / self.weights.sum()))

    def calibrated(self, designs: int, seed: int = 0, joint_sigma: float = _JOINT_SIGMA) -> Array:
        """Predict the position's RMS ``(designs,)`` m at other poses after calibrations at random poses.

        Joints scatter and the instrument has its noise at every pose; at the next visit the joints scatter again.

        Args:
            joint_sigma: rad, of each joint's scatter.
        """
        out = []
        kept = self.rates[..., list(self.identifiable)]
        for k in range(designs):
            rows = rng_for(seed, "poses", k).permutation(len(kept))
            fitted, fresh = rows[:_POSES], rows[_POSES : _POSES + _FRESH]
            J = self.jacobians[fitted]
            covariance = joint_sigma**2 * J @ J.swapaxes(1, 2) + _NOISE_SIGMA**2 * np.eye(self.dimensions)
            information = np.einsum("ndp,nde,neq->pq", kept[fitted], np.linalg.inv(covariance), kept[fitted])
            scale = 1 / np.sqrt(np.diag(information))
            spread = scale[:, None] * np.linalg.pinv(scale[:, None] * information * scale) * scale
            square = np.einsum("ndp,pq,ndq->n", kept[fresh], spread, kept[fresh])
            square += joint_sigma**2 * self.gains[fresh] ** 2
            out.append(np.sqrt(np.average(square, weights=self.weights[fresh])))
        return np.array(out)


@cache
def machine(kind: KindOfRobot, poses: int = 2000, places: int = 200) -> Machine:
    """Return a robot of table I.1 with legs of one metre."""
    arm: RigidArm = load_robot(kind.robot).arm(("p1",))
    values = arm.nominal({"p1": np.zeros(3)})
    joints = arm.chain.random_joints(poses, rng_for(0, "poses"))
    Ts, jacobian = arm.tool(joints, values)
    stands = np.isfinite(Ts).all(axis=(1, 2))
    joints, jacobian = joints[stands], jacobian[stands]
    task = jacobian[:, [0, 1, 5]] if kind.plane else jacobian[:, :3]
    rows = [0, 1] if kind.plane else [0, 1, 2]
    angles = np.array([parameter.is_angle for parameter in arm.parameters])
    rates = arm.observe(joints, values)[1][:, 0][:, rows] * np.where(angles, 1 / kind.length_m, 1.0)
    links = np.array([not name.startswith(("base.", "tool.")) for name in arm.names])
    seen = rates.reshape(-1, len(angles))
    space = workspace_of(arm, values, places, rng_for(0, "poses", 1)).measured
    unit = kind.length_m ** len(rows)
    return Machine(
        kind, (space.size / unit, space.standard_error / unit), jacobian[:, rows] / kind.length_m,
        np.abs(np.linalg.det(task)), rates, links, angles, base_set_of(seen, arm.column_priority()).identifiable,
    )  # fmt: skip


def serial_over_parallel(pair: str, arms: int = 400, designs: int = 30) -> dict[str, dict[str, Interval]]:
    """Compare a pair of table I.1: the serial robot's value over the parallel one's, of legs of one length.

    Returns:
        By property its ratio at "equal length", and at "equal workspace": both scaled to the same size of workspace.
    """
    serial, parallel = (machine(kind) for kind in PAIRS[pair])
    spread = float(np.hypot(serial.size[1] / serial.size[0], parallel.size[1] / parallel.size[0]))
    size = serial.size[0] / parallel.size[0]
    workspace = Interval(size, *(size * np.exp(1.96 * sign * spread) for sign in (-1, 1)))
    shrunk = size ** (-1 / serial.dimensions)  # of lengths, to the same workspace
    repeatability = ratio_of(serial.gains, parallel.gains, (serial.weights, parallel.weights))
    before = ratio_of(serial.uncalibrated(arms), parallel.uncalibrated(arms, 1))
    after = ratio_of(serial.calibrated(designs), parallel.calibrated(designs, 1))
    exact = ratio_of(serial.calibrated(designs, 0, 0.0), parallel.calibrated(designs, 1, 0.0))
    compliance = Interval(*(np.array([repeatability.value, repeatability.lower, repeatability.upper]) ** 2).tolist())
    return {
        "workspace": {"equal length": workspace},
        "repeatability": {"equal length": repeatability, "equal workspace": repeatability.scaled(shrunk)},
        "compliance": {"equal length": compliance, "equal workspace": compliance.scaled(shrunk**2)},
        "error before calibration": {"equal length": before},
        "error after calibration": {"equal length": after},
        "error after calibration, exact joints": {"equal length": exact},
    }


@dataclass(frozen=True)
class ErrorGrowth:
    """Position errors of the frames of an arm whose links have equal errors.

    Attributes:
        errors: ``(arms, n)`` m, RMS over poses of the origin of each frame, from the base outward.
    """

    robot: str
    errors: Array

    @property
    def steps(self) -> tuple[Interval, ...]:
        """The error of each frame over that of the one before."""
        return tuple(
            paired_ratio(after, before) for before, after in zip(self.errors.T, self.errors.T[1:], strict=False)
        )

    @property
    def whole(self) -> Interval:
        """The error of the last frame over that of the first."""
        return paired_ratio(self.errors[:, -1], self.errors[:, 0])

    @property
    def monotone(self) -> Interval:
        """The share of arms whose error grows at every step."""
        return _share(np.asarray((np.diff(self.errors, axis=1) > 0).all(axis=1)))


def growth_along(name: str, arms: int = 100, poses: int = 50) -> ErrorGrowth:
    """Simulate arms whose Denavit-Hartenberg entries all have the default tolerances."""
    arm = load_robot(name).serial_arm(("p1",))
    joints = arm.chain.random_joints(poses, rng_for(0, "poses"))
    nominal = _origins(arm, joints, arm.nominal())
    found = [
        _origins(arm, joints, random_table(arm, TOLERANCE_M, TOLERANCE_RAD, rng_for(k, "arm"))) for k in range(arms)
    ]
    return ErrorGrowth(name, np.sqrt(((np.array(found) - nominal) ** 2).sum(axis=3).mean(axis=1)))


def _origins(arm: SerialArm, joints: Array, values: Array) -> Array:
    """Return the origins ``(poses, n, 3)`` of the frames."""
    links = arm.links(joints, values)
    Ts = [links[:, 0]]
    for i in range(1, links.shape[1]):
        Ts.append(Ts[-1] @ links[:, i])
    return np.stack(Ts, axis=1)[..., :3, 3]


@dataclass(frozen=True)
class EffectSizes:
    """Sizes of errors that are neither the joints' zeros and gains nor geometry, and of those.

    Attributes:
        gain: standard deviation of a joint's gain, relative.
        stiffness: Nm/rad of each joint; payloads are uniform up to ``payload_kg``.
        runout_rad: amplitude of an error once a turn, of random phase.
        backlash_rad: play, half to either side by a random approach.
        heat: standard deviation of an arm's thermal growth, relative: 5 K of steel.
    """

    gain: float = 50e-6
    stiffness: float = 1e5
    payload_kg: float = 2.0
    runout_rad: float = 1e-4
    backlash_rad: float = 5e-5
    heat: float = 5 * 11.5e-6


RANKED = ("irb120", "tx40")  # arms with masses whose joints are of the default stiffness
_SOURCES = ("joints", "geometry", "other")


def error_sources(
    name: str, arms: int = 200, poses: int = 100, *, aligned: bool = False, effects: EffectSizes | None = None
) -> dict[str, Array]:
    """Simulate arms with each source of the thesis' ranking alone: RMS position errors ``(arms,)`` m by source.

    ``joints``: zeros and gains of the joints. ``geometry``: all other entries of the table. ``other``: compliance,
    runout, backlash and heat. Zeros and angles have the default tolerance of angles, lengths that of lengths.

    Args:
        aligned: base and tool are fitted to the measured points first, as in a calibration; else both are given.
    """
    given = effects or EffectSizes()
    robot = load_robot(name)
    arm = robot.serial_arm(("p1",))
    values = arm.nominal(robot.tool)
    joints = arm.chain.random_joints(poses, rng_for(0, "poses"))
    rates = arm.observe(joints, values)[1][:, 0]
    names = np.array(arm.names)
    zeros = np.array([each.endswith(".theta") for each in names])
    placed = np.array([each.startswith(("base.", "tool.")) for each in names])
    angles = np.array([parameter.is_angle for parameter in arm.parameters])
    sigma = np.where(angles, TOLERANCE_RAD, TOLERANCE_M)
    by_joint = arm.joint_jacobian(joints, values)[:, 0]
    rng = rng_for(0, "effects")
    turned = rng.standard_normal((arms, 1, arm.chain.size))
    zero = sigma[zeros] * rng.standard_normal((arms, 1, int(zeros.sum())))
    geometry = sigma * rng.standard_normal((arms, len(names)))
    moved = {
        "joints": np.einsum("ndj,anj->and", by_joint, zero + given.gain * turned * joints),
        "geometry": np.einsum("ndp,ap->and", rates[..., ~zeros & ~placed], geometry[:, ~zeros & ~placed]),
        "other": _other(robot.loads, arm, joints, by_joint, values, given, arms),
    }
    if aligned:
        u, s, _ = np.linalg.svd(rates[..., placed].reshape(3 * poses, -1), full_matrices=False)
        basis = u[:, s > 1e-9 * s[0]]
        flat = {source: each.reshape(arms, -1) for source, each in moved.items()}
        moved = {source: (each - each @ basis @ basis.T).reshape(arms, poses, 3) for source, each in flat.items()}
    return {source: np.sqrt((moved[source] ** 2).sum(axis=2).mean(axis=1)) for source in _SOURCES}


def _other(
    loads: Loads | None, arm: SerialArm, joints: Array, by_joint: Array, values: Array, given: EffectSizes, arms: int
) -> Array:
    """Displace the tool ``(arms, poses, 3)`` by compliance, runout, backlash and heat."""
    assert loads is not None  # of the arms in RANKED
    poses, n = joints.shape
    out = np.empty((arms, poses, 3))
    points = arm.points(joints, values)[:, 0]
    for k in range(arms):
        rng = rng_for(k, "effects", 1)
        payload = np.full(poses, given.payload_kg) * rng.random(poses)
        turned = loads.forces(joints, payload)[0] / given.stiffness
        turned = turned + given.runout_rad * np.sin(joints + rng.uniform(-np.pi, np.pi, n))
        turned = turned + given.backlash_rad / 2 * rng.choice((-1.0, 1.0), (poses, n))
        out[k] = np.einsum("ndj,nj->nd", by_joint, turned) + given.heat * rng.standard_normal() * points
    return out


def thesis_arm_sources(poses: int = 500) -> dict[str, Array]:
    """Compute the position errors ``(poses,)`` m that the thesis' own table IV.2 makes: by zeros, and by the rest."""
    case = thesis_case()
    joints = case.arm.chain.random_joints(poses, rng_for(0, "poses"))
    rates = case.arm.observe(joints, case.nominal)[1][:, 0]
    off = case.truth() - case.nominal
    zeros = np.array([name.endswith(".theta") for name in case.arm.names])
    return {
        source: np.linalg.norm(rates[..., flags] @ off[flags], axis=1)
        for source, flags in (("joints", zeros), ("geometry", ~zeros))
    }


@dataclass(frozen=True)
class Contradiction:
    """Indices of pairs of random sets of poses.

    Attributes:
        scores: ``(pairs, 2)`` of both sets, by index.
        joints: ``(pairs, 2, poses, 6)``.
    """

    scores: Mapping[str, Array]
    joints: Array

    def prefers(self, name: str) -> NDArray[np.bool_]:
        """Return whether an index prefers the first set ``(pairs,)``."""
        return np.asarray(self.scores[name][:, 0] > self.scores[name][:, 1])

    def disagree(self, *names: str) -> Interval:
        """Return the share of pairs that not all of these indices order alike."""
        flags = np.array([self.prefers(name) for name in names])
        return _share(np.asarray(flags.any(axis=0) & ~flags.all(axis=0)))

    def example(self) -> int:
        """Return the pair that O1 orders most clearly in one way, and both O2 and O3 in the other."""
        margins = {name: np.diff(np.log(self.scores[name]), axis=1)[:, 0] for name in ("O1", "O2", "O3")}
        against = np.minimum(-np.sign(margins["O1"]) * margins["O2"], -np.sign(margins["O1"]) * margins["O3"])
        return int(np.argmax(np.minimum(np.abs(margins["O1"]), against)))


def contradiction(pairs: int = 400, poses: int = 20, seed: int = 0) -> Contradiction:
    """Draw pairs of sets of random poses of the thesis' arm, and compute their indices of its 19 parameters."""
    case = thesis_case()
    joints = rng_for(seed, "poses").uniform(-np.pi, np.pi, (2 * pairs * poses, case.arm.chain.size))
    rates = case.arm.observe(joints, case.nominal)[1][:, 0][..., list(case.free)]
    found = indices((MM.of(rates) / case.mm).reshape(2 * pairs, poses, 3, len(case.free)))
    scores = {"O1": found.o1, "O2": found.o2, "O3": found.o3, "O4": found.o4, "O5": found.o5}
    return Contradiction(
        {name: score.reshape(pairs, 2) for name, score in scores.items()},
        joints.reshape(pairs, 2, poses, case.arm.chain.size),
    )
