"""Phrases of a verification and of a certificate."""

from collections.abc import Mapping, Sequence

import numpy as np

from lab.core.checks import Check
from lab.core.significance import VERIFICATION
from lab.core.units import MM, MRAD
from lab.phrases.diagnosis_phrases import advice, cause_text, deciding_measurement
from lab.phrases.template import Phrase, worded

__all__ = [
    "CERTIFICATE_PHRASES", "PHRASES", "chance_text", "change_text", "extent_text", "next_step",
    "parameter_text",
]  # fmt: skip

_LEAST_CHANCE = 1e-9  # a smaller one is no better known than the normal distribution
_LINK = {"theta": "zero of joint", "a": "length of link", "d": "offset of link", "alpha": "twist of link",
         "beta": "tilt of link"}  # fmt: skip


def parameter_text(name: str) -> str:
    """Return what a parameter is, with its name: ``zero of joint 3 (link3.theta)``; the name alone of others."""
    part, _, kind = name.partition(".")
    link = part.removeprefix("link")
    return f"{_LINK[kind]} {link} ({name})" if link.isdigit() and kind in _LINK else name


def chance_text(p: float) -> str:
    """Return a p-value to two digits: ``p = 0.032``, ``p < 1e-09``."""
    return f"p = {p:.2g}" if p >= _LEAST_CHANCE else f"p < {_LEAST_CHANCE:g}"


_SET_UP_ANEW = {
    "situation.setup": "the robot or the instrument was set up anew",
    "situation.tool": "another tool is mounted, or its targets were moved",
    "situation.setup_and_tool": "robot or instrument were set up anew, with another tool",
}
_CHANGED = {
    "changed.base_step": "the base (or the instrument) has moved by",
    "changed.tool_step": "the tool has moved by",
    "changed.target_step": "target {of[0]} has moved on the tool by",
    "changed.joint_step": "the zero of joint {number} ({of[0]}) has moved by",
    "changed.range_constant": "the instrument's range constant is another one by",
    "changed.outliers": "the reading of {names} alone is in error by",
}
_SEVERAL = (
    "no single movement of base, tool or a joint's zero and no single outlier explains it: more than one thing has "
    "changed; calibrate anew"
)


def _verification(check: Check) -> str:
    data, cause = check.data, check.data["cause"]
    sizes = f"errors of {MM.text(data['rms_m'])}, where {MM.text(data['predicted_m'])} are predicted"
    errors = f"{sizes} ({_tests(check)})"
    if check.outcome == "passed":
        return f"still good: {errors}"
    diagnosis = f": {_diagnosis(check)}" if data["alike"] or cause is None else ""
    if cause is None:
        return f"changed: {errors}{diagnosis}"
    text = cause_text(cause) if cause.name.startswith("diagnosis.") else worded(PHRASES[cause.name], cause)
    return f"{text}. Changed: {errors}{diagnosis}"


def _tests(check: Check) -> str:
    parts, dof, tail = (check.data[name] for name in ("parts", "sigma_dof", "tail_dof"))
    kind = "chi2" if dof is None else "F"
    if tail is not None:
        kind = f"by {check.data['draws']:,} draws of noise with the tails of Student's t, {tail:g} degrees of freedom:"
    over = f" and {dof}" if dof is not None and tail is None else ""
    if len(parts) < 2:
        counts = ", ".join(f"{numbers}{over} degrees of freedom, {_chance(p)}" for numbers, p in parts)
        return f"{kind} test at {100 * VERIFICATION:g} %, {counts or 'no degrees of freedom'}"
    (along, p_along), (rest, p_rest) = parts
    return (
        f"{kind} tests at {100 * VERIFICATION:g} % together: along the parameters {along}{over} degrees of freedom, "
        f"{_chance(p_along)}; of the rest {rest}{over}, {_chance(p_rest)}"
    )


def _chance(p: float) -> str:
    return f"p = {p:.2g}" if p > 0 else "p < 1e-300"


