"""The verdict on a calibration: three answers (accuracy, goodness of fit, determination), and one word.

Checks are made from the fit and its validation first; ``judge`` then decides by these alone.

It is good only where all three hold or do not matter. Lack of fit does not matter where a gate is given and the
95 %/95 % tolerance bound of the validation errors lies below it; weak determination does not where the predicted 95 %
error over the region does. The region is where poses were measured, or the one that a task names; the rest of the
workspace is extrapolated, and has a figure of its own. What cannot be of this arm is bad, whatever the errors are. It
is never good where something changed during the campaign, or where errors at poses that were not fitted exceed their
prediction.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from lab.calibration.identification import COLLAPSED, Identification
from lab.calibration.observation import ROTATION_PARAMETERS, observation_of
from lab.calibration.prior import Tolerance
from lab.calibration.statistics.goodness_of_fit import is_doubted, upper_tolerance_bound
from lab.core.checks import Check
from lab.kinematics.gauge import base_set
from lab.kinematics.parameter import indices_of_groups
from lab.prediction.extrapolation import MOST_UNCOVERED, MeasuredRange
from lab.prediction.regions import Region, workspace_region
from lab.prediction.residual_spread import ResidualSpread, residual_spread
from lab.prediction.validation import MOST_OUTLIERS, Errors, Validation
from lab.prediction.workspace_prediction import (
    Distance,
    RegionPrediction,
    WorkspacePrediction,
    distances_from_nominal,
    own_tolerance,
    predict_elsewhere,
    predict_over_region,
    predict_over_workspace,
)
from lab.verdict.noise_findings import COMMON_NOISE_M

__all__ = ["CONSTANT_SPREAD", "MOST_TOLERANCES", "Answer", "Verdict", "Word", "judge", "rotation_noise_rad", "verdict"]

CONSTANT_SPREAD = 1e-6  # of what was measured, to the nominal model's: below, it does not change from pose to pose
_LARGEST_ROTATION_RAD = 50e-3  # of measured orientations' residuals: no probe is that bad, and no calibration needs it
MOST_TOLERANCES = 10.0  # that a link is from its nominal value
_LEAST_GAIN = 0.9  # of the mean error: above, there is hardly an improvement
_CLEAR_GAIN = 0.5  # of the mean error: below, a larger maximum is one pose's
_WORSE = 1.1  # times the nominal model's mean error
_NOISE_FLOOR = 1.5  # times what the noise and the parameters' covariance make of the error
_UNINFORMATIVE = 0.5  # of what tolerances make of an arm: a calibration that predicts no less is uninformative
_ROUGHLY = 1.1  # times the predicted mean error: as much a campaign's own differs from what is predicted
_MOST_FITTED = 0.5  # of the validation poses: if more were fitted, they validate nothing
_FLOOR_M = 1e-7  # errors below are rounding
_ONE_SIDED = 1.645  # standard deviations: 95 % of a normal distribution lie above

Word = Literal["good", "doubtful", "bad", "not judged"]
_Standing = Literal["holds", "does not matter", "doubtful", "bad", "not judged"]


@dataclass(frozen=True)
class Answer:
    """One of the three answers of a verdict, with the checks behind its sentence."""

    standing: _Standing
    checks: tuple[Check, ...]


@dataclass(frozen=True)
class Verdict:
    """Verdict on a calibration: one word, the three answers behind it, and the reasons where it is not good.

    Attributes:
        reasons: the failed checks that make it less than good, the heaviest first.
        gate_m: the largest mean error that is allowed; None for no limit.
    """

    word: Word
    accuracy: Answer
    fit: Answer
    determination: Answer
    reasons: tuple[Check, ...]
    checks: tuple[Check, ...]
    gate_m: float | None = None

    @property
    def answers(self) -> dict[str, Answer]:
        """The three answers by their names."""
        return {"accuracy": self.accuracy, "goodness of fit": self.fit, "determination": self.determination}

    @property
    def workspace(self) -> WorkspacePrediction:
        """The predicted errors over the whole workspace, by the covariance alone."""
        found: WorkspacePrediction = self._predicted["workspace"]
        return found

    @property
    def region(self) -> RegionPrediction:
        """The predicted errors that determination is judged by."""
        found: RegionPrediction = self._predicted["region"]
        return found

    @property
    def elsewhere(self) -> RegionPrediction | None:
        """The predicted errors over the extrapolated part of the workspace; None where there is none, or none known."""
        found: RegionPrediction | None = self._predicted["elsewhere"]
        return found

    @property
    def farthest(self) -> Distance | None:
        """The link that is estimated farthest from its nominal value; None where none is identified."""
        found: Distance | None = self._predicted["farthest"]
        return found

    @property
    def prediction(self) -> Check | None:
        """Observed against predicted errors at the validation poses; None where they were not compared."""
        return next((each for each in self.checks if each.name == "accuracy.prediction"), None)

    @property
    def _predicted(self) -> Mapping[str, Any]:
        return next(each for each in self.checks if each.name == "determination.error").data


def judge(checks: Sequence[Check], gate_m: float | None = None) -> Verdict:
    """Decide the verdict by checks alone.

    Args:
        checks: of the fit, its validation and its predictions, with those of lack of fit and of the errors.
        gate_m: the largest mean error that is allowed; None for no limit.
    """
    misread = list(filter(_is_misread, _failed(checks, "diagnosis")))
    foreign = misread or _failed(checks, "arm")
    accuracy, because = _accuracy(checks)
    fit, misfits = _fit(checks)
    determination, unsure = _determination(checks, gate_m)
    if foreign:  # of a fit that is not this arm's, small errors are no good news; of misread ones, large ones none
        found = accuracy, fit, determination
        good = ("holds", "does not matter", *["doubtful", "bad"] * bool(misread))
        accuracy, fit, determination = (replace(a, standing="not judged") if a.standing in good else a for a in found)
    ratio = _one(checks, "fit.residuals").statistic  # NaN where the noise was not given
    reasons = sorted(
        foreign or [*because, *misfits, *unsure],  # of another arm, all else only follows
        key=lambda each: (_SEVERITIES.index(_makes(each)), -_weight(each, ratio)),
    )
    word: Word = _makes(reasons[0]) if reasons else "good"
    if word != "bad" and accuracy.standing == "not judged":
        word = "not judged"
    return Verdict(word, accuracy, fit, determination, tuple(reasons), tuple(checks), gate_m)


_COMPARED = ("observed_p95_m", "predicted_p95_m", "extrapolated")  # of the check of the prediction
_SEVERITIES: tuple[Word, ...] = ("bad", "not judged", "doubtful")
_MAKES: Mapping[str, Word] = {  # of a calibration, by the check that failed; another makes it doubtful
    "accuracy.validation": "not judged",
    "accuracy.gate": "bad",
    "accuracy.worse": "bad",
    "links.other_robot": "bad",
}


def _is_misread(check: Check) -> bool:
    """Check whether a finding is a mistake of reading, with which no other check of a fit means anything."""
    return bool(check.data.get("discrete"))


def _makes(check: Check) -> Word:
    return "bad" if _group(check) == "arm" or _is_misread(check) else _MAKES.get(check.name, "doubtful")


def _weight(check: Check, residuals: float) -> float:
    """Return the ratio of a figure to its limit; infinite for results impossible for this arm, and for findings."""
    if _group(check) == "lack_of_fit":
        return max(residuals, 1.0) if np.isfinite(residuals) else 1.0
    if _group(check) == "diagnosis":
        return np.inf
    return check.statistic if np.isfinite(check.statistic) else np.inf


def _group(check: Check) -> str:
    return check.name.partition(".")[0]


def _failed(checks: Sequence[Check], group: str) -> list[Check]:
    return [each for each in checks if each.outcome == "failed" and _group(each) == group]


def _one(checks: Sequence[Check], name: str) -> Check:
    return next(each for each in checks if each.name == name)


def _accuracy(checks: Sequence[Check]) -> tuple[Answer, list[Check]]:
    """Check whether the errors at poses that were not fitted are as small as requested, or as they can be."""
    failed, validation = _failed(checks, "accuracy"), _one(checks, "accuracy.validation")
    if validation.outcome != "passed":
        return Answer("not judged", (validation,)), [each for each in failed if each is validation]
    bad = any(_makes(each) == "bad" for each in failed)
    return Answer("bad" if bad else "doubtful" if failed else "holds", (validation,)), failed


def _fit(checks: Sequence[Check]) -> tuple[Answer, list[Check]]:
    answer, reasons = _goodness(checks)
    found = [*_failed(checks, "diagnosis"), *_failed(checks, "finding")]
    if not found or _one(checks, "fit.residuals").outcome == "passed":
        return answer, reasons
    if _below_gate(checks):
        return Answer("does not matter", (found[0],)), []
    return Answer("doubtful", (found[0],)), [*found, *reasons]


def _goodness(checks: Sequence[Check]) -> tuple[Answer, list[Check]]:
    tested, residuals = [each for each in checks if _group(each) == "lack_of_fit"], _one(checks, "fit.residuals")
    if not tested:
        return Answer("holds", (replace(residuals, outcome="not tested"),)), []
    if residuals.outcome == "passed":
        return Answer("holds", (residuals,)), []
    (found,) = tested
    if found.outcome == "failed" and not is_doubted(found):  # it failed at the level of a warning
        return Answer("holds", (found, Check("fit.weak", "noted"))), []
    if found.outcome != "failed" and found.name != "lack_of_fit.nothing":
        return Answer("holds", (found,)), []
    if _below_gate(checks):
        return Answer("does not matter", (found,)), []
    return Answer("doubtful", (found,)), [found]


def _below_gate(checks: Sequence[Check]) -> bool:
    return any(each.name == "accuracy.tolerance_bound" and each.outcome == "passed" for each in checks)


_UNDETERMINED = ("links.far", "determination.limit", "links.tolerances")  # in the order of their weight


def _determination(checks: Sequence[Check], gate_m: float | None) -> tuple[Answer, list[Check]]:
    failed = [each for each in checks if each.outcome == "failed"]
    if other := _called(failed, "links.other_robot"):
        return Answer("bad", (other[0],)), other
    error, uncovered = _one(checks, "determination.error"), _called(failed, "determination.cover")
    reasons = [each for name in _UNDETERMINED for each in _called(failed, name)]
    region = error.data["region"]  # with the base placed anew it bounds no error that a gate limits
    accurate = gate_m is not None and not region.anew and region.p95_m <= gate_m
    if reasons and not uncovered and accurate:
        return Answer("does not matter", (error, reasons[0])), []
    reasons += uncovered
    if error.outcome == "failed" and gate_m is None:  # a gate is judged by the errors of the validation
        reasons.append(error)
    return Answer("doubtful" if reasons else "holds", (error,)), reasons


def _called(checks: Sequence[Check], name: str) -> list[Check]:
    return [each for each in checks if each.name == name]


def verdict(
    identification: Identification,
    validation: Validation,
    gate_m: float | None = None,
    *,
    goodness: Check | None = None,
    tolerance: Tolerance = Tolerance(),  # noqa: B008
    measured: MeasuredRange | None = None,
    findings: Sequence[Check] = (),
    prediction: Check | None = None,
    region: Region | None = None,
    poses: Region | None = None,
    left: ResidualSpread | None = None,
) -> Verdict:
    """Judge a calibration by the checks of its fit and of its validation.

    Args:
        gate_m: a larger mean error there is bad; None for no such limit.
        goodness: the test of lack of fit; None where nobody tested it.
        measured: the range of the measured joint positions; None where nothing is known of what lies beyond.
        findings: about the errors; with one that nothing supports, a calibration is doubtful at most.
        prediction: observed against predicted errors at the validation poses; None where they were not compared.
        poses: poses like the measured ones; those of the whole workspace where not given.
        region: where the arm has to be known; ``poses`` where not given.
        left: what the fit left of the measurements; worked out as if no pose was repeated where not given.
    """
    missing = goodness is not None and goodness.outcome == "failed"
    left = left or residual_spread(identification, lack_of_fit=missing)
    poses = poses or workspace_region(identification.model, identification.values)
    own = own_tolerance(identification, tolerance, poses)
    calibration = _Calibration(
        identification,
        validation,
        gate_m,
        goodness,
        tolerance,
        predict_over_workspace(identification, tolerance, lack_of_fit=missing, measured=measured),
        predict_over_region(identification, own, region or poses, left, measured=measured),
        None if measured is None else predict_elsewhere(identification, own, left, measured),
        distances_from_nominal(identification, tolerance),
    )
    given = (*([] if goodness is None else [goodness]), *findings)
    return judge((*calibration.checks(prediction), *given), gate_m)


def rotation_noise_rad(identification: Identification) -> float:
    """Noise (rad) of a measured rotation where ``sigma_m`` is a position's; NaN where no orientation is observed."""
    observation = observation_of(identification.model)
    turns = ROTATION_PARAMETERS[0] in identification.model.parameters
    rotations = observation.units[observation.positions :] if turns else np.empty(0)
    return float(identification.sigma_m * rotations[0]) if len(rotations) else float("nan")


