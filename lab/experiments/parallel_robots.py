"""Parallel robots calibrated: how many parameters show, how well positions come out, and what six true rods change.

Virtual robots in MuJoCo, every dimension off by 0.5 mm and 1 mrad (gains by 1e-3), measured with 5 µm a coordinate.
Where a tracker may stand anywhere, its frame is fitted too: six numbers of the rank. In the plane it stands in that of
the robot, and x, y, rz are fitted; where the frame is known, so are the targets' places, and neither is counted. With n
poses of k targets, positions at the poses are off by sigma sqrt(rank / (k n)), the floor; at fresh ones by a little
more, which linear propagation of the noise predicts.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

from lab.calibration.gauss_newton import fit
from lab.calibration.identify import Identification, IdentifyOptions, identify
from lab.calibration.observation import observation_of
from lab.calibration.prior import Tolerance
from lab.calibration.statistics.goodness_of_fit import goodness_of_fit
from lab.calibration.weights import Noise, weighed
from lab.campaign.model_files import models_folder
from lab.campaign.option_groups import ArmEffects
from lab.campaign.option_types import Flag
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import load_robot
from lab.campaign.virtual_robot import perturbed_arm
from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.closed.recognition import ClassicalModel, classical_model_of
from lab.kinematics.closed.arm import ClosedArm
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.effects.arm import Arm
from lab.kinematics.gauge import STRUCTURE_POSES, named
from lab.kinematics.joints import JointSpec
from lab.noise.instruments import Instrument, instrument
from lab.simulation.closed_robot import ClosedModel, TrueMechanism, true_mechanism
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import track
from lab.simulation.true_robot import TrueRobot

__all__ = [
    "CASES",
    "EVERY",
    "LONGER_M",
    "NOISELESS",
    "Options",
    "Row",
    "assembled",
    "course_of",
    "longer_rod",
    "one_robot",
    "six_rods",
]

POSES, FRESH = 50, 1000
DEVICE = Instrument("gaussian-5um", "gaussian", radial_m=5e-6)
OFF, OFF_SIX = (0.5, 1.0), (0.1, 0.1)  # mm and mrad
LONGER_M = 1e-4  # one rod than its twin
ROUNDING = 1e-10  # of the largest singular value
SAME = 1e-9  # m and rad
SMALL, SIX = (str(models_folder() / "delta" / name) for name in ("small.toml", "six_rods.toml"))
THREE, EVERYWHERE, ANCHORS = ("p1", "p2", "p3"), ("base.*", "tool.*"), ("A2.y", "A3.x", "A3.y")
EVERY = 8  # robots of which every parameter is fitted
Row = dict[str, Any]
robot_of = cache(load_robot)


@dataclass(frozen=True)
class Case:
    """A robot, what is measured of it, and what of it is held or freed; places of targets are not counted if held."""

    robot: str
    targets: tuple[str, ...] = ("p1",)
    groups: tuple[str, ...] = ()
    tracker: Literal["anywhere", "in the plane", "known"] = "anywhere"
    fix: tuple[str, ...] = ("tool.*",)
    free: tuple[str, ...] = ()


CASES = {
    "2-RPR at P, in the plane": Case("rpr2", ("p1",), ("gear",), "in the plane", ("base.z", "base.r[xy]", "tool.*")),
    "2-RPR at P": Case("rpr2", groups=("gear",)),
    "3-RPR pose, frame known": Case("rpr3", THREE, (), "known", EVERYWHERE, ANCHORS),
    "3-RPR pose": Case("rpr3", THREE, fix=()),
    "3-RPR point p1, frame known": Case("rpr3", ("p1",), (), "known", EVERYWHERE, ANCHORS),
    "3-RPR point p1": Case("rpr3"),
    "3-RRR pose": Case("rrr3", THREE, fix=()),
    "3-PRR pose": Case("prr3", THREE, fix=()),
    "Hexapod pose": Case("hexapod", THREE, fix=()),
    "Delta": Case("delta"),
    "Delta of 800 mm": Case(SMALL),
    "IRB 120": Case("irb120", fix=()),
}
NOISELESS = ("2-RPR at P", "3-RPR point p1", "3-RRR pose", "3-PRR pose", "Hexapod pose", "Delta", "Delta of 800 mm")


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: int = 24
    """Virtual robots of each kind."""
    readings: int = 10_000
    """Random ones at which drawings are assembled."""
    seed: int = 0
    """Of the first robot; the others follow."""
    out: Path = Path("runs/parallel-robots")
    """Folder of the figures and the picture."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Bench:
    """A virtual robot, poses to measure, and fresh ones with where its targets are there (m)."""

    real: TrueRobot
    targets: tuple[str, ...]
    joints: Array
    fresh: Array
    points: Array

    @classmethod
    def of(cls, real: TrueRobot, targets: tuple[str, ...], seed: int) -> "Bench":
        """Poses by their seed."""
        joints = random_poses(real.robot, POSES, rng_for(seed, "poses"))
        fresh = random_poses(real.robot, FRESH, rng_for(seed, "fresh"))
        return cls(real, targets, joints, fresh, real.points(fresh, targets))

    def identified(
        self, model: Arm, request: IdentifyOptions, device: Instrument, seed: int
    ) -> tuple[Identification, Row]:
        """With this model of the robot, and how good that is."""
        data = track(self.real, self.joints, self.targets, device, rng_for(seed, "noise"))
        found = identify(model, data, model.nominal(self.real.robot.tool), Noise(device), request)
        seen, known = weighed(observation_of(model), data, Noise(device))
        judged = goodness_of_fit(model, seen, found.fit, known=known, extra_residuals=found.extra_residuals)
        row = {"converged": found.status == "converged", "inadequate": judged.outcome == "failed"}
        return found, {**row, **self.errors(model, found.values)}

    def errors(self, model: Arm, values: Array) -> Row:
        """On validation poses, in µm, and at how many of these the model refuses to answer."""
        off = 1e6 * np.linalg.norm(model.points(self.fresh, values) - self.points, axis=2)
        return {
            "fresh_um": rms(off),
            "worst_um": float(np.nanmax(off)),
            "refused": int(np.isnan(off).any(axis=1).sum()),
        }


