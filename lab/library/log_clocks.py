"""Estimate offset and drift between a tracker's clock and a controller's, from times of points and of rests.

An offset places a point if it moves its time into a window in which the arm stood still. The number of points that are
placed is a step function of the offset, whose maxima are all found by sorting its steps. Equally spaced rests have many
maxima, of which the nominal arm decides: with base and tool fitted, it follows the points of the right poses to within
millimetres. Points of other poses, or joints in another unit, order or direction, are missed by a large part of its
reach.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.calibration.guess import columns_of
from lab.core.errors import LabError, be, counted
from lab.core.limits import CLOCK_DRIFT_PPM
from lab.core.measurements import measured
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.diagnosis.placement import placed
from lab.phrases.phrase import phrase
from lab.robots.robot import Robot
from lab.verdict.diagnosed import misread_points

__all__ = ["LEAST_POSES", "ClockComparison", "ClockOffset", "NominalFit", "PlacedPoints"]

LEAST_POSES = 6  # distinct ones, which overdetermine base and tool
_TOLERANCE = 0.05  # of the points' median distance from their middle, within which a point follows the nominal arm
_DISTINCT = 0.01  # rad or m: joint positions that are closer are one pose


class NominalFit:
    """The nominal arm, with base and tool fitted to points and the poses that they are taken for."""

    def __init__(self, robot: Robot, targets: tuple[str, ...], points: Array) -> None:
        """Take the robot, its targets, and all points ``(n, 3)`` (m), whose spread sets the tolerance."""
        self._robot, self._targets = robot, targets
        self._arm, self._count = robot.arm(targets), len(targets)
        self._nominal = self._arm.nominal({target: np.zeros(3) for target in targets})
        from_middle = np.linalg.norm(points - np.median(points, axis=0), axis=1)
        self.tolerance_m = _TOLERANCE * float(np.median(from_middle))

    def usable(self, joints: Array) -> bool:
        """Return whether joint positions ``(n, joints)`` are enough distinct poses to contradict wrong points."""
        return len(np.unique(np.round(joints / _DISTINCT), axis=0)) >= LEAST_POSES

    def mistake(self, joints: Array, targets: NDArray[np.int_], points: Array) -> str:
        """Return the mistake of reading that explains why points do not follow the arm; empty where none does.

        The arguments are those of ``predicted``.
        """
        data = measured(self._robot.chain.joint_names, joints, self._targets, self._by_target(targets, points))
        return next((phrase(each.check) for each in misread_points(self._robot, data)), "")

    def _by_target(self, targets: NDArray[np.int_], points: Array) -> Array:
        """Return points ``(n, 3)`` as ``(n, targets, 3)``, NaN for the targets that were not measured."""
        seen = np.full((len(points), self._count, 3), np.nan)
        seen[np.arange(len(points)), targets] = points
        return seen

    def flanges(self, joints: Array) -> Array:
        """Return positions ``(n, 3)`` of the nominal flange in the base, m; NaN where the arm's loops do not close."""
        at_base = self._nominal.copy()
        at_base[list(columns_of(self._arm, ("base",)))] = 0.0
        flanges: Array = self._arm.points(joints, at_base)[:, 0]
        return flanges

    def distances(self, joints: Array, targets: NDArray[np.int_], points: Array) -> Array:
        """Return how far ``(n,)`` (m) points are from where the nominal arm has them; infinite where it cannot be.

        The arguments are those of ``predicted``.
        """
        apart = np.linalg.norm(self.predicted(joints, targets, points) - points, axis=1)
        return np.where(np.isfinite(apart), apart, np.inf)

    def predicted(self, joints: Array, targets: NDArray[np.int_], points: Array) -> Array:
        """Return where ``(n, 3)`` (m) the nominal arm has points; NaN where its loops do not close.

        Base and tool are placed robustly, as some points may be taken for wrong poses.

        Args:
            joints: ``(n, joints)`` rad or m, of each point.
            targets: ``(n,)`` which of the tool's targets each point is.
            points: ``(n, 3)`` m.
        """
        n, seen = len(joints), self._by_target(targets, points)
        possible, found = np.isfinite(self.flanges(joints)).all(axis=1), np.full((n, 3), np.nan)
        if possible.sum() >= LEAST_POSES:
            at = placed(self._arm, joints[possible], seen[possible], self._nominal, rng_for(0, "null"))
            found[possible] = at.predicted[np.arange(possible.sum()), targets[possible]]
        return found


