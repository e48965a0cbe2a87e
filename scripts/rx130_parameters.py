"""The parameters of a virtual RX 130, identified from poses by the global and by the sequential method.

The arm stands in MuJoCo. One session gives the table: every parameter by both methods, with its 95 % interval.
Then the noise is drawn many times for several arms, and each interval of each method holds the truth or does not. The
intervals of the sequential method have the errors of the angles in those of the lengths.
"""

from dataclasses import dataclass

import numpy as np
from observation_coverage import MeasuredArm, measured_arm
from shared import Answer, Document, Flag, Paragraph, Section, Table, run_script, short

from lab.calibration.gauss_newton import Fit, fit
from lab.calibration.observation import observation_of
from lab.calibration.sequential import fit_sequentially
from lab.calibration.weights import Noise, weigh
from lab.core.errors import LabError
from lab.core.limits import positive
from lab.core.linear_model import half_width_95
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.noise.instruments import PoseInstrument
from lab.render.document import digits_of, fixed

METHODS = ("global", "sequential")


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: int = 20
    """Virtual arms; the table is of the first."""
    draws: int = 50
    """Of the noise, for each arm."""
    poses: int = 60
    """That are measured of each."""
    noise_mm: float = 0.1
    """Noise of a position, 1 sigma per axis."""
    noise_mrad: float = 0.3
    """Noise of an orientation, 1 sigma per axis."""
    robot: str = "rx130"
    """Which arm."""
    seed: int = 0
    """Of the first arm; the others have those after it."""
    json: Flag = False
    """Print one JSON object."""

    @property
    def device(self) -> PoseInstrument:
        """What measures the poses."""
        return PoseInstrument(
            "poses", "gaussian", radial_m=1e-3 * self.noise_mm, rotation_rad=1e-3 * self.noise_mrad
        )  # fmt: skip


def arm_of(options: Options, number: int) -> MeasuredArm:
    """One of the arms with its poses."""
    return measured_arm(options.robot, "pose", options.device, options.poses, options.seed + number)


def identified(arm: MeasuredArm, rng: np.random.Generator) -> tuple[Fit, Fit]:
    """The global and the sequential fit of the arm's poses with new noise.

    Raises:
        LabError: one of them did not converge.
    """
    model, data = arm.noisy(rng)
    observation = observation_of(model)
    observed, _ = weigh(observation, data, Noise(arm.device))
    free, start = arm.exact.fit.free, arm.exact.nominal_aligned
    both = fit(model, observed, free, start), fit_sequentially(observation, observed, free, start)
    if any(each.status != "converged" for each in both):
        raise LabError("a fit did not converge: give more --poses, or less noise")
    return both


def covered(options: Options) -> dict[str, dict[str, float]]:
    """How often the 95 % intervals of each method hold, over all arms and draws, and how sure the parameters are."""
    held: dict[str, list[Array]] = {name: [] for name in METHODS}
    squares: dict[str, list[Array]] = {name: [] for name in METHODS}
    widths: dict[str, list[Array]] = {name: [] for name in METHODS}
    for number in range(options.robots):
        arm = arm_of(options, number)
        rng, free = rng_for(options.seed, "noise", number), list(arm.exact.fit.free)
        for _ in range(options.draws):
            for name, found in zip(METHODS, identified(arm, rng), strict=True):
                sigma = np.sqrt(np.diag(found.unit_covariance()))
                z = (found.values - arm.truth)[free] / sigma
                held[name].append((np.abs(z) < half_width_95(np.inf)).astype(np.float64))
                squares[name].append(z**2)
                widths[name].append(sigma)
    return {
        name: {
            "campaigns": float(len(held[name])),
            "coverage_mean": float(np.mean(held[name])),
            "coverage_least": float(np.mean(held[name], axis=0).min()),
            "coverage_largest": float(np.mean(held[name], axis=0).max()),
            "squares_by_variance": float(np.mean(squares[name])),
            "wider_than_global": float(np.mean(np.mean(widths[name], axis=0) / np.mean(widths["global"], axis=0))),
        }
        for name in METHODS
    }


def parameters(options: Options) -> list[dict[str, str | float]]:
    """A row for each parameter of the first arm: nominal, true, and by each method with the half-width of 95 %."""
    arm = arm_of(options, 0)
    fits = identified(arm, rng_for(options.seed, "noise"))
    model, free = arm.exact.model, arm.exact.fit.free
    deviations = [half_width_95(np.inf) * np.sqrt(np.diag(each.unit_covariance())) for each in fits]
    rows: list[dict[str, str | float]] = []
    for at, i in enumerate(free):
        unit = model.parameters[i].unit
        row: dict[str, str | float] = {"parameter": model.names[i], "unit": unit.name}
        row |= {"nominal": unit.of(float(arm.exact.nominal_aligned[i]))}
        row |= {"true": unit.of(float(arm.truth[i]))}
        for name, found, half in zip(METHODS, fits, deviations, strict=True):
            row |= {name: unit.of(float(found.values[i])), f"{name}_half_width": unit.of(float(half[at]))}
        rows.append(row)
    return rows


def answer(options: Options) -> Answer:
    """The table, and whether its intervals hold.

    Raises:
        LabError: too few robots, draws or poses, or a noise that is none.
    """
    positive("--noise-mm", options.noise_mm)
    positive("--noise-mrad", options.noise_mrad)
    if options.robots < 1 or options.draws < 2:
        raise LabError("give --robots 1 or more and --draws 2 or more")
    rows, coverage = parameters(options), covered(options)
    title = (
        f"A virtual {options.robot}, {options.poses} poses, noise {options.noise_mm:g} mm and {options.noise_mrad:g} "
        "mrad: the parameters by both methods"
    )
    return Answer({"parameters": rows, "coverage": coverage}, Document(title, (_table(rows), *_intervals(coverage))))


def _table(rows: list[dict[str, str | float]]) -> Table:
    cells = []
    for row in rows:
        halves = {name: float(row[f"{name}_half_width"]) for name in METHODS}
        most = max(digits_of(half, 6) for half in halves.values())
        values = (text for name in METHODS for text in (fixed(float(row[name]), most), fixed(halves[name], most)))
        known = (fixed(float(row[name]), most) for name in ("nominal", "true"))
        cells.append((str(row["parameter"]), str(row["unit"]), *known, *values))
    heads = ("parameter", "unit", "nominal", "true", "global", "±", "sequential", "±")
    caption = "Nominal base and tool are fitted to the poses. ±: half of each 95 % interval."
    return Table(heads, tuple(cells), caption)


def _intervals(coverage: dict[str, dict[str, float]]) -> tuple[Section]:
    cells = tuple((name, *(short(value) for value in row.values())) for name, row in coverage.items())
    heads = ("method", "campaigns", "held, mean", "least", "largest", "z², mean", "σ over the global one's, mean")
    words = "How often the 95 % intervals of the parameters hold the truth."
    return (Section("Do the intervals hold?", (Paragraph(words), Table(heads, cells))),)


if __name__ == "__main__":
    run_script("rx130_parameters")