def rms(values: Array) -> float:
    """NaN are left out."""
    return float(np.sqrt(np.nanmean(values**2)))


def drawn_real(robot: str, seed: int, off: tuple[float, float], gear_ppm: float = 0.0) -> TrueRobot:
    """A virtual robot of this seed before its tracker."""
    effects = ArmEffects(gear_ppm=gear_ppm)
    asked = VirtualCampaign(robot, seed=seed, position_sigma_mm=off[0], rotation_sigma_mrad=off[1], effects=effects)
    return perturbed_arm(robot_of(robot), asked)


def one_robot(name: str, seed: int, noiseless: bool = False) -> Row:
    """A case of the table."""
    case, device = CASES[name], instrument("exact") if noiseless else DEVICE
    robot, real = robot_of(case.robot), drawn_real(case.robot, seed, OFF, 1e3 if case.groups else 0.0)
    if case.tracker != "anywhere":
        assert isinstance(real, TrueMechanism)
        x, y, turn = rng_for(seed, "tracker").uniform(-1, 1, 3) * (case.tracker == "in the plane")
        moved = se3.pose(se3.exp(np.array([0.0, 0.0, turn])), np.array([x, y, 0.0]))
        real = true_mechanism(real.robot, real.values, real.robot.T_world_frame0 @ moved).with_effects(real.effects)
    bench, model = Bench.of(real, case.targets, seed), robot.arm_with(case.targets, case.groups)
    found, row = bench.identified(model, IdentifyOptions(case.fix, case.free), device, seed)
    before = found.nominal_aligned if case.tracker != "known" else model.nominal(robot.tool)
    rates = model.observe(bench.fresh, found.values)[1][..., list(found.fit.free)]
    foreseen = np.einsum("...f,fg,...g->...", rates, found.covariance, rates).sum(axis=2)
    parameters = len(model.names) - len(named(model.names, "fix", case.fix))
    row |= {"parameters": parameters, "rank": found.fit.rank, "condition": found.fit.condition}
    row |= {"before_mm": bench.errors(model, before)["fresh_um"] / 1e3, "predicted_um": 1e6 * rms(np.sqrt(foreseen))}
    floor = 1e6 * DEVICE.radial_m * float(np.sqrt(found.fit.rank / (POSES * len(case.targets))))
    return row | {"floor_um": floor, "ratio": row["fresh_um"] / floor}