def _diagnosis(check: Check) -> str:
    alike = check.data["alike"]
    if len(alike) > 1:
        return f"these poses cannot decide whether {', or '.join(map(_changed, alike))}"
    if alike:
        return _changed(alike[0])
    return _SEVERAL


def _changed(check: Check) -> str:
    if check.name.startswith("diagnosis."):
        return cause_text(check)
    return f"{_named(_CHANGED[check.name], check)} {extent_text(check)}"


def _named(text: str, check: Check) -> str:
    of = check.data.get("of", ())
    return text.format_map({**check.data, "names": ", ".join(of)})


_EXTENTS = (
    ("shift_m", "shift_std_m", MM),
    ("turn_rad", "turn_std_rad", MRAD),
)


def extent_text(check: Check) -> str:
    """Return how far something moved, with one standard deviation: ``0.497 ± 0.005 mrad``."""
    parts = [
        f"{_with_std(unit.of(check.data[size]), unit.of(check.data[std]))} {unit.name}"
        for size, std, unit in _EXTENTS
        if np.isfinite(check.data[size])
    ]
    return " and ".join(parts) or "an amount that these poses do not determine"


def _with_std(size: float, std: float) -> str:
    """A number to the last digit that its standard deviation leaves."""
    digits = int(np.clip(np.ceil(-np.log10(max(std, 1e-6))), 0, 6))
    return f"{size:.{digits}f} ± {std:.{digits}f}"


def _set_up_anew(check: Check) -> str:
    refit = check.data["refit"]
    left = f"With {' and '.join(refit)} fitted anew errors are {MM.text(check.data['left_m'])}"
    return f"{_SET_UP_ANEW[check.name]}: use --refit {','.join(refit)}. {left}"


_THINGS = {
    "changed.base_step": "base moved",
    "changed.tool_step": "tool moved",
    "changed.target_step": "target {of[0]} moved",
    "changed.joint_step": "zero of joint {number}",
    "changed.range_constant": "range constant",
    "changed.outliers": "reading of {names}",
}
_AGAIN = "; then run lab verify again."
_WITHIN = "Look at what happened between these poses, and measure again"
_NEXT_STEPS = {
    "changed.base": "Run lab verify again with --refit base: it estimates the new pose, and tests the rest of the arm.",
    "changed.tool": "Run lab verify again with --refit tool: it estimates the new pose, and tests the rest of the arm.",
    "changed.target": "Run lab verify again with --refit tool: it estimates the new place, and tests the rest.",
    "changed.joint_step": "Set the zero of joint {number} anew, or calibrate anew.",
    "changed.range_constant": "Compare the reflector with the one that the instrument is set to; then measure again.",
    "changed.outliers": "Measure {names} again, or mark its row use = skip; then run lab verify again.",
    "situation.another_arm": "Compare the serial number: verify against the run of this arm, or calibrate it anew.",
}  # by the name of a check, or what it begins with
_STILL_GOOD = "Go on with this calibration. Check the arm again in a month."
_BUILT_ON_DOUBT = "The calibration itself is not good: its page says what to do first."
_AMBIGUOUS = "Measure more poses, spread over all joints, and run lab verify on all: these cannot tell what moved."
_ANEW = "Calibrate anew: no single change explains the errors."


def change_text(check: Check) -> str:
    """Return what a hypothesis says has changed, in two or three words: ``zero of joint 3``."""
    if check.name.startswith("diagnosis."):
        return " ".join((check.name.removeprefix("diagnosis.").replace("_", " "), *check.data["of"][:1]))
    return _named(_THINGS[check.name], check)


def next_step(check: Check, verdict: str) -> str:
    """Return what to do after a verification.

    Args:
        check: that of the whole verification.
        verdict: good, doubtful or bad.
    """
    if check.outcome == "passed":
        return _STILL_GOOD if verdict == "good" else _BUILT_ON_DOUBT
    cause, alike = check.data["cause"], check.data["alike"]
    if cause is None and len(alike) != 1:
        return f"{_AMBIGUOUS}{_deciding(alike)}" if alike else _ANEW
    return _step_after(alike[0] if cause is None else cause)


