"""Phrases of a calibration's checks: lack of fit, findings about the errors, and the verdict."""

from collections.abc import Mapping

import numpy as np

from lab.core.checks import Check
from lab.core.errors import counted
from lab.core.units import DEGREES, MM, MRAD, short_length
from lab.phrases import diagnosis_phrases as diagnosis
from lab.phrases.template import PRIOR, Phrase
from lab.prediction.task_region import RegionKind
from lab.prediction.workspace_prediction import Distance, RegionPrediction
from lab.verdict.noise_findings import COMMON_NOISE_M
from lab.verdict.verdict import Verdict

__all__ = ["LACK_OF_FIT_ADVICE", "PHRASES", "gate_text", "next_step", "region_text", "without_figures"]

_REGIONS: Mapping[RegionKind, str] = {
    "measured": "where poses were measured",
    "workspace": "over the workspace",
    "box": "in the box of the task",
    "targets": "at the targets of the task",
}


def gate_text(gate_mm: float | None) -> str:
    """Return the gate (mm) in words."""
    return "no gate was given" if gate_mm is None else f"gate: {gate_mm:g} mm"


def region_text(region: RegionPrediction) -> str:
    """Return the name of a region as the end of a sentence."""
    return _REGIONS[region.kind]


_NOT_TESTED = {
    "residual": (
        "lack of fit is not tested",
        ": the group residual follows the measurements; only errors at other poses test it",
    ),
    "left out": ("lack of fit is not tested", ": the step 'check lack of fit' was left out"),
    "misread": ("lack of fit is not tested", ": the measurements are misread"),
    "too few": ("lack of fit cannot be tested", ": there are no more measurements than parameters; measure more poses"),
    "unknown noise": (
        "lack of fit cannot be tested",
        ": sigma is estimated from the same residuals; give --instrument, --noise-mm or --noise-px, or measure some "
        "poses twice",
    ),
}
_TESTS = {
    "lack_of_fit.repeats": "F test of lack of fit",
    "lack_of_fit.holdout": "F test of held-out errors",
    "lack_of_fit.joints": "F test of each joint's sine and cosine",
    "lack_of_fit.distances": "F test against distances between targets",
}


def without_figures(check: Check) -> str:
    """Return what a test of lack of fit found, without the figures and the advice that stand with the verdict."""
    if check.outcome == "failed":
        return "lack of fit"
    if "shared" in check.data:
        return "; ".join(check.data["shared"].descriptions)
    if check.name == "lack_of_fit.nothing":
        return _NOT_TESTED[check.data["why"]][0]
    return "no lack of fit detected" if check.outcome == "passed" else _signs(check)


def _figures(check: Check) -> str:
    first, second = check.data["dof"]
    return f"({_TESTS[check.name]}, {first} and {second} degrees of freedom, p = {check.p:.2g})"


def _seen(check: Check) -> str:
    if check.name == "lack_of_fit.joints":
        return f"the residuals vary with the joints {_figures(check)}"
    return f"the errors at held-out poses are {check.statistic:.3g} times their prediction {_figures(check)}"


def _not_seen(check: Check) -> str:
    if check.name == "lack_of_fit.joints":
        return f"the residuals do not vary with the joints {_figures(check)}"
    return f"the errors at held-out poses are consistent with their prediction {_figures(check)}"


def _signs(check: Check) -> str:
    return " and ".join(map(_not_seen, check.data.get("tests", ()))) or _chi2(check)


def _chi2(check: Check) -> str:
    (dof,) = check.data["dof"]
    test = f"(chi2 test, {dof} degrees of freedom, p = {check.p:.2g})"
    if check.outcome == "passed":
        return f"no lack of fit detected: the residuals are consistent with the instrument's noise {test}"
    if check.outcome == "not tested":
        too_large = "so the given noise is too large to test the fit"
        return f"the residuals are only {check.statistic:.2g} times the noise, {too_large} {test}"
    text = f"lack of fit: the residuals are {check.statistic:.3g} times the noise {test}"
    if "shared" not in check.data:
        return text
    shared = "; ".join(check.data["shared"].descriptions)
    return f"{text}, as if {shared}; only repeats could distinguish that from model discrepancy"


