"""How well are an arm's dynamic parameters identified? A virtual TX 40 along a D-optimal path, many times.

Do the 95 % intervals hold, how well are the torques of another path predicted, does the test of the residuals tell what
biases a parameter by more than four of its standard deviations, and is a load better identified with the arm at once or
by the difference of two runs?
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import signal
from shared import Answer, Document, Flag, Paragraph, Section, Table, run_script, short

from lab.campaign.robot import load_virtual
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.dynamics.arm.base_parameters import base_parameters
from lab.extensions.dynamics.arm.identify import DynamicModel, ThinnedRun, fit_runs, predict, thinned_run
from lab.extensions.dynamics.load_files import PayloadSamples
from lab.extensions.dynamics.options import SimulationOptions
from lab.extensions.dynamics.payload.methods import from_torques
from lab.extensions.dynamics.simulated_session import MeasuringBench, simulated_load
from lab.extensions.dynamics.simulation import LoadBench
from lab.kinematics.dynamics.rigid_body import LOAD, ArmDynamics, directions
from lab.simulation.model_files import link_inertias

Row = dict[str, float | str]
ROBOT = load_virtual("tx40")
LOAD_KG = 1.5
_BISECTIONS = 10
SERVO = 3e-4  # rad/Nm by which the load shifts the path of the second case
ASKED = SimulationOptions(simulate=True, rate_hz=200.0)


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    runs: int = 1000
    """Measurements of the empty arm, for intervals and predictions."""
    power_runs: int = 200
    """Measurements with each thing that is wrong."""
    load_runs: int = 200
    """Measurements with and without a load."""
    rounds: int = 4
    """How long a path is sought: ascents from the best of some random ones."""
    sigmas: float = 4.0
    """By how many standard deviations the worst parameter is biased."""
    seed: int = 0
    """Of everything random."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Study:
    """A virtual arm on its bench, its designed path and another one.

    Attributes:
        empty, loaded, other: runs without noise, thinned: the designed path without and with the load, another path.
        exact: what was read on the designed path without noise, with the load and without it.
        noise: ``(J,)`` Nm, of one reading.
        truth: ``(b,)`` base parameters.
    """

    options: Options
    model: DynamicModel
    bench: MeasuringBench
    exact: PayloadSamples
    empty: ThinnedRun
    loaded: ThinnedRun
    other: ThinnedRun
    noise: Array
    truth: Array

    @property
    def runs(self) -> tuple[ThinnedRun, ThinnedRun]:
        """The designed path without and with the load."""
        return self.empty, self.loaded

    def noisy(self, run: ThinnedRun, rng: np.random.Generator, more: Array | float = 0.0) -> ThinnedRun:
        """The run with noise of its torques, and what is wrong with them ``(n, J)``."""
        return replace(run, torques=run.torques + more + self.noise * rng.standard_normal(run.torques.shape))


@dataclass(frozen=True)
class Bias:
    """Something that is wrong.

    Attributes:
        name: what it is.
        wrong: of a size, what it adds to the torques of the empty and of the loaded run ``(n, J)``.
        first: a size, from which the one that biases enough is sought.
        friction: whether the model has friction.
        known_load: whether the load is taken to be known.
    """

    name: str
    wrong: Callable[[Study, float], tuple[Array, Array]]
    first: float
    friction: bool = True
    known_load: bool = False


def _friction(study: Study, size: float) -> tuple[Array, Array]:
    """So many times the arm's friction, in the place of all of it."""
    errors = study.bench.errors()
    own = (errors.coulomb_nm * directions(run.speeds) + errors.viscous_nm_s * run.speeds for run in study.runs)
    empty, loaded = ((size - 1) * each for each in own)
    return empty, loaded


def _filtered(study: Study, size: float) -> tuple[Array, Array]:
    """A causal low-pass of first order with a time constant of so many s."""
    step = study.empty.band.step_s
    pole = float(np.exp(-step / size))

    def passed(torques: Array) -> Array:
        start = pole * torques[:1]  # settled before the run
        late: Array = signal.lfilter([1 - pole], [1, -pole], torques, axis=0, zi=start)[0]
        return late - torques

    empty, loaded = (run.band.trimmed(passed(_torques(study.exact, run.loaded))) for run in study.runs)
    return empty, loaded


def _heavier(study: Study, size: float) -> tuple[Array, Array]:
    """A load that is larger by this share than it is said to be."""
    return np.zeros_like(study.empty.torques), size * (study.loaded.torques - study.empty.torques)


