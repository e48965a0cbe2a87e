"""Effects of packages and programs: what their functions return is checked, and an error in them names them.

The lab's own effects are tested; those of others are checked where they are used, once for all their callers.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, get_args

import numpy as np

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.extension_points import numbers, own_errors
from lab.kinematics.effects.effect import ArmFacts, Effect, FittedGroup, Moves, Offsets, structure_values
from lab.kinematics.joints import JointSpec
from lab.kinematics.parameter import Parameter

__all__ = ["fitted_own", "own_function"]

_POSES, _DRAWS = 8, 3  # of the comparison with differences
_STEP = 1e-4  # of a difference, in typical sizes of the parameter
_TOLERANCE = 1e-3  # largest error of a derivative, relative to it
_USUAL_SCALE = 1e-3  # of a parameter without a typical size
_COMPLEX_TOO = "biufc"  # of joint positions with complex steps
_compared = dict[tuple[object, ...], object]()  # functions whose derivatives are right, by their groups and arms


@contextmanager
def own_function(effect: str, function: str) -> Iterator[None]:
    """Report an error in a function of an effect that is not the lab's.

    Args:
        effect: its name.
        function: the function that is called within.

    Raises:
        LabError: the function raises an error, which is chained.
    """
    with own_errors("effect", effect, function=function), np.errstate(all="ignore"):  # what comes of it is checked
        yield


def fitted_own(group: FittedGroup, facts: ArmFacts) -> Effect:
    """Return the effect of an own group for an arm, with checked functions.

    At its first use for an arm its derivatives are compared with differences.

    Raises:
        LabError: its functions raise errors or return something wrong, or a derivative is wrong.
    """
    name = group.name
    with own_function(name, "fitted"):
        made = group.fitted(facts)
    _refuse_malformed(name, made, facts.chain)
    if not made.parameters:
        return made
    own = replace(made, offsets=_checked(made, facts.chain))
    key = (name, id(group.fitted), facts.chain.name, facts.chain.size, own.parameters, own.conditions)
    if key not in _compared:
        _refuse_wrong_derivative(own, facts.chain)
        _compared[key] = group.fitted  # held, so that its id is its own
    return own


def _refuse_malformed(name: str, made: object, chain: JointSpec) -> None:
    start = f"effect '{name}': fitted returns"
    if not isinstance(made, Effect):
        raise LabError(f"{start} {type(made).__name__}; return a {Effect.__module__}.Effect")
    if made.name != name:
        raise LabError(f"{start} an Effect named '{made.name}'; name it '{name}', as its group")
    if not all(isinstance(each, Parameter) for each in made.parameters):
        raise LabError(f"{start} parameters that are none; make them by joint_parameter or Parameter")
    if not isinstance(made.conditions, tuple) or not all(isinstance(each, str) for each in made.conditions):
        raise LabError(f"{start} conditions {made.conditions!r}; return a tuple of names of columns")
    _refuse_wrong_motion(start, made, chain)


def _refuse_wrong_motion(start: str, made: Effect, chain: JointSpec) -> None:
    """Refuse what an effect moves that is nothing of the kind, links that the arm does not have, and typical values."""
    if made.moves not in get_args(Moves):
        raise LabError(f"{start} moves '{made.moves}'; give one of {', '.join(get_args(Moves))}")
    if (made.moves == "links") != bool(made.links) or not all(0 <= link < chain.size for link in made.links):
        raise LabError(f"{start} links {made.links} with moves '{made.moves}'; give links from 0 where it moves links")
    if len(made.typical) not in (0, len(made.parameters)):
        raise LabError(f"{start} {len(made.typical)} typical values; give one for each of {len(made.parameters)}")


def _moved_numbers(effect: Effect, chain: JointSpec) -> int:
    return {"joints": chain.size, "frame": 7, "station": 7, "links": 6 * len(effect.links), "size": 1}[effect.moves]


def _checked(effect: Effect, chain: JointSpec) -> Offsets:
    """Return the effect's function, whose result is checked."""
    name, moved, count, offsets = effect.name, _moved_numbers(effect, chain), len(effect.parameters), effect.offsets

    where = f"effect '{name}': offsets"

    def checked(joints: Array, conditions: Array, values: Array) -> tuple[Array, Array]:
        with own_function(name, "offsets"):
            returned: Any = offsets(joints, conditions, values)
        n = len(joints)
        shape = (n, moved) if values.ndim == 1 else (len(values), n, moved)
        if not isinstance(returned, tuple) or len(returned) != 2:
            raise LabError(
                f"{where} returns {type(returned).__name__}; return two arrays, the offsets {shape} "
                f"and their derivatives {(*shape, count)}"
            )
        alike = values.ndim > 1 and np.ndim(returned[1]) == 3  # all stacked arms have the same derivatives
        derivative = (n, moved, count) if alike else (*shape, count)
        return (
            numbers(where, returned[0], shape, "offsets", kinds=_COMPLEX_TOO),
            numbers(where, returned[1], derivative, "derivatives", kinds=_COMPLEX_TOO),
        )

    return checked