def _repeats(check: Check) -> str:
    if check.outcome == "passed":
        return f"no lack of fit detected: the residuals are consistent with the repeatability {_figures(check)}"
    return f"lack of fit: the residuals are {check.statistic:.3g} times the repeatability {_figures(check)}"


def _distances(check: Check) -> str:
    instrument = check.data["instrument"].description
    if check.outcome == "passed":
        return (
            f"no lack of fit detected: {instrument}, and the other residuals are consistent with that {_figures(check)}"
        )
    return f"lack of fit: {instrument}, and the other residuals are {check.statistic:.3g} times that {_figures(check)}"


def _unknown_noise(check: Check) -> str:
    """Word the tests that need no given noise: of held-out errors, and of the joints' positions."""
    if check.outcome == "failed":
        return f"lack of fit: {_seen(check.data['tests'][0])}"
    return f"{_signs(check)}; only a given sigma or repeats could show that the rest is noise"


def _joints(check: Check) -> str:
    if "shared" not in check.data:
        return _unknown_noise(check)
    shared = "; ".join(check.data["shared"].descriptions)
    if check.outcome == "failed":
        return f"lack of fit: beside random errors ({shared}) {_seen(check)}"
    return f"{shared}: {_not_seen(check)}; only repeats could show that the model is complete"


def _nothing(check: Check) -> str:
    if "shared" in check.data:
        return f"{'; '.join(check.data['shared'].descriptions)}: beside these errors lack of fit cannot be tested"
    return "".join(_NOT_TESTED[check.data["why"]])


def _unsupported(check: Check) -> str:
    return "; no repeated poses and no stated instrument support it" if check.outcome == "failed" else ""


def _drift(check: Check) -> str:
    size = short_length(check.data["size_m"])
    return f"the base or the instrument drifts by {size} over the campaign{_unsupported(check)}"


def _correlated(check: Check) -> str:
    size = short_length(check.data["size_m"])
    next_pose = f"{check.data['correlation']:.2g} from one pose to the next"
    return f"errors are correlated in time: {size} (1σ per axis), {next_pose}{_unsupported(check)}"


def _scatter(check: Check) -> str:
    size = MRAD.text(check.data["scatter_rad"], 2)
    at_tool = short_length(check.data["size_m"])
    return f"joints scatter by {size} from pose to pose ({at_tool} at the tool){_unsupported(check)}"


def _residuals(check: Check) -> str:
    return "the residuals are at rounding level" if check.outcome == "passed" else "not tested"


def _convergence(check: Check) -> str:
    if check.data["status"] == "in a valley":
        return f"the fit stalled on an ill-conditioned problem: some parameters are unobservable ({PRIOR})"
    why = f"wrong robot, signs or axes, or too few measurements for these parameters ({PRIOR})?"
    return f"Gauss-Newton did not converge: {why}"


_MOST_COLLAPSED = 3  # links in a sentence


def _collapsed(check: Check) -> str:
    names = check.data["names"]
    first, more = ", ".join(names[:_MOST_COLLAPSED]), len(names) - _MOST_COLLAPSED
    others = f" and {counted(more, 'other')}" if more > 0 else ""
    return (
        f"the readings do not determine {first}{others}: the fit found those of another arm, "
        "whose errors are small for any readings; they are not stated"
    )


def _identifiable(check: Check) -> str:
    names = check.data["names"]
    return f"{', '.join(names)} {'are' if len(names) > 1 else 'is'} not identifiable from these poses"


def _validation(check: Check) -> str:
    data = check.data
    if check.outcome == "not tested":
        return "no poses were held out, so the accuracy is unknown"
    if check.outcome == "failed":
        share = f"{100 * data['fitted_share']:.0f} % of the validation poses"
        return f"{share} were also fitted, so the accuracy is unknown"
    before, after = MM.text(data["before_m"]), MM.text(data["after_m"])
    text = f"{before} with the nominal model, {after} with the calibrated one (means)"
    if "observed_p95_m" in data:
        observed, predicted = MM.text(data["observed_p95_m"]), MM.text(data["predicted_p95_m"])
        text += f"; 95 % are below {observed}, and {predicted} was predicted for these poses by parameters and noise"
        if left_out := data["extrapolated"]:
            text += f" ({_left_out(left_out)})"
    if "without_noise_m" in data:
        text += f", {MM.text(data['without_noise_m'])} of it without the noise of the validation"
    return text


