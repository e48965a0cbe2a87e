"""Global, or sequential (level by level)? Poses of virtual RX 130 arms, fitted at once or angles first, lengths after.

Global: one weighted least squares of positions and orientations over 30 parameters. Sequential: 15 angles
from orientations alone, then 15 lengths from positions, in which these are linear. The gauge has 16 angles, but to
orientations a turn of axis 2 is one of axis 3: so the offset of axis 2 belongs to the lengths, as y3 = a3 dtheta2, a Ty
after Tx(a3). Every answer sees the same arms, poses and noise; errors are those of positions on validation poses,
without noise. Beside what is simulated stands what linear propagation of the noise predicts.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pose_batches import MAX_STEPS, MeasuredPoses, StackedPoseArm, fit_poses
from scipy.special import elliprg
from shared import SERIES, Answer, Document, Flag, drawing, paragraphs, run_script, save_figure, write_rows

from lab.core import se3
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.significance import STUDY_COMPARISON
from lab.kinematics.serial.chain import Chain
from lab.kinematics.serial.serial_arm import SerialArm
from lab.report.style import MUTED, REFERENCE
from lab.robots.load_robot import load_robot
from lab.robots.robot import Robot
from lab.simulation.collisions import random_poses
from lab.simulation.tracking import target_rotations
from lab.simulation.true_robot import true_robot_from_table
from lab.studies.analysis import RESAMPLES, resampled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NEEDS = ("matplotlib",)

SIGMA_M = 1e-4  # of a coordinate
SIGMAS_RAD = (1e-5, 1e-4, 3e-4, 1e-3)  # of an orientation, per axis
CURVE_RAD = np.geomspace(5e-6, 2e-3, 25)  # where the prediction is drawn
PREDICTED = 100  # robots whose poses the curve is predicted for
OFF_M, OFF_RAD = 0.5e-3, 1e-3  # the arms' errors
CIRCLE_M, ROUNDS = 0.07, 10
FEWEST = 10  # poses
WORSE = 1.1  # times the global error: from here on the two part
# Names in the RX 130 that has a y3 (``with_y3``): from axis 3 on its links are one further.
ANGLES = (
    *("base.rx", "base.ry", "base.rz", "link2.alpha", "link3.alpha", "link4.beta", "link4.theta", "link5.alpha"),
    *("link5.theta", "link6.alpha", "link6.theta", "link7.alpha", "tool.rx", "tool.ry", "tool.rz"),
)
OFFSET, Y3 = "link2.theta", "link3.d"
LENGTHS = (
    *("base.x", "base.y", "base.z", "link2.a", "link3.a", Y3, "link4.d", "link5.a", "link5.d", "link6.a", "link6.d"),
    *("link7.a", "tool.p1.x", "tool.p1.y", "tool.p1.z"),
)
ALL = (*ANGLES, *LENGTHS)
Interval = tuple[float, float, float]  # mean, and the ends of its 95 % interval


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: int = 400
    """Virtual arms, each with poses of its own."""
    poses: int = 60
    """That are measured of each."""
    fresh: int = 200
    """By which each is judged."""
    seed: int = 0
    """Of everything random."""
    free: Flag = False
    """Take no poses in which the arm touches itself or the floor, in the place of any within the limits."""
    out: Path = Path("runs/global-or-sequential")
    """Folder of the table and the picture."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class Campaigns:
    """Arms with the poses they are measured and judged at.

    Attributes:
        nominal: as the identifier has it.
        exact: the measured poses without noise.
        noise: standard normal numbers ``(b, n, 6)``: of positions, then of rotations.
        validation: joint positions ``(b, m, joints)``.
        points: where they truly lead, ``(b, m, 3)`` m.
    """

    nominal: StackedPoseArm
    exact: MeasuredPoses
    noise: Array
    validation: Array
    points: Array

    @property
    def start(self) -> Array:
        """The nominal parameters, for every arm."""
        return np.tile(self.nominal.nominal(), (len(self.exact), 1))

    def measured(self, sigma_m: float, sigma_rad: float | Array) -> MeasuredPoses:
        """With noise, per axis; that of rotations about the axes of the target's frame."""
        points = self.exact.points + sigma_m * self.noise[..., :3]
        return replace(
            self.exact, points=points, rotations=self.exact.rotations @ se3.exp(sigma_rad * self.noise[..., 3:])
        )

    def errors_mm(self, values: Array) -> Array:
        """Mean length of the position error on validation poses ``(b,)``."""
        points = self.nominal.poses(self.validation, values)[0]
        return np.asarray(1e3 * np.linalg.norm(points - self.points, axis=2).mean(axis=1))


