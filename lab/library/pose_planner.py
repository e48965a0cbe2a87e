"""Plan a measurement session while it is measured: propose the next pose, and predict the accuracy so far."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from lab.calibration.identification import identify
from lab.calibration.weights import Noise
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.core.progress import Progress, no_progress
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extension_points import named_parts
from lab.noise.instruments import observing
from lab.options.named_instruments import named_instrument
from lab.options.virtual_campaign import DesignOptions
from lab.planning.design_problem import PoseProblem, pose_problem
from lab.pose_selection.criteria import Criterion, is_singular
from lab.pose_selection.exchange import information
from lab.pose_selection.predicted_accuracy import PredictedAccuracy, predict
from lab.pose_selection.sequential_choice import NoiseCheck, best_candidates, noise_check
from lab.pose_selection.tour import fastest_path, rated
from lab.prediction.validation import poses_to_validate
from lab.robots.load_robot import load_virtual
from lab.robots.robot import Robot
from lab.simulation.free_path import CLEARANCE_MM

__all__ = ["PosePlanner", "Proposal"]

_NEAR_ENOUGH = 0.8  # of the best gain: among such candidates the nearest is proposed
_LOOSE = 1e-4  # prior information of base and tool: a standard deviation of 100 tolerances
_MOST_AHEAD = 100  # poses that are planned ahead to estimate how many remain
_AHEAD_OF = 4  # every so many candidates are enough for that


@dataclass(frozen=True)
class Proposal:
    """The pose to measure next, and the accuracy so far.

    Attributes:
        measured: number of poses measured so far.
        joints: ``(joints,)`` rad or m, of the pose to measure next; None where the accuracy is reached.
        waypoints: ``(s, joints)`` on a free way there, from where the arm is to the pose; None without a pose.
        accuracy_m: error that 95 % of the validation poses keep in 95 % of the calibrations; None as long as the poses
            do not determine all parameters.
        next_m: the same after the proposed pose.
        noise: residuals against the stated noise; None as long as nothing is left over.
        remaining: estimated number of further poses; None without a wanted accuracy, or where so many poses as are
            planned ahead do not reach it.
        reached: whether the wanted accuracy is reached, by poses enough to validate the calibration.
        from_home: whether no free way leads on from where the arm is, so that the way begins at home.
        for_validation: whether the wanted accuracy is predicted already, and the further poses are those that a
            cross-validation needs.
    """

    measured: int
    joints: Array | None
    waypoints: Array | None
    accuracy_m: float | None
    next_m: float | None
    noise: NoiseCheck | None
    remaining: int | None
    reached: bool
    from_home: bool = False
    for_validation: bool = False


class PosePlanner:
    """Proposes poses for a robot, one after the other, while they are measured.

    Candidates are drawn once; a proposal then takes a fraction of a second.

    Attributes:
        problem: the robot, its feasible candidates and what the poses are to identify.
        accuracy_m: the wanted error; None for none.
    """

    problem: PoseProblem
    accuracy_m: float | None

    def __init__(
        self,
        robot: str | Path | Robot = "irb120",
        *,
        accuracy_mm: float | None = None,
        targets: Sequence[str] = ("p1",),
        instrument: str = "uniform-8um",
        cell: str | Path | None = None,
        criterion: str | Criterion | Callable[..., Array] = "I",
        candidates: int = 2000,
        home: Sequence[float] = (),
        clearance_mm: float = CLEARANCE_MM,
        self_clearance_mm: float = CLEARANCE_MM,
        no_check: bool = False,
        seed: int = 0,
        progress: Progress = no_progress,
    ) -> None:
        """Draw candidates for a robot, seen by an instrument.

        Args:
            robot: a model's name, a path, or a loaded robot.
            accuracy_mm: the error that 95 % of the validation poses are to keep in 95 % of the campaigns.
            targets: measured points of the tool.
            instrument: whose noise and sight count: a name, or the TOML file of a tracker.
            cell: the TOML file of the robot's cell.
            criterion: what the next pose is to make as good as can be, as for ``lab.design``.
            candidates: how many feasible poses to choose from.
            home: joint positions (deg, mm of a slide) where the session starts; the robot's, if not given.
            clearance_mm, self_clearance_mm: least distances from obstacles, and of links from each other.
            no_check: whether collisions are ignored.
            seed: of the candidates and the validation poses.
            progress: told how many candidates are found.

        Raises:
            LabError: the robot or instrument cannot be used, or the instrument has several stations.
        """
        known = load_virtual(robot, None if cell is None else Path(cell))
        self.options = DesignOptions(
            known.source, None if cell is None else Path(cell), accuracy_mm=accuracy_mm,
            criterion=named_parts("criterion", criterion),
            targets=tuple(targets), instrument=instrument, candidates=candidates, home=tuple(home), seed=seed,
            clearance_mm=clearance_mm, self_clearance_mm=self_clearance_mm, no_check=no_check,
        )  # fmt: skip
        self.options.refuse_nonsense()
        self.problem = pose_problem(self.options, known, progress)
        if self.problem.robot.model.stations:
            raise LabError("the cell has several stations, but poses are proposed one after the other from one station")
        self.accuracy_m = None if accuracy_mm is None else MM.to_si(accuracy_mm)
        self._device = observing(named_instrument(instrument), "points")
        self._chain = rated(self.problem.robot.chain)[0]

    @property
    def nothing_measured(self) -> Measurements:
        """The measurements before the session: those of the plan's targets, without a row."""
        names, targets = self.problem.robot.chain.joint_names, self.options.targets
        return measured(names, np.empty((0, len(names))), targets, np.empty((0, len(targets), 3)))

    @cached_property
    def _prior(self) -> Array:
        """Information of tolerances: one of each link's parameter, next to none of base and tool."""
        parameters = [self.problem.seen.parameters[i] for i in self.problem.structure.identifiable]
        return np.diag([1.0 if each.group not in ("base", "tool") else _LOOSE for each in parameters])

    @cached_property
    def fewest(self) -> int:
        """Number of poses below which the calibration could not be validated, however good."""
        return poses_to_validate(len(self._prior), 3 * len(self.problem.seen.targets))

    @cached_property
    def _per_candidate(self) -> Array:
        """Sensitivities ``(m, r, p)`` to parameters in their own units, in standard deviations of the noise."""
        return self.problem.whitened(self.problem.inputs)

    def propose(self, data: Measurements | None = None, *, at: Array | None = None) -> Proposal:
        """Propose the next pose, given all measurements so far.

        Args:
            data: joint positions (rad or m) and points (m) measured so far, in the order of the visits; nothing is
                measured yet, if not given.
            at: joint positions ``(joints,)`` of the arm now; those of the last row, or home, if not given.

        Raises:
            LabError: no candidate can be reached from where the arm is.
        """
        problem, data = self.problem, self.nothing_measured if data is None else data
        joints = data.joints[data.seen.all(axis=1)]
        # The information so far: in the units of the criterion, and in those of the noise.
        scaled = information(problem.sensitivity(joints)) if len(joints) else np.zeros_like(self._prior)
        own = information(problem.whitened(joints)) if len(joints) else np.zeros_like(self._prior)
        noise = self._noise(data)
        factor = 1.0 if noise is None else noise.factor
        now = self._accuracy(own, factor)
        accurate = now is not None and now <= (self.accuracy_m or 0.0)
        if accurate and len(joints) >= self.fewest:
            return Proposal(len(joints), None, None, now, None, noise, 0, True)
        # The pose, the way to it, and the accuracy after it.
        row, way, from_home = self._nearest(scaled + self._prior, self._place(data, at))
        with_it = own + information(self._per_candidate[row : row + 1])
        # The ratio of the predicted radius to the mean error hardly changes from one pose to the next.
        after = self._accuracy(with_it, factor) if now is None else now * self._mean(with_it) / self._mean(own)
        remaining = self._remaining(len(joints), scaled, own, now)
        pose = problem.inputs[row, : self._chain.size]
        return Proposal(len(joints), pose, way, now, after, noise, remaining, False, from_home, accurate)

    def _place(self, data: Measurements, at: Array | None) -> Array:
        """Return where the arm is: as stated, at the last row, or at home."""
        if at is not None:
            return at
        last: Array = data.joints[-1] if len(data) else self.problem.access.hubs[0]
        return last

    def _nearest(self, total: Array, start: Array) -> tuple[int, Array, bool]:
        """Return the candidate that is reached soonest of those that add nearly the most, the way, and if from home."""
        home = self.problem.access.hubs[0]
        for begin in (start, home):
            if (nearest := self._nearest_from(total, begin)) is not None:
                row, way = nearest
                return row, way if begin is start else np.concatenate([start[None], way]), begin is not start
        raise LabError(
            "no free way leads to any pose worth measuring, from where the arm is or from home; check the cell"
        )

    def _nearest_from(self, total: Array, start: Array) -> tuple[int, Array] | None:
        problem = self.problem
        rows, gains = best_candidates(problem.goal, total, problem.pool)
        good = gains >= _NEAR_ENOUGH * gains[0]
        size = self._chain.size
        distance = np.abs((problem.inputs[rows, :size] - start) / self._chain.speed).max(axis=1)
        for i in np.lexsort((distance, ~good)):
            pose = problem.inputs[rows[i], :size]
            if not problem.access.reachable(problem.inputs[rows[i] : rows[i] + 1])[0]:
                continue
            try:
                return int(rows[i]), fastest_path(start, pose, problem.access.hubs, self._chain, problem.access.free)
            except LabError:
                continue
        return None

    def _accuracy(self, own: Array, factor: float) -> float | None:
        return None if is_singular(own) else factor * self._predicted(own).coverage_radius

    def _predicted(self, own: Array) -> PredictedAccuracy:
        return predict(own, self.problem.test, rng_for(self.options.seed, "promise"))

    def _remaining(self, measured: int, scaled: Array, own: Array, now: float | None) -> int | None:
        """Return the number of poses that a greedy plan takes to the wanted accuracy, by the mean error alone."""
        if self.accuracy_m is None:
            return None
        goal, total = self.problem.goal, scaled + self._prior
        pool, per_candidate = self.problem.pool[::_AHEAD_OF], self._per_candidate[::_AHEAD_OF]
        known = now if measured >= self.fewest else None
        wanted = None if known is None else self._mean(own) * self.accuracy_m / known
        for count in range(1, _MOST_AHEAD + 1):
            row = int(np.argmax(np.einsum("mrp,mrp->m", pool @ goal.slope(total), pool)))
            total = total + information(pool[row : row + 1])
            own = own + information(per_candidate[row : row + 1])
            if measured + count < self.fewest or is_singular(own):
                continue
            if wanted is None:  # the ratio of fewer poses is another
                wanted = self._mean(own) * self.accuracy_m / self._predicted(own).coverage_radius
            if self._mean(own) <= wanted:
                return count
        return None

    @cached_property
    def _spread(self) -> Array:
        """Mean of J'J ``(f, f)`` over the test poses."""
        return information(self.problem.test) / len(self.problem.test)

    def _mean(self, own: Array) -> float:
        """Root mean square of the predicted error over the test poses, m."""
        return float(np.sqrt(np.sum(self._spread * np.linalg.inv(own))))

    def _noise(self, data: Measurements) -> NoiseCheck | None:
        """Fit the measurements so far, and compare its residuals with the stated noise."""
        try:
            fit = identify(self.problem.arm, data.with_points(), self.problem.values, Noise(self._device))
        except LabError:  # there are fewer poses than the parameters need
            return None
        if fit.dof < 1 or not np.isfinite(fit.residual_sigma_m):
            return None
        look = -(-fit.dof // (3 * len(self.problem.arm.targets)))  # one after each pose that adds residuals
        return noise_check(fit.residual_sigma_m / fit.sigma_m, fit.dof, look)