def _left_out(count: int) -> str:
    """Name validation poses that the prediction is not compared at; the table of errors has them too."""
    return f"without {counted(count, 'pose')} outside the measured joint range or far from measured poses"


def _prediction(check: Check) -> str:
    data = check.data
    observed, predicted, allowed = (MM.text(data[f"{each}_p95_m"]) for each in ("observed", "predicted", "allowed"))
    without = f", {_left_out(data['extrapolated'])}," if data["extrapolated"] else ""
    return (
        f"95 % of the errors at poses that were not fitted{without} are below {observed}, but {predicted} was "
        f"predicted for them by parameters and noise ({allowed} allowing for chance): the model or the stated noise is "
        "wrong; identify with --model auto, then auto+residual (points of a serial arm), or check the stated noise"
    )


def _gate(check: Check) -> str:
    data = check.data
    limit = f"the {MM.text(data['limit_m'])} of an uncalibrated arm within its tolerances"
    if data["gate"]:
        limit = f"the gate of {MM.text(data['limit_m'], 6)}"
    guess = "; wrong --orientation?" if data["oriented"] else ""
    return f"does not fit: {MM.text(data['after_m'])} on poses not fitted, above {limit}{guess}"


def _gate_below_noise(check: Check) -> str:
    after, limit = MM.text(check.data["after_m"]), MM.text(check.data["limit_m"], 6)
    how = "measure poses several times" if check.data["noise_given"] else "give the instrument's noise"
    return (
        f"the {limit} asked for cannot be shown: {after} on poses not fitted, most of it perhaps noise; {how}, or ask "
        "for less"
    )


def _gain(check: Check) -> str:
    before, after = MM.text(check.data["before_m"]), MM.text(check.data["after_m"])
    largest = ", and the largest error grew" if check.data["grown"] else ""
    return f"little better than the nominal model: {before} before, {after} after{largest}"


def _error(check: Check) -> str:
    region, elsewhere, condition = (check.data[name] for name in ("region", "elsewhere", "condition"))
    of_condition = f", condition number {condition:,.0f}" if np.isfinite(condition) else ""
    if not np.isfinite(region.p95_m):
        text = f"the error {region_text(region)} cannot be predicted{of_condition}"
        return text if check.outcome != "failed" else f"{text}: contacts do not determine the arm's size"
    there = ""
    if elsewhere is not None and np.isfinite(elsewhere.p95_m):
        share = f"{100 * elsewhere.extrapolated_share:.0f} % of the workspace"
        there = f", in the extrapolated {share} {MM.text(elsewhere.p95_m)}"
    anew = f", the {' and '.join(region.anew)} placed anew," if region.anew else ""
    return f"the predicted 95 % error {region_text(region)}{anew} is {MM.text(region.p95_m)}{there}{of_condition}"


def _limit(check: Check) -> str:
    limit = MM.text(check.data["limit_m"])
    if not check.data["gate"]:
        text = f"above {limit}, half of the error of such an arm before calibration"
    elif check.data["lack_of_fit"]:
        text = f"with the lack of fit it is above the gate of {limit}"
    else:
        text = f"the predicted mean of {MM.text(check.data['region'].mean_m)} is above the gate of {limit}"
    return f"{_error(check)}; {text}"


def _cover(check: Check) -> str:
    region = check.data["region"]
    share = f"{100 * region.extrapolated_share:.0f} % of the poses {region_text(region)}"
    return f"{share} are extrapolated: not covered by measured poses"


def _far(check: Check) -> str:
    distance: Distance = check.data["distance"]
    size = (DEGREES if distance.is_angle else MM).text(distance.size)
    return f"{distance.name} is estimated {size} from its nominal value ({distance.tolerances:,.0f} tolerances)"