def campaigns(options: Options) -> Campaigns:
    """Arms in MuJoCo with every parameter off, base and tool too; random poses within the limits.

    Raises:
        LabError: too few poses or robots.
    """
    if options.poses < FEWEST or options.robots < 2:
        raise LabError(f"give --poses {FEWEST} or more, for 27 unknowns from positions alone, and two --robots or more")
    robot = load_robot("rx130")
    nominal = StackedPoseArm(SerialArm(with_y3(robot.serial_arm(("p1",)).chain)))
    arms = [_measured_arm(robot, options, number) for number in range(options.robots)]
    joints, points, rotations, validation, there = (np.stack(parts) for parts in zip(*arms, strict=True))
    noise = rng_for(options.seed, "noise").standard_normal((options.robots, options.poses, 6))
    return Campaigns(nominal, MeasuredPoses(still(joints), points, rotations), noise, still(validation), there)


def _measured_arm(robot: Robot, options: Options, number: int) -> tuple[Array, Array, Array, Array, Array]:
    """One arm in MuJoCo before an instrument that stands about where its base is: exact poses, and validation poses.

    Returns:
        Joint positions ``(n, 6)``, positions ``(n, 3)`` m and rotations ``(n, 3, 3)`` that are measured there; joint
        positions ``(m, 6)`` and positions ``(m, 3)`` of the validation.
    """
    arm = robot.serial_arm(("p1",))
    off = np.where([each.is_angle for each in arm.parameters], OFF_RAD, OFF_M)
    values = arm.nominal(robot.tool) + off * rng_for(options.seed, "arm", number).standard_normal(len(off))
    T_world_instrument = robot.T_world_frame0 @ se3.inverse(arm.T_tracker_frame0(values))
    real = true_robot_from_table(robot.serial_model, arm, values, T_world_instrument)
    draw = partial(random_poses, robot.model) if options.free else robot.chain.random_joints
    joints = draw(options.poses, rng_for(options.seed, "poses", number))
    validation = draw(options.fresh, rng_for(options.seed, "fresh", number))
    points, there = (real.points(poses, ("p1",))[:, 0] for poses in (joints, validation))
    return joints, points, target_rotations(real, joints, "p1"), validation, there


def with_y3(chain: Chain) -> Chain:
    """The RX 130 with a length y3 along y after Tx(a3): the d of a further link, whose joint stands still.

    Rx(alpha3) Tx(a3) Ty(y3) = Rx(alpha3 - 90°) Tx(a3) Tz(y3) Rx(90°); then follows the rest of link 3.
    """
    theta, d, a, alpha, _ = chain.table[2]
    table = np.insert(chain.table, 2, [0.0, 0.0, a, alpha - np.pi / 2, 0.0], axis=0)
    table[3] = theta, d, 0.0, np.pi / 2, 0.0
    return replace(
        chain,
        table=table,
        joint_names=(*chain.joint_names[:2], "still", *chain.joint_names[2:]),
        prismatic=(*chain.prismatic[:2], True, *chain.prismatic[2:]),
        parallel=(*chain.parallel[:2], False, *chain.parallel[2:]),
        sign=np.insert(chain.sign, 2, 1.0),
        lower=np.insert(chain.lower, 2, -1.0),
        upper=np.insert(chain.upper, 2, 1.0),
        speed=np.insert(chain.speed, 2, np.nan),
        acceleration=np.insert(chain.acceleration, 2, np.nan),
    )