def _refuse_wrong_derivative(effect: Effect, chain: JointSpec) -> None:
    """Compare the derivatives with central differences at some random positions, conditions and values.

    One that differs at a single draw may stand at a kink, so it has to differ at two.
    """
    rng = np.random.default_rng(0)
    scale = np.array([each.scale if np.isfinite(each.scale) else _USUAL_SCALE for each in effect.parameters])
    wrong = np.zeros(len(scale), dtype=np.int_)
    messages = dict[int, str]()
    for _ in range(_DRAWS):
        joints, conditions = _drawn_inputs(effect, chain, rng)
        values = scale * rng.standard_normal(len(scale))
        moved, derivative = effect.offsets(joints, conditions, values)
        for i, step in enumerate(_STEP * scale):
            aside = step * (np.arange(len(scale)) == i)
            after, before = (effect.offsets(joints, conditions, values + side)[0] for side in (aside, -aside))
            slope = (after - before) / (2 * step)
            rounding = 100 * np.finfo(np.float64).eps * max(float(np.abs(moved).max()), 1.0) / step
            if message := _slope_error(derivative[..., i], slope, rounding):
                wrong[i] += 1
                messages[i] = message
        if effect.stacks:
            _refuse_wrong_stack(effect, joints, conditions, values, moved)
    if bad := [i for i in messages if wrong[i] > 1]:
        name, more = effect.parameters[bad[0]].name, f" (and {len(bad) - 1} more are wrong)" if len(bad) > 1 else ""
        raise LabError(
            f"effect '{effect.name}': offsets returns a wrong derivative by {name}: {messages[bad[0]]}{more}; repair it"
        )


def _drawn_inputs(effect: Effect, chain: JointSpec, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw joint positions and the effect's conditions at some poses."""
    joints = chain.random_joints(_POSES, rng)
    columns = [structure_values(name, _POSES, rng) for name in effect.conditions]
    return joints, np.stack(columns, axis=1) if columns else np.empty((_POSES, 0))


def _slope_error(own: Array, slope: Array, rounding: float) -> str:
    """Describe a derivative that is not that of differences, where it is farthest off; empty if they agree."""
    apart, size = np.abs(own - slope), max(float(np.abs(slope).max()), float(np.abs(own).max()))
    if apart.max() <= _TOLERANCE * size + rounding:
        return ""
    at = np.unravel_index(int(apart.argmax()), apart.shape)
    return f"{own[at]:.6g}, but by differences it is {slope[at]:.6g}"


def _refuse_wrong_stack(effect: Effect, joints: Array, conditions: Array, values: Array, moved: Array) -> None:
    """Compare the offsets of stacked parameters with those of the same parameters alone."""
    stacked, _ = effect.offsets(joints, conditions, np.stack([values, values])[:, None])
    if not np.allclose(stacked, moved, rtol=1e-9, atol=1e-15):
        raise LabError(
            f"effect '{effect.name}': offsets of stacked parameters (b, 1, p) differ from those of the same "
            f"parameters (p,); repair it, or leave stacks off"
        )