def _other_robot(check: Check) -> str:
    return f"{_far(check)}: is the nominal model that of this robot?"


def _given_noise(check: Check) -> str:
    data = check.data
    name = "column sigma_mm" if data["in_column"] else "--noise-mm"
    return (
        f"{name} {MM.of(data['given_m']):g} is {data['given_m'] / data['known_m']:.0f} times too large: "
        f"{data['whose']} correspond to a noise of {MM.text(data['known_m'], 2)}. Intervals are too wide by the same "
        "factor, and errors smaller than the given noise are not detected"
    )


def _given_noises(check: Check) -> str:
    least, most = (f"{MM.of(check.data[name]):.3g}" for name in ("least_m", "most_m"))
    return f"column sigma_mm ranges from {least} to {most}: is it all in mm? Noisy rows get almost no weight"


def _given_scale(check: Check) -> str:
    names, scale = check.data["links"], check.data["scale"]
    return (
        f"all {len(names)} long links ({', '.join(names)}) are about {100 * abs(scale):.2g} % "
        f"{'longer' if scale > 0 else 'shorter'} than the robot's: check the scale of the points (the instrument's "
        "unit, its correction for air and temperature), or give the right --robot"
    )


def _tolerance_bound(check: Check) -> str:
    if check.outcome == "not tested":
        return "the validation errors are not compared with a gate"
    return f"95 % of the validation errors are below {check.statistic:.3g} times the gate, with 95 % confidence"


PHRASES: Mapping[str, Phrase] = {
    "lack_of_fit.chi2": _chi2,
    "lack_of_fit.repeats": _repeats,
    "lack_of_fit.holdout": _unknown_noise,
    "lack_of_fit.joints": _joints,
    "lack_of_fit.distances": _distances,
    "lack_of_fit.nothing": _nothing,
    "isotropy": (
        "residuals across the line of sight are {statistic:.2g} times those along it (F test, p = {p:.1g}): the noise "
        "is not isotropic, so intervals and outlier test are biased; state the instrument with --instrument"
    ),
    "finding.drift": _drift,
    "finding.correlated": _correlated,
    "finding.scatter": _scatter,
    "finding.noise": (
        f"the noise is estimated at {{size_m:short}} per axis, but common instruments have less than "
        f"{short_length(COMMON_NOISE_M)}: state the instrument (--instrument or --noise-mm), or find the cause of "
        "larger errors"
    ),
    "finding.missing": (
        "lack of fit: {effects:list} would explain errors now attributed to noise (mean error of held-out poses "
        "{before_m:mm} without, {after_m:mm} with): fit with --model auto"
    ),
    "fit.residuals": _residuals,
    "fit.weak": "not significant at the level that makes a verdict doubtful",
    "given.noise": _given_noise,
    "given.noises": _given_noises,
    "given.scale": _given_scale,
    "arm.constant_points": "the measured values are the same in every pose: wrong column?",
    "arm.convergence": _convergence,
    "arm.orientations": "measured orientations do not fit ({rms_rad:mrad}): wrong --orientation or columns?",
    "arm.collapsed": _collapsed,
    "arm.identifiable": _identifiable,
    "accuracy.validation": _validation,
    "accuracy.gate": _gate,
    "accuracy.gate_below_noise": _gate_below_noise,
    "accuracy.worse": ("the calibrated model is worse than the nominal one: {before_m:mm} before, {after_m:mm} after"),
    "accuracy.gain": _gain,
    "accuracy.fitted_poses": "{share:%} of the validation poses were fitted",
    "accuracy.outliers": "{share:% 3} of the hold-out set are outliers",
    "accuracy.prediction": _prediction,
    "accuracy.tolerance_bound": _tolerance_bound,
    "determination.error": _error,
    "determination.limit": _limit,
    "determination.cover": _cover,
    "links.far": _far,
    "links.tolerances": _far,
    "links.other_robot": _other_robot,
}