_PAIRS = 400_000  # of points and windows by which offsets are searched
_LEAST_POINTS = 20  # by which they are searched, however many windows there are
_DRIFT_STEP = 0.25  # of a typical window, by which two drifts that are tried move the last point
_MAX_DRIFTS = 12  # that are tried in each direction
_MAX_OFFSETS = 400  # maxima of each drift that are compared
_MAX_FITS = 16  # offsets at which base and tool are fitted
_RIVAL = 0.8  # of the best offset's points: another that explains as many is its rival
_FEW = 0.5  # of the points: an offset that places fewer is not trusted
_LESS = 0.1  # of the points: an offset that places so many fewer than another is wrong
_FOLLOW = 0.8  # of the placed points that follow the nominal arm at the right offset


@dataclass(frozen=True)
class ClockOffset:
    """Offset of the tracker's clock ahead of the controller's."""

    seconds: float = 0.0  # at the first point
    drift_ppm: float = 0.0  # excess rate of the tracker's clock, in millionths

    def on_log(self, at: Array) -> Array:
        """Return times ``(n,)`` of the tracker's clock on the controller's (s; NaN stays)."""
        times: Array = at - self.seconds - 1e-6 * self.drift_ppm * (at - np.nanmin(at))
        return times

    @property
    def flags(self) -> str:
        """The options that apply it."""
        drift = f" --clock-drift-ppm {self.drift_ppm:.4g}" if self.drift_ppm else ""
        return f"--clock-offset-s {self.seconds:.10g}{drift}"


@dataclass(frozen=True, eq=False)
class PlacedPoints:
    """Assignment of points to windows by a clock offset.

    Attributes:
        distances_m: ``(n,)`` of the points from the nominal arm, infinite where not placed; None where too few
            distinct poses are met to compare.
    """

    offset: ClockOffset
    where: NDArray[np.int_]  # (n,) the window of each point, -1 where none
    distances_m: Array | None
    tolerance_m: float  # largest distance at which a point counts as following the arm

    @cached_property
    def placed(self) -> int:
        """Number of points that fall into a window."""
        return int((self.where >= 0).sum())

    @cached_property
    def follows(self) -> NDArray[np.bool_]:
        """``(n,)`` which points follow the nominal arm."""
        if self.distances_m is None:
            return np.zeros(len(self.where), dtype=np.bool_)
        return np.asarray(self.distances_m <= self.tolerance_m)

    @property
    def rms_m(self) -> float | None:
        """Root mean square distance of the points that follow the nominal arm; None where that is not known."""
        if self.distances_m is None or not self.follows.any():
            return None
        return float(np.sqrt((self.distances_m[self.follows] ** 2).mean()))

    def astray(self, targets: int) -> NDArray[np.bool_]:
        """``(n,)`` which placed points do not follow the nominal arm; of a pose of several targets all with one."""
        if self.distances_m is None:
            return np.zeros(len(self.where), dtype=np.bool_)
        far = np.isfinite(self.distances_m) & ~self.follows
        return far if targets == 1 else np.isin(self.where, self.where[far])

    def conflicts(self, other: "PlacedPoints") -> NDArray[np.bool_]:
        """``(n,)`` which points the two place in different windows."""
        return _conflicts(self.where, other.where)

    @property
    def description(self) -> str:
        """Description of how many points are placed, and how well the nominal arm follows them."""
        text = f"{self.placed} of {len(self.where)}"
        if self.rms_m is None:
            return text
        number = "" if self.follows.sum() == self.placed else f"{int(self.follows.sum())} of them "
        return f"{text}, {number}within {MM.text(self.rms_m, 2)} (rms) of the nominal arm"


