"""Run the campaigns of a study: choose the poses of a cell, and solve all campaigns of some robots.

A campaign's row depends on the study's seed and on the numbers of its cell, robot and draw alone: a robot and its
tracker are drawn from the robot's own seed, the noise from the robot's and the draw's, and each robot's campaigns are
solved in blocks of their own. Least squares of points by geometry and groups of effects are solved together
(``GridCell.is_stacked``); any other campaign is identified alone (``identified``).
"""

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from lab.calibration.batched_fits import BatchFits, PointBatch, align, fit_points, in_nominal_frame, weighted
from lab.core import se3
from lab.core.errors import LabError, error_context
from lab.core.linear_model import whitening
from lab.core.random import Purpose, rng_for, seed_of
from lab.core.se3 import Array
from lab.core.units import MM
from lab.core.version import __version__
from lab.kinematics.effects.effect import PAYLOAD
from lab.kinematics.gauge import base_set
from lab.kinematics.model import Model, RigidArm
from lab.kinematics.parameter import names_of
from lab.kinematics.serial.serial_arm import DEFAULT_TOOL, Stacked, stacked
from lab.library.virtual_arm import draw_conditions, perturbed_arm, poses_to_measure, requested_conditions, truth_of
from lab.noise.instruments import Instrument, instrument, is_isotropic, observing
from lab.options.option_groups import Effects
from lab.options.virtual_campaign import DesignOptions, VirtualCampaign
from lab.planning.design_problem import pose_problem
from lab.planning.design_search import best_design
from lab.pose_selection.criteria import CRITERIA, Criterion, criterion, refuse_unknown
from lab.robots.load_robot import load_robot, load_virtual
from lab.robots.robot import Robot
from lab.simulation.collisions import random_poses
from lab.simulation.effects import true_parameters
from lab.simulation.tracking import misalignments, track
from lab.simulation.true_robot import TrueRobot
from lab.studies.grid import ANY, NONE, GridCell, Study, Task
from lab.studies.identified import NOT_CONVERGED, RANK_DEFICIENT, identified_campaigns, parameter_errors

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
_TRIED = 3  # poses, at which payloads are to change something
_VALIDATED_TOGETHER = 5  # campaigns, to fit the processor's cache
_Columns = dict[str, Array]
COLUMNS = {  # of every campaign's row, and what they mean
    "cell": "number of the cell, from 0 (manifest.json says which)",
    "robot": "number of the perturbed robot, from 0; the same number is the same robot in every cell",
    "draw": "number of the noise draw, from 0; the same number is the same noise in every cell",
    "converged": "whether the calibration succeeded: Gauss-Newton converged, and the poses show all parameters",
    "steps": "how many steps it took",
    "fresh_mean_mm": "mean position error over the validation poses, without noise",
    "fresh_p95_mm": "95 % of these errors are smaller",
    "fresh_worst_mm": "largest of these errors",
    "length_rms_mm": "root mean square error of the identified lengths, of base and tool too; parameters that no "
    "measurement can tell apart from others stay at nominal, in the arm's true values too",
    "angle_rms_mrad": "the same of the identified angles",
    "link_length_rms_mm": "the same of the lengths of the arm's own dimensions, without base, tool and effects",
    "link_angle_rms_mrad": "the same of the angles of the arm's own dimensions",
    "mixed_rms": "the same of all identified parameters, in mm and rad as they are, as the thesis takes it",
    "nees": "squared parameter errors by their predicted covariance, a parameter: one on average",
    "before_mm": "mean position error over the validation poses with nominal links, base and tool fitted",
    "lost": "measured or validation poses that the robot cannot take, as its loops do not close there: left out",
    "failure": "why the calibration failed: not converged, rank deficient, or the reason of a refusal; empty if not",
}
METRICS = tuple(COLUMNS)[5:-2]
_RANK_TOLERANCE = 1e-12  # of the largest eigenvalue of J' J in unit columns


def refuse_impossible(study: Study) -> None:
    """Refuse an impossible study before any work begins.

    Raises:
        LabError: the robot cannot be loaded, or lacks a target, a parameter, an effect or a group of some cell; a
            criterion, a sensor or an instrument is unknown; a plan cannot be read; or a cell has too few poses.
    """
    robot = load_virtual(study.robot)
    robot.refuse_unknown(study.targets)
    for cell in study.cells:
        if cell.criterion != ANY:
            refuse_unknown(cell.criterion, _RANDOM)
    fitted: dict[GridCell, _Fitted] = {}
    for cell in study.cells:
        key = replace(cell, criterion=_RANDOM, scaling=ANY, poses=1, noise=1.0, plan=NONE)
        if key not in fitted:
            fitted[key] = _Fitted.of(study, cell, robot)
            options = fitted[key].options(study)
            options.check()
            perturbed_arm(robot, options)
            _refuse_idle_payloads(study, fitted[key], options.effects.payload_kg)
        if cell.plan != NONE:
            joints = _planned(study, cell, robot)
            _refuse_idle_payloads(study, fitted[key], joints[:, robot.chain.size :].ravel().tolist())
        elif cell.is_stacked:
            _refuse_few_poses(cell.poses, fitted[key])