_REPEAT = "Repeat some poses at the end of the session, or state the instrument with --instrument."
_WHOSE = "Check --robot, the order and signs of the joints, and the unit of the points; then identify again."
_MORE = "Measure more poses: lab next proposes the best one to add."
LACK_OF_FIT_ADVICE = (
    "Identify with --model auto. If the lack of fit remains: with auto+residual, if points of a serial arm were "
    "measured; or check the stated noise by measuring some poses twice."
)
_NEXT_STEPS: Mapping[str, str] = {  # by the heaviest reason, or what its name begins with
    **diagnosis.NEXT_STEPS,
    "lack_of_fit": LACK_OF_FIT_ADVICE,
    "lack_of_fit.nothing": "Measure more poses to validate on, or some poses twice; or state the noise (--instrument).",
    "isotropy": "State the instrument with --instrument.",
    "finding.drift": "Measure the first poses again at the end: they show what drifts.",
    "finding.correlated": _REPEAT,
    "finding.scatter": _REPEAT,
    "finding.noise": "State the instrument with --instrument or --noise-mm.",
    "finding.missing": "Identify with --model auto.",
    "given.noise": "Correct the stated noise: --noise-mm, or column sigma_mm.",
    "given.scale": "Check the scale of the points (unit, air, temperature); then identify again.",
    "arm.convergence": f"Check robot and rows; if both are right, use {PRIOR}.",
    "arm.orientations": "Check --orientation and the columns of the orientations.",
    "arm.collapsed": "Read in more positions and directions, or identify with --prior on.",
    "arm.identifiable": _MORE,
    "arm": _WHOSE,
    "accuracy.validation": "Measure more poses, or give other measurements with --validate.",
    "accuracy.fitted_poses": "Validate on poses that were not fitted.",
    "accuracy.gate_below_noise": "Measure each pose several times, or state the instrument's noise.",
    "accuracy.outliers": "Measure the poses that are listed as outliers again.",
    "accuracy.prediction": (
        "Identify with --model auto, then with auto+residual; or check the stated noise, and measure more poses where "
        "the robot works."
    ),
    "accuracy": "Identify with --model auto; if that does not help, check robot and rows.",
    "determination": _MORE,
    "determination.error": "Measure points as well, or a known length (--socket-distance-mm for sockets).",
    "links": _WHOSE,
    "note": _WHOSE,
}
_OTHERWISE = "Find the cause of the first reason below; then identify again."
_GOOD_NEXT = "Correct targets or programs with lab compensate. Check the arm each month with lab verify."
_GOOD_WITHOUT_FRAME = (
    "Use calibrated.xml or calibrated.py in your simulation. Correcting targets needs points or poses measured in one "
    "frame."
)
_OUTLIERS = "Identify with --robust, which excludes the outliers below; or measure these poses again."
_BETTER = "Measure more poses (lab next), or with an instrument of less noise."
_FREE = ("finding.missing", "finding.noise")  # reasons whose next step needs no new measurement: these come first


def next_step(verdict: Verdict, *, with_outliers: bool = False, in_instrument_frame: bool = True) -> str:
    """Return what to do after a calibration, by the heaviest reason of its verdict.

    Args:
        with_outliers: whether outliers were found and fitted.
        in_instrument_frame: whether the measurements place the arm in the instrument's frame.
    """
    if not verdict.reasons:
        good = _GOOD_NEXT if in_instrument_frame else _GOOD_WITHOUT_FRAME
        return good if verdict.word == "good" else _MORE
    names = [each.name for each in verdict.reasons]
    keys = [each.data["key"] for each in verdict.reasons if each.data.get("discrete")]
    if keys and names[0] != "diagnosis.other_robot":
        return f"Correct the file; or, if the cause below is right, identify with --accept {','.join(keys)}."
    if with_outliers and not names[0].startswith(("arm", "links", "given", "diagnosis")):
        return _OUTLIERS
    name = next((each for each in _FREE if each in names), names[0])
    if name == "accuracy.gate" and verdict.fit.standing == "holds":
        return _BETTER
    fitting = (each for each in sorted(_NEXT_STEPS, key=len, reverse=True) if name.startswith(each))
    return _NEXT_STEPS.get(next(fitting, ""), _OTHERWISE)
