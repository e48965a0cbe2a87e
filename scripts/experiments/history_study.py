"""Does `lab history` keep its level over a year, name a joint whose zero moved, and cover by how much?

Virtual years of an IRB 120 that is measured once a month: 30 random poses, three targets, the uniform noise of 8 µm.
Base and tool are set up anew each time. The arm is taken to be linear in its parameters, which errors of a few
micrometres cannot tell from the truth; change points, levels and names are those of the command. In some years nothing
changes. In the others the zero of one joint moves once, before a month drawn at random (as many as are told are before
it); it is named where the first or the second calibration after it names that joint's zero and nothing else.

The coverage is that of the change's 95 % interval between two calibrations, where that joint's zero moved, and the
length of link 3 too, by some of its standard deviations: less than the test sees. Beside it stands the interval of the
least-squares estimate that takes the zero alone to have changed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np
from shared import Answer, Document, Flag, Section, Table, paragraphs, run_script

from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import TREND_YEAR
from lab.kinematics.gauge import base_set
from lab.prediction.estimate import IdentifiedSubset
from lab.robots.load_robot import load_robot
from lab.simulation.collisions import random_poses
from lab.verification.parameter_changes import CalibrationSeries, ChangeDirections

TARGETS = ("p1", "p2", "p3")
HALF_WIDTH_M = 8e-6  # of the uniform noise
JOINTS = (2, 3, 4, 5)
_MONTH = 365.25 / 12


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    years: int = 1000
    """Without a change; and as many with one for each of joints 2 to 5."""
    calibrations: int = 12
    """In a year."""
    earlier: int = 1
    """The fewest calibrations before the change."""
    poses: int = 30
    """Of a calibration."""
    moved_mrad: float = 0.1
    """How far the zero moves."""
    second: Sequence[float] = (0.0, 1.0, 2.0, 4.0)
    """How far link3.a changes as well, in standard deviations of its difference; of the coverage."""
    pose_sets: int = 100
    """From which the calibrations draw their poses."""
    seed: int = 0
    """Of all draws."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Months:
    """Sets of poses, and the least squares of each, for the parameters of the links.

    Attributes:
        names: of the links' parameters ``(f,)``.
        gains: of each set, from the noise of its measurements to their estimates ``(f, N)``.
        covariances: of each set ``(f, f)``.
    """

    names: tuple[str, ...]
    gains: tuple[Array, ...]
    covariances: tuple[Array, ...]

    @classmethod
    def of(cls, sets: int, poses: int, seed: int) -> "Months":
        """Of random poses."""
        robot = load_robot("irb120")
        arm, rng = robot.arm(TARGETS), rng_for(seed, "poses")
        values = arm.nominal(robot.tool)
        free = list(base_set(arm, values).identifiable)
        links = [k for k, i in enumerate(free) if arm.parameters[i].group not in ("base", "tool")]
        gains = []
        for _ in range(sets):
            _, jacobian = arm.observe(random_poses(robot.model, poses, rng), values)
            columns = jacobian[..., free].reshape(-1, len(free))
            size = np.linalg.norm(columns, axis=0)
            gains.append((np.linalg.pinv(columns / size) / size[:, None])[links])
        covariances = tuple(HALF_WIDTH_M**2 / 3 * (gain @ gain.T) for gain in gains)
        return cls(tuple(arm.names[free[k]] for k in links), tuple(gains), covariances)

    def estimates(self, shifts: Array, rng: np.random.Generator) -> list[IdentifiedSubset]:
        """Calibrations of an arm whose parameters are off by ``shifts`` ``(n, f)``."""
        estimates = []
        for shift in shifts:
            k = int(rng.integers(len(self.gains)))
            noise = rng.uniform(-HALF_WIDTH_M, HALF_WIDTH_M, self.gains[k].shape[1])
            values = shift + self.gains[k] @ noise
            angles = tuple(name.endswith(("theta", "alpha", "beta")) for name in self.names)
            estimates.append(IdentifiedSubset(self.names, values, self.covariances[k], angles))
        return estimates

    def series(self, shifts: Array, rng: np.random.Generator) -> CalibrationSeries:
        """Monthly calibrations of an arm whose parameters are off by ``shifts`` ``(n, f)``."""
        return self.series_of(self.estimates(shifts, rng))

    def series_of(self, estimates: Sequence[IdentifiedSubset]) -> CalibrationSeries:
        """The test of monthly calibrations."""
        one = ChangeDirections(self.names, np.eye(len(self.names)))
        return CalibrationSeries(estimates, [_MONTH * i for i in range(len(estimates))], one)


def unchanged_years(months: Months, options: Options) -> Iterator[bool]:
    """Of each year without a change, whether there was an alarm."""
    rng = rng_for(options.seed, "noise")
    for _ in range(options.years):
        yield bool(months.series(np.zeros((options.calibrations, len(months.names))), rng).change_points())


