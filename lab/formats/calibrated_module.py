"""The calibrated arm as a standalone Python module: ``calibrated.py`` of a run.

Its text is that of ``plain_arm`` with the numbers of the arm and its effects, and two functions. For an arm that it
cannot express the functions refuse, with the reason.
"""

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from textwrap import dedent, fill
from types import ModuleType
from typing import Any

import numpy as np

from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extension_points import numbers, own_errors
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.effects.arm_with_effects import Arm, ArmWithEffects
from lab.kinematics.effects.compliance import NEWTON_STEPS
from lab.kinematics.effects.effect import Effect
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = ["MODULE_FILE", "largest_difference", "loaded", "module_text", "plain_model", "refusing_text"]

MODULE_FILE = "calibrated.py"
_WIDTH = 100
_COMPARED, _ROUNDING = 8, 1e-12  # poses at which an effect's own function is compared with it
_IMPORTS = "from __future__ import annotations\nimport math\n"  # what the module gives such a function
_USE = (
    "forward(joints, **conditions) returns the pose of the last frame as four rows of four numbers, and the positions "
    "of the measured points by name. inverse(pose, near, point=None, **conditions) returns the joint positions near "
    "others at which the last frame, or a measured point with the axes of the tool, has a pose; a ValueError says "
    "where there are none.",
    "Lengths are in m and angles in rad. Joint positions are the measured ones, in this order: {joints}. Poses "
    "and points are in {frame}. BASE is the pose of the arm's base there (frame 0 of its table), and to_base(pose) "
    "turns a pose of that frame into one of the base.",
    "{conditions}",
    "It needs Python 3.8 or later and no packages.",
)
_FUNCTIONS = '''

BASE = MODEL["base"]


def forward(joints: list[float], **conditions: float) -> tuple[list[list[float]], dict[str, list[float]]]:
    """Pose of the last frame and positions of the measured points (m) at joint positions (rad, m of a slide)."""
    return place(MODEL, joints, conditions)


def inverse(
    pose: list[list[float]], near: list[float], point: str | None = None, **conditions: float
) -> list[float]:
    """Joint positions (rad, m of a slide) at which the last frame, or a measured point, has a pose (m)."""
    return inverse_of(MODEL, pose, near, point, conditions)


def to_base(pose: list[list[float]]) -> list[list[float]]:
    """A pose of the frame of the measurements, in the arm's base."""
    return in_base(MODEL, pose)
'''
_REFUSING = '''
REASON = {reason!r}


def forward(joints, **conditions):
    """Refuse: see REASON."""
    raise NotImplementedError(REASON)


def inverse(pose, near, point=None, **conditions):
    """Refuse: see REASON."""
    raise NotImplementedError(REASON)
'''


def plain_model(
    arm: Arm, values: Array, loads: Loads | None, R_last_tool: Array, usual: Mapping[str, float]
) -> dict[str, Any]:
    """Return an arm with parameters ``values`` ``(p,)`` as the ``model`` of ``plain_arm``.

    Args:
        loads: nominal masses, or None.
        R_last_tool: rotation ``(3, 3)`` of the measured tool in the last frame.
        usual: default values of conditions; others are required.
    """
    rigid = arm.rigid
    if not isinstance(rigid, SerialArm):
        raise LabError("it has loops, whose closure a standalone module cannot solve")
    effects = arm.effects if isinstance(arm, ArmWithEffects) else ()
    terms, first = list[dict[str, Any]](), len(rigid.names)
    for effect in effects:
        part = slice(first, first + len(effect.parameters))
        first = part.stop
        if effect.moves in ("frame", "station") or (effect.terms is None and effect.plain is None):
            raise LabError(f"effect {effect.name} cannot be written as plain Python: it gives no function plain")
        if effect.terms is not None:
            terms += [dict(term) for term in effect.terms(values[part])]
        else:
            terms.append(_own_term(effect, arm, values[part]))
    chain = rigid.chain
    _, table, points = rigid.split(values[: len(rigid.names)])
    model: dict[str, Any] = {
        "joint_names": list(chain.joint_names),
        "convention": chain.convention,
        "prismatic": [bool(slides) for slides in chain.prismatic],
        "sign": chain.sign.tolist(),
        "lower": _finite(chain.lower),
        "upper": _finite(chain.upper),
        "table": table.tolist(),
        "base": rigid.T_tracker_frame0(values[: len(rigid.names)]).tolist(),
        "points": dict(zip(rigid.targets, points.tolist(), strict=True)),
        "tool": R_last_tool.tolist(),
        "conditions": {name: usual.get(name) for name in arm.conditions},
        "terms": terms,
    }
    if terms:
        masses = Loads(chain, np.zeros(chain.size), np.zeros((chain.size, 3)), np.zeros(3)) if loads is None else loads
        model["loads"] = {
            "table": masses.chain.table.tolist(),
            "mass_kg": masses.mass_kg.tolist(),
            "centre_m": masses.centre_m.tolist(),
            "gravity": masses.gravity.tolist(),
            "payload_at_m": masses.payload_at_m.tolist(),
            "steps": NEWTON_STEPS,
        }
    return model


@dataclass(frozen=True)
class _Embedded:
    """A function of plain Python with its text, under a name that no other function of the module has."""

    name: str
    text: str

    @cached_property
    def _function(self) -> Callable[..., Any]:
        namespace: dict[str, Any] = {}
        exec(compile(f"{_IMPORTS}{self.text}", MODULE_FILE, "exec"), namespace)
        function: Callable[..., Any] = namespace[self.name]
        return function

    def __call__(self, joints: list[float], conditions: list[float], values: list[float]) -> list[float]:
        """Return the offsets at one pose."""
        return [float(each) for each in self._function(joints, conditions, values)]

    def __repr__(self) -> str:
        """Return the name, by which the module's text calls it."""
        return self.name