BIASES = (
    Bias("friction that the model has not", _friction, 1e-3, friction=False),
    Bias("a filter of the torques alone", _filtered, 1e-5),
    Bias("a load other than the given one", _heavier, 1e-3, known_load=True),
)


def study_of(options: Options) -> Study:
    """Design the path, and drive it without noise.

    Raises:
        LabError: fewer than two runs.
    """
    if min(options.runs, options.power_runs, options.load_runs) < 2:
        raise LabError("give two runs or more of each: a scatter is asked for")
    asked = replace(ASKED, seed=options.seed, rounds=options.rounds)
    bench = MeasuringBench(ROBOT, asked, simulated_load(LOAD_KG, asked))
    model = _model(bench)

    def regressor(joints: Array, speeds: Array, accelerations: Array) -> Array:
        return model.columns(joints, speeds, accelerations)[..., len(LOAD) :]

    path, errors = bench.designed(regressor), bench.errors()
    quiet = LoadBench(ROBOT.serial_model, bench.load, bench.mounting, replace(errors, torque_noise_nm=0.0))
    exact, other = (
        replace(quiet.moving(each.at, asked.seconds, asked.rate_hz, rng_for(0, "noise")), wrench=None)
        for each in (path, bench.another())
    )
    runs = [thinned_run(model, exact, loaded) for loaded in (False, True)]
    truth = model.base.projection @ model.arm.standard(link_inertias(ROBOT.serial_model), bench.truth())
    noise = np.asarray(errors.torque_noise_nm)
    return Study(options, model, bench, exact, runs[0], runs[1], thinned_run(model, other, False), noise, truth)


def noise_free(study: Study) -> Row:
    """The largest errors without noise: of the base parameters, and of the load beside them (SI)."""
    found = fit_runs(study.model, [study.empty, study.loaded])
    assert found.load is not None and study.bench.load is not None
    return {
        "base_parameters": float(np.abs(found.values - study.truth).max()),
        "load": float(np.abs(found.load.phi - study.bench.load.phi).max()),
    }


def coverage(study: Study) -> tuple[list[Row], Row]:
    """A row for each parameter with its truth, relative standard deviation and coverage; and what holds of all."""
    rng, hits, squares, told, ratios, relative = rng_for(study.options.seed, "noise", 1), [], [], [], [], []
    sigmas = []
    for _ in range(study.options.runs):
        found = fit_runs(study.model, [study.noisy(study.empty, rng)])
        predicted = predict(found, [study.noisy(study.other, rng)], None, "another path")
        errors = found.values - study.truth
        hits.append(np.abs(errors) < found.half_width)
        squares.append((errors / found.sigma) ** 2)
        sigmas.append(found.sigma)
        told.append(found.adequate is False)
        ratios.append(predicted.total_noise_ratio)
        relative.append(predicted.total_relative)
    covered, sigma = np.mean(hits, axis=0), np.sqrt(np.mean(np.square(sigmas), axis=0))
    names = [study.model.base.names[i] for i in study.model.base.independent.tolist()]
    rows: list[Row] = [
        {"parameter": label, "unit": unit, "true": float(true), "sigma": float(spread), "covered": float(share),
         "relative_sigma": float(spread / abs(true)) if abs(true) > 1e-9 else float("inf")}
        for label, unit, true, spread, share in zip(
            study.model.base.labels, study.model.arm.units(names), study.truth, sigma, covered, strict=True
        )
    ]  # fmt: skip
    return rows, {
        "runs": float(study.options.runs),
        "covered_least": float(covered.min()),
        "covered_mean": float(covered.mean()),
        "covered_largest": float(covered.max()),
        "squares_by_variance": float(np.mean(squares)),
        "told_although_right": float(np.mean(told)),
        "prediction_error_by_noise": float(np.mean(ratios)),
        "prediction_error_by_noise_largest": float(np.max(ratios)),
        "prediction_relative": float(np.mean(relative)),
    }


