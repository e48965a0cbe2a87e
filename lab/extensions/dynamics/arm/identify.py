"""The base dynamic parameters of an arm by weighted least squares, with a load at once where one was carried.

Torques of an empty and of a loaded run are rows of one fit: the load's ten columns are zero where there was none, so
that the arm's and the load's parameters are told apart, each with its interval. The noise of each drive is estimated
with the parameters (``payload_identification.least_squares``), and the residuals are tested for what may bias them.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extensions.dynamics.arm.adequacy import residual_verdict
from lab.extensions.dynamics.arm.estimate import DynamicsEstimate, Prediction
from lab.extensions.dynamics.arm.runs import DynamicModel, ThinnedRun, thinned_run
from lab.extensions.dynamics.filtering import BAND_HZ
from lab.extensions.dynamics.load_samples import PayloadSamples
from lab.extensions.dynamics.payload.estimate import LoadEstimate, Nuisance, estimate_of
from lab.extensions.dynamics.payload.from_torques import from_torques
from lab.extensions.dynamics.regression import ChannelSolution, ResidualVerdict, least_squares
from lab.kinematics.dynamics.rigid_body import LOAD
from lab.kinematics.serial.arm import SerialArm

__all__ = ["fit_runs", "identify_dynamics", "predict"]

_ROUNDS, _SETTLED_S = 10, 1e-7
_SIZE = len(LOAD)


def identify_dynamics(
    model: DynamicModel,
    samples: PayloadSamples,
    *,
    known_load: Array | None = None,
    delay: bool = False,
    holdout: float = 0.0,
    other: PayloadSamples | None = None,
    band_hz: float = BAND_HZ,
) -> DynamicsEstimate:
    """Identify an arm from an unloaded run, and with it what a loaded run carries.

    Args:
        known_load: ``(10,)`` phi of what the loaded run carries, about the flange; else it is estimated.
        delay: fit how much later the torques are than the positions.
        holdout: the share at the end of each run that is predicted and not fitted.
        other: runs along another path, to be predicted.
        band_hz: of the filter in which torques are compared.

    Raises:
        LabError: no torques, no unloaded run, or too few samples.
    """
    runs = _runs(model, samples, known_load, band_hz)
    held: list[ThinnedRun] = []
    if holdout:
        pairs = [run.split(holdout) for run in runs]
        runs, held = [first for first, _ in pairs], [last for _, last in pairs]
    found = fit_runs(model, runs, known_load, delay=delay)
    predictions = []
    if held:
        predictions.append(predict(found, held, known_load, f"the last {100 * holdout:.3g} % of the path"))
    if other is not None:
        predictions.append(predict(found, _runs(model, other, known_load, band_hz), known_load, "another path"))
    return replace(
        found, predictions=tuple(predictions), by_difference=_by_difference(model, _beginning(samples, holdout), found)
    )


def fit_runs(
    model: DynamicModel, runs: Sequence[ThinnedRun], known_load: Array | None = None, *, delay: bool = False
) -> DynamicsEstimate:
    """The fit of thinned runs, and the tests of its residuals."""
    with_load = known_load is None and any(run.loaded for run in runs)
    columns = [np.concatenate([_design(run, with_load, order) for run in runs]) for order in range(3)]
    names = [*(LOAD if with_load else ()), *model.base.labels]
    solution, late = _fitted(runs, names, columns, known_load, delay)
    said = residual_verdict(model, runs, solution, columns, known_load=known_load, delay=delay)
    first = _SIZE if with_load else 0
    identified = solution.identifiable[first : first + model.base.size]
    widths = solution.half_widths(np.eye(len(solution.names)))
    covariance = solution.covariance
    chosen = slice(first, first + model.base.size)
    gain = float(np.linalg.norm(runs[0].band.impulse))
    late_found = Nuisance("delay", late, float(widths[-1]), "s") if delay else None
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
        delay=late_found,
        load=_load_of(solution, said, gain) if with_load else None,
        by_difference=None,
        predictions=(),
        verdict=said,
        solution=solution,
    )


def predict(found: DynamicsEstimate, runs: Sequence[ThinnedRun], known_load: Array | None, of: str) -> Prediction:
    """The torques of runs that were not fitted, by what was found."""
    late = found.delay.value if found.delay else 0.0
    parameters = np.where(found.identified, found.values, 0.0)
    load = known_load if known_load is not None else None if found.load is None else np.nan_to_num(found.load.phi)
    if load is None and any(run.loaded for run in runs):
        raise LabError("the path to predict carries a load that the fitted one did not: give it, or an unloaded run")
    measured = np.concatenate([run.measured(late) for run in runs])
    predicted = np.concatenate(
        [
            run.rows()[..., _SIZE:] @ parameters
            + (run.rows()[..., :_SIZE] @ load if run.loaded and load is not None else 0.0)
            for run in runs
        ]
    )
    left = measured - predicted
    squares, sizes = (left**2).mean(axis=0), (measured**2).mean(axis=0)
    ratio = np.sqrt(squares) / found.solution.sigma
    return Prediction(
        of,
        np.sqrt(squares / np.maximum(sizes, 1e-300)),
        ratio,
        float(np.sqrt(squares.sum() / sizes.sum())),
        float(np.sqrt((ratio**2).mean())),
        measured,
        predicted,
    )


def _runs(
    model: DynamicModel, samples: PayloadSamples, known_load: Array | None, band_hz: float
) -> list[ThinnedRun]:  # fmt: skip
    """The runs of a file, the unloaded one first."""
    there = [loaded for loaded in (False, True) if (samples.loaded == loaded).any()]
    if there == [True] and known_load is None:
        raise LabError(
            "there is a loaded run alone: its load cannot be told from the last link's parameters; record a run "
            "without the load too, or give what it is"
        )
    return [thinned_run(model, samples, loaded, band_hz) for loaded in there]


def _design(run: ThinnedRun, with_load: bool, order: int) -> Array:
    """The columns of a run's rows ``(k, J, c)``; a load's are zero where there was none."""
    rows = run.rows(order)
    if not with_load:
        return rows[..., _SIZE:]
    return rows if run.loaded else np.concatenate([0 * rows[..., :_SIZE], rows[..., _SIZE:]], axis=2)


def _measured(runs: Sequence[ThinnedRun], known_load: Array | None, late_s: float) -> Array:
    """What the columns are to explain: the torques less those of a load that is known."""
    parts = []
    for run in runs:
        torques = run.measured(late_s)
        if known_load is not None and run.loaded:
            torques = torques - run.rows()[..., :_SIZE] @ known_load
        parts.append(torques)
    return np.concatenate(parts)


def _fitted(
    runs: Sequence[ThinnedRun],
    names: Sequence[str],
    columns: Sequence[Array],
    known_load: Array | None,
    delay: bool,
) -> tuple[ChannelSolution, float]:
    """The solution, and the delay (s) that Gauss and Newton's steps find, whose column is -X' p."""
    groups, late = [0] * columns[0].shape[1], 0.0
    solution = least_squares(names, columns[0], _measured(runs, known_load, late), groups)
    for _ in range(_ROUNDS if delay else 0):
        moving = -(columns[1] @ solution.values[: len(names)])[..., None]
        design = np.concatenate([columns[0], moving], axis=2)
        solution = least_squares([*names, "delay"], design, _measured(runs, known_load, late), groups)
        late += float(solution.values[-1])
        if abs(late) > runs[0].band.every * runs[0].band.step_s:
            raise LabError(f"a delay of {1e3 * late:.3g} ms is too long: align torques and positions first")
        if abs(float(solution.values[-1])) < _SETTLED_S:
            break
    return solution, late


def _load_of(solution: ChannelSolution, said: ResidualVerdict, gain: float) -> LoadEstimate:
    unidentified = tuple(
        f"{name} of the load" for name, seen in zip(LOAD, solution.identifiable, strict=False) if not seen
    )
    return estimate_of("arm and load at once", solution, {}, unidentified, said, gain)


def _beginning(samples: PayloadSamples, holdout: float) -> PayloadSamples:
    """The rows of each run before those that are held out."""
    rows = [np.flatnonzero(samples.loaded == loaded) for loaded in (True, False)]
    return samples.take(np.concatenate([each[: round(len(each) * (1 - holdout))] for each in rows]))


def _by_difference(model: DynamicModel, samples: PayloadSamples, found: DynamicsEstimate) -> LoadEstimate | None:
    """The load from the difference of the two runs, each less what the arm found would ask along its own path.

    None where the runs are of other lengths, or the arm is not wholly identified.
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
