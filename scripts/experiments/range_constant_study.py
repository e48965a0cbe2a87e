"""What a tracker's range constant costs, how well it is found, and whether what is stated of it holds.

Virtual campaigns of an arm before a tracker that measures every range too long by a constant. The tables: standard
deviation of the constant against distance, poses and targets; which constants are findings; how often the stated 95 %
of the constant, of the base and of predicted points in the instrument's frame contain the truth; and certificates.
"""

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from shared import Answer, Document, Flag, Section, Table, run_script

import lab
from lab.core import se3
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.core.probability import Uncertain
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.kinematics.effects.range_errors import CONSTANT, with_range_errors
from lab.kinematics.gauge import base_set
from lab.library.certify import certify
from lab.noise.instruments import Instrument
from lab.options.command_options import CertifyOptions
from lab.options.virtual_campaign import VirtualCampaign
from lab.prediction.estimate import Estimate
from lab.robots.load_robot import load_robot

_HALF_95 = 1.959963984540054
_ELSEWHERE = 20  # poses at which points are predicted
_FINDING_M, _FINDING_SIGMAS = 1e-4, 3.0
_CORNERS = ("p1", "p2", "p3")


@dataclass(frozen=True)
class Options:
    """What is simulated."""

    robots: tuple[str, ...] = ("irb120", "ur5e")
    """Arms of the first table; the others are of the first one."""
    instrument: str = "leica-at960"
    """The tracker."""
    distances_m: tuple[float, ...] = (1.5, 2.0, 3.0, 5.0)
    """Distances of the arm's base."""
    constants_mm: tuple[float, ...] = (0.0, 0.05, 0.1, 0.2, 0.5)
    """True range constants."""
    stated_um: float = 15.0
    """The standard deviation of the constant where it is stated."""
    campaigns: int = 1000
    """Campaigns of each row of the tables of findings and coverage."""
    certificates: int = 20
    """Certificates for each constant; 0 for none."""
    seed: int = 0
    """Of all draws."""
    markdown: Flag = False
    """Print the tables as Markdown."""
    json: Flag = False
    """Print one JSON object."""

    def check(self) -> None:
        """Refuse numbers that make no sense.

        Raises:
            LabError: there are no campaigns, or the instrument measures no range.
        """
        if self.campaigns < 2:
            raise LabError(f"--campaigns {self.campaigns}: give 2 or more")
        if lab.instrument(self.instrument).range_prior is None:
            raise LabError(f"--instrument {self.instrument}: measures no range; give a tracker")


@dataclass(frozen=True)
class Setup:
    """An arm before a tracker.

    Attributes:
        poses: measured ones.
        targets: their number.
        distance_m: of the base from the head.
    """

    robot: str
    device: Instrument
    poses: int
    targets: int
    distance_m: float

    @cached_property
    def _robot(self) -> lab.Robot:
        return load_robot(self.robot)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the targets."""
        return _CORNERS[: self.targets]

    def campaign(self, constant_m: float, rng: np.random.Generator) -> "Campaign":
        """Draw an arm within its tolerances, a tracker's direction, poses and readings."""
        arm = self._robot.arm(self.names)
        values = arm.nominal(self._robot.tool)
        # the tracker looks at the arm from anywhere, level or from a little above
        azimuth, turn = rng.uniform(-np.pi, np.pi, 2)
        sight = np.array([np.cos(azimuth), np.sin(azimuth), -rng.uniform(0.1, 0.4)])
        values[:3] = self.distance_m * sight / np.linalg.norm(sight)
        values[3:6] = se3.log(se3.exp(np.array([0.0, 0.0, turn])) @ se3.exp(rng.normal(0.0, 0.03, 3)))
        links = [i for i in base_set(arm, values).identifiable if arm.parameters[i].is_link]
        values[links] += [arm.parameters[i].scale * rng.standard_normal() for i in links]
        joints = self._robot.chain.random_joints(self.poses, rng)
        exact = arm.points(joints, values)
        seen = with_range_errors(exact, np.tile([constant_m, 0.0], (self.poses, 1)))
        points = self.device.sample(seen, rng) + self.device.errors.sample(seen, rng)  # of nest and lock-on, too
        data = measured(self._robot.chain.joint_names, joints, self.names, points)
        elsewhere = self._robot.chain.random_joints(_ELSEWHERE, rng)
        return Campaign(data, constant_m, values[:3], elsewhere, arm.points(elsewhere, values))

    def fitted(self, campaign: "Campaign", device: Instrument) -> Estimate:
        """Fit a campaign, weighted by an instrument, with the range constant as that states it."""
        return lab.fit(campaign.data, self._robot, instrument=device)


