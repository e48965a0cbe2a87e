"""The verdict on a calibration: three answers (accuracy, goodness of fit, determination), and one word.

It is good only where all three hold or do not matter. Lack of fit does not matter where a gate is given and the
95 %/95 % tolerance bound of the validation errors lies below it; weak determination does not where the predicted 95 %
error over the region does. The region is where poses were measured, or the one that a task names; the rest of the
workspace is extrapolated, and has a figure of its own. What cannot be of this arm is bad, whatever the errors are. It
is never good where something changed during the campaign, or where errors at poses that were not fitted exceed their
prediction.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from lab.calibration.extrapolation import MeasuredRange
from lab.calibration.identify import Identification
from lab.calibration.noise.plausibility import NoiseFinding
from lab.calibration.observation import observation_of
from lab.calibration.pose_cover import MOST_UNCOVERED
from lab.calibration.prediction_check import PredictionCheck
from lab.calibration.prior import Tolerance
from lab.calibration.regions import Region, workspace_region
from lab.calibration.residual_spread import ResidualSpread, residual_spread
from lab.calibration.statistics.goodness_of_fit import GoodnessOfFit
from lab.calibration.statistics.tolerance_bound import upper_tolerance_bound
from lab.calibration.validation import MOST_OUTLIERS, Errors, Validation
from lab.calibration.workspace_prediction import (
    Distance,
    RegionPrediction,
    WorkspacePrediction,
    distances_from_nominal,
    own_tolerance,
    predict_elsewhere,
    predict_over_region,
    predict_over_workspace,
)
from lab.kinematics.gauge import base_set
from lab.kinematics.parameter import indices_of_groups

__all__ = [
    "CONSTANT_SPREAD",
    "MOST_TOLERANCES",
    "Answer",
    "Reason",
    "Verdict",
    "Word",
    "gate_words",
    "rotation_noise_rad",
    "verdict",
]

CONSTANT_SPREAD = 1e-6  # of what was measured, to the nominal model's: below, it does not change from pose to pose
LARGEST_CHANGE_M, LARGEST_CHANGE_RAD = 20e-3, np.deg2rad(10)  # of a link: beyond, it is another robot's drawing
LARGEST_ROTATION_RAD = 50e-3  # of measured orientations' residuals: no probe is that bad, and no calibration needs it
MOST_TOLERANCES = 10.0  # that a link is from its nominal value
LEAST_GAIN = 0.9  # of the mean error: what is left of more is hardly an improvement
CLEAR_GAIN = 0.5  # of the mean error: below, a larger maximum is one pose's
WORSE = 1.1  # times the nominal model's mean error
NOISE_FLOOR = 1.5  # times what the noise and the parameters' covariance make of the error
KNOWN_BEFORE = 0.5  # of what tolerances make of an arm: a calibration that predicts no less says little
ROUGHLY = 1.1  # times the predicted mean error: as much a campaign's own differs from what is predicted
MOST_FITTED = 0.5  # of the validation poses: if more were fitted, they validate nothing
_FLOOR_M = 1e-7  # errors below are rounding

Word = Literal["good", "doubtful", "bad", "not judged"]
Standing = Literal["holds", "does not matter", "doubtful", "bad", "not judged"]


@dataclass(frozen=True)
class Reason:
    """Why a calibration is not good.

    Attributes:
        words: of a sentence.
        weight: how many times a figure is what it may be at most; infinite of what cannot be of this arm.
        word: what it makes of the calibration.
    """

    words: str
    weight: float
    word: Word = "doubtful"


@dataclass(frozen=True)
class Answer:
    """One of the three answers: whether it holds, and its figures in words."""

    standing: Standing
    words: str


@dataclass(frozen=True)
class Verdict:
    """One word for a calibration, the three answers that it comes from, and the reasons where it is not good.

    Attributes:
        workspace: the predicted errors over the whole workspace, by the covariance alone.
        region: the predicted errors that determination is judged by.
        farthest: the link that is estimated farthest from its nominal value; None where none is identified.
        reasons: the heaviest first.
        gate_m: the largest mean error that was asked for; None where none was.
        prediction: observed against predicted errors at the validation poses; None where they were not compared.
        elsewhere: the predicted errors over the extrapolated part of the workspace; None where there is none, or the
            measured poses are not known.
    """

    word: Word
    accuracy: Answer
    fit: Answer
    determination: Answer
    workspace: WorkspacePrediction
    region: RegionPrediction
    farthest: Distance | None = None
    reasons: tuple[str, ...] = ()
    gate_m: float | None = None
    prediction: PredictionCheck | None = None
    elsewhere: RegionPrediction | None = None

    @property
    def reason(self) -> str:
        """All reasons in one line; empty where the calibration is good."""
        return "; ".join(self.reasons)

    @property
    def answers(self) -> dict[str, Answer]:
        """The three answers by their names."""
        return {"accuracy": self.accuracy, "goodness of fit": self.fit, "determination": self.determination}


def verdict(
    identification: Identification,
    validation: Validation,
    gate_m: float | None = None,
    *,
    goodness: GoodnessOfFit | None = None,
    tolerance: Tolerance = Tolerance(),  # noqa: B008
    measured: MeasuredRange | None = None,
    findings: Sequence[NoiseFinding] = (),
    prediction: PredictionCheck | None = None,
    region: Region | None = None,
    poses: Region | None = None,
    left: ResidualSpread | None = None,
) -> Verdict:
    """Judge a calibration.

    Args:
        identification: the fit.
        validation: its errors on poses that were not fitted.
        gate_m: a larger mean error there is bad; None for no such limit.
        goodness: whether the model fits what was measured; None where nobody tested it.
        tolerance: of manufacture.
        measured: the range of the measured joint positions; None where nothing is known of what lies beyond.
        findings: about the errors; with one that nothing supports, a calibration is doubtful at most.
        prediction: observed against predicted errors at the validation poses; None where they were not compared.
        poses: poses like the measured ones; those of the whole workspace where not given.
        region: where the arm has to be known; ``poses`` where not given.
        left: what the fit left of the measurements; worked out as if no pose was repeated where not given.
    """
    lacking = goodness is not None and goodness.adequate is False
    left = left or residual_spread(identification, lack_of_fit=lacking)
    poses = poses or workspace_region(identification.model, identification.values)
    own = own_tolerance(identification, tolerance, poses)
    judging = _Judging(
        identification,
        validation,
        gate_m,
        goodness,
        tolerance,
        predict_over_workspace(identification, tolerance, lack_of_fit=lacking, measured=measured),
        predict_over_region(identification, own, region or poses, left, measured=measured),
        distances_from_nominal(identification, tolerance),
        tuple(each for each in findings if not each.supported),
        prediction,
    )
    elsewhere = None
    if measured is not None:
        elsewhere = predict_elsewhere(identification, own, left, measured)
    foreign = judging.foreign()
    accuracy, because = judging.accuracy()
    fit, misfits = judging.fit()
    determination, unsure = judging.determination(elsewhere)
    if foreign:  # of a fit that is not this arm's, small errors are no good news
        found = accuracy, fit, determination
        good = ("holds", "does not matter")
        accuracy, fit, determination = (replace(a, standing="not judged") if a.standing in good else a for a in found)
    reasons = sorted(
        foreign or [*because, *misfits, *unsure],  # of another arm, all else only follows
        key=lambda each: (("bad", "not judged", "doubtful").index(each.word), -each.weight),
    )
    words: list[Word] = [each.word for each in reasons]
    if "bad" not in words and accuracy.standing == "not judged":
        words = ["not judged"]
    said = tuple(dict.fromkeys(each.words for each in reasons))
    farthest = judging.distances[0] if judging.distances else None
    word = words[0] if words else "good"
    return Verdict(
        word,
        accuracy,
        fit,
        determination,
        judging.workspace,
        judging.region,
        farthest,
        said,
        gate_m,
        prediction,
        elsewhere,
    )


def gate_words(gate_mm: float | None) -> str:
    """The gate (mm), for a person."""
    return "no gate was given" if gate_mm is None else f"gate: {gate_mm:g} mm"


def rotation_noise_rad(identification: Identification) -> float:
    """Noise (rad) of a measured rotation where ``sigma_m`` is a position's; NaN where no orientation is observed."""
    observation = observation_of(identification.model)
    rotations = observation.units[observation.positions :] if observation.positions else np.empty(0)
    return float(identification.sigma_m * rotations[0]) if len(rotations) else float("nan")


