"""Phrases of what is wrong with measurements: one for each kind of finding, by the name of its check.

A phrase names the cause and where it is, its size, how much of the errors it explains, what explains them nearly as
well with the measurement that would decide, and what to do.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from lab.core.checks import Check
from lab.core.errors import counted
from lab.core.se3 import Array
from lab.core.units import DEGREES, MICRORADIANS, MM, MRAD, PPM, Unit, short_length
from lab.phrases.template import Phrase, worded

__all__ = ["HALF_95", "NEXT_STEPS", "PHRASES", "advice", "cause_text", "deciding_measurement"]

HALF_95 = 1.96  # of an interval, in standard deviations
_MOST_NAMED = 5  # poses or pictures in a sentence
_PER_CENT = Unit("1", "%", 100.0)


def _named(names: Sequence[str], most: int = _MOST_NAMED) -> str:
    """Return names as a part of a sentence: "a", "a and b", "a, b, c and 4 more"."""
    if len(names) > most:
        return f"{', '.join(names[:most])} and {len(names) - most} more"
    return " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)


def _poses(names: Sequence[str], what: str = "pose") -> str:
    return f"{what}{'s' * (len(names) > 1)} {_named(names)}"


# Discrete mistakes: of readings


def _joint_zero(check: Check) -> str:
    offset = check.data.get("offset_rad")
    size = _size(check) if offset is None else DEGREES.text(offset, 4)
    return f"the zero of joint {check.data['of'][0]} is off by {size}"


def _coupled(check: Check) -> str:
    one, other, sign = check.data["of"]
    return f"the reading of joint {one} is {one} {sign} {other}"


def _shifted(check: Check, what: str = "pose", rows: str = "row") -> str:
    by, *first = check.data["of"]
    begin = f"from {what} {first[0]} on " if first else ""
    return (
        f"{begin}each pose's joint positions are {counted(abs(int(by)), rows)} too {'late' if int(by) > 0 else 'early'}"
    )


def _convention(check: Check) -> str:
    of, angle = check.data["of"], check.data.get("angle_rad")
    turned = "" if angle is None else f", turned by {np.rad2deg(angle):.1f}° against that of the positions"
    return f"the orientations are given in another convention{f' ({_named(of)}{turned})' if of else ''}"


def _joints(names: Sequence[str]) -> str:
    return f"joint{'s' * (len(names) > 1)} {_named(names, len(names))} {'are' if len(names) > 1 else 'is'}"


def _signs(check: Check) -> str:
    of = check.data["of"]
    return f"{_joints(of)} read with the opposite sign"


def _joint_unit(check: Check) -> str:
    unit, *joints = check.data["of"]
    return f"{_joints(joints) if joints else 'the joint positions are'} in {unit}"


def _exchanged_targets_once(check: Check) -> str:
    count = check.data.get("targets", 2)
    targets, poses = check.data["of"][:count], check.data["of"][count:]
    return f"targets {_named(targets)} are exchanged in {_poses(poses)}"


def _unit(check: Check) -> str:
    return f"the points are in {check.data['of'][0]} (multiply them by {check.data['factor']:g})"


def _reading_unit(check: Check) -> str:
    factor = f" (multiply it by {check.data['factor']:g})" if "factor" in check.data else ""
    column = f"column {check.data['column']}" if "column" in check.data else "the distance between the sockets"
    return f"{column} is in {check.data['of'][0]}{factor}"


_TURNS = {"half": "half a turn", "quarter": "a quarter turn", "three-quarter": "three quarters of a turn"}


def _board_turned(check: Check) -> str:
    turn = _TURNS.get(check.data.get("turn", ""), "a turn")
    return f"the board is turned by {turn} in {_poses(check.data['of'], 'picture')}"


def _fixtures_exchanged(what: str) -> Callable[[Check], str]:
    return lambda check: f"{_poses(check.data['of'])} {'are' if len(check.data['of']) > 1 else 'is'} at another {what}"


def _fixture_moved(what: str) -> Callable[[Check], str]:
    def phrase(check: Check) -> str:
        name, first = check.data["of"]
        named = what if name == what else f"{what} {name}"
        by = f" by {MM.text(check.data['step_m'], 2)}" if "step_m" in check.data else ""
        return f"{named} moved{by} before pose {first}"

    return phrase


_FIXTURES = {**{name: name for name in ("socket", "plane", "anchor", "plate", "cube", "dial")}, "bar": "ball bar"}
_READINGS = ("socket", "cable", "dial", "bar", "plane", "plate", "cube")

_DISCRETE: Mapping[str, Phrase] = {
    "joint_unit": _joint_unit,
    "joint_sign": _signs,
    "joint_stuck": "the reading of joint {of[0]} stays the same while the joint moves",
    "joint_zero": _joint_zero,
    "joints_exchanged": "joints {of[0]} and {of[1]} are exchanged",
    "joints_coupled": _coupled,
    "joints_reversed": "the joints are in the reversed order",
    "rows_reversed": "the joint positions are in the reversed order of what was measured",
    "rows_shifted": _shifted,
    "rows_exchanged": "the joint positions of poses {of[0]} and {of[1]} are exchanged",
    "point_unit": _unit,
    "points_mirrored": "the frame of the points is mirrored (an axis negated, or two exchanged)",
    "targets_exchanged": lambda check: f"targets {_named(check.data['of'])} are exchanged",
    "targets_exchanged_once": _exchanged_targets_once,
    "other_robot": "the measured robot is a {of[0]}",
    "orientation_convention": _convention,
    "board_turned": _board_turned,
    "pictures_shifted": lambda check: _shifted(check, "picture", "picture"),
    "pictures_exchanged": "pictures {of[0]} and {of[1]} are exchanged",
    "camera_mount": "cameras and boards are fixed the other way round (what is given as in the hand is in the room)",
    "focal_length": "the focal length of camera {of[0]} is {ratio:.4g} times the given one",
    "square_size": "the squares of board {of[0]} are {ratio:.4g} times as large as given",
    **{f"{name}_unit": _reading_unit for name in _READINGS},
    **{f"{name}_exchanged": _fixtures_exchanged(what) for name, what in _FIXTURES.items()},
    **{f"{name}_moved": _fixture_moved(what) for name, what in _FIXTURES.items()},
}

# Continuous mistakes: what moved, and what is not to scale


def _size(check: Check) -> str:
    """Return the sizes with their 95 %: the length of a displacement, then the angle of a rotation."""
    sizes, stds, units = (np.array(check.data[name]) for name in ("sizes", "stds", "units"))
    each = [_norm(sizes[units == unit], stds[units == unit], unit) for unit in dict.fromkeys(units.tolist())]
    parts = [text for text, sure in each if sure] or [text for text, _ in each[:1]]
    return f"{' and '.join(parts)} (95 %)"


def _norm(sizes: Array, stds: Array, si: str) -> tuple[str, bool]:
    """Return the length of a vector with its 95 %, and whether it is longer than these."""
    size = float(np.linalg.norm(sizes))
    half = HALF_95 * (float(np.linalg.norm(sizes * stds)) / size if size > 0 else float(np.linalg.norm(stds)))
    unit = _unit_of(si, size)
    number, digits = unit.of(size), 3 if unit.of(size) < 100 else 4
    return f"{number:.{digits}g} ± {unit.of(half):.2g} {unit.name}", size > half


def _unit_of(si: str, size: float) -> Unit:
    """Return the unit in which a size is neither a very small nor a very large number."""
    if si == "m":
        return MM
    if si == "rad":
        return MICRORADIANS if size < 1e-4 else MRAD if size < 0.02 else DEGREES
    return PPM if size < 0.95e-3 else _PER_CENT


def _between(check: Check) -> str:
    return "between poses {} and {}".format(*check.data["of"][-2:])


def _step(what: Callable[[Check], str]) -> Callable[[Check], str]:
    return lambda check: f"{what(check)} by {_size(check)} {_between(check)}"


def _ratio(check: Check, more: str, less: str) -> str:
    return more if check.data["sizes"][0] > 0 else less


def _gain(check: Check) -> str:
    than = _ratio(check, "more", "less")
    return f"joint {check.data['of'][0]} moves {_size(check)} {than} than its reading"


def _coupling(check: Check) -> str:
    one, other = check.data["of"]
    return f"joint {one} moves with {other}: by {_size(check)} of its motion"


def _scale(check: Check) -> str:
    return f"the points are {_size(check)} too {_ratio(check, 'large', 'small')} for this arm"


def _range_constant(check: Check) -> str:
    too = f"the instrument measures every range {_size(check)} too {_ratio(check, 'long', 'short')}"
    cause = f"{too}, by the radius of the reflector or the zero of its range"
    if "in_frame" not in check.data:
        return cause
    constant = abs(check.data["sizes"][0])
    frame, shape = (short_length(constant * check.data[name]) for name in ("in_frame", "in_shape"))
    return f"{cause}. Left out, it would displace the arm by {frame} in its frame, and by {shape} relative to the base"


def _growth(check: Check) -> str:
    return f"the arm {_ratio(check, 'grows', 'shrinks')} by {_size(check)} over the campaign, or the scale changes"


def _lag(check: Check) -> str:
    sure = [
        (name, size)
        for name, size, std in zip(check.data["joints"], check.data["sizes"], check.data["stds"], strict=True)
        if abs(size) > HALF_95 * std
    ]
    behind = "they lag behind it" if sum(size for _, size in sure) > 0 else "it lags behind them"
    shares = ", ".join(f"{name} {100 * abs(size):.2g} %" for name, size in sure)
    return f"the recorded joint positions do not follow the arm: {behind}, by shares of the last move of {shares}"


def _outliers(check: Check) -> str:
    of, size = check.data["of"], short_length(check.data["size_m"])
    return f"{_poses(of)} {'are' if len(of) > 1 else 'is'} off by {'up to ' if len(of) > 1 else ''}{size}"


_CONTINUOUS: Mapping[str, Callable[[Check], str]] = {
    "base_step": _step(lambda _: "the base or the instrument moved"),
    "tool_step": _step(lambda _: "the tool moved on the flange"),
    "target_step": _step(lambda check: f"target {check.data['of'][0]} moved"),
    "joint_step": _step(lambda check: f"the zero of joint {check.data['of'][0]} changed"),
    "joint_gain": _gain,
    "joint_coupling": _coupling,
    "joint_lag": _lag,
    "link": lambda check: f"{check.data['of'][0]} is off from its nominal value by {_size(check)}",
    "scale": _scale,
    "range_constant": _range_constant,
    "shear": lambda check: f"the measured space is sheared by {_size(check)}",
    "outliers": _outliers,
    "drift": lambda check: f"the base or the instrument drifts by {_size(check)} over the campaign",
    "growth": _growth,
}
_ADVICE: Mapping[str, str] = {  # of what no fit contains
    "target_step": "Measure again with the target fixed, or leave it out on one side of the step",
    "outliers": "Measure these poses again, or leave them out (use = skip)",
    "joint_gain": "Check the joint's gear ratio and encoder",
    "joint_coupling": "Check the coupling of these joints in the controller and in --robot",
    "joint_lag": "Let the arm settle before each measurement",
    "scale": "Check the instrument's scale (unit, air, temperature)",
    "shear": "Check the instrument's axes and scales, and whether all points are in one frame",
    "drift": "Measure the first poses again at the end: they show what drifts",
    "growth": "Let the arm warm up, and measure the first poses again at the end",
}
_DECIDING: Mapping[frozenset[str], str] = {  # measurements that tell two kinds apart
    frozenset({"base_step", "joint_step"}): "nests on the floor and on the base, measured before and after",
    frozenset({"base_step", "drift"}): "nests on the floor, measured again in between",
    frozenset({"tool_step", "joint_step"}): "two more targets on the tool",
    frozenset({"target_step", "joint_step"}): "two more targets on the tool",
    frozenset({"target_step", "tool_step"}): "two more targets on the tool",
    frozenset({"scale", "link"}): "a bar of known length, measured by the instrument",
    frozenset({"scale", "growth"}): "a bar of known length, measured by the instrument",
    frozenset({"range_constant", "base_step"}): "the same poses from a second distance of the instrument",
    frozenset({"range_constant", "scale"}): "the same poses from a second distance of the instrument",
    frozenset({"joint_gain", "joint_coupling"}): "poses in which these joints move without each other",
    frozenset({"joint_zero", "link"}): "more poses, with this joint far from where it was",
}


def deciding_measurement(name: str, rivals: Sequence[str]) -> str:
    """Return the measurement that tells a finding from its rivals (keys); empty where none is known."""
    pairs = (frozenset({name, rival.partition(":")[0]}) for rival in rivals)
    return next((_DECIDING[pair] for pair in pairs if pair in _DECIDING), "")


def _sentence(cause: Phrase) -> Callable[[Check], str]:
    """Return the phrase of a finding: cause, effect, rivals and remedy as clauses and sentences."""

    def phrase(check: Check) -> str:
        whole, where = _of_a_part(check)
        return ". ".join([f"{worded(cause, whole)}{where}{_effect(check)}", *_rivals(check), *_remedy(check)])

    return phrase


def _of_a_part(check: Check) -> tuple[Check, str]:
    """Return a mistake of a part of the rows as one of all rows, and which part it is; empty for all rows."""
    if not isinstance(count := check.data.get("rows"), int):
        return check, ""
    *of, first, last = check.data["of"]
    part = f" from pose {first} to pose {last} ({counted(count, 'pose')})"
    return replace(check, data={**check.data, "of": tuple(of)}), part


def _effect(check: Check) -> str:
    """Return what a finding does to the errors: with it and without, or how much of them it explains."""
    data = check.data
    if np.isfinite(data["before_m"]) and np.isfinite(data["after_m"]):
        before, after = short_length(data["before_m"]), short_length(data["after_m"])
        if not data["discrete"]:
            return f"; it is fitted: the residual is {before} without it, {after} with it (RMS)"
        if data["accepted"]:
            return f"; undone on request: the arm misses by {after} (RMS), as read by {before}"
        return f": the arm misses by {before} (RMS), with this undone by {after}"
    explained = f"explains {short_length(data['explains_m'])} of the errors (RMS)"
    return f"; it is fitted, and {explained}" if data["accepted"] else f"; it {explained}"


def _rivals(check: Check) -> Iterator[str]:
    rivals = check.data["rivals"]
    if not rivals:
        return
    verb = "explain" if len(rivals) > 1 else "explains"
    measured = deciding_measurement(check.name.removeprefix("diagnosis."), rivals)
    decide = f"; {measured} would decide" if measured else ""
    yield f"{_named(rivals)} {verb} the errors nearly as well{decide}"


def _remedy(check: Check) -> Iterator[str]:
    name, data = check.name.removeprefix("diagnosis."), check.data
    if data["accepted"]:
        return
    if name == "other_robot":
        yield f"Give --robot {data['of'][0]}"
    elif data["discrete"]:
        yield f"Correct the file, or undo it by --accept {data['key']}"
    elif name in _ADVICE:
        yield _ADVICE[name]


_CAUSES: Mapping[str, Phrase] = {**_DISCRETE, **_CONTINUOUS}


def cause_text(check: Check) -> str:
    """Return the clause that names the cause alone, with its place and size."""
    name = check.name.removeprefix("diagnosis.")
    other = " ".join((name.replace("_", " "), *check.data["of"]))  # of a sensor of one's own
    return worded(_CAUSES.get(name, lambda _: other), check)


def advice(name: str) -> str:
    """Return what to do about a continuous mistake, by the name of its check; empty where it is fitted."""
    return _ADVICE.get(name.removeprefix("diagnosis."), "")


PHRASES: Mapping[str, Phrase] = {f"diagnosis.{name}": _sentence(cause) for name, cause in _CAUSES.items()}
NEXT_STEPS: Mapping[str, str] = {
    "diagnosis": "Correct the file or undo the mistake by --accept, if the cause below is right; then identify again.",
    "diagnosis.other_robot": "Identify with the --robot that is named below.",
    **{f"diagnosis.{name}": f"{step}; then identify again." for name, step in _ADVICE.items()},
}