def _deciding(alike: Sequence[Check]) -> str:
    """Return the measurement that tells equivalent causes apart, as a further sentence; nothing where none is known."""
    first, *others = (each.name.partition(".")[2] for each in alike)
    measurement = deciding_measurement(first, others)
    return f" It can be decided by {measurement}." if measurement else ""


def _step_after(last: Check) -> str:
    if "refit" in last.data:
        return f"Run lab verify again with --refit {','.join(last.data['refit'])}: it tests the rest of the arm."
    if last.name.startswith("diagnosis."):
        undone = f"Correct the file, or read it so by --accept {last.data['key']}" if last.data["discrete"] else ""
        return f"{undone or advice(last.name) or _WITHIN}{_AGAIN}"
    return _named(next(step for name, step in _NEXT_STEPS.items() if last.name.startswith(name)), last)


PHRASES: Mapping[str, Phrase] = {
    "verification": _verification,
    **dict.fromkeys(_CHANGED, _changed),
    **dict.fromkeys(_SET_UP_ANEW, _set_up_anew),
    "situation.another_arm": (
        "this is another arm than the calibrated one, or it was rebuilt or crashed: verify against its own run, or "
        "calibrate anew. With base and tool fitted anew, errors are {left_m:mm}; those of the nominal model are "
        "{by_nominal_m:mm}"
    ),
}


_ITS = "the certificate of the {gauge}"
_CERTIFICATE = {
    "certificate.other_day": "measured_on is {stated}, but the run was measured on {of_run}",
    "certificate.issued_before": (
        "the measurements of {measured_on} are later than the issue of the certificate on {issued}"
    ),
    "certificate.issued_late": (
        "the certificate of {issued} is issued {days:,} days after the measurements of {measured_on}"
    ),
    "certificate.ends_before_begin": f"{_ITS} of {{checked}} ends before it begins, on {{until}}",
    "certificate.later_than_issue": f"{_ITS} of {{checked}} is later than this certificate of {{issued}}",
    "certificate.no_day": f"{_ITS} ({{either}}) cannot be judged: the date of the measurements is not stated",
    "certificate.later_than_measured": f"{_ITS} of {{checked}} is later than {{of}}: its state then is unknown",
    "certificate.ended": f"{_ITS} ended on {{until}}, before {{of}}",
    "certificate.old": (
        f"{_ITS} of {{checked}} is {{years:.1f}} years older than {{of}}, and states no end (valid_until)"
    ),
    "certificate.other_robot": ("the certificate names the robot {stated}, but the run calibrates the model {of_run}"),
    "certificate.same_serial": "robot and instrument have the same serial number, {serial}",
    "certificate.other_instrument": (
        "the certificate names the instrument {stated}, but the run was weighted by the noise of {of_run}"
    ),
    "certificate.unfit_temperature": (
        "the temperature is {at_c:g} °C, but the instrument works from {least_c:g} to {most_c:g} °C"
    ),
    "certificate.unusual_temperature": (
        "the temperature is {at_c:g} °C, but robots are measured at {least_c:g} to {most_c:g} °C"
    ),
    "certificate.robot_temperature": (
        "the robot's temperature is stated within {spread_k:g} K, more than {most_k:g} K"
    ),
    "certificate.unusual_number": (
        "{name} is {value:g} {unit}, usual is {least:g} to {most:g} {unit}: is the unit right?"
    ),
    "certificate.unusual_repeatability": (
        "repeatability_mm is {stated_mm:g} mm, data sheets state {least_mm:g} to {most_mm:g} mm: is the unit right?"
    ),
    "certificate.other_repeatability": (
        "the repeatability is stated as {stated_mm:g} mm, but repeated poses show {found_mm:.2g} mm"
    ),
}


def _certificate(check: Check) -> str:
    data = dict(check.data)
    if "on" in data:
        data["of"] = f"{'the measurements' if data['measured'] else 'this certificate'} of {data['on']}"
    return _CERTIFICATE[check.name].format(either=data.get("checked") or data.get("until"), **data)


CERTIFICATE_PHRASES: Mapping[str, Phrase] = dict.fromkeys(_CERTIFICATE, _certificate)