@dataclass(frozen=True)
class Campaign:
    """A campaign and its truth.

    Attributes:
        base: ``(3,)`` true position (m) in the instrument's frame.
        elsewhere: ``(n, joints)`` poses, with the true points ``(n, k, 3)`` there.
    """

    data: Measurements
    constant_m: float
    base: Array
    elsewhere: Array
    points: Array


@dataclass
class Covered:
    """Counts of what stated 95 % contain, and of findings."""

    constant: list[bool] = field(default_factory=list)
    base: list[float] = field(default_factory=list)
    points: list[float] = field(default_factory=list)
    named: list[bool] = field(default_factory=list)
    stds: list[float] = field(default_factory=list)

    def add(self, campaign: Campaign, estimate: Estimate) -> None:
        """Compare an estimate with the truth."""
        params, free = estimate.params, list(estimate.free_names)
        constant, std = params[CONSTANT].estimate, params[CONSTANT].std or float("nan")
        self.stds.append(std)
        self.constant.append(abs(constant - campaign.constant_m) <= _HALF_95 * std)
        self.named.append(abs(constant) > max(_FINDING_M, _FINDING_SIGMAS * std))
        # the base along the line of sight, where the constant stands in full
        rows = [free.index(f"base.{axis}") for axis in "xyz"]
        sight = campaign.base / np.linalg.norm(campaign.base)
        off = sight @ (np.array([params[f"base.{axis}"].estimate for axis in "xyz"]) - campaign.base)
        variance = sight @ estimate.free_covariance[np.ix_(rows, rows)] @ sight
        self.base.append(float(abs(off) <= _HALF_95 * np.sqrt(variance)))
        # every coordinate of points at other poses
        predicted = estimate.predict(campaign.elsewhere)
        widths = np.sqrt(np.diagonal(predicted.covariance, axis1=-2, axis2=-1))
        self.points.append(float((np.abs(predicted.points - campaign.points) <= _HALF_95 * widths).mean()))

    @property
    def values(self) -> dict[str, float]:
        """The shares in per cent, and the median standard deviation in µm."""
        shares = {name: 100 * float(np.mean(getattr(self, name))) for name in ("constant", "base", "points", "named")}
        return {**shares, "std_um": 1e6 * float(np.median(self.stds))}


def _covered(setup: Setup, device: Instrument, constants_m: Iterator[float], options: Options, part: int) -> Covered:
    found, rng = Covered(), rng_for(options.seed, "noise", part)
    for constant_m in constants_m:
        campaign = setup.campaign(constant_m, rng)
        found.add(campaign, setup.fitted(campaign, device))
    return found


def _deviations(options: Options, device: Instrument) -> Iterator[dict[str, Any]]:
    """The standard deviation of a free constant, and the shape that it costs, by distance, poses and targets."""
    few, sizes = 10, [(poses, targets) for poses in (20, 60) for targets in (1, 3)]
    for part, (robot, distance) in enumerate((r, d) for r in options.robots for d in options.distances_m):
        row: dict[str, Any] = {"robot": robot, "distance_m": distance}
        for poses, targets in sizes:
            setup = Setup(robot, device, poses, targets, distance)
            rng, stds, costs = rng_for(options.seed, "poses", part), [], []
            for _ in range(few):
                campaign = setup.campaign(0.0, rng)
                free = setup.fitted(campaign, device)
                stds.append(1e6 * (free.params[CONSTANT].std or np.nan))
                costs.append(1e6 * _cost_of_shape(free, campaign))
            row[f"{poses} x {targets}"] = float(np.median(stds))
            row[f"{poses} x {targets} shape"] = float(np.median(costs))
        yield row


def _cost_of_shape(estimate: Estimate, campaign: Campaign) -> float:
    """How much larger the predicted error (m, root mean square) relative to the base is than with the range known."""
    _, slopes = estimate.arm.observe(campaign.elsewhere, estimate.values)
    shape = [i for i, name in enumerate(estimate.free_names) if not name.startswith("base.")]
    slopes = slopes[..., [estimate.free[i] for i in shape]]
    shifts = estimate.shifts_by_range[shape]
    whole = estimate.free_covariance[np.ix_(shape, shape)]
    variances = (np.einsum("nkip,pq,nkiq->nk", slopes, each, slopes) for each in (whole, whole - shifts @ shifts.T))
    free, known = (float(np.sqrt(each.mean())) for each in variances)
    return free - known