@dataclass(frozen=True)
class _Judging:
    """All that a verdict is made from."""

    identification: Identification
    validation: Validation
    gate_m: float | None
    goodness: GoodnessOfFit | None
    tolerance: Tolerance
    workspace: WorkspacePrediction
    region: RegionPrediction
    distances: tuple[Distance, ...]
    unsupported: tuple[NoiseFinding, ...]
    prediction: PredictionCheck | None

    def foreign(self) -> list[Reason]:
        """Why the measurements cannot be of this arm, or do not identify it."""
        found = self.identification
        if found.spread < CONSTANT_SPREAD:
            return [_cannot_be("what was measured is the same in every pose: wrong column?")]
        if not found.plausible:
            times = f"{found.spread:.3g} times as far as the robot's do in these poses"
            return [_cannot_be(f"the measured points spread {times}: wrong unit, or another robot")]
        if found.status == "in a valley":
            return [
                _cannot_be("the fit ended in a valley, along which the measurements say next to nothing (--prior on)")
            ]
        if found.status != "converged":
            why = "wrong robot, signs or axes, or too little measured for these (--prior on)?"
            return [_cannot_be(f"Gauss-Newton did not converge: {why}")]
        if words := self._strange_rotations() or self._unconstrained_links():
            return [_cannot_be(words)]
        if found.unobservable:
            names = [found.model.names[i] for i in found.unobservable]
            plural = "are" if len(names) > 1 else "is"
            return [_cannot_be(f"{', '.join(names)} {plural} not identifiable from these poses")]
        return []

    def _strange_rotations(self) -> str:
        """That measured orientations do not fit at all; empty if they do."""
        observation = observation_of(self.identification.model)
        if not observation.positions:
            return ""
        rotations = self.identification.residuals[:, observation.positions :]
        off = float(np.sqrt(np.nanmean(rotations**2))) if np.isfinite(rotations).any() else 0.0
        words = f"measured orientations do not fit ({1e3 * off:.3g} mrad): wrong --orientation or columns?"
        return words if off > LARGEST_ROTATION_RAD else ""

    def _unconstrained_links(self) -> str:
        """Where only fixtures hold the arm: that links and errors may have shrunk together; empty if they did not."""
        model, found = self.identification.model, self.identification
        if observation_of(model).positions:
            return ""
        lengths = [i for i, each in enumerate(model.parameters) if each.is_link and each.kind == "length"]
        off = float(np.abs(found.values - found.nominal_aligned)[lengths].max())
        if off <= LARGEST_CHANGE_M:
            return ""
        return (
            f"a link is estimated {1e3 * off:.3g} mm from its nominal length: these fixtures do not constrain the arm; "
            "wrong columns or rows, or is --prior on needed?"
        )

    def accuracy(self) -> tuple[Answer, list[Reason]]:
        """Are the errors at poses that were not fitted as small as was asked, or as small as they can be?"""
        errors, validation = self.validation.errors, self.validation
        if errors is None or not np.isfinite(errors.after).any():
            return Answer("not judged", "no poses were held out, so the accuracy is not known"), []
        if validation.fitted_share > MOST_FITTED:
            share = f"{100 * validation.fitted_share:.0f} % of the validation poses"
            words = f"{share} are those that were fitted, so the accuracy is not known"
            return Answer("not judged", words), [Reason(words, np.inf, "not judged")]
        before, after = float(np.nanmean(errors.before)), float(np.nanmean(errors.after))
        said = f"{_mm(before)} with the nominal model, {_mm(after)} with the calibrated one (means)"
        if self.prediction is not None and validation.judged_by != "file":  # whose noise may be another
            of_95 = _mm(self.prediction.observed_p95_m), _mm(self.prediction.predicted_p95_m)
            said += "; 95 % are below {}, and {} was predicted there".format(*of_95)
        if self.gate_m is not None and after > self.gate_m:
            said += f", {_mm(after * self._share_without_noise())} of it without the noise of the validation"
        reasons = self._above_gate(after) or self._no_gain(errors, before, after)
        reasons += self._doubtful_validation() + self._beyond_prediction()
        if any(each.word == "bad" for each in reasons):
            return Answer("bad", said), reasons
        return Answer("doubtful" if reasons else "holds", said), reasons

    def _above_gate(self, after: float) -> list[Reason]:
        """The mean error against the gate; without one against what an arm within tolerances has uncalibrated."""
        guess = "" if np.isnan(rotation_noise_rad(self.identification)) else "; wrong --orientation?"
        begun = f"does not fit: {_mm(after)} on poses not fitted, above"
        if self.gate_m is not None:
            limit, words = self.gate_m, f"the gate of {1e3 * self.gate_m:g} mm"
        else:
            limit = self.workspace.tolerance_rms_m
            words = f"the {_mm(limit)} of an arm within its tolerances that was never calibrated"
        if not after > limit:
            return []
        if after * self._share_without_noise() <= limit:
            return []
        return [Reason(f"{begun} {words}{guess}", after / limit, "bad")]

    def _share_without_noise(self) -> float:
        """The share of the measured errors that is the arm's: the rest is the noise of the validation, where known."""
        errors, found = self.validation.errors, self.identification
        if errors is None or self.validation.judged_by == "fresh" or not found.sigma_known:
            return 1.0
        square = float(np.nanmean(errors.after**2))
        return float(np.sqrt(max(1 - 3 * found.sigma_m**2 / square, 0.0))) if square > 0 else 1.0

    def _no_gain(self, errors: Errors, before: float, after: float) -> list[Reason]:
        """That the calibrated model is hardly better than the nominal one, though not as good as noise allows."""
        floor = NOISE_FLOOR * self._floor_m() + _FLOOR_M
        if float(np.sqrt(np.nanmean(errors.after**2))) <= floor or before <= 0:
            return []
        figures = f"{_mm(before)} before, {_mm(after)} after"
        if after > WORSE * before:
            return [Reason(f"the calibrated model is worse than the nominal one: {figures}", after / before, "bad")]
        grown = float(np.nanmax(errors.after)) > float(np.nanmax(errors.before))
        if after > LEAST_GAIN * before or (grown and after > CLEAR_GAIN * before):
            largest = ", and the largest error grew" if grown else ""
            words = f"hardly better than the nominal model: {figures}{largest}"
            return [Reason(words, after / before / LEAST_GAIN if not grown else 1 + after / before)]
        return []

    def _floor_m(self) -> float:
        """The root mean square error (m) that noise and the covariance alone would make; NaN where it is not known."""
        found, predicted = self.identification, self.workspace.rms_m
        if self.validation.judged_by == "fresh":
            return predicted if np.isfinite(predicted) else 0.0
        if not found.sigma_known:
            return 0.0
        return float(np.sqrt(3 * found.sigma_m**2 + np.nan_to_num(predicted) ** 2))

    def _doubtful_validation(self) -> list[Reason]:
        """That the validation itself is not to be trusted."""
        reasons, found = [], self.validation
        if found.fitted_share > 0:
            words = f"{100 * found.fitted_share:.0f} % of the validation poses were fitted"
            reasons.append(Reason(words, 1 + found.fitted_share))
        if found.outlier_share > MOST_OUTLIERS:
            words = f"{100 * found.outlier_share:.3g} % of the hold-out set are outliers"
            reasons.append(Reason(words, found.outlier_share / MOST_OUTLIERS))
        return reasons

    def _beyond_prediction(self) -> list[Reason]:
        """Report errors at poses that were not fitted that are larger than predicted: no gate makes that good."""
        found = self.prediction
        if found is None or not found.exceeded:
            return []
        words = (
            f"95 % of the errors at poses that were not fitted are below {_mm(found.observed_p95_m)}, but "
            f"{_mm(found.predicted_p95_m)} was predicted there ({_mm(found.allowed_p95_m)} with chance): the model or "
            "the noise is not what was assumed"
        )
        return [Reason(words, found.observed_p95_m / max(found.allowed_p95_m, _FLOOR_M))]

    def fit(self) -> tuple[Answer, list[Reason]]:
        """Are the residuals what the noise explains, and is that noise what instruments and arms have?"""
        answer, reasons = self._goodness()
        found = self.unsupported
        if not found or self.identification.residual_sigma_m < _FLOOR_M:
            return answer, reasons
        events = [each for each in found if each.between is not None]
        if not events and self._validated_below_gate():
            return Answer("does not matter", found[0].words), []
        first = [Reason(each.words, np.inf) for each in found]
        return Answer("doubtful", first[0].words), [*first, *reasons]

    def _goodness(self) -> tuple[Answer, list[Reason]]:
        """Are the residuals what the noise explains?"""
        found = self.goodness
        if found is None:
            return Answer("holds", "not tested"), []
        if self.identification.residual_sigma_m < _FLOOR_M:
            return Answer("holds", "the residuals are rounding"), []
        if found.adequate is not False and found.by != "nothing":
            return Answer("holds", found.words), []
        if found.adequate is False and not found.is_doubted:
            return Answer("holds", f"{found.words}: too weak for a doubt"), []
        if self._validated_below_gate():
            return Answer("does not matter", found.words), []
        ratio = 1.0
        if self.identification.sigma_known and self.identification.sigma_m > 0:
            ratio = max(self.identification.residual_sigma_m / self.identification.sigma_m, 1.0)
        return Answer("doubtful", found.words), [Reason(found.words, ratio)]

    def _validated_below_gate(self) -> bool:
        """Whether 95 % of the validation errors are below the gate, with 95 % confidence."""
        errors = self.validation.errors
        if self.gate_m is None or errors is None or self.validation.fitted_share > 0:
            return False
        worst = np.max(np.where(np.isfinite(errors.after), errors.after, -np.inf), axis=1)
        return upper_tolerance_bound(worst[np.isfinite(worst)]) < self.gate_m

    def determination(self, elsewhere: RegionPrediction | None) -> tuple[Answer, list[Reason]]:
        """Decide whether the arm is known over its region, and is the one of the nominal model.

        Args:
            elsewhere: the prediction over the extrapolated part of the workspace, which is reported and not judged.
        """
        far = [each for each in self.distances if each.size > self._largest(each)]
        surely = [each for each in far if each.sure > self._largest(each) and self._is_felt(each)]
        if surely and observation_of(self.identification.model).positions:
            words = f"{_far(surely[0])}: is the nominal model that of this robot?"
            return Answer("bad", words), [Reason(words, surely[0].size / self._largest(surely[0]), "bad")]
        region, predicted, condition = self.region, self.region.p95_m, self.identification.fit.condition
        of_condition = f", condition number {condition:,.0f}" if np.isfinite(condition) else ""
        said = (
            f"the predicted 95 % error {region.words} is {_mm(predicted)}{_elsewhere_words(elsewhere)}{of_condition}"
            if np.isfinite(predicted)
            else f"the error {region.words} cannot be predicted{of_condition}"
        )
        reasons = [Reason(_far(far[0]), far[0].size / self._largest(far[0]))] if far else []
        reasons += [Reason(f"{said}; {words}", times) for times, words in self._exceeded()[:1]]
        off = [each for each in self.distances if each.sure_tolerances > MOST_TOLERANCES]
        if off and not far:
            reasons.append(Reason(_far(off[0]), off[0].tolerances / MOST_TOLERANCES))
        if region.lacks and (alone := region.extrapolated_share) > MOST_UNCOVERED:
            words = f"{100 * alone:.0f} % of the poses {region.words} are extrapolated: not covered by measured poses"
            reasons.append(Reason(words, alone / MOST_UNCOVERED))
        elif reasons and self.gate_m is not None and predicted <= self.gate_m:
            return Answer("does not matter", f"{said}; {reasons[0].words}"), []
        return Answer("doubtful" if reasons else "holds", said), reasons

    def _is_felt(self, of: Distance) -> bool:
        """Decide whether positions show that a link is another one, by more than the tolerances explain.

        What a point near an axis hardly shows harms no prediction, however far from nominal it is estimated.
        """
        errors, most = self.validation.errors, self.workspace.tolerance_rms_m
        model, nominal = self.identification.model, np.inf
        placed = set(indices_of_groups(model.parameters, ("base", "tool")))
        fixed = placed & set(self.identification.base_set.fixed)  # in their place a link was freed on request
        asked = fixed and fixed - set(base_set(model, self.identification.nominal_aligned).fixed)
        if not asked and errors is not None and np.isfinite(errors.before).any():
            nominal = float(np.sqrt(np.nanmean(errors.before**2)))
        return not min(of.felt_m, nominal) <= most

    def _largest(self, of: Distance) -> float:
        """A link that is farther from its nominal value is of another robot."""
        tolerance, least = self.tolerance, (LARGEST_CHANGE_M, LARGEST_CHANGE_RAD)[of.is_angle]
        return max(float(least), MOST_TOLERANCES * (tolerance.angle_rad if of.is_angle else tolerance.length_m))

    def _exceeded(self) -> list[tuple[float, str]]:
        """List the limits that the predicted error over the region exceeds: how many times, and which.

        Under a gate the predicted mean counts, as the gate is of a mean; where the model shows lack of fit, which is
        larger elsewhere, the predicted 95 % error. Without a gate the limit is that of an arm within its tolerances. No
        limit depends on the calibration's own errors, so that a more accurate one never exceeds more.
        """
        predicted = self.region
        if self.gate_m is not None:
            if self.goodness is not None and self.goodness.is_doubted:
                times, words = predicted.p95_m / self.gate_m, "with the lack of fit that"
            else:
                times, words = (
                    predicted.mean_m / self.gate_m / ROUGHLY,
                    f"the predicted mean of {_mm(predicted.mean_m)}",
                )
            return [(times, f"{words} is above the gate of {_mm(self.gate_m)}")] if times > 1 else []
        never = KNOWN_BEFORE * predicted.uncalibrated_rms_m
        words = f"above {_mm(never)}, half of the error of such an arm that was never calibrated"
        return [(predicted.p95_m / never, words)] if predicted.p95_m > never > 0 else []


def _elsewhere_words(elsewhere: RegionPrediction | None) -> str:
    """Report the extrapolated part of the workspace, in a sentence; nothing where there is none."""
    if elsewhere is None or not np.isfinite(elsewhere.p95_m):
        return ""
    share = 100 * elsewhere.extrapolated_share
    return f", in the extrapolated {share:.0f} % of the workspace {_mm(elsewhere.p95_m)}"


def _mm(length_m: float) -> str:
    """A length in mm, for a person."""
    millimetres = 1e3 * length_m
    return f"{millimetres:,.0f} mm" if millimetres >= 1e3 else f"{millimetres:.3g} mm"


def _cannot_be(words: str) -> Reason:
    return Reason(words, np.inf, "bad")


def _far(distance: Distance) -> str:
    size = f"{np.rad2deg(distance.size):.3g}°" if distance.is_angle else _mm(distance.size)
    return f"{distance.name} is estimated {size} from its nominal value ({distance.tolerances:,.0f} tolerances)"