def still(joints: Array) -> Array:
    """Readings ``(b, n, 6)`` with that of the joint that stands still."""
    return np.insert(joints, 2, 0.0, axis=2)


def fitted(
    campaign: Campaigns,
    measured: MeasuredPoses,
    start: Array,
    names: Sequence[str],
    sigma_m: float = np.inf,
    sigma_rad: float | Array = np.inf,
    steps: int = MAX_STEPS,
) -> Array:
    """Least squares over these parameters; positions or orientations without a sigma are left out.

    Raises:
        LabError: a fit did not converge.
    """
    model, weight = campaign.nominal, 1 / np.asarray(sigma_rad)
    found = fit_poses(
        model,
        measured,
        start,
        model.columns(names),
        position_weight=1 / sigma_m,
        rotation_weight=weight,
        max_steps=steps,
    )
    if steps == MAX_STEPS and not found.converged.all():
        raise LabError(f"Gauss-Newton did not settle for {(~found.converged).sum()} robots: give more --poses")
    return found.values


def sequential(
    campaign: Campaigns, measured: MeasuredPoses, sigma_rad: float | Array = 1.0, *, literal: bool = False
) -> Array:
    """Angles from orientations alone, then lengths from positions alone; literally 16 angles, then 14 lengths."""
    angles, lengths = ((*ANGLES, OFFSET), [name for name in LENGTHS if name != Y3]) if literal else (ANGLES, LENGTHS)
    turned = fitted(campaign, measured, campaign.start, angles, sigma_rad=sigma_rad)
    return fitted(campaign, measured, turned, lengths, sigma_m=1.0)


def alternated(campaign: Campaigns, measured: MeasuredPoses) -> tuple[Array, Array]:
    """Errors of angles and lengths from positions alone, in turn from the nominal: after one round, and after ten."""
    values, errors = campaign.start, []
    for _ in range(ROUNDS):
        for names in (ANGLES[:-3], LENGTHS):
            values = fitted(campaign, measured, values, names, sigma_m=1.0)
        errors.append(campaign.errors_mm(values))
    return errors[0], errors[-1]


def ranks(campaign: Campaigns) -> dict[str, int]:
    """Of the first arm's poses, at the nominal: what each step can identify, and what both can together."""
    free, k = campaign.nominal.columns((*ALL, OFFSET)), len(ANGLES)
    _, _, moves, turns = campaign.nominal.observe(campaign.exact.joints[:1], campaign.start[:1], free)
    moves, turns = moves.reshape(-1, len(free)), turns.reshape(-1, len(free))

    def rank(rows: Array) -> int:
        return int(np.linalg.matrix_rank(rows / np.linalg.norm(rows, axis=0), tol=1e-8))

    return {
        "15 angles from orientations": rank(turns[:, :k]),
        "16 angles from orientations": rank(turns[:, [*range(k), -1]]),
        "15 lengths from positions": rank(moves[:, k:-1]),
        "all 30 from both": rank(np.concatenate([moves, turns])[:, :-1]),
    }


