"""Run the campaigns of a study: choose the poses of a cell, and solve all campaigns of some robots.

A campaign's row depends on the study's seed and on the numbers of its cell, robot and draw alone: a robot and its
tracker are drawn from the robot's own seed, the noise from the robot's and the draw's, and each robot's campaigns are
solved in blocks of their own.
"""

import platform
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import metadata
from typing import Any

import numpy as np

from lab.calibration.batch import BatchFits, PointBatch, align, fit_points, in_nominal_frame
from lab.campaign.design_problem import best_design, pose_problem
from lab.campaign.option_groups import Effects, Fitting
from lab.campaign.options import DesignOptions, VirtualCampaign
from lab.campaign.robot import Robot, load_robot, load_virtual
from lab.campaign.virtual_robot import draw_conditions, perturbed_arm, truth_of
from lab.core import se3
from lab.core.errors import LabError
from lab.core.linear_model import whitening
from lab.core.random import Purpose, rng_for, seed_of
from lab.core.se3 import Array
from lab.core.units import MM, MRAD
from lab.core.version import __version__
from lab.kinematics.gauge import base_set
from lab.kinematics.parameter import names_of
from lab.kinematics.serial.arm import Stacked, stacked
from lab.noise.instruments import Instrument, instrument, is_isotropic, observing
from lab.pose_selection.criteria import refuse_unknown
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import misalignments, track
from lab.simulation.true_robot import TrueRobot
from lab.studies.grid import ANY, NONE, USUAL, Cell, Study, Task

__all__ = [
    "COLUMNS",
    "METRICS",
    "cell_poses",
    "difference",
    "origin_of",
    "other_version",
    "refuse_impossible",
    "run_task",
]

_RANDOM = "random"
CANDIDATES, STARTS = 1000, 2  # of a cell's design
_VALIDATED_TOGETHER = 5  # campaigns, to fit the processor's cache
_Columns = dict[str, Array]
COLUMNS = {  # of every campaign's row, and what they mean
    "cell": "number of the cell, from 0 (manifest.json says which)",
    "robot": "number of the perturbed robot, from 0; the same number is the same robot in every cell",
    "draw": "number of the noise draw, from 0; the same number is the same noise in every cell",
    "converged": "whether Gauss-Newton converged",
    "steps": "how many steps it took",
    "fresh_mean_mm": "mean position error over the validation poses, without noise",
    "fresh_p95_mm": "95 % of these errors are smaller",
    "fresh_worst_mm": "largest of these errors",
    "length_rms_mm": "root mean square error of the identified lengths, in the canonical gauge",
    "angle_rms_mrad": "the same of the identified angles",
    "mixed_rms": "the same of all identified parameters, in mm and rad as they are, as the thesis takes it",
    "nees": "squared parameter errors by their predicted covariance, a parameter: one on average",
    "before_mm": "mean position error over the validation poses with nominal links, base and tool fitted",
    "lost": "measured or validation poses that the robot cannot take, as its loops do not close there: left out",
}
METRICS = tuple(COLUMNS)[5:-1]


def refuse_impossible(study: Study) -> None:
    """Refuse an impossible study before any work begins.

    Raises:
        LabError: the robot cannot be loaded, or lacks a target, a parameter or an effect of some cell; a criterion or
            an instrument is unknown; or a cell has too few poses.
    """
    robot = load_virtual(study.robot)
    robot.refuse_unknown(study.targets)
    for cell in study.cells:
        refuse_unknown(cell.criterion, _RANDOM)
    fitted: dict[tuple[object, ...], _Fitted] = {}
    for cell in study.cells:
        key = (cell.parameters, cell.effects, cell.instrument)
        if key not in fitted:
            fitted[key] = _Fitted.of(study, cell, robot)
            options = VirtualCampaign(robot=study.robot, targets=study.targets, effects=fitted[key].effects)
            perturbed_arm(robot, options)
        _refuse_few_poses(cell, fitted[key], study)