def _findings(options: Options, device: Instrument) -> Iterator[dict[str, Any]]:
    """How often a free constant of so many standard deviations is a finding."""
    for part, (poses, targets, distance) in enumerate(((20, 1, 2.0), (20, 3, 2.0), (20, 3, 5.0), (60, 3, 5.0))):
        setup = Setup(options.robots[0], device, poses, targets, distance)
        std = _covered(setup, device, iter([0.0] * 20), options, part).values["std_um"] * 1e-6
        row: dict[str, Any] = {"poses": poses, "targets": targets, "distance_m": distance, "std_um": 1e6 * std}
        count = max(options.campaigns // 5, 2)
        for times in (0, 2, 4, 8, 12):
            found = _covered(setup, device, iter([times * std] * count), options, 10 * part + times)
            row[f"{times} sigma"] = found.values["named"]
        yield row


def _coverage(options: Options, device: Instrument) -> Iterator[dict[str, Any]]:
    """How often the stated 95 % contain the truth: free, stated and held to it, and drawn as stated."""
    setup = Setup(options.robots[0], device, 30, 3, 2.0)
    stated_m = 1e-6 * options.stated_um
    stated = replace(device, name="stated", errors=replace(device.errors, range_offset=Uncertain(stated_m)))
    for part, constant_mm in enumerate(options.constants_mm):
        for prior, weights in (("free", device), (f"{options.stated_um:g} µm stated", stated)):
            found = _covered(setup, weights, iter([1e-3 * constant_mm] * options.campaigns), options, 100 + part)
            yield {"true constant": f"{constant_mm:g} mm", "prior": prior, **found.values}
    drawn = stated_m * rng_for(options.seed, "arm").standard_normal(options.campaigns)
    found = _covered(setup, stated, iter(drawn.tolist()), options, 200)
    yield {"true constant": "drawn as stated", "prior": f"{options.stated_um:g} µm stated", **found.values}


def _certificates(options: Options) -> Iterator[dict[str, Any]]:
    """Share of the position errors over the workspace that U contains, in the instrument's frame."""
    for constant_mm in options.constants_mm if options.certificates else ():
        within, expanded = list[float](), list[float]()
        for seed in range(options.seed, options.seed + options.certificates):
            wrong = VirtualCampaign(
                robot=options.robots[0],
                poses=40,
                seed=seed,
                targets=_CORNERS,
                instrument=options.instrument,
                effects=lab.Effects(range_constant_mm=constant_mm),
                no_recording=True,
            )
            result = lab.calibrate(wrong)
            with tempfile.TemporaryDirectory() as folder:
                budget = certify(CertifyOptions(result.save(Path(folder) / "run"), force=True)).budgets[0]
            true = lab.simulate(replace(wrong, effects=lab.Effects())).validation
            predicted = result.estimate.predict(true.inputs(result.estimate.arm.conditions)).points
            errors = np.linalg.norm(predicted - true.points, axis=2)[:, 0]
            within.append(100 * float((errors <= budget.expanded_m).mean()))
            expanded.append(1e3 * budget.expanded_m)
        yield {
            "true constant": f"{constant_mm:g} mm",
            "errors within U, %": float(np.mean(within)),
            "U, mm": float(np.median(expanded)),
        }


def _table(rows: list[dict[str, Any]], caption: str) -> Table:
    def text(value: Any) -> str:
        return f"{value:.3g}" if isinstance(value, float) else str(value)

    headings = tuple(rows[0]) if rows else ("",)
    return Table(headings, tuple(tuple(text(value) for value in row.values()) for row in rows), caption)


def answer(options: Options) -> Answer:
    """Make all tables."""
    options.check()
    device = lab.instrument(options.instrument)
    found: Mapping[str, list[dict[str, Any]]] = {
        "deviations": list(_deviations(options, device)),
        "findings": list(_findings(options, device)),
        "coverage": list(_coverage(options, device)),
        "certificates": list(_certificates(options)),
    }
    captions = {
        "deviations": "standard deviation of a free constant, and what it adds to the error relative to the base, µm",
        "findings": "campaigns in which a constant of so many standard deviations is a finding, %",
        "coverage": "stated 95 % that contain the truth: the constant, the base along the line of sight, points, %",
        "certificates": "position errors in the instrument's frame that the certificate's U contains, %",
    }
    tables = tuple(_table(rows, captions[name]) for name, rows in found.items() if rows)
    return Answer(found, Document("The range constant of a tracker", (Section(options.instrument, tables),)))


if __name__ == "__main__":
    run_script("range_constant_study")