def predicted_mm(campaign: Campaigns, sigmas_rad: Sequence[float], robots: int) -> Array:
    """Expected errors ``(2, sigmas, robots)``, global and sequential, by linear propagation of the noise.

    Small changes a of angles and l of lengths move positions by A a + L l, and turn orientations by O a. Global: the
    inverse of the information. Sequential: a from O alone, and then l = L^+ (noise of positions - A a).
    """
    free, k, start = campaign.nominal.columns(ALL), len(ANGLES), campaign.start[:robots]
    _, _, moves, turns = campaign.nominal.observe(campaign.exact.joints[:robots], start, free)
    fresh = campaign.nominal.observe(campaign.validation[:robots], start, free)[2]
    moves, turns = (each.reshape(len(start), -1, len(free)) for each in (moves, turns))
    by_position, by_rotation = moves.swapaxes(1, 2) @ moves, turns.swapaxes(1, 2) @ turns
    alone, lengths = np.linalg.inv(by_rotation[:, :k, :k]), np.linalg.inv(by_position[:, k:, k:])
    follow = -lengths @ by_position[:, k:, :k]  # -L^+ A
    errors = np.empty((2, len(sigmas_rad), len(start)))
    for i, sigma in enumerate(sigmas_rad):
        angles = sigma**2 * alone
        carried = follow @ angles
        rest = SIGMA_M**2 * lengths + carried @ follow.swapaxes(1, 2)
        together = np.asarray(np.linalg.inv(by_position / SIGMA_M**2 + by_rotation / sigma**2), dtype=float)
        errors[0, i] = expected_mm(fresh, together)
        errors[1, i] = expected_mm(fresh, np.block([[angles, carried.swapaxes(1, 2)], [carried, rest]]))
    return errors


def expected_mm(rates: Array, covariance: Array) -> Array:
    """Expected length of J x, x normal, mean over the poses: sqrt(8/pi) R_G(eigenvalues of J C J').

    sqrt(8/pi) is the mean length of a standard normal vector, and Carlson's R_G the mean of sqrt(u' S u) over all
    directions u (DLMF 19.16.3, 19.23.6).

    Args:
        rates: J ``(b, m, 3, f)``.
        covariance: C ``(b, f, f)``.
    """
    spread = np.linalg.eigvalsh(rates @ covariance[:, None] @ rates.swapaxes(2, 3))
    return np.asarray(1e3 * np.sqrt(8 / np.pi) * elliprg(*np.moveaxis(spread, 2, 0)).mean(axis=1))


def intervals(columns: dict[str, Array], seed: int) -> dict[str, Interval]:
    """Means over robots of columns ``(b,)``."""
    size = len(next(iter(columns.values())))
    drawn = rng_for(seed, "bootstrap").multinomial(size, np.full(size, 1 / size), RESAMPLES)
    found = resampled(np.stack(list(columns.values()), axis=1), drawn.astype(float), STUDY_COMPARISON)
    ends = zip(found.mean.tolist(), found.lower.tolist(), found.upper.tolist(), strict=True)
    return dict(zip(columns, ends, strict=True))


def table_of(campaign: Campaigns, seed: int) -> list[dict[str, float]]:
    """A row a noise of orientations: simulated errors (mm) and their ratio, with intervals, and those predicted."""
    rows = []
    predicted = predicted_mm(campaign, SIGMAS_RAD, len(campaign.exact)).mean(axis=2)
    for sigma, (least, apart) in zip(SIGMAS_RAD, predicted.T.tolist(), strict=True):
        measured = campaign.measured(SIGMA_M, sigma)
        first = sequential(campaign, measured)
        answers = {
            "global_mm": fitted(campaign, measured, campaign.start, ALL, SIGMA_M, sigma),
            "sequential_mm": first,
            "one_step_mm": fitted(campaign, measured, first, ALL, SIGMA_M, sigma, steps=1),
        }
        errors = {name: campaign.errors_mm(values) for name, values in answers.items()}
        ratio = errors["sequential_mm"] / errors["global_mm"]
        row = {"noise_mrad": 1e3 * sigma}
        for name, (mean, lower, upper) in intervals({**errors, "ratio": ratio}, seed).items():
            row |= {name: mean, f"{name}_lower": lower, f"{name}_upper": upper}
        row |= {"global_mm_predicted": least, "sequential_mm_predicted": apart}
        row |= {"ratio_of_means": row["sequential_mm"] / row["global_mm"], "ratio_of_means_predicted": apart / least}
        row |= {"share_worse": float((ratio > 1).mean())}
        row |= {"one_step_off": float(np.abs(errors["one_step_mm"] / errors["global_mm"] - 1).max())}
        rows.append(row)
    return rows