def _refuse_idle_payloads(study: Study, fitted: "_Fitted", loads: Sequence[float]) -> None:
    """Refuse payloads that change neither a cell's arms nor its model.

    Raises:
        LabError: they do not, or the arm lacks an effect.
    """
    options = fitted.options(study)
    if not any(loads) or PAYLOAD in requested_conditions(fitted.robot, replace(options, effects=Effects())):
        return
    real = perturbed_arm(fitted.robot, options)
    joints = random_poses(real.robot, _TRIED, rng_for(study.seed, "poses"))
    conditions = _conditions(real, options, joints, _AT_POSES, (PAYLOAD,))
    without, loaded = (
        real.points(joints, options.targets, conditions | {PAYLOAD: np.full(_TRIED, load)})
        for load in (0.0, max(loads))
    )
    if np.array_equal(without, loaded, equal_nan=True):
        named = f"[effects.{fitted.cell.effects}]" if fitted.cell.effects != NONE else "a rigid arm"
        raise LabError(
            f"payload_kg: {named} does not deflect under a load, so payloads change nothing; give it an effect such as "
            "stiffness_nm_per_rad, or leave payload_kg out"
        )


def cell_poses(study: Study, cell: GridCell) -> Array:
    """Return the poses ``(n, joints)`` of every campaign of a cell: of its plan, or chosen for the nominal model.

    They are designed for the usual parameters, whatever is then identified. A plan with payloads has a further column
    of these, kg.

    Raises:
        LabError: there are fewer than the identifiable parameters need, or the plan cannot be measured.
    """
    robot = load_virtual(study.robot)
    if cell.plan != NONE:
        return _planned(study, cell, robot)
    targets = _targets(study, cell, robot)
    if cell.is_stacked:
        _refuse_few_poses(cell.poses, _Fitted.of(study, cell, robot))
    if cell.criterion == _RANDOM:
        return random_poses(robot.model, cell.poses, rng_for(study.seed, "poses"))
    requested = DesignOptions(
        robot=study.robot,
        poses=cell.poses,
        criterion=cell.criterion,
        scaling="whitened" if cell.scaling == ANY else cell.scaling,
        targets=targets,
        instrument=cell.instrument,
        candidates=CANDIDATES,
        starts=STARTS,
        seed=study.seed,
    )
    own = None if requested.criterion in CRITERIA else criterion(requested.criterion, 0)
    return _designed(requested, own).copy()


def _planned(study: Study, cell: GridCell, robot: Robot) -> Array:
    """Read the poses of a cell's plan."""
    options = VirtualCampaign(
        robot=study.robot,
        plan=Path(cell.plan),
        targets=_targets(study, cell, robot),
        effects=study.effects_of(cell),
    )
    with error_context("factor plan"):
        joints, conditions, _ = poses_to_measure(robot, options)
        loads = conditions.pop(PAYLOAD, None)
        if conditions:
            raise LabError(f"{cell.plan}: a study takes no column {next(iter(conditions))} from a plan; remove it")
    if cell.is_stacked:
        _refuse_few_poses(len(joints), _Fitted.of(study, cell, robot))
    return joints if loads is None else np.column_stack([joints, loads])


def _targets(study: Study, cell: GridCell, robot: Robot) -> tuple[str, ...]:
    """Return the targets of a cell: the study's, then the robot's others.

    Raises:
        LabError: the robot has fewer.
    """
    known = tuple(dict.fromkeys([*study.targets, *(robot.tool or DEFAULT_TOOL)]))
    if cell.targets > len(known):
        raise LabError(f"factor targets {cell.targets}: robot {robot.name} has {len(known)}: {', '.join(known)}")
    return known[: cell.targets]