def named_within_two(months: Months, joint: int, options: Options) -> Iterator[tuple[bool, bool]]:
    """Of each year with a change, whether the joint was named alone by the second calibration after it, by the first.

    Args:
        joint: whose zero moves, counted from one.
    """
    rng, name = rng_for(options.seed + joint, "noise"), f"link{joint}.theta"
    at = months.names.index(name)
    for _ in range(options.years):
        before = int(rng.integers(options.earlier, options.calibrations - 1))
        named = []
        shifts = np.zeros((before + 2, len(months.names)))
        shifts[before:, at] = options.moved_mrad / 1e3
        series = months.series(shifts, rng)
        for count in (before + 2, before + 1):
            found = series.first(count).change_points()
            named.append(bool(found) and found[-1].after == before - 1 and found[-1].named == (name,))
        yield named[0] or named[1], named[1]


@dataclass(frozen=True)
class Coverage:
    """How often 95 % intervals cover a zero that moved, and half their mean width (mrad).

    Attributes:
        reported: the interval of the change that ``lab history`` reports; ``alone`` that which takes nothing else to
            have changed.
        found: in how many pairs of calibrations the change was found, with this zero among what is named.
    """

    reported: float
    reported_mrad: float
    alone: float
    alone_mrad: float
    found: int


def coverage(months: Months, joint: int, second: float, options: Options) -> Coverage:
    """Of pairs of calibrations with a change between them, how often the intervals of a joint's zero cover it.

    Args:
        joint: whose zero moves, counted from one.
        second: how far link3.a changes as well, in standard deviations of its difference.
    """
    rng, name = rng_for(options.seed + 10 * joint, "noise"), f"link{joint}.theta"
    at, other = months.names.index(name), months.names.index("link3.a")
    moved, rows = options.moved_mrad / 1e3, []
    std = np.sqrt(2 * np.mean([each[other, other] for each in months.covariances]))
    for _ in range(options.years):
        shifts = np.zeros((2, len(months.names)))
        shifts[1, [at, other]] = moved, second * std
        pair = months.estimates(shifts, rng)
        found = months.series_of(pair).change_points()
        if not found or name not in found[0].named:
            continue
        i = found[0].named.index(name)
        information = np.linalg.inv(pair[0].covariance + pair[1].covariance)
        difference = pair[1].values - pair[0].values
        size, half = (information @ difference)[at] / information[at, at], 1.96 / np.sqrt(information[at, at])
        reported = abs(found[0].changes[i] - moved) < found[0].half_widths[i]
        rows.append((reported, found[0].half_widths[i], abs(size - moved) < half, half))
    covered, width, alone, narrow = np.mean(rows, axis=0).tolist()
    return Coverage(covered, 1e3 * width, alone, 1e3 * narrow, len(rows))


def answer(options: Options) -> Answer:
    """The level over a year, how often each joint is named, and the coverage of a change's interval."""
    months = Months.of(options.pose_sets, options.poses, options.seed)
    raised = float(np.mean(list(unchanged_years(months, options))))
    shares = {joint: np.mean(list(named_within_two(months, joint, options)), axis=0).tolist() for joint in JOINTS}
    covered = {
        (joint, second): coverage(months, joint, second, options) for joint in (2, 4) for second in options.second
    }
    values = {
        "years": options.years,
        "level": TREND_YEAR,
        "raised": raised,
        "named": {f"joint{joint}": {"within_two": two, "at_once": one} for joint, (two, one) in shares.items()},
        "coverage": [{"joint": joint, "second": second, **asdict(each)} for (joint, second), each in covered.items()],
    }
    said = (
        f"{options.years:,} years of {options.calibrations} calibrations without a change: an alarm in "
        f"{100 * raised:.1f} % (at most {100 * TREND_YEAR:g} % are meant)."
    )
    rows = tuple((f"joint {joint}", f"{100 * one:.1f}", f"{100 * two:.1f}") for joint, (two, one) in shares.items())
    caption = f"A zero moved by {options.moved_mrad:g} mrad: named, % of {options.years:,} years"
    table = Table(("", "by the next calibration", "within two"), rows, caption)
    cover = Table(
        ("zero of joint", "link3.a changes by, 1σ", "reported ±, mrad", "covers, %", "± if nothing else changed, mrad",
         "covers, %"),
        tuple(
            (str(joint), f"{second:g}", f"{each.reported_mrad:.4f}", f"{100 * each.reported:.1f}",
             f"{each.alone_mrad:.4f}", f"{100 * each.alone:.1f}")
            for (joint, second), each in covered.items()
        ),
        f"95 % intervals of the change between two calibrations, of {options.years:,} pairs",
    )  # fmt: skip
    return Answer(
        values, Document("Changes: level, power, coverage", (Section("", (*paragraphs([said]), table, cover)),))
    )


if __name__ == "__main__":
    run_script("history_study")