def beside(campaign: Campaigns, seed: int) -> dict[str, Interval]:
    """The splits without noise, positions alone, and poses from three points on a circle: errors in mm."""
    measured = campaign.measured(SIGMA_M, 0.0)
    # Of three points on a circle, each with a noise s, the centre has s/sqrt(3), the plane's tilt s/(r sqrt(3/2)), and
    # a turn in the plane s/(r sqrt(3)).
    centre, turn = SIGMA_M / np.sqrt(3), SIGMA_M / CIRCLE_M / np.sqrt([1.5, 1.5, 3.0])
    three, circle = campaign.measured(centre, turn), f"three points on a circle of {1e3 * CIRCLE_M:g} mm"
    first, last = alternated(campaign, measured)
    answers = {
        "exact split, no noise": sequential(campaign, campaign.exact),
        "literal split, no noise": sequential(campaign, campaign.exact, literal=True),
        "positions alone, global": fitted(campaign, measured, campaign.start, (*ANGLES[:-3], *LENGTHS), SIGMA_M),
        f"{circle}, global": fitted(campaign, three, campaign.start, ALL, centre, turn),
        f"{circle}, sequential": sequential(campaign, three, turn),
    }
    errors = {name: campaign.errors_mm(values) for name, values in answers.items()}
    errors["positions alone, angles with nominal lengths, then lengths"] = first
    errors[f"the same, after {ROUNDS} rounds"] = last
    errors[f"the same, after {ROUNDS} rounds, no noise"] = alternated(campaign, campaign.exact)[1]
    return intervals(errors, seed)


def crossing_rad(curve: Array, level: float) -> float:
    """The noise at which a rising curve over ``CURVE_RAD`` reaches a level."""
    return float(np.exp(np.interp(level, curve, np.log(CURVE_RAD))))


def picture(rows: Sequence[dict[str, float]], curve: Array, alone_mm: float, title: str) -> "Figure":
    """Errors on validation poses against the orientations' noise.

    Points are simulated, lines ``(2, CURVE_RAD)`` predicted.
    """
    noise = [row["noise_mrad"] for row in rows]
    with drawing((8.5, 5.5)) as figure:
        axes = figure.add_subplot(xscale="log", yscale="log", title=title)
        for name, colour, mark, size, line in (
            ("sequential", SERIES[1][0], "s--", 6.5, curve[1]),
            ("global", SERIES[2][0], "o-", 5, curve[0]),
        ):
            mean, lower, upper = (np.array([row[f"{name}_mm{e}"] for row in rows]) for e in ("", "_lower", "_upper"))
            axes.plot(1e3 * CURVE_RAD, line, mark[1:], color=colour, label=f"{name}: predicted")
            axes.errorbar(noise, mean, [mean - lower, upper - mean], fmt=mark[0], color=colour, markersize=size,
                          ecolor=REFERENCE, capsize=5, label=f"{name}: simulated, 95 % interval")  # fmt: skip
        repaired = [row["one_step_mm"] for row in rows]
        axes.plot(noise, repaired, "o", color=REFERENCE, fillstyle="none", markersize=13,
                  label="sequential, then one global step")  # fmt: skip
        axes.axhline(alone_mm, color=MUTED, linestyle=":", label="positions alone: global")
        parting = 1e3 * crossing_rad(curve[1] / curve[0], WORSE)
        axes.axvline(parting, color=MUTED, linewidth=1)
        words = f"from {parting:.2f} mrad on sequential\nis {100 * (WORSE - 1):.0f} % worse and more"
        axes.text(parting / 1.05, 0.6, words, transform=axes.get_xaxis_transform(), ha="right")
        for axis, ticks in ((axes.xaxis, (0.01, 0.03, 0.1, 0.3, 1)), (axes.yaxis, (0.05, 0.07, 0.1, 0.2, 0.3, 0.4))):
            axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
            axis.set_ticks([], minor=True)
        axes.set_xlabel("noise of orientations, mrad (1 σ per axis)")
        axes.set_ylabel("mean position error on validation poses, mm")
        axes.legend(loc="upper left")
    return figure