@dataclass(frozen=True)
class ClockComparison:
    """Points and windows on two clocks.

    Attributes:
        starts, ends: ``(k,)`` s, of the windows, in order and apart from each other.
    """

    at: Array  # (n,) s, when points were measured; NaN where unknown
    starts: Array
    ends: Array
    window_of: Callable[[Array], NDArray[np.int_]]  # the window of each of some times, -1 where none
    joints: Array  # (k, joints) of the windows, by the numbers that window_of gives them
    points: Array  # (n, 3) m
    targets: int  # how many of them are measured in each pose, in turn
    nominal: NominalFit | None  # the arm that they are to follow; None to compare times alone

    def check(self, offset: ClockOffset, *, given: bool) -> None:
        """Refuse an offset that the points contradict.

        Args:
            given: whether the user gave it: then it may be one of several that explain the points alike.

        Raises:
            LabError: another offset places clearly more points or explains them better, two explain them alike, few
                are placed, or none makes them follow the nominal arm; the message has the option to give.
        """
        some = self._some
        here = some.placed_by(offset)
        found = [here, *some.candidates(offset)]
        if any(each.distances_m is not None for each in found):
            some.judge_by_arm(here, found, given=given)
        else:
            some.judge_by_times(here, found, given=given)

    def proposal(self) -> str:
        """Describe the clock offset that places the points."""
        some = self._some
        best, alike = some.best_of(some.candidates(ClockOffset()))
        if best is None:
            return "give --clock-offset-s, the seconds by which the tracker's clock is ahead"
        return f"{best.offset.flags} would place {best.description}{_or_another(alike)}"

    def placed_by(self, offset: ClockOffset) -> PlacedPoints:
        """Return the windows of the points, and their distances from the nominal arm."""
        return self._compared(offset, self.window_of(offset.on_log(self.at)))

    def _compared(self, offset: ClockOffset, where: NDArray[np.int_]) -> PlacedPoints:
        nominal = self.nominal
        if nominal is None:
            return PlacedPoints(offset, where, None, np.inf)
        rows, targets = self._in_turn(where)
        joints = self.joints[where[rows]]
        if not nominal.usable(joints):
            return PlacedPoints(offset, where, None, nominal.tolerance_m)
        distances = np.full(len(where), np.inf)
        distances[rows] = nominal.distances(joints, targets, self.points[rows])
        return PlacedPoints(offset, where, distances, nominal.tolerance_m)

    def _in_turn(self, where: NDArray[np.int_]) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """The points of windows that hold all targets, and which target each is."""
        inside = np.flatnonzero(where >= 0)
        rows = inside[np.argsort(where[inside], kind="stable")]
        _, first, count = np.unique(where[rows], return_index=True, return_counts=True)
        turn = np.arange(len(rows)) - np.repeat(first, count)
        whole = np.repeat(count % self.targets == 0, count)
        return rows[whole], turn[whole] % self.targets

    @cached_property
    def _some(self) -> "ClockComparison":
        """Comparison reduced to enough points: blocks of the first, the middle and the last ones."""
        timed = np.argsort(self.at, kind="stable")[: int(np.isfinite(self.at).sum())]
        most = max(_LEAST_POINTS, _PAIRS // len(self.starts))
        if len(timed) > most:
            each = -(-most // 3)
            middle = (len(timed) - each) // 2
            timed = np.concatenate([timed[:each], timed[middle : middle + each], timed[-each:]])
        timed = np.sort(timed)
        return ClockComparison(self.at[timed], self.starts, self.ends, self.window_of, self.joints,
                               self.points[timed], self.targets, self.nominal)  # fmt: skip

    # Search

    def candidates(self, near: ClockOffset) -> list[PlacedPoints]:
        """Offsets that place points in different windows, those of most points first."""
        maxima = sorted(
            (each for drift in self._drifts(near.drift_ppm) for each in self._maxima(drift)),
            key=lambda each: (-each[0], each[1].drift_ppm != near.drift_ppm, -each[2]),
        )
        least = _FEW * maxima[0][0] if maxima else 0.0
        retained, wheres = list[ClockOffset](), np.zeros((0, len(self.at)), dtype=np.int_)
        for count, offset, _ in maxima:
            if count < least or len(retained) >= _MAX_OFFSETS:
                break
            where = self.window_of(offset.on_log(self.at))
            if not len(wheres) or _conflicts(wheres, where).any(axis=1).all():
                retained.append(offset)
                wheres = np.vstack([wheres, where])
        if len(retained) > _MAX_FITS:
            chosen = np.sort(np.argsort(-self._alike(wheres), kind="stable")[:_MAX_FITS])
            retained, wheres = [retained[i] for i in chosen], wheres[chosen]
        return [self._compared(offset, where) for offset, where in zip(retained, wheres, strict=True)]

    def _drifts(self, given: float) -> list[float]:
        window = max(float(np.median(self.ends - self.starts)), 1e-3)
        shift = 1e-6 * CLOCK_DRIFT_PPM.most * float(np.ptp(self.at))
        steps = min(int(np.ceil(shift / (_DRIFT_STEP * window))), _MAX_DRIFTS)
        tried = [CLOCK_DRIFT_PPM.most * k / steps for k in range(-steps, steps + 1)] if steps else [0.0]
        return sorted({0.0, given, *tried})

    def _maxima(self, drift_ppm: float) -> Iterator[tuple[int, ClockOffset, float]]:
        """Return the offsets between which most points are placed: how many, the middle, and the width (s)."""
        times = ClockOffset(0.0, drift_ppm).on_log(self.at)
        enter, leave = (times[:, None] - self.ends).ravel(), (times[:, None] - self.starts).ravel()
        steps = np.concatenate([enter, leave])
        order = np.argsort(steps, kind="stable")
        change = np.where(order < len(enter), 1, -1)
        steps, counts = steps[order], np.cumsum(change)
        tops = np.flatnonzero((change[:-1] > 0) & (change[1:] < 0))
        tops = tops[np.argsort(-counts[tops], kind="stable")[:_MAX_OFFSETS]]
        for i in tops.tolist():
            width = float(steps[i + 1] - steps[i])
            yield int(counts[i]), ClockOffset(_rounded((steps[i] + steps[i + 1]) / 2, width), drift_ppm), width

    def _alike(self, wheres: NDArray[np.int_]) -> Array:
        """Correlation ``(m,)`` of steps between points with those of the nominal flange; 1 where there is no arm."""
        if self.nominal is None:
            return np.ones(len(wheres))
        flanges = np.nan_to_num(self.nominal.flanges(self.joints))
        both = (wheres[:, 1:] >= 0) & (wheres[:, :-1] >= 0)
        measured = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        stepped = np.linalg.norm(flanges[wheres[:, 1:]] - flanges[wheres[:, :-1]], axis=2)
        count = np.maximum(both.sum(axis=1), 1)[:, None]
        one, two = (np.where(both, each - (both * each).sum(axis=1)[:, None] / count, 0.0)
                    for each in (np.broadcast_to(measured, both.shape), stepped))  # fmt: skip
        sizes = np.sqrt((one**2).sum(axis=1) * (two**2).sum(axis=1))
        return np.asarray(np.divide((one * two).sum(axis=1), sizes, out=np.zeros(len(wheres)), where=sizes > 0))

    # Judgement

    def best_of(self, found: Sequence[PlacedPoints]) -> tuple[PlacedPoints | None, list[PlacedPoints]]:
        """Return the offset that explains most points, and those that explain them in other windows as well."""
        by_arm = any(each.distances_m is not None for each in found)
        if not found:
            return None, []
        best = max(found, key=lambda each: (each.follows.sum() if by_arm else 0, each.placed))
        return best, [each for each in found if _is_rival(each, best, by_arm=by_arm)]

    def _mistake(self, best: PlacedPoints) -> str:
        """Return the mistake of reading that explains why the points do not follow the arm; empty where none does."""
        rows, targets = self._in_turn(best.where)
        assert self.nominal is not None
        return self.nominal.mistake(self.joints[best.where[rows]], targets, self.points[rows])

    def judge_by_arm(self, here: PlacedPoints, found: Sequence[PlacedPoints], *, given: bool) -> None:
        """Judge an offset by the nominal arm."""
        best, rivals = self.best_of(found)
        assert best is not None
        count, follow = len(self.at), int(best.follows.sum())
        if follow < max(_FOLLOW * best.placed, 1):
            raise LabError(
                f"no offset of the clocks lets the points follow the nominal arm (at {best.offset.flags} {follow} of "
                f"{best.placed} placed ones do): {self._mistake(best) or 'are the two files of one session?'}"
            )
        lost = follow - int(here.follows.sum())
        differs = bool(here.conflicts(best).any()) and not (given and here in rivals)
        if differs or lost > max(1.0, _LESS * count):
            raise LabError(
                f"{_called(here, given=given)} places {here.description}; {best.offset.flags} places {best.description}"
                f"{_or_another(rivals)}"
            )
        self._refuse_alike(here, rivals, given=given)
        self._refuse_few(here, best, count, trusted=given)

    def judge_by_times(self, here: PlacedPoints, found: Sequence[PlacedPoints], *, given: bool) -> None:
        """Judge an offset by times alone: there are too few poses for the arm to contradict."""
        best, rivals = self.best_of(found)
        assert best is not None
        count = len(self.at)
        if best.placed - here.placed > max(0.0, _LESS * count):
            raise LabError(
                f"{_called(here, given=given)} places {here.description} points; {best.offset.flags} places "
                f"{best.description}{_or_another(rivals)}"
            )
        self._refuse_alike(here, [each for each in found if _is_rival(each, here, by_arm=False)], given=given)
        self._refuse_few(here, best, count, trusted=given)

    def _refuse_alike(self, here: PlacedPoints, rivals: Sequence[PlacedPoints], *, given: bool) -> None:
        if rivals and not given:
            raise LabError(
                f"{_called(here, given=False)} places {here.description}, and {rivals[0].offset.flags} places "
                f"{rivals[0].description}: these poses fit both; give --clock-offset-s "
                f"{here.offset.seconds:.10g} if the clocks are known to agree, or --by name or --by order"
            )

    def _refuse_few(self, here: PlacedPoints, best: PlacedPoints, count: int, *, trusted: bool) -> None:
        if here.placed < _FEW * count and not trusted:
            raise LabError(
                f"only {here.placed} of {counted(count, 'point')} {be(here.placed)} measured while the arm stood "
                f"still, and no offset of the clocks places more than {best.placed}; give --clock-offset-s "
                f"{here.offset.seconds:.10g} if the others are of something else"
            )


def _is_rival(each: PlacedPoints, best: PlacedPoints, *, by_arm: bool) -> bool:
    """Decide whether an offset with other windows than the best explains about as many points."""
    apart = each.conflicts(best)
    if not apart.any():
        return False
    if not by_arm:
        return each.placed >= _RIVAL * best.placed
    explained = each.follows.sum() >= _RIVAL * best.follows.sum()
    return bool(explained and 2 * each.follows[apart].sum() >= best.follows[apart].sum())


def _conflicts(wheres: NDArray[np.int_], where: NDArray[np.int_]) -> NDArray[np.bool_]:
    return np.asarray((wheres != where) & (wheres >= 0) & (where >= 0))


def _called(here: PlacedPoints, *, given: bool) -> str:
    return here.offset.flags if given else "taking the two clocks for one"


def _or_another(rivals: Sequence[PlacedPoints]) -> str:
    return f"; so does {rivals[0].offset.flags}, and these poses fit both" if rivals else ""


def _rounded(offset_s: float, width_s: float) -> float:
    """An offset to as few digits as keep it within a fifth of the width of its interval."""
    digits = int(np.clip(np.ceil(-np.log10(max(width_s, 1e-6) / 2.5)), 0, 6))
    return round(float(offset_s), digits)