def six_rods(seed: int, every: bool = True) -> Row:
    """One Delta whose six rods are all off: its rank and fits of it, of every parameter only if asked."""
    robot, real = robot_of(SIX), drawn_real(SIX, seed, OFF_SIX)
    assert isinstance(real, TrueMechanism)
    bench, arm = Bench.of(real, ("p1",), seed), robot.arm(("p1",))
    nominal = arm.nominal(robot.tool)
    sizes = {}
    for kind, values in (("drawn", nominal), ("copy", np.concatenate([nominal[:6], real.values[6:], nominal[-3:]]))):
        rates = arm.observe(arm.structure_joints(STRUCTURE_POSES, rng_for(0, "structure")), values)[1]
        flat = rates.reshape(-1, len(values))
        sizes[kind] = np.linalg.svd(flat / np.linalg.norm(flat, axis=0), compute_uv=False)
    row: Row = {f"rank_{kind}": int((s > ROUNDING * s[0]).sum()) for kind, s in sizes.items()}
    row |= {"least_drawn": float(sizes["drawn"][row["rank_drawn"] - 1]), "rank": row["rank_drawn"]}
    row |= {"least_copy": float(sizes["copy"][row["rank_copy"] - 1]), "next_copy": float(sizes["copy"][row["rank"]])}
    tolerance = Tolerance(OFF_SIX[0] / 1e3, OFF_SIX[1] / 1e3)
    plain, row["plain"] = bench.identified(arm, IdentifyOptions(), DEVICE, seed)
    row["prior"] = bench.identified(arm, IdentifyOptions(tolerance=tolerance), DEVICE, seed)[1]
    row["exact"] = bench.identified(arm, IdentifyOptions(), instrument("exact"), seed)[1]
    if every:  # takes 12 s
        data = track(real, bench.joints, ("p1",), DEVICE, rng_for(seed, "noise"))
        seen = weighed(observation_of(arm), data, Noise(DEVICE))[0]
        done = fit(arm, seen, range(len(nominal)), plain.nominal_aligned)
        row["every"] = {"converged": done.status == "converged", **bench.errors(arm, done.values)}
    row["three rods"] = bench.identified(robot_of("delta").arm(("p1",)), IdentifyOptions(), DEVICE, seed)[1]
    return row


def longer_rod() -> Row:
    """A drawn Delta with one rod longer than its twin: how the platform tilts, and what three rods say of it."""
    robot, place = robot_of(SIX), robot_of(SIX).model.T_world_tracker
    assert isinstance(robot.chain, Mechanism) and isinstance(robot.model, ClosedModel)
    values = robot.chain.nominal_values + LONGER_M * (np.array(robot.chain.names) == "rod1a.length")
    bench = Bench.of(true_mechanism(robot.model, values, place), ("p1",), 0)
    Ts = ClosedArm(robot.chain).tool(bench.fresh, np.concatenate([values, np.zeros(3)]))[0]
    tilt = 1e3 * np.linalg.norm(se3.log(Ts[:, :3, :3]), axis=1)
    row = bench.identified(robot_of("delta").arm(("p1",)), IdentifyOptions(), instrument("exact"), 0)[1]
    return row | {"tilt_mrad": float(tilt.mean()), "worst_mrad": float(tilt.max())}


def course_of(robot: str) -> tuple[Mechanism, ClassicalModel]:
    """A robot's mechanism with its closed form."""
    chain = robot_of(robot).chain
    assert isinstance(chain, Mechanism)
    course = classical_model_of(chain)
    assert course is not None
    return chain, course


def assembled(robot: str, readings: int, seed: int) -> Row:
    """A drawing at readings anywhere within the limits: its mode against the closed form's, and what is refused."""
    chain, course = course_of(robot)
    joints = JointSpec.random_joints(chain, readings, rng_for(seed, "poses"))
    found, modes = chain.assembled(joints, chain.nominal_values), course.modes(joints)
    at_home = course.side(
        chain.home[None], chain.assembled(chain.home[None], chain.nominal_values).configuration.passive.T
    )
    ours = np.stack([course.side(joints, mode) == at_home for mode in modes.swapaxes(0, 1)], axis=1)  # (n, m)
    near = np.abs(modes - found.configuration.passive.T[:, None]).max(axis=2) < SAME
    closes, fits = ours.any(axis=1), found.fits
    row = {"readings": fits | True, "close": closes, "answered": fits, "right": (near & ours).any(axis=1) & fits}
    row |= {"the first mode": near[:, 0] & fits, "refused": closes & ~fits}
    return {name: int(rows.sum()) for name, rows in row.items()}
