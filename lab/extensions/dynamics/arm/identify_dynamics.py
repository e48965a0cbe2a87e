"""Identify the base dynamic parameters of an arm, and of a load that it carried, by weighted least squares.

Torques of an empty and of a loaded run are rows of one fit: the load's ten columns are zero in the empty run, which
separates the arm's parameters from the load's. The noise of each drive is estimated with the parameters
(``regression``), and the residuals are tested for likely biases.

The regressor is computed at the file's own rate, from positions that are smoothed and differentiated there, and only
then filtered and decimated as the torques are (``filtering``): friction that changes its sign between two retained rows
passes the filter as the torque did. Long runs are computed part by part.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core.checks import Check
from lab.core.errors import LabError
from lab.core.linear_model import p_value_of_squares
from lab.core.se3 import Array
from lab.extensions.dynamics.arm.base_parameters import BaseParameters
from lab.extensions.dynamics.filtering import BAND_HZ, Band, band_of
from lab.extensions.dynamics.load_files import PayloadSamples
from lab.extensions.dynamics.payload.methods import from_torques
from lab.extensions.dynamics.payload.payload_estimate import LoadEstimate, Nuisance, estimate_of
from lab.extensions.dynamics.payload.physical_consistency import BodyCone, WeightedTarget
from lab.extensions.dynamics.regression import (
    BiasCandidate,
    ChannelSolution,
    EvenSamples,
    check_residuals,
    least_squares,
)
from lab.kinematics.dynamics.rigid_body import (
    LOAD,
    ArmDynamics,
    diagonal_matrices,
    directions,
    flange_in_last_link,
    load_in_frame,
)
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = [
    "DynamicModel",
    "DynamicsEstimate",
    "PhysicalFit",
    "ThinnedRun",
    "fit_runs",
    "identify_dynamics",
    "nearest_physical_arm",
    "predict",
    "thinned_run",
]

_PART = 4000  # rows of a file that are computed at a time
_STILL = 1e-3  # rad or m
_GAP = 8  # retained rows between two parts of a run, so that no filter reaches from one into the other
_MAX_ITERATIONS, _CONVERGED_S = 10, 1e-7
_LOAD_SIZE = len(LOAD)
_SAME = 0.1  # standard deviations: parameters that are nearer are those identified
_DEFAULTS = {"Ia": 0.1, "Fc": 1.0, "Fv": 1.0, "Fcm": 1.0, "Fvm": 1.0}  # reference values where none are given, SI
_BALL_KG, _BALL_M = 2.0, 0.1  # of each link, where no masses are given


@dataclass(frozen=True)
class DynamicModel:
    """A robot's inverse dynamic model with its base parameters.

    Attributes:
        chain: of the robot's table; a load is given in its last frame, the flange.
        arm: the inverse dynamic model.
        base: its base parameters.
    """

    chain: Chain
    arm: ArmDynamics
    base: BaseParameters

    @cached_property
    def _load(self) -> Array:
        """Matrix ``(10, 10)`` from a load at the flange to parameters of the last link."""
        return load_in_frame(flange_in_last_link(self.chain))

    def columns(self, joints: Array, speeds: Array, accelerations: Array) -> Array:
        """Return the regressor ``(n, J, 10 + b)`` of a load at the flange and of the base parameters."""
        standard = self.arm.regressor(joints, speeds, accelerations)
        load = standard[..., self.arm.bodies()[-1]] @ self._load
        return np.concatenate([load, standard[..., self.base.independent]], axis=2)

    def torques(self, values: Array, motion: tuple[Array, Array, Array]) -> Array:
        """Return the drives' torques ``(n, J)`` by base parameters ``(b,)`` along a motion."""
        joints, speeds, accelerations = motion
        found = np.empty_like(joints)
        for first in range(0, len(joints), _PART):
            at = slice(first, first + _PART)
            regressor = self.arm.regressor(joints[at], speeds[at], accelerations[at])
            found[at] = regressor[..., self.base.independent] @ values
        return found