def report(rows: Sequence[dict[str, float]], others: dict[str, Interval]) -> list[str]:
    """The table, and the other ways beside it, line by line."""
    lines = [
        "mean position error on validation poses, mm, with 95 % intervals over robots; p: predicted",
        f"{'mrad':>5}  {'global':34}  {'sequential':34}  one step  {'paired ratio':22}  {'of means':13}  worse in",
    ]
    for row in rows:
        cells = [f"{row['noise_mrad']:>5g}"]
        for name in ("global_mm", "sequential_mm"):
            mean, lower, upper, foreseen = (row[name + end] for end in ("", "_lower", "_upper", "_predicted"))
            cells.append(f"{mean:.4f} ({lower:.4f} to {upper:.4f}) p {foreseen:.4f}")
        cells.append(f"{row['one_step_mm']:8.4f}")
        cells.append(f"{row['ratio']:.3f} ({row['ratio_lower']:.3f} to {row['ratio_upper']:.3f})")
        cells.append(f"{row['ratio_of_means']:.3f} p {row['ratio_of_means_predicted']:.3f}")
        lines.append("  ".join([*cells, f"{row['share_worse']:8.0%}"]))
    lines.append("one step: a global one after the sequential answer; worse in: of the robots")
    for name, (mean, lower, upper) in others.items():
        lines.append(f"{name}: {mean:.1e}" if mean < 1e-9 else f"{name}: {mean:.4f} ({lower:.4f} to {upper:.4f})")
    return lines


def said(rows: Sequence[dict[str, float]], curve: Array, alone_mm: float, reach_m: float) -> str:
    """The answer in a few sentences."""
    part, useless = crossing_rad(curve[1] / curve[0], WORSE), crossing_rad(curve[1], alone_mm)
    last, off = rows[-1], max(row["one_step_off"] for row in rows)
    return (
        "Sequential equals global only where the noise of orientations times the reach is well below that of "
        f"positions, {1e3 * SIGMA_M:g} mm. They part at {1e3 * part:.2f} mrad ({1e3 * part * reach_m:.2f} mm at "
        f"{reach_m:.2f} m), where sequential is {100 * (WORSE - 1):.0f} % worse. From {1e3 * useless:.2f} mrad on "
        f"it is worse than positions alone, and at {last['noise_mrad']:g} mrad {last['ratio']:.1f} times worse than "
        "the global fit. One global step after it repairs it: no robot's error then differs from the global one's by "
        f"more than {100 * off:.1f} %."
    )


def answer(options: Options) -> Answer:
    """Simulate, predict, and draw."""
    began, campaign = time.perf_counter(), campaigns(options)
    found, rows, others = ranks(campaign), table_of(campaign, options.seed), beside(campaign, options.seed)
    curve = predicted_mm(campaign, CURVE_RAD.tolist(), PREDICTED).mean(axis=2)
    alone_mm = others["positions alone, global"][0]
    words = said(rows, curve, alone_mm, float(np.abs(campaign.nominal.arm.chain.table[:, [1, 2]]).sum()))
    size = f"{options.robots} RX 130 arms, {options.poses} poses each, position noise {1e3 * SIGMA_M:g} mm"
    title = f"Global or sequential? {size}"
    options.out.mkdir(parents=True, exist_ok=True)
    save_figure(options.out, "global_or_sequential", picture(rows, curve, alone_mm, title))
    table = options.out / "global_or_sequential.csv"
    write_rows(table, rows)
    seconds = time.perf_counter() - began
    lines = [
        f"ranks: {', '.join(f'{name}: {rank}' for name, rank in found.items())}",
        *report(rows, others),
        words,
        f"{seconds:.0f} s; table: {table}, picture: {table.with_suffix('.png')}",
    ]
    values = {"ranks": found, "rows": rows, "beside_mm": others, "words": words, "seconds": seconds}
    return Answer(values, Document(title, paragraphs(lines)))


if __name__ == "__main__":
    run_script("global_or_sequential")