@dataclass(frozen=True)
class _Calibration:
    """The fit, its validation and its predictions, of which checks are made."""

    identification: Identification
    validation: Validation
    gate_m: float | None
    goodness: Check | None
    tolerance: Tolerance
    workspace: WorkspacePrediction
    region: RegionPrediction
    elsewhere: RegionPrediction | None
    distances: tuple[Distance, ...]

    def checks(self, prediction: Check | None) -> list[Check]:
        return [*self._foreign(), *self._accuracy(prediction), self._residuals(), *self._determination()]

    def _foreign(self) -> list[Check]:
        """Return why the measurements cannot be of this arm, or do not identify it: the first check that fails."""
        found = self.identification
        if found.spread < CONSTANT_SPREAD:
            return [_cannot_be("constant_points")]
        if found.collapsed:
            return [_cannot_be("collapsed", names=found.collapsed)]
        if found.status != "converged":
            return [_cannot_be("convergence", status=found.status)]
        if (rms_rad := self._orientations_rad()) > _LARGEST_ROTATION_RAD:
            return [_cannot_be("orientations", rms_rad=rms_rad)]
        if found.unobservable:
            return [_cannot_be("identifiable", names=[found.model.names[i] for i in found.unobservable])]
        return []

    def _orientations_rad(self) -> float:
        observation = observation_of(self.identification.model)
        if not observation.positions:
            return 0.0
        rotations = self.identification.residuals[:, observation.positions :]
        return float(np.sqrt(np.nanmean(rotations**2))) if np.isfinite(rotations).any() else 0.0

    def _accuracy(self, prediction: Check | None) -> list[Check]:
        errors, validation = self.validation.errors, self.validation
        if errors is None or not np.isfinite(errors.after).any():
            return [Check("accuracy.validation", "not tested")]
        if validation.fitted_share > _MOST_FITTED:
            return [Check("accuracy.validation", "failed", data={"fitted_share": validation.fitted_share})]
        before, after = float(np.nanmean(errors.before)), float(np.nanmean(errors.after))
        gate = self._gate(after)
        return [
            Check("accuracy.validation", "passed", data=self._mean_errors(before, after, prediction)),
            gate,
            *([] if gate.outcome == "failed" else self._gain(errors, before, after)),
            *self._validation_poses(),
            *([] if prediction is None else [prediction]),
            self._tolerance_bound(),
        ]

    def _mean_errors(self, before_m: float, after_m: float, prediction: Check | None) -> dict[str, Any]:
        """Return the mean errors (m), with the predicted ones, and without noise where they are above the gate."""
        data = {"before_m": before_m, "after_m": after_m}
        if prediction is not None and self.validation.judged_by != "file":  # whose noise may be another
            data |= {name: prediction.data[name] for name in _COMPARED}
        if self.gate_m is not None and after_m > self.gate_m:
            data["without_noise_m"] = after_m * self._shares_without_noise()[0]
        return data

    def _gate(self, after_m: float) -> Check:
        """Check the mean error against the gate; without one against what an arm within tolerances has uncalibrated.

        A mean error above it that the noise of the validation may explain fails ``accuracy.gate_below_noise`` instead.
        """
        limit = self.workspace.tolerance_rms_m if self.gate_m is None else self.gate_m
        given = self.identification.sigma_given
        known, least = self._shares_without_noise()
        within = not after_m > limit or (given and after_m * known <= limit)  # without positions the limit is NaN
        data = {
            "after_m": after_m,
            "limit_m": limit,
            "gate": self.gate_m is not None,
            "oriented": not np.isnan(rotation_noise_rad(self.identification)),
            "noise_given": given,
        }
        name = "accuracy.gate" if within or after_m * least > limit else "accuracy.gate_below_noise"
        return Check(name, "passed" if within else "failed", after_m / limit if after_m > limit else 0.0, data=data)

    def _shares_without_noise(self) -> tuple[float, float]:
        """Return the arm's share of the measured errors, and its lower 95 % limit, without the validation's noise.

        Where no noise is given, that of the residuals counts, up to what common instruments have.
        """
        errors, found = self.validation.errors, self.identification
        if errors is None or self.validation.judged_by == "fresh":
            return 1.0, 1.0
        squares = errors.after[np.isfinite(errors.after)] ** 2
        noise = 3 * (found.sigma_m if found.sigma_given else min(found.sigma_m, COMMON_NOISE_M)) ** 2
        if not (measured := float(squares.mean())) > 0:
            return 1.0, 1.0
        arm = max(measured - noise, 0.0)
        least = arm - _ONE_SIDED * np.sqrt((2 / 3 * noise**2 + 4 / 3 * noise * arm) / squares.size)
        return float(np.sqrt(arm / measured)), float(np.sqrt(max(least, 0.0) / measured))

    def _gain(self, errors: Errors, before: float, after: float) -> list[Check]:
        """Check that the calibrated model is better than the nominal one, where it is not as good as noise allows."""
        floor = _NOISE_FLOOR * self._floor_m() + _FLOOR_M
        if float(np.sqrt(np.nanmean(errors.after**2))) <= floor or before <= 0:
            return []
        grown = float(np.nanmax(errors.after)) > float(np.nanmax(errors.before))
        data = {"before_m": before, "after_m": after, "grown": grown}
        if after > _WORSE * before:
            return [Check("accuracy.worse", "failed", after / before, data=data)]
        if after > _LEAST_GAIN * before or (grown and after > _CLEAR_GAIN * before):
            times = after / before / _LEAST_GAIN if not grown else 1 + after / before
            return [Check("accuracy.gain", "failed", times, data=data)]
        return []

    def _floor_m(self) -> float:
        """Return the root mean square error (m) by noise and the covariance alone; NaN where unknown."""
        found, predicted = self.identification, self.workspace.rms_m
        if self.validation.judged_by == "fresh":
            return predicted if np.isfinite(predicted) else 0.0
        if not found.sigma_given:
            return 0.0
        return float(np.sqrt(3 * found.sigma_m**2 + np.nan_to_num(predicted) ** 2))

    def _validation_poses(self) -> list[Check]:
        checks, found = [], self.validation
        if found.fitted_share > 0:
            data = {"share": found.fitted_share}
            checks.append(Check("accuracy.fitted_poses", "failed", 1 + found.fitted_share, data=data))
        if found.outlier_share > MOST_OUTLIERS:
            times, data = found.outlier_share / MOST_OUTLIERS, {"share": found.outlier_share}
            checks.append(Check("accuracy.outliers", "failed", times, data=data))
        return checks

    def _tolerance_bound(self) -> Check:
        """Check whether 95 % of the validation errors are below the gate, with 95 % confidence."""
        errors = self.validation.errors
        if self.gate_m is None or errors is None or self.validation.fitted_share > 0:
            return Check("accuracy.tolerance_bound", "not tested")
        worst = np.max(np.where(np.isfinite(errors.after), errors.after, -np.inf), axis=1)
        bound_m = upper_tolerance_bound(worst[np.isfinite(worst)])
        return Check("accuracy.tolerance_bound", "passed" if bound_m < self.gate_m else "noted", bound_m / self.gate_m)

    def _residuals(self) -> Check:
        """Compare the residuals with the given noise: passed where they are rounding."""
        found = self.identification
        given = found.sigma_given and found.sigma_m > 0
        times = found.residual_sigma_m / found.sigma_m if given else float("nan")
        return Check("fit.residuals", "passed" if found.residual_sigma_m < _FLOOR_M else "noted", times)

    def _determination(self) -> list[Check]:
        """Check whether the arm is determined over its region, and is the one of the nominal model."""
        region = self.region
        data = {
            "region": region,
            "elsewhere": self.elsewhere,
            "workspace": self.workspace,
            "farthest": self.distances[0] if self.distances else None,
            "condition": self.identification.fit.condition,
        }
        if self.identification.lacks_size:
            error = Check("determination.error", "failed", 1.0, data=data)
        else:
            error = Check("determination.error", "noted", data=data)
        checks = [error, *self._far_links(), *self._limit(data), *self._links_beyond_tolerances()]
        if region.lacks and (alone := region.extrapolated_share) > MOST_UNCOVERED:
            checks.append(Check("determination.cover", "failed", alone / MOST_UNCOVERED, data={"region": region}))
        return checks

    @cached_property
    def _far(self) -> tuple[Distance, ...]:
        """The links whose distance from nominal is another robot's, the farthest first."""
        return tuple(each for each in self.distances if each.size > self._largest(each))

    def _far_links(self) -> list[Check]:
        """Check whether links are those of another robot: surely, or by what they were estimated."""
        checks = list[Check]()
        surely = [each for each in self._far if each.sure > self._largest(each) and self._is_felt(each)]
        if surely and observation_of(self.identification.model).positions:
            times = surely[0].size / self._largest(surely[0])
            checks.append(Check("links.other_robot", "failed", times, data={"distance": surely[0]}))
        if self._far:
            times = self._far[0].size / self._largest(self._far[0])
            checks.append(Check("links.far", "failed", times, data={"distance": self._far[0]}))
        return checks

    def _links_beyond_tolerances(self) -> list[Check]:
        """Check whether a link is farther from nominal than tolerances explain, where none is another robot's."""
        beyond = [each for each in self.distances if each.sure_tolerances > MOST_TOLERANCES]
        if self._far or not beyond:
            return []
        times = beyond[0].tolerances / MOST_TOLERANCES
        return [Check("links.tolerances", "failed", times, data={"distance": beyond[0]})]

    def _is_felt(self, of: Distance) -> bool:
        """Decide whether positions show that a link is another one, by more than the tolerances explain.

        A weakly observable link harms no prediction, however far from nominal it is estimated.
        """
        errors, most = self.validation.errors, self.workspace.tolerance_rms_m
        model, nominal = self.identification.model, np.inf
        placed = set(indices_of_groups(model.parameters, ("base", "tool")))
        fixed = placed & set(self.identification.base_set.fixed)  # in their place a link was freed on request
        freed = fixed and fixed - set(base_set(model, self.identification.nominal_aligned).fixed)
        if not freed and errors is not None and np.isfinite(errors.before).any():
            nominal = float(np.sqrt(np.nanmean(errors.before**2)))
        return not min(of.felt_m, nominal) <= most

    def _largest(self, of: Distance) -> float:
        """Return the distance from nominal beyond which a link is of another robot."""
        tolerance, least = self.tolerance, COLLAPSED[of.is_angle]
        return max(float(least), MOST_TOLERANCES * (tolerance.angle_rad if of.is_angle else tolerance.length_m))

    def _limit(self, predicted: Mapping[str, Any]) -> list[Check]:
        """Check the predicted error over the region against its limit.

        Under a gate the predicted mean counts, as the gate is of a mean; where the model shows lack of fit, which is
        larger elsewhere, the predicted 95 % error. Without a gate the limit is that of an arm within its tolerances. No
        limit depends on the calibration's own errors, so that a more accurate one never exceeds more.
        """
        region = self.region
        if self.gate_m is None:
            limit, missing = _UNINFORMATIVE * region.uncalibrated_rms_m, False
            failed = region.p95_m > limit > 0
            times = region.p95_m / limit if failed else 0.0
        else:
            limit, missing = self.gate_m, self.goodness is not None and is_doubted(self.goodness)
            times = region.p95_m / limit if missing else region.mean_m / limit / _ROUGHLY
            failed = times > 1
        data = {**predicted, "limit_m": limit, "gate": self.gate_m is not None, "lack_of_fit": missing}
        return [Check("determination.limit", "failed", times, data=data)] if failed else []


def _cannot_be(what: str, **data: Any) -> Check:
    return Check(f"arm.{what}", "failed", float("inf"), data=data)