@dataclass(frozen=True)
class ThinnedRun:
    """A run of a recording, filtered and decimated.

    Attributes:
        loaded: whether it carried the load.
        band: of the decimation filter.
        columns: ``(3, k, J, 10 + b)``, those of ``DynamicModel`` with their first two derivatives in time.
        torques: ``(n, J)`` as recorded, at the rows of ``motion``.
        speeds: ``(n, J)``.
        start_s: of the file's first row.
        first, last: range of the retained rows in use.
    """

    loaded: bool
    band: Band
    columns: Array
    torques: Array
    speeds: Array
    start_s: float
    first: int = 0
    last: int | None = None

    def measured(self, late_s: float = 0.0) -> Array:
        """Return the torques ``(k, J)``, at this delay after the positions."""
        return self.band.decimated(self.torques, late_s)[self.first : self.last]

    def rows(self, order: int = 0) -> Array:
        """Return the columns ``(k, J, 10 + b)``, or their derivative in time."""
        rows: Array = self.columns[order, self.first : self.last]
        return rows

    def times(self) -> Array:
        """Return the times ``(k,)`` s of the retained rows."""
        return np.asarray(self.start_s + self.band.times(self.columns.shape[1])[self.first : self.last])

    def thinned(self, values: Array) -> Array:
        """Decimate values ``(n, ...)`` at the rows of ``motion``."""
        return self.band.decimated(values)[self.first : self.last]

    def split(self, share: float) -> tuple["ThinnedRun", "ThinnedRun"]:
        """Split the run into its beginning and the share at its end.

        Raises:
            LabError: one of them would have too few rows.
        """
        count = self.columns.shape[1]
        cut = round(count * (1 - share))
        if cut - _GAP < 2 or count - cut < 2:
            raise LabError(f"a run of {count} independent rows cannot be held out by {share:g}: record a longer one")
        return replace(self, last=cut - _GAP), replace(self, first=cut)