def cell_poses(study: Study, cell: Cell) -> Array:
    """Return the poses ``(n, joints)`` of every campaign of a cell, chosen for the nominal model.

    They are designed for the usual parameters, whatever is then identified.

    Raises:
        LabError: there are fewer than the identifiable parameters need.
    """
    robot = load_virtual(study.robot)
    _refuse_few_poses(cell, _Fitted.of(study, cell, robot), study)
    if cell.criterion == _RANDOM:
        return random_poses(robot.model, cell.poses, rng_for(study.seed, "poses"))
    requested = DesignOptions(
        robot=study.robot,
        poses=cell.poses,
        criterion=cell.criterion,
        scaling="whitened" if cell.scaling == ANY else cell.scaling,
        targets=study.targets,
        instrument=cell.instrument,
        candidates=CANDIDATES,
        starts=STARTS,
        seed=study.seed,
    )
    return _designed(requested).copy()


def _refuse_few_poses(cell: Cell, fitted: "_Fitted", study: Study) -> None:
    needed = -(-len(fitted.free) // (3 * len(study.targets)))
    if cell.poses < needed:
        raise LabError(f"factor poses: {cell.poses} poses cannot show the parameters: give {needed} or more")


@lru_cache(maxsize=16)
def _designed(requested: DesignOptions) -> Array:
    """Design poses; cached, as cells that differ in the arm alone share them."""
    assert requested.poses is not None
    return best_design(requested, pose_problem(requested), requested.poses).joints


def run_task(study: Study, task: Task, joints: Array) -> _Columns:
    """Run all campaigns of a task, a row each, with the columns of ``COLUMNS``.

    Args:
        joints: the cell's poses.
    """
    robot, cell = load_virtual(study.robot), study.cells[task.cell]
    fitted = _Fitted.of(study, cell, robot)
    fresh = random_poses(robot.model, study.fresh, rng_for(study.seed, "fresh"))
    rows = [_of_robot(study, fitted, number, joints, fresh) for number in range(task.first, task.last)]
    columns = {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
    numbers = np.repeat(np.arange(task.first, task.last, dtype=np.int32), study.draws)
    draws = np.tile(np.arange(study.draws, dtype=np.int32), task.last - task.first)
    return {"cell": np.full(len(numbers), task.cell, dtype=np.int32), "robot": numbers, "draw": draws, **columns}


@dataclass(frozen=True)
class _Fitted:
    """Parameters identified in a cell.

    Attributes:
        nominal: parameters ``(p,)`` of the nominal model before the nominal tracker.
        free: the identified ones.
        placed: whether the base is identified, so that the points may be aligned.
        device: the instrument, with the noise of the cell.
    """

    robot: Robot
    cell: Cell
    stacked: Stacked
    nominal: Array
    free: tuple[int, ...]
    placed: bool
    effects: Effects
    device: Instrument

    @classmethod
    def of(cls, study: Study, cell: Cell, robot: Robot) -> "_Fitted":
        requested = Fitting() if cell.parameters == USUAL else study.parameters[cell.parameters]
        if (
            requested != Fitting(fix=requested.fix, free=requested.free, prior=requested.prior)
            or requested.prior == "on"
        ):
            raise LabError(f"parameters.{cell.parameters}: a study fits geometry alone, by fix and free")
        arm, model = robot.arm(study.targets), robot.model
        nominal = model.values_before(arm, model.T_world_tracker)
        free = base_set(arm, nominal, fix=requested.fix, free=requested.free).identifiable
        effects = Effects() if cell.effects == NONE else study.effects[cell.effects]
        device = _noisy(observing(instrument(cell.instrument), "points"), cell.noise)
        if study.frozen and not is_isotropic(device):
            raise LabError(
                f"frozen: {device.name} weighs every arm otherwise, so one Jacobian cannot serve all; leave it"
            )
        return cls(robot, cell, stacked(arm), nominal, free, set(range(6)) <= set(free), effects, device)


def _noisy(device: Instrument, noise: float) -> Instrument:
    names = ("radial_m", "radial_per_m", "transverse_m", "transverse_per_m", "angle_rad")
    grown = {name: noise * getattr(device, name) for name in names if hasattr(device, name)}
    return replace(device, errors=device.errors.times(noise), **grown)


def _of_robot(study: Study, fitted: _Fitted, number: int, joints: Array, fresh: Array) -> _Columns:
    seed, cell = seed_of(study.seed, "robots", number), fitted.cell
    requested = VirtualCampaign(
        robot=study.robot,
        seed=seed,
        targets=study.targets,
        instrument=cell.instrument,
        position_sigma_mm=cell.position_sigma_mm,
        rotation_sigma_mrad=cell.rotation_sigma_mrad,
        effects=fitted.effects,
    )
    real = perturbed_arm(fitted.robot, requested)
    measured = _measured(real, fitted.device, requested, joints, study.draws)
    exact = real.points(joints, study.targets, _conditions(real, requested, joints, "conditions"))
    there = real.points(fresh, study.targets, _conditions(real, requested, fresh, "fresh"))
    taken, met = (np.isfinite(points).all(axis=(1, 2)) for points in (exact, there))
    measured, exact, joints, there, fresh = measured[:, taken], exact[taken], joints[taken], there[met], fresh[met]
    campaigns = _aligned(fitted, real, joints, measured)
    found = fit_points(campaigns, fitted.nominal, fitted.free, frozen=study.frozen)
    metrics = _metrics(fitted, real, found, campaigns, fresh, there)
    before = _before(fitted, joints, exact, fresh, there)
    lost = int((~taken).sum() + (~met).sum())
    return {**metrics, "before_mm": np.full(study.draws, before), "lost": np.full(study.draws, lost, dtype=np.int32)}


def _conditions(real: TrueRobot, options: VirtualCampaign, joints: Array, purpose: Purpose) -> dict[str, Array]:
    return draw_conditions(real, options, len(joints), rng_for(options.seed, purpose), ())


def _measured(real: TrueRobot, device: Instrument, requested: VirtualCampaign, joints: Array, draws: int) -> Array:
    """Simulate the tracker's readings of each draw, ``(draws, n, k, 3)`` m; shared parts are computed once."""
    effects = real.effects
    conditions = _conditions(real, requested, joints, "conditions")
    noises = [rng_for(requested.seed, "noise", draw) for draw in range(draws)]
    if effects.varies:
        points = [track(real, joints, requested.targets, device, rng, conditions=conditions).points for rng in noises]
        return np.array(points)
    exact = real.points(joints, requested.targets, conditions)
    noisy = np.array([device.sample(exact, rng) for rng in noises])
    if not device.errors.stated:
        return noisy
    return noisy + [device.errors.sample(exact, misalignments(rng)) for rng in noises]


def _aligned(fitted: _Fitted, real: TrueRobot, joints: Array, measured: Array) -> PointBatch:
    """Align the campaigns with the nominal model, by the measured points, or by a fixed base."""
    shown, device = real.effects.shown(joints), fitted.device
    if fitted.placed:
        campaigns = align(fitted.stacked, shown, measured, fitted.nominal)
    else:
        T = se3.inverse(real.T_world_tracker) @ real.robot.T_world_frame0
        Ts = np.broadcast_to(T, (len(measured), 4, 4))
        campaigns = PointBatch(fitted.stacked, shown, in_nominal_frame(measured, Ts), Ts)
    if is_isotropic(device):
        return campaigns
    rotations = campaigns.Ts_instrument_nominal[:, None, None, :3, :3]
    whiten = whitening(device.covariance(measured)) @ rotations  # (b, n, k, 3, 3)
    return replace(campaigns, whiten=whiten.transpose(0, 2, 3, 4, 1))


def _metrics(
    fitted: _Fitted, real: TrueRobot, found: BatchFits, campaigns: PointBatch, fresh: Array, exact: Array
) -> _Columns:
    """Evaluate the campaigns with one robot.

    Args:
        exact: ``(m, k, 3)`` m, its true targets at the validation poses.
    """
    Ts = campaigns.Ts_instrument_nominal
    errors = _errors(fitted, fresh, found.values, in_nominal_frame(exact, Ts))
    free, parameters = list(fitted.free), fitted.stacked.arm.parameters
    off = (found.values - _true_values(fitted, real, Ts))[:, free]
    angular = np.array([parameters[i].is_angle for i in free])
    device = fitted.device
    sigma = 1.0 if campaigns.whiten is not None else device.isotropic_sigma()
    weight = 1 / sigma**2 if sigma else np.nan
    lengths, angles = MM.of(off[:, ~angular]), off[:, angular]
    return {
        "converged": found.converged,
        "steps": found.steps.astype(np.int32),
        "fresh_mean_mm": errors.mean(axis=1),
        "fresh_p95_mm": np.quantile(errors, 0.95, axis=1),
        "fresh_worst_mm": errors.max(axis=1),
        "length_rms_mm": _rms(lengths),
        "angle_rms_mrad": MRAD.of(_rms(angles)),
        "mixed_rms": _rms(np.concatenate([lengths, angles], axis=1)),
        "nees": weight * np.einsum("bf,bfg,bg->b", off, found.information, off) / len(free),
    }


def _before(fitted: _Fitted, joints: Array, exact: Array, fresh: Array, there: Array) -> float:
    """Return the mean error (mm) at validation poses of nominal links with base and tool fitted, without noise."""
    campaigns = align(fitted.stacked, joints, exact[None], fitted.nominal)
    placing = base_set(
        fitted.stacked.arm, fitted.nominal, fix=names_of(each for each in fitted.stacked.arm.parameters if each.is_link)
    ).identifiable
    found = fit_points(campaigns, fitted.nominal, placing, block=1)
    return float(_errors(fitted, fresh, found.values, in_nominal_frame(there, campaigns.Ts_instrument_nominal)).mean())


def _errors(fitted: _Fitted, fresh: Array, values: Array, exact: Array) -> Array:
    """Return errors ``(b, k m)`` mm at validation poses ``(m, joints)``, with targets at ``(b, k, 3, m)``."""
    parts = []
    for at in range(0, len(values), _VALIDATED_TOGETHER):
        part = slice(at, at + _VALIDATED_TOGETHER)
        off = fitted.stacked.points(fresh, values[part]) - exact[part]
        parts.append(MM.of(np.sqrt((off**2).sum(axis=2)).reshape(len(off), -1)))
    errors = np.concatenate(parts)
    return errors[:, np.isfinite(errors).all(axis=0)]  # without poses where a fit's loops do not close


def _true_values(fitted: _Fitted, real: TrueRobot, Ts_instrument_nominal: Array) -> Array:
    """Return the robot's parameters ``(b, p)`` in the canonical gauge, with the base of each aligned campaign."""
    arm = fitted.stacked.arm
    found = truth_of(real, arm)
    truth = np.full(len(arm.names), np.nan) if found is None else found.of(arm.names)
    Ts = se3.inverse(Ts_instrument_nominal) @ arm.T_tracker_frame0(truth)
    values = np.tile(truth, (len(Ts), 1))
    values[:, :3], values[:, 3:6] = Ts[:, :3, 3], se3.log(Ts[:, :3, :3])
    return values


def _rms(values: Array) -> Array:
    """Return root mean squares ``(b,)`` of ``(b, f)``; NaN for no columns."""
    return np.sqrt((values**2).mean(axis=1)) if values.shape[1] else np.full(len(values), np.nan)


_LIBRARIES = ("mujoco", "numpy", "scipy", "pyarrow")


def origin_of(robot: str) -> dict[str, Any]:
    """Return the digest of the robot's files, and versions, on which a study's numbers depend."""
    versions = {name: metadata.version(name) for name in _LIBRARIES}
    versions |= {"python": platform.python_version(), "virtual-calibration-lab": __version__}
    return {"model_sha256": load_robot(robot).sha256, "versions": versions}


def difference(there: dict[str, Any], here: dict[str, Any]) -> str | None:
    """Describe the difference between two origins; None if they are equal."""
    files = there["model_sha256"] == here["model_sha256"]
    return other_version(there["versions"], here["versions"]) or (None if files else "other files of the robot")


def other_version(old: Mapping[str, str], new: Mapping[str, str]) -> str | None:
    """Describe the first package of another version; None if all versions are equal."""
    other = next((name for name in sorted({*old, *new}) if old.get(name) != new.get(name)), None)
    return None if other is None else f"{other} {old.get(other)}, not {new.get(other)}"