def _embedded(effect: Effect) -> _Embedded:
    """Return an effect's function in plain Python, as the module holds it."""
    where = f"effect '{effect.name}': plain"
    try:
        text = dedent(inspect.getsource(effect.plain))  # type: ignore[arg-type]
    except (OSError, TypeError):
        raise LabError(f"{where} has no text to copy; write it by def, in a file or a notebook") from None
    match = re.match(r"def \w+\(", text)
    if match is None:
        raise LabError(f"{where} is no function that def makes; write it so, without a decorator")
    name = "_".join(["plain", *re.findall(r"\w+", effect.name)])
    return _Embedded(name, f"def {name}({text[match.end() :]}")


def _own_term(effect: Effect, arm: Arm, values: Array) -> dict[str, Any]:
    """Return the term of an effect with a function ``plain``, compared with its offsets at some poses.

    Args:
        values: its own parameters.

    Raises:
        LabError: the function fails by itself, or returns other offsets.
    """
    call, size = _embedded(effect), arm.rigid.chain.size
    inputs = arm.structure_joints(_COMPARED, rng_for(0, "structure"))
    joints, conditions = inputs[:, :size], inputs[:, [size + arm.conditions.index(name) for name in effect.conditions]]
    expected = effect.offsets(joints, conditions, values)[0]
    with own_errors("effect", effect.name, function="plain"):
        returned = [call(q, c, values.tolist()) for q, c in zip(joints.tolist(), conditions.tolist(), strict=True)]
    offsets = numbers(f"effect '{effect.name}': plain", returned, expected.shape, "offsets")
    if (apart := float(np.abs(offsets - expected).max())) > _ROUNDING * max(1.0, float(np.abs(expected).max())):
        raise LabError(f"effect '{effect.name}': plain returns other numbers than offsets, by {apart:.2g}; repair it")
    return {
        "call": call,
        "moves": effect.moves,
        "links": list(effect.links),
        "conditions": list(effect.conditions),
        "values": values.tolist(),
    }


def module_text(title: str, about: str, frame: str, model: Mapping[str, Any]) -> str:
    """Return the text of the module.

    Args:
        title: its first line.
        about: description of the arm and its effects.
        frame: description of the frame of its poses.
        model: of ``plain_model``.
    """
    needs = [
        f"{name!r} ({'must be given' if usual is None else f'{usual:g} if not given'})"
        for name, usual in model["conditions"].items()
    ]
    text = f"Conditions of a pose, as in forward(q, **{{'name': value}}): {', '.join(needs)}." if needs else ""
    filled = (each.format(frame=frame, joints=", ".join(model["joint_names"]), conditions=text) for each in _USE)
    head = "\n\n".join([title, *(fill(each, _WIDTH) for each in (about, *filled) if each)]) + "\n"
    source = (files("lab") / "formats" / "plain_arm.py").read_text(encoding="utf-8")
    code = re.sub(r'^""".*?"""\n', "", source, count=1, flags=re.DOTALL)
    code = re.sub(r"^__all__ = .*\n\n", "", code, count=1, flags=re.MULTILINE)
    own = "".join(f"\n\n\n{term['call'].text.rstrip()}" for term in model["terms"] if "call" in term)
    return f"{_docstring(head)}\n{code.rstrip()}{own}\n\n\nMODEL: dict[str, Any] = {_literal(model, 0)}\n{_FUNCTIONS}"


def refusing_text(title: str, about: str, reason: str) -> str:
    """Return the text of a module whose functions refuse with a reason."""
    refusal = f"forward and inverse refuse: {reason}."
    head = _docstring("\n\n".join([title, fill(about, _WIDTH), fill(refusal, _WIDTH)]) + "\n")
    return head + "\n" + _REFUSING.format(reason=reason)


def loaded(text: str) -> ModuleType:
    """Return the module of a text made by the lab."""
    module = ModuleType("calibrated")
    exec(compile(text, MODULE_FILE, "exec"), module.__dict__)
    return module


def largest_difference(text: str, arm: Arm, values: Array, inputs: Array) -> float:
    """Return the largest distance (m) of the module from the arm at ``inputs`` ``(n, joints + conditions)``."""
    module, size = loaded(text), arm.rigid.chain.size
    largest = 0.0
    for row, points in zip(inputs.tolist(), arm.points(inputs, values), strict=True):
        conditions = dict(zip(arm.conditions, row[size:], strict=True))
        _, found = module.forward(row[:size], **conditions)
        largest = max(largest, float(np.abs(points - np.array(list(found.values()))).max()))
    return largest


def _literal(value: Any, level: int) -> str:
    """Write plain values as Python, with a line for each item of a dictionary and each row of nested lists."""
    inner, outer = "\n" + 4 * (level + 1) * " ", "\n" + 4 * level * " "
    if isinstance(value, Mapping) and value:
        return (
            "{" + "".join(f"{inner}{key!r}: {_literal(each, level + 1)}," for key, each in value.items()) + outer + "}"
        )
    if isinstance(value, list) and any(isinstance(each, list | dict) for each in value):
        return "[" + "".join(f"{inner}{_literal(each, level + 1)}," for each in value) + outer + "]"
    return repr(value)


def _finite(limits: Array) -> list[float | None]:
    return [float(limit) if np.isfinite(limit) else None for limit in limits]


def _docstring(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"""{escaped}"""'