def _refuse_few_poses(poses: int, fitted: "_Fitted") -> None:
    needed = -(-len(fitted.free) // (3 * len(fitted.targets)))
    if poses < needed:
        raise LabError(f"factor poses: {poses} poses cannot show the parameters: give {needed} or more")


@lru_cache(maxsize=16)
def _designed(requested: DesignOptions, own: Criterion | None) -> Array:
    """Design poses; cached, as cells that differ in the arm alone share them.

    Args:
        own: the criterion of the request that is not the lab's: another one may have its name later.
    """
    assert requested.poses is not None
    return best_design(requested, pose_problem(requested), requested.poses).joints


def run_task(study: Study, task: Task, joints: Array) -> _Columns:
    """Run all campaigns of a task, a row each, with the columns of ``COLUMNS``.

    Args:
        joints: the cell's poses (``cell_poses``).
    """
    robot, cell = load_virtual(study.robot), study.cells[task.cell]
    fitted = _Fitted.of(study, cell, robot)
    joints, loads = joints[:, : robot.chain.size], joints[:, robot.chain.size :]
    set_there = {PAYLOAD: loads[:, 0]} if loads.size else {}
    fresh = random_poses(robot.model, study.fresh, rng_for(study.seed, "fresh"))
    campaigns = _of_robot if cell.is_stacked else _of_robot_alone
    rows = [campaigns(study, fitted, number, joints, fresh, set_there) for number in range(task.first, task.last)]
    columns = {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
    numbers = np.repeat(np.arange(task.first, task.last, dtype=np.int32), study.draws)
    draws = np.tile(np.arange(study.draws, dtype=np.int32), task.last - task.first)
    return {"cell": np.full(len(numbers), task.cell, dtype=np.int32), "robot": numbers, "draw": draws, **columns}


@dataclass(frozen=True)
class _Fitted:
    """Model and parameters that are identified in a cell.

    Attributes:
        rigid: the geometry.
        stacked: the model, of all campaigns with a robot.
        nominal: parameters ``(p,)`` of the nominal model before the nominal tracker.
        free: the identified ones, where campaigns are solved together.
        placed: whether the base is identified, so that the points may be aligned.
        device: the instrument, with the noise of the cell.
    """

    robot: Robot
    cell: GridCell
    targets: tuple[str, ...]
    rigid: RigidArm
    stacked: Stacked
    nominal: Array
    free: tuple[int, ...]
    placed: bool
    device: Instrument

    @classmethod
    def of(cls, study: Study, cell: GridCell, robot: Robot) -> "_Fitted":
        requested, targets = study.fitting_of(cell), _targets(study, cell, robot)
        rigid, whole = robot.arm(targets), robot.model
        model: Model = robot.arm_with(targets, requested.groups) if cell.is_stacked else rigid
        nominal = np.zeros(len(model.names))
        nominal[: len(rigid.names)] = whole.values_before(rigid, whole.T_world_tracker)
        if cell.is_stacked:
            free = base_set(model, nominal, fix=requested.fix, free=requested.free).identifiable
        else:
            free = tuple(range(len(nominal)))
        device = _noisy(observing(instrument(cell.instrument), cell.observe), cell.noise)
        if study.frozen and not cell.is_stacked:
            raise LabError("frozen: campaigns that are identified one by one have no common Jacobian; leave it")
        if study.frozen and not is_isotropic(device):
            raise LabError(
                f"frozen: {device.name} weighs every arm otherwise, so one Jacobian cannot serve all; leave it"
            )
        return cls(robot, cell, targets, rigid, stacked(model), nominal, free, set(range(6)) <= set(free), device)

    @property
    def model(self) -> Model:
        """The fitted model."""
        return self.stacked.arm

    @property
    def has_effects(self) -> bool:
        """True if the model has groups beside the geometry."""
        return len(self.model.names) > len(self.rigid.names)

    @cached_property
    def placing(self) -> tuple[int, ...]:
        """Identifiable parameters of base and tool."""
        links = names_of(each for each in self.rigid.parameters if each.is_link)
        return base_set(self.rigid, self.nominal[: len(self.rigid.names)], fix=links).identifiable

    def options(self, study: Study, seed: int = 0) -> VirtualCampaign:
        """Return the options of the campaigns with one robot."""
        return VirtualCampaign(
            robot=study.robot,
            seed=seed,
            targets=self.targets,
            instrument=self.cell.instrument,
            observe=self.cell.observe,
            position_sigma_mm=self.cell.position_sigma_mm,
            rotation_sigma_mrad=self.cell.rotation_sigma_mrad,
            sampler=self.cell.sampler,
            fitting=study.fitting_of(self.cell),
            effects=study.effects_of(self.cell),
        )


def _noisy(device: Instrument, noise: float) -> Instrument:
    names = ("radial_m", "radial_per_m", "transverse_m", "transverse_per_m", "angle_rad")
    grown = {name: noise * getattr(device, name) for name in names if hasattr(device, name)}
    return replace(device, errors=device.errors.times(noise), **grown)


def _of_robot_alone(
    study: Study, fitted: _Fitted, number: int, joints: Array, fresh: Array, set_there: Mapping[str, Array]
) -> _Columns:
    """Identify each campaign with one robot alone."""
    options = fitted.options(study, seed_of(study.seed, "robots", number))
    return identified_campaigns(fitted.robot, options, fitted.device, study.draws, joints, fresh, set_there)


def _of_robot(
    study: Study, fitted: _Fitted, number: int, joints: Array, fresh: Array, set_there: Mapping[str, Array]
) -> _Columns:
    """Solve all campaigns with one robot together."""
    requested = fitted.options(study, seed_of(study.seed, "robots", number))
    real = perturbed_arm(fitted.robot, requested)
    conditions, later = (
        _conditions(real, requested, poses, purpose, fitted.model.conditions) | dict(there)
        for poses, purpose, there in ((joints, _AT_POSES, set_there), (fresh, _AT_FRESH, {}))
    )
    exact = real.points(joints, fitted.targets, conditions)
    there = real.points(fresh, fitted.targets, later)
    measured = _measured(real, fitted.device, requested, joints, study.draws, exact, set_there)
    taken, reached = (np.isfinite(points).all(axis=(1, 2)) for points in (exact, there))
    shown = _inputs(fitted.model, real.effects.shown(joints), conditions)[taken]
    inputs, new = _inputs(fitted.model, joints, conditions)[taken], _inputs(fitted.model, fresh, later)[reached]
    measured, exact, there = measured[:, taken], exact[taken], there[reached]
    campaigns = _aligned(fitted, real, shown, measured)
    fits = fit_points(campaigns, fitted.nominal, fitted.free, frozen=study.frozen)
    metrics = _metrics(fitted, real, fits, campaigns, new, there)
    before = _before(fitted, inputs[:, : joints.shape[1]], exact, new[:, : joints.shape[1]], there)
    lost = int((~taken).sum() + (~reached).sum())
    return {**metrics, "before_mm": np.full(study.draws, before), "lost": np.full(study.draws, lost, dtype=np.int32)}


def _inputs(model: Model, joints: Array, conditions: Mapping[str, Array]) -> Array:
    """Return a model's inputs ``(n, joints + conditions)``."""
    columns = [conditions[name][:, None] for name in model.conditions]
    return np.concatenate([joints, *columns], axis=1) if columns else joints


_AT_POSES: Final[Purpose] = "conditions"
_AT_FRESH: Final[Purpose] = "fresh"


def _conditions(
    real: TrueRobot, options: VirtualCampaign, joints: Array, purpose: Purpose, requested: Sequence[str] = ()
) -> dict[str, Array]:
    return draw_conditions(real, options, len(joints), rng_for(options.seed, purpose), requested)


def _measured(
    real: TrueRobot,
    device: Instrument,
    requested: VirtualCampaign,
    joints: Array,
    draws: int,
    exact: Array,
    set_there: Mapping[str, Array] = MappingProxyType({}),
) -> Array:
    """Simulate the tracker's readings of each draw, ``(draws, n, k, 3)`` m, of points ``(n, k, 3)`` m."""
    noises = [rng_for(requested.seed, "noise", draw) for draw in range(draws)]
    if real.effects.varies:
        conditions = _conditions(real, requested, joints, _AT_POSES) | dict(set_there)
        points = [track(real, joints, requested.targets, device, rng, conditions=conditions).points for rng in noises]
        return np.array(points)
    noisy = np.array([device.sample(exact, rng) for rng in noises])
    if not device.errors.stated:
        return noisy
    return noisy + [device.errors.sample(exact, misalignments(rng)) for rng in noises]


def _aligned(fitted: _Fitted, real: TrueRobot, shown: Array, measured: Array) -> PointBatch:
    """Align the campaigns with the nominal model, by the measured points, or by a fixed base.

    Args:
        shown: inputs ``(n, joints + conditions)`` of the model.
    """
    device = fitted.device
    if fitted.placed:
        campaigns = align(fitted.stacked, shown, measured, fitted.nominal)
    else:
        T = se3.inverse(real.T_world_tracker) @ real.robot.T_world_frame0
        Ts = np.broadcast_to(T, (len(measured), 4, 4))
        campaigns = PointBatch(fitted.stacked, shown, in_nominal_frame(measured, Ts), Ts)
    if is_isotropic(device):
        return campaigns
    return weighted(campaigns, whitening(device.covariance(measured)))


def _metrics(
    fitted: _Fitted, real: TrueRobot, fits: BatchFits, campaigns: PointBatch, fresh: Array, exact: Array
) -> _Columns:
    """Evaluate the campaigns with one robot.

    Args:
        exact: ``(m, k, 3)`` m, its true targets at the validation poses.
    """
    Ts = campaigns.Ts_instrument_nominal
    errors = _errors(fitted.stacked, fresh, fits.values, in_nominal_frame(exact, Ts))
    free = list(fitted.free)
    off = (fits.values - _true_values(fitted, real, Ts))[:, free]
    device = fitted.device
    sigma = 1.0 if campaigns.whiten is not None else device.isotropic_sigma()
    weight = 1 / sigma**2 if sigma else np.nan
    failure = _failures(fits, fitted)
    return {
        "converged": failure == "",
        "steps": fits.steps.astype(np.int32),
        "fresh_mean_mm": errors.mean(axis=1),
        "fresh_p95_mm": np.quantile(errors, 0.95, axis=1),
        "fresh_worst_mm": errors.max(axis=1),
        **parameter_errors(off, [fitted.model.parameters[i] for i in free]),
        "nees": weight * np.einsum("bf,bfg,bg->b", off, fits.information, off) / len(free),
        "failure": failure,
    }


def _failures(fits: BatchFits, fitted: _Fitted) -> NDArray[np.object_]:
    """Return why each fit failed, ``(b,)``; empty where it did not."""
    failure = np.where(fits.converged, "", NOT_CONVERGED).astype(object)
    scale = np.sqrt(np.diagonal(fits.information, axis1=1, axis2=2))
    checked = np.isfinite(fits.information).all(axis=(1, 2))
    if not fitted.has_effects:  # a base set of geometry that converged has its rank: not worth the time
        checked &= ~fits.converged
    failure[checked & (scale == 0).any(axis=1)] = RANK_DEFICIENT
    rows = np.flatnonzero(checked & (scale > 0).all(axis=1))
    sizes = np.linalg.eigvalsh(fits.information[rows] / (scale[rows, :, None] * scale[rows, None, :]))
    failure[rows[sizes[:, 0] < _RANK_TOLERANCE * sizes[:, -1]]] = RANK_DEFICIENT
    return failure


def _before(fitted: _Fitted, joints: Array, exact: Array, fresh: Array, fresh_points: Array) -> float:
    """Return the mean error (mm) at validation poses of nominal links with base and tool fitted, without noise."""
    rigid, nominal = stacked(fitted.rigid), fitted.nominal[: len(fitted.rigid.names)]
    campaigns = align(rigid, joints, exact[None], nominal)
    fits = fit_points(campaigns, nominal, fitted.placing, block=1)
    return float(
        _errors(rigid, fresh, fits.values, in_nominal_frame(fresh_points, campaigns.Ts_instrument_nominal)).mean()
    )


def _errors(arms: Stacked, fresh: Array, values: Array, exact: Array) -> Array:
    """Return errors ``(b, k m)`` mm at inputs ``(m, joints + conditions)``, with targets at ``(b, k, 3, m)``."""
    parts = []
    for at in range(0, len(values), _VALIDATED_TOGETHER):
        part = slice(at, at + _VALIDATED_TOGETHER)
        off = arms.points(fresh, values[part]) - exact[part]
        parts.append(MM.of(np.sqrt((off**2).sum(axis=2)).reshape(len(off), -1)))
    errors = np.concatenate(parts)
    return errors[:, np.isfinite(errors).all(axis=0)]  # without poses where a fit's loops do not close


def _true_values(fitted: _Fitted, real: TrueRobot, Ts_instrument_nominal: Array) -> Array:
    """Return the robot's parameters ``(b, p)`` in the canonical gauge, with the base of each aligned campaign."""
    names, found = fitted.model.names, truth_of(real, fitted.rigid)
    if found is None:
        truth = np.full(len(names), np.nan)
    else:
        truth = replace(found, effects=true_parameters(real.effects)).of(names)
    Ts = se3.inverse(Ts_instrument_nominal) @ fitted.rigid.T_tracker_frame0(truth[: len(fitted.rigid.names)])
    values = np.tile(truth, (len(Ts), 1))
    values[:, :3], values[:, 3:6] = Ts[:, :3, 3], se3.log(Ts[:, :3, :3])
    return values


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