def power(study: Study, biases: Sequence[Bias]) -> list[Row]:
    """A row for each thing that is wrong: its size, by how much it biases, and how often the residuals tell it."""
    rows: list[Row] = []
    for number, bias in enumerate(biases):
        model = study.model if bias.friction else _model(study.bench, friction=False)
        empty, loaded = (_of_model(study, model, each) for each in (False, True))
        known = study.bench.load.phi if bias.known_load and study.bench.load is not None else None
        runs = [empty, loaded] if bias.known_load else [empty]
        kept = [study.model.base.labels.index(name) for name in model.base.labels]
        truth = study.truth[kept]
        rng = rng_for(study.options.seed, "noise", 2, number)
        scatter = fit_runs(model, [study.noisy(run, rng, _right(bias, run, study)) for run in runs], known).sigma

        def biased(
            wrong: tuple[Array, Array], model: DynamicModel = model, runs: list[ThinnedRun] = runs,
            known: Array | None = known, truth: Array = truth, scatter: Array = scatter,
        ) -> float:  # fmt: skip
            spoilt = [replace(run, torques=run.torques + wrong[run.loaded]) for run in runs]
            return float(np.abs((fit_runs(model, spoilt, known).values - truth) / scatter).max())

        size, worst = _sized(study, bias, biased)
        wrong = bias.wrong(study, size)
        told = [
            fit_runs(model, [study.noisy(run, rng, wrong[run.loaded]) for run in runs], known).adequate is False
            for _ in range(study.options.power_runs)
        ]
        rows.append({"wrong": bias.name, "size": size, "bias_sigma": worst, "told": float(np.mean(told))})
    return rows


def loads(study: Study) -> list[Row]:
    """Errors of a load with the arm at once, and by difference of the runs, where the load shifts the path or not."""
    assert study.bench.load is not None
    rows: list[Row] = []
    for number, servo in enumerate((0.0, SERVO)):
        exact = study.exact if not servo else _shifted(study, servo)
        runs = [thinned_run(study.model, exact, loaded) for loaded in (False, True)]
        rng, found = rng_for(study.options.seed, "noise", 3, number), []
        arm = ROBOT.serial_arm(("p1",))
        values, gravity = arm.nominal(ROBOT.tool), study.bench.mounting.gravity
        for _ in range(study.options.load_runs):
            assert exact.torques is not None
            noise = study.noise * rng.standard_normal(exact.torques.shape)
            records = replace(exact, torques=exact.torques + noise)
            band = runs[0].band
            noisy = [replace(run, torques=band.trimmed(_torques(records, run.loaded))) for run in runs]
            once = fit_runs(study.model, noisy).load
            assert once is not None
            found.append((once.phi, from_torques(arm, values, records, gravity).phi))
        for i, way in enumerate(("with the arm at once", "by difference")):
            errors = np.array([_quantities(pair[i]) for pair in found]) - _quantities(study.bench.load.phi)
            rms = np.sqrt((errors**2).mean(axis=0))
            mean = np.abs(errors.mean(axis=0))
            rows.append({
                "way": way,
                "servo_rad_per_nm": servo,
                "mass_percent": float(100 * rms[0] / LOAD_KG),
                "centre_mm": float(1e3 * np.sqrt((rms[1:4] ** 2).mean())),
                "inertia_kgcm2": float(1e4 * np.sqrt((rms[4:] ** 2).mean())),
                "mass_bias_percent": float(100 * mean[0] / LOAD_KG),
                "centre_bias_mm": float(1e3 * np.sqrt((mean[1:4] ** 2).mean())),
            })  # fmt: skip
    return rows


def _model(bench: MeasuringBench, *, friction: bool = True) -> DynamicModel:
    chain = ROBOT.serial_model.chain
    arm = replace(ArmDynamics.of(chain, bench.mounting.gravity), friction=friction)
    return DynamicModel(chain, arm, base_parameters(arm, rng_for(0, "structure")))


def _of_model(study: Study, model: DynamicModel, loaded: bool) -> ThinnedRun:
    if model is study.model:
        return study.loaded if loaded else study.empty
    return thinned_run(model, study.exact, loaded)


def _right(bias: Bias, run: ThinnedRun, study: Study) -> Array | float:
    """What is added so that the model is right: nothing, or less all of the friction that it does not have."""
    return 0.0 if bias.friction else bias.wrong(study, 0.0)[run.loaded]


def _sized(
    study: Study, bias: Bias, biased: Callable[[tuple[Array, Array]], float]
) -> tuple[float, float]:  # fmt: skip
    """The least size found at which the worst parameter is biased by so many standard deviations; and how many."""
    low, high = 0.0, bias.first
    while (reached := biased(bias.wrong(study, high))) < study.options.sigmas:
        low, high = high, 1.5 * high
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        if (now := biased(bias.wrong(study, middle))) < study.options.sigmas:
            low = middle
        else:
            high, reached = middle, now
    return high, reached