def thinned_run(model: DynamicModel, samples: PayloadSamples, loaded: bool, band_hz: float = BAND_HZ) -> ThinnedRun:
    """Filter and decimate one run of a recording.

    Raises:
        LabError: torques or times are missing, nothing moves, or the run is too short.
    """
    run = samples.run(loaded)
    if run.torques is None or run.time_s is None:
        raise LabError("an arm is identified from torques along a motion: give time_s and the torques of every joint")
    if float(np.ptp(run.joints, axis=0).max()) < _STILL:
        raise LabError("the joints stand still: an arm's dynamics show in a motion alone")
    band = band_of(run.time_s, band_hz)
    motion = band.motion(run.joints)
    reach = len(band.impulse)
    count = 1 + (len(motion[0]) - reach) // band.every
    step, parts = max(1, _PART // band.every), []
    for first in range(0, count, step):
        last = min(first + step, count)
        at = slice(first * band.every, (last - 1) * band.every + reach)
        columns = model.columns(*(each[at] for each in motion))
        parts.append(np.array([band.decimated(columns, order=order) for order in range(3)]))
    columns = np.concatenate(parts, axis=1)
    assert columns.shape[3] == len(LOAD) + model.base.size
    return ThinnedRun(loaded, band, columns, band.trimmed(run.torques), motion[1], float(run.time_s[0]))


def _check_residuals(
    model: DynamicModel,
    runs: Sequence[ThinnedRun],
    solution: ChannelSolution,
    columns: Sequence[Array],
    *,
    given_load: Array | None,
    delay: bool,
) -> Check:
    """Test the residuals of a fit.

    Args:
        columns: fitted columns ``(n, J, c)``, and their first two derivatives in time.
        given_load: of the loaded run, where it was not fitted.
        delay: whether a delay was fitted.
    """
    fitted = solution.values[: columns[0].shape[2]]
    candidates = [BiasCandidate((columns[2] @ fitted)[..., None], "arm.filter")]
    if not delay:
        candidates.append(BiasCandidate((columns[1] @ fitted)[..., None], "arm.delay"))
    signs = np.concatenate([run.thinned(directions(run.speeds)) for run in runs])
    if model.arm.friction:
        # by fitted torques: the noise of recorded ones would be that of the residuals
        candidates.append(BiasCandidate(diagonal_matrices(np.abs(columns[0] @ fitted) * signs), "arm.load_friction"))
    else:
        speeds = np.concatenate([run.thinned(run.speeds) for run in runs])
        friction = np.concatenate([diagonal_matrices(signs), diagonal_matrices(speeds)], axis=2)
        candidates.append(BiasCandidate(friction, "arm.unmodelled_friction"))
    if given_load is not None and any(run.loaded for run in runs):
        loads = [run.rows()[..., : len(LOAD)] * float(run.loaded) for run in runs]
        candidates.append(BiasCandidate(np.concatenate(loads), "arm.load"))
    return check_residuals(solution, candidates, _series(runs))


def _series(runs: Sequence[ThinnedRun]) -> list[EvenSamples]:
    series, first = [], 0
    for run in runs:
        count = len(run.rows())
        series.append(EvenSamples(first, first + count, run.band.hz))
        first += count
    return series


@dataclass(frozen=True)
class TorquePrediction:
    """Prediction of torques that were not fitted, with its errors.

    Attributes:
        of: the predicted part of the motion.
        relative: ``(J,)`` residual of each drive's torque, relative to its root mean square.
        noise_ratio: ``(J,)`` root mean square of the residual, relative to the noise of the fit.
        total_relative, total_noise_ratio: ``relative`` and ``noise_ratio`` of all drives together.
        measured, predicted: ``(n, J)``.
    """

    of: str
    relative: Array
    noise_ratio: Array
    total_relative: float
    total_noise_ratio: float
    measured: Array
    predicted: Array

    @property
    def rows(self) -> int:
        """Number of independent rows."""
        return len(self.measured)


@dataclass(frozen=True)
class DynamicsEstimate:
    """The base parameters of an arm with 95 % intervals; NaN where they are not identified.

    Attributes:
        names: of the base parameters, b of them.
        values, sigma, half_width: ``(b,)`` in SI, with the standard deviations and the intervals' half-widths.
        covariance: ``(b, b)``; NaN where one is not identified.
        noise: ``(J,)`` standard deviation of one reading of each drive's torque, Nm (N of a slide).
        time_s: ``(n,)`` of the rows that were fitted, run by run.
        measured, residual: ``(n, J)`` torques of arm and estimated load, and the fit's residuals.
        delay: of the torques after the positions, where it was fitted.
        load: of the loaded run, fitted together with the arm; None without such a run, or where it was given.
        by_difference: the load from the loaded run less the unloaded one, where their paths are alike.
        predictions: of torques that were not fitted.
        verdict: the test of the residuals.
    """

    names: tuple[str, ...]
    values: Array
    sigma: Array
    half_width: Array
    covariance: Array
    noise: Array
    time_s: Array
    measured: Array
    residual: Array
    delay: Nuisance | None
    load: LoadEstimate | None
    by_difference: LoadEstimate | None
    predictions: tuple[TorquePrediction, ...]
    verdict: Check
    solution: ChannelSolution

    @property
    def identified(self) -> NDArray[np.bool_]:
        """Flags ``(b,)`` of the base parameters that the motion shows."""
        return np.isfinite(self.values)

    @property
    def adequate(self) -> bool | None:
        """True if noise explains the residuals; None where there are too few to test."""
        return None if self.verdict.outcome == "not tested" else self.verdict.outcome == "passed"

    @property
    def rows(self) -> int:
        """Number of fitted readings, each of which counts as independent."""
        return int(self.residual.size)

    @property
    def relative_sigma(self) -> Array:
        """Standard deviations ``(b,)`` relative to the values."""
        return np.asarray(self.sigma / np.maximum(np.abs(self.values), 1e-300))

    @property
    def relative_error(self) -> float:
        """Residual of the fitted torques, relative to their root mean square."""
        return float(np.sqrt((self.residual**2).sum() / (self.measured**2).sum()))


def identify_dynamics(
    model: DynamicModel,
    samples: PayloadSamples,
    *,
    given_load: Array | None = None,
    delay: bool = False,
    holdout: float = 0.0,
    other: PayloadSamples | None = None,
    band_hz: float = BAND_HZ,
) -> DynamicsEstimate:
    """Identify an arm from an unloaded run, and with it the load of a loaded run.

    Args:
        given_load: ``(10,)`` phi of the loaded run's load, about the flange; else it is estimated.
        delay: fit the delay of the torques after the positions.
        holdout: share at the end of each run that is predicted and not fitted.
        other: runs along another path, to be predicted.
        band_hz: of the filter in which torques are compared.

    Raises:
        LabError: no torques, no unloaded run, or too few samples.
    """
    runs = _runs(model, samples, given_load, band_hz)
    held: list[ThinnedRun] = []
    if holdout:
        pairs = [run.split(holdout) for run in runs]
        runs, held = [first for first, _ in pairs], [last for _, last in pairs]
    found = fit_runs(model, runs, given_load, delay=delay)
    predictions = []
    if held:
        predictions.append(predict(found, held, given_load, f"the last {100 * holdout:.3g} % of the path"))
    if other is not None:
        predictions.append(predict(found, _runs(model, other, given_load, band_hz), given_load, "another path"))
    return replace(
        found, predictions=tuple(predictions), by_difference=_by_difference(model, _beginning(samples, holdout), found)
    )


def fit_runs(
    model: DynamicModel, runs: Sequence[ThinnedRun], given_load: Array | None = None, *, delay: bool = False
) -> DynamicsEstimate:
    """Fit thinned runs, and test the residuals."""
    with_load = given_load is None and any(run.loaded for run in runs)
    columns = [np.concatenate([_design(run, with_load, order) for run in runs]) for order in range(3)]
    names = [*(LOAD if with_load else ()), *model.base.labels]
    solution, late = _fitted(runs, names, columns, given_load, delay)
    check = _check_residuals(model, runs, solution, columns, given_load=given_load, delay=delay)
    first = _LOAD_SIZE if with_load else 0
    chosen = slice(first, first + model.base.size)
    identified, covariance = solution.identifiable[chosen], solution.covariance
    widths = solution.half_widths(np.eye(len(solution.names)))
    gain = float(np.linalg.norm(runs[0].band.impulse))
    return DynamicsEstimate(
        names=model.base.labels,
        values=np.where(identified, solution.values[chosen], np.nan),
        sigma=np.where(identified, np.sqrt(np.diag(covariance)[chosen]), np.nan),
        half_width=np.where(identified, widths[chosen], np.nan),
        covariance=np.where(np.outer(identified, identified), covariance[chosen, chosen], np.nan),
        noise=solution.sigma / gain,
        time_s=np.concatenate([run.times() for run in runs]),
        measured=solution.measured,
        residual=solution.residual * solution.sigma,
        delay=Nuisance("delay", late, float(widths[-1]), "s") if delay else None,
        load=_load_of(solution, check, gain) if with_load else None,
        by_difference=None,
        predictions=(),
        verdict=check,
        solution=solution,
    )


def predict(
    estimate: DynamicsEstimate, runs: Sequence[ThinnedRun], given_load: Array | None, of: str
) -> TorquePrediction:
    """Predict the torques of runs that were not fitted."""
    late = estimate.delay.value if estimate.delay else 0.0
    parameters = np.where(estimate.identified, estimate.values, 0.0)
    load = given_load
    if load is None and estimate.load is not None:
        load = np.nan_to_num(estimate.load.phi)
    if load is None and any(run.loaded for run in runs):
        raise LabError("the path to predict carries a load that the fitted one did not: give it, or an unloaded run")
    measured = np.concatenate([run.measured(late) for run in runs])
    predicted = np.concatenate([_predicted(run, parameters, load) for run in runs])
    left = measured - predicted
    squares, sizes = (left**2).mean(axis=0), (measured**2).mean(axis=0)
    ratio = np.sqrt(squares) / estimate.solution.sigma
    return TorquePrediction(
        of,
        np.sqrt(squares / np.maximum(sizes, 1e-300)),
        ratio,
        float(np.sqrt(squares.sum() / sizes.sum())),
        float(np.sqrt((ratio**2).mean())),
        measured,
        predicted,
    )


def _predicted(run: ThinnedRun, parameters: Array, load: Array | None) -> Array:
    """Return the torques ``(k, J)`` of a run by the base parameters, and by a load that it carries."""
    rows = run.rows()
    torques = rows[..., _LOAD_SIZE:] @ parameters
    return np.asarray(torques + rows[..., :_LOAD_SIZE] @ load if run.loaded and load is not None else torques)


def _runs(
    model: DynamicModel, samples: PayloadSamples, given_load: Array | None, band_hz: float
) -> list[ThinnedRun]:  # fmt: skip
    """Return the thinned runs of a file, the unloaded one first."""
    present = [loaded for loaded in (False, True) if (samples.loaded == loaded).any()]
    if present == [True] and given_load is None:
        raise LabError(
            "there is a loaded run alone: its load cannot be told from the last link's parameters; record a run "
            "without the load too, or give what it is"
        )
    return [thinned_run(model, samples, loaded, band_hz) for loaded in present]


def _design(run: ThinnedRun, with_load: bool, order: int) -> Array:
    """Return the columns of a run's rows ``(k, J, c)``; a load's are zero in the unloaded run."""
    rows = run.rows(order)
    if not with_load:
        return rows[..., _LOAD_SIZE:]
    return rows if run.loaded else np.concatenate([0 * rows[..., :_LOAD_SIZE], rows[..., _LOAD_SIZE:]], axis=2)


def _measured(runs: Sequence[ThinnedRun], given_load: Array | None, late_s: float) -> Array:
    """Return the measured torques, less those of a given load."""
    parts = []
    for run in runs:
        torques = run.measured(late_s)
        if given_load is not None and run.loaded:
            torques = torques - run.rows()[..., :_LOAD_SIZE] @ given_load
        parts.append(torques)
    return np.concatenate(parts)


def _fitted(
    runs: Sequence[ThinnedRun],
    names: Sequence[str],
    columns: Sequence[Array],
    given_load: Array | None,
    delay: bool,
) -> tuple[ChannelSolution, float]:
    """Return the solution, and the delay (s) by Gauss-Newton steps, whose column is -X' p."""
    groups, late = [0] * columns[0].shape[1], 0.0
    solution = least_squares(names, columns[0], _measured(runs, given_load, late), groups)
    for _ in range(_MAX_ITERATIONS if delay else 0):
        moving = -(columns[1] @ solution.values[: len(names)])[..., None]
        design = np.concatenate([columns[0], moving], axis=2)
        solution = least_squares([*names, "delay"], design, _measured(runs, given_load, late), groups)
        late += float(solution.values[-1])
        if abs(late) > runs[0].band.every * runs[0].band.step_s:
            raise LabError(f"a delay of {1e3 * late:.3g} ms is too long: align torques and positions first")
        if abs(float(solution.values[-1])) < _CONVERGED_S:
            break
    return solution, late


def _load_of(solution: ChannelSolution, check: Check, gain: float) -> LoadEstimate:
    unidentified = tuple(
        f"{name} of the load" for name, seen in zip(LOAD, solution.identifiable, strict=False) if not seen
    )
    return estimate_of("arm and load at once", solution, {}, unidentified, check, gain)


def _beginning(samples: PayloadSamples, holdout: float) -> PayloadSamples:
    """Return the rows of each run before those that are held out."""
    rows = [np.flatnonzero(samples.loaded == loaded) for loaded in (True, False)]
    return samples.take(np.concatenate([each[: round(len(each) * (1 - holdout))] for each in rows]))


def _by_difference(model: DynamicModel, samples: PayloadSamples, found: DynamicsEstimate) -> LoadEstimate | None:
    """Estimate the load from the difference of the two runs, each less the identified arm's torques along its own path.

    None without an estimated load, or where the arm is not wholly identified.
    """
    if found.load is None or not found.identified.all() or samples.torques is None:
        return None
    couplings = model.arm.couplings

    def own(joints: Array, speeds: Array, accelerations: Array) -> Array:
        torques: Array = model.torques(found.values, (joints, speeds, accelerations)) @ couplings
        return torques

    flange = SerialArm(model.chain)
    of_joints = replace(samples, torques=samples.torques @ couplings)
    return from_torques(flange, flange.nominal(), of_joints, model.arm.gravity, own=own)


@dataclass(frozen=True)
class PhysicalFit:
    """Nearest physically consistent parameters of an arm.

    Attributes:
        standard: ``(p,)`` standard parameters with positive definite pseudo-inertias, and positive inertias of motors
            and friction; those that torques do not determine are near a reference.
        base: ``(b,)`` their base parameters.
        distance: from the identified parameters, in standard deviations (the root of the sum of squares).
        p: probability that noise alone moves an arm's estimate so far from physical parameters.
    """

    standard: Array
    base: Array
    distance: float
    p: float

    @property
    def physical(self) -> bool:
        """True if the identified parameters are physically consistent."""
        return self.distance < _SAME


def nearest_physical_arm(model: DynamicModel, found: DynamicsEstimate, links: Array | None = None) -> PhysicalFit:
    """Find the nearest physically consistent parameters of an arm.

    Args:
        links: ``(J, 10)`` phi of links like the arm's, in Khalil's frames, near which undetermined parameters are
            kept; balls of 2 kg where they are not given.

    Raises:
        LabError: some base parameter was not identified.
    """
    if not found.identified.all():
        raise LabError("not every base parameter is identified: there is nothing to make physical; move more joints")
    arm = model.arm
    positive = [i for i, name in enumerate(arm.names) if name.rstrip("0123456789") in _DEFAULTS]
    reference = _reference(arm, links)
    scale = found.sigma
    root = np.linalg.inv(np.linalg.cholesky(found.covariance / np.outer(scale, scale))) / scale
    aim = WeightedTarget(model.base.projection, found.values, root)
    standard = BodyCone(arm.bodies(), np.array(positive, dtype=np.int_), reference).nearest(aim, reference)
    distance = float(np.linalg.norm(aim.misfit(standard)))
    return PhysicalFit(
        standard, model.base.projection @ standard, distance, float(p_value_of_squares(distance**2, model.base.size))
    )


def _reference(arm: ArmDynamics, links: Array | None) -> Array:
    others = {name: _DEFAULTS[kind] for name in arm.names if (kind := name.rstrip("0123456789")) in _DEFAULTS}
    moment = 0.4 * _BALL_KG * _BALL_M**2
    ball = np.array([_BALL_KG, 0.0, 0.0, 0.0, moment, moment, moment, 0.0, 0.0, 0.0])
    return arm.standard(np.tile(ball, (arm.chain.size, 1)) if links is None else links, others)