def _shifted(study: Study, servo: float) -> PayloadSamples:
    """The designed path, of which the load shifts the loaded run."""
    bench, asked = study.bench, study.bench.options
    errors = replace(bench.errors(), torque_noise_nm=0.0, servo_rad_per_nm=servo)

    def regressor(joints: Array, speeds: Array, accelerations: Array) -> Array:
        return study.model.columns(joints, speeds, accelerations)[..., len(LOAD) :]

    path = bench.designed(regressor).at
    records = LoadBench(ROBOT.serial_model, bench.load, bench.mounting, errors).moving(
        path, asked.seconds, asked.rate_hz, rng_for(0, "noise")
    )
    return replace(records, wrench=None)


def _torques(records: PayloadSamples, loaded: bool) -> Array:
    torques = records.run(loaded).torques
    assert torques is not None
    return torques


def _quantities(phi: Array) -> Array:
    """Mass, centre of mass, inertia about the flange, ``(10,)`` SI."""
    return np.concatenate([phi[:1], phi[1:4] / phi[0], phi[4:]])


_ALIKE = 1.1  # times the other's error: what is closer is alike


def answer(options: Options) -> Answer:
    """All parts, one after another."""
    study = study_of(options)
    exact = noise_free(study)
    parameters, whole = coverage(study)
    biases, ways = power(study, BIASES), loads(study)
    values = {"noise_free": exact, "parameters": parameters, "coverage": whole, "power": biases, "loads": ways}
    return Answer(values | {"advice": advice(ways)}, _document(exact, parameters, whole, biases, ways))


def advice(ways: list[Row]) -> str:
    """Which way to identify a load, in a sentence."""
    best = []
    for servo in sorted({float(row["servo_rad_per_nm"]) for row in ways}):
        once, apart = (float(row["mass_percent"]) for row in ways if row["servo_rad_per_nm"] == servo)
        best.append("alike" if max(once, apart) < _ALIKE * min(once, apart) else "once" if once < apart else "apart")
    same, shifted = best
    first = {
        "alike": "both ways are as good",
        "once": "the fit with the arm is better",
        "apart": "the difference is better",
    }
    return (
        f"Where both runs are along one path {first[same]}, and where the load shifts the path {first[shifted]}: "
        + ("take the difference if only the load is asked for, else fit both at once." if shifted != "once" else
           "fit load and arm at once, unless the paths are known to be the same.")
    )  # fmt: skip


def _document(exact: Row, parameters: list[Row], whole: Row, biases: list[Row], ways: list[Row]) -> Document:
    return Document(
        "How well are an arm's dynamic parameters identified?",
        (
            Paragraph(
                f"Without noise the base parameters are off by {short(float(exact['base_parameters']))} at most, the "
                f"load by {short(float(exact['load']))} (SI)."
            ),
            Section("Intervals and predictions", (_table(whole),)),
            Section("Parameters", (_parameters(parameters),)),
            Section("What is told", (_biases(biases),)),
            Section("The load", (_ways(ways), Paragraph(advice(ways)))),
        ),
    )


def _table(row: Row) -> Table:
    return Table(("", ""), tuple((key.replace("_", " "), short(float(value))) for key, value in row.items()))


def _parameters(rows: list[Row]) -> Table:
    cells = tuple(
        (str(row["parameter"]), short(_true(row)), short(float(row["sigma"])), _relative(row), str(row["unit"]))
        for row in rows
    )
    return Table(("base parameter", "true", "σ", "relative σ", "unit"), cells)


def _true(row: Row) -> float:
    return float(row["true"]) if row["relative_sigma"] != float("inf") else 0.0


def _relative(row: Row) -> str:
    return "–" if row["relative_sigma"] == float("inf") else short(100 * float(row["relative_sigma"]), "%")


def _biases(rows: list[Row]) -> Table:
    numbers = [(float(row["size"]), float(row["bias_sigma"]), 100 * float(row["told"])) for row in rows]
    cells = tuple(
        (str(row["wrong"]), short(size), short(worst), short(told, "%"))
        for row, (size, worst, told) in zip(rows, numbers, strict=True)
    )
    return Table(("wrong", "size", "worst bias, σ", "told"), cells)


def _ways(rows: list[Row]) -> Table:
    names = ("servo_rad_per_nm", "mass_percent", "centre_mm", "inertia_kgcm2", "mass_bias_percent", "centre_bias_mm")
    cells = tuple((str(row["way"]), *(short(float(row[name])) for name in names)) for row in rows)
    heads = ("shift, rad/Nm", "mass, %", "centre, mm", "inertia, kg cm²", "mass, mean", "centre, mean")
    return Table(("RMS errors", *heads), cells)


if __name__ == "__main__":
    run_script("arm_dynamics")
