"""Mechanisms as TOML files: joints, frames at the ends of paths, rods and pins. Keys as in the README.

Files by ``write_mechanism`` (m, rad) read back to the bit.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import numpy as np

from lab.core.errors import LabError
from lab.core.limits import FRAMES, JOINTS, LENGTH_M
from lab.core.se3 import Array
from lab.core.units import DEGREES, MM
from lab.formats.description import DescriptionFormat
from lab.formats.robot_toml import (
    ANGLES,
    LENGTHS,
    JointSection,
    JointSections,
    TrackedSection,
    quoted,
    read_base,
    read_height,
    read_tool,
    refuse_unknown_keys,
    written_base_and_tool,
)
from lab.formats.structured import read_toml
from lab.kinematics.closed.closed_arm import ClosedArm
from lab.kinematics.closed.loop_closure import BASE, Frame, Kind, Pin, Rod, Step, Tree
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.parameter import is_reserved_owner

__all__ = ["MECHANISM_TOML", "MechanismFile", "read_mechanism", "write_mechanism"]

_TOP_KEYS = ("name", "height_mm", "joint", "frame", "rod", "pin", "platform", "tool", "base")
_OF_JOINT = "name, type, sign, lower and upper with _deg or _rad (of a slide _mm or _m), speed, acceleration"
_OF_STEP = "one of x, y, z with _mm or _m, rx, ry, rz with _deg or _rad; and joint, passive or exact"
_GROUND = "base"
_RESERVED = ("world", "tracker", "floor")  # names in the virtual robot's model


@dataclass(frozen=True)
class MechanismFile:
    """Content of a mechanism file; ``base``, ``tool`` and ``height_m`` as in ``RobotTable``."""

    mechanism: Mechanism
    base: Array | None
    tool: dict[str, Array]
    height_m: float | None
    warnings: tuple[str, ...]


def read_mechanism(path: Path) -> MechanismFile:
    """Read a mechanism file."""
    document = read_toml(path)
    refuse_unknown_keys(path, document, _TOP_KEYS)
    warnings: list[str] = []
    joints = JointSections(path, _sections(path, document, "joint"))
    tool = read_tool(path, document.get("tool", {}))
    for name in (*joints.names, *tool):
        if "." in name or name in _RESERVED:
            raise LabError(f"{path}: {name} cannot be a joint's or a target's name; choose one without a dot")
    values = joints.values(warnings)
    joints.refuse_the_rest(_OF_JOINT)
    try:
        tree = _Tree(path, joints.joints).tree(document)
        mechanism = Mechanism(name=_robot_name(path, document), tree=tree, **values)
        if not tree.passive:
            raise LabError("it has no passive joint, so it has no loop; describe a chain by a Denavit-Hartenberg table")
        mechanism.refuse_open()
    except LabError as error:
        raise error if str(error).startswith(str(path)) else LabError(f"{path}: {error}") from error
    base = read_base(path, document["base"]) if "base" in document else None
    return MechanismFile(mechanism, base, tool, read_height(path, document), tuple(warnings))


def write_mechanism(mechanism: Mechanism, values: Array, tool: dict[str, Array]) -> str:
    """Write a mechanism with parameters ``(p,)``, base included, that reads back to the bit."""
    dimensions, tree = mechanism.dimensions(values), mechanism.tree
    lines = [f"name = {quoted(mechanism.name)}", f"platform = {quoted(tree.frames[tree.platform].name)}"]
    for i, joint in enumerate(mechanism.joint_names):
        kind, unit = ("prismatic", "m") if mechanism.prismatic[i] else ("revolute", "rad")
        lines += ["", "[[joint]]", f"name = {quoted(joint)}", f'type = "{kind}"', f"sign = {int(mechanism.sign[i])}"]
        lines += [f"lower_{unit} = {float(mechanism.lower[i])!r}", f"upper_{unit} = {float(mechanism.upper[i])!r}"]
    for frame, constants in zip(tree.frames, dimensions.steps, strict=True):
        steps = ", ".join(_step_text(step, value, mechanism) for step, value in zip(frame.path, constants, strict=True))
        lines += ["", "[[frame]]", f"name = {quoted(frame.name)}", f"on = {quoted(_name_of(tree, frame.on))}"]
        lines += [f"path = [{steps}]"]
    for rod, length in zip(tree.rods, dimensions.lengths, strict=True):
        lines += ["", "[[rod]]", f"name = {quoted(rod.name)}", f"between = {_between(tree, rod.ends)}"]
        lines += [f"length_m = {float(length)!r}"]
        lines += [f"joint = {quoted(mechanism.joint_names[rod.joint])}"] if rod.joint is not None else []
        lines += ["exact = true"] if rod.exact else []
    for pin in tree.pins:
        lines += ["", "[[pin]]", f"name = {quoted(pin.name)}", f"between = {_between(tree, pin.ends)}"]
        lines += [f'along = "{"".join("xyz"[axis] for axis in pin.axes)}"']
    return "\n".join([*lines, *written_base_and_tool(values[:6], tool, "the platform's frame")]) + "\n"


MECHANISM_TOML: DescriptionFormat[ClosedArm, object] = DescriptionFormat(
    "calibrated.toml",
    lambda identified: write_mechanism(
        identified.arm.chain, identified.values, identified.arm.tool_positions(identified.values)
    ),
)


def _step_text(step: Step, value: float, mechanism: Mechanism) -> str:
    more = f", joint = {quoted(mechanism.joint_names[step.joint])}" if step.joint is not None else ""
    more += ", passive = true" if step.passive else ", exact = true" if step.exact else ""
    return f"{{ {step.kind}_{'rad' if step.is_turn else 'm'} = {float(value)!r}{more} }}"


def _name_of(tree: Tree, frame: int) -> str:
    return _GROUND if frame == BASE else tree.frames[frame].name


def _between(tree: Tree, ends: tuple[int, int]) -> str:
    return f"[{', '.join(quoted(_name_of(tree, end)) for end in ends)}]"


def _robot_name(path: Path, document: dict[str, Any]) -> str:
    name = document.get("name", path.stem)
    if not isinstance(name, str) or not name.strip():
        raise LabError(f"{path}: name is {name!r}; name the robot, or leave it out")
    return name


def _sections(path: Path, document: dict[str, Any], name: str, least: int = 1) -> list[Any]:
    contents = document.get(name, [])
    if not isinstance(contents, list) or len(contents) < least:
        raise LabError(f"{path}: no {name}s; give each {name} a [[{name}]] section")
    (JOINTS if name == "joint" else FRAMES)(path, contents)
    return contents


class _Tree:
    """Reader of the frames, rods and pins of a file."""

    def __init__(self, path: Path, joints: list[JointSection]) -> None:
        self.path, self.joints = path, {joint.name: i for i, joint in enumerate(joints)}
        self._names, self.slides = [joint.name for joint in joints], [joint.prismatic for joint in joints]
        self.frames: dict[str, Frame] = {}

    def tree(self, document: dict[str, Any]) -> Tree:
        for section, name in self._named(document, "frame", self.frames):
            on = self._frame(section, section.take("on", _GROUND))
            self.frames[name] = Frame(name, on, self._steps(section, name))
            section.refuse_the_rest("name, on, path")
        rods: dict[str, Rod] = {}
        for section, name in self._named(document, "rod", self.frames, rods):
            rods[name] = self._rod(section, name)
        pins: dict[str, Pin] = {}
        for section, name in self._named(document, "pin", self.frames, rods, pins):
            pins[name] = self._pin(section, name)
        platform = document.get("platform")
        if not isinstance(platform, str) or platform not in self.frames:
            stated = "missing" if platform is None else repr(platform)
            frames = ", ".join(self.frames)
            raise LabError(f"{self.path}: platform is {stated}; name the frame that carries the targets: {frames}")
        return Tree(
            tuple(self.frames.values()), tuple(rods.values()), tuple(pins.values()), list(self.frames).index(platform)
        )

    def _named(
        self, document: dict[str, Any], kind: str, *taken: Mapping[str, object]
    ) -> Iterator[tuple[TrackedSection, str]]:
        """Yield the sections of a kind with their names, which no earlier one has."""
        for i, content in enumerate(_sections(self.path, document, kind, int(kind == "frame"))):
            section = TrackedSection(f"{self.path}, {kind} {i + 1}", content)
            name = self._name(section, {name for names in taken for name in names})
            section.where = f"{self.path}, {kind} {name}"
            yield section, name

    def _pin(self, section: TrackedSection, name: str) -> Pin:
        axes = str(section.take("along", "xyz"))
        if not axes or set(axes) - set("xyz") or len(set(axes)) < len(axes):
            raise LabError(f'{section.where}: along is {axes!r}; write axes of the base, "xy" or "xyz"')
        pin = Pin(name, self._ends(section), tuple("xyz".index(axis) for axis in axes))
        section.refuse_the_rest("name, between, along")
        return pin

    def _name(self, section: TrackedSection, taken: set[str]) -> str:
        name = section.take("name")
        if not isinstance(name, str) or not name.strip() or "." in name or "," in name:
            raise LabError(f"{section.where}: name is {name!r}; give it a name, without a dot or a comma")
        if name in taken or name in _RESERVED or is_reserved_owner(name):
            raise LabError(f"{section.where}: the name {name} is already used; give another name")
        return name

    def _frame(self, section: TrackedSection, name: Any) -> int:
        if name == _GROUND:
            return BASE
        if not isinstance(name, str) or name not in self.frames:
            known = ", ".join((_GROUND, *self.frames))
            raise LabError(f"{section.where}: there is no frame {name!r} before it; there are {known}")
        return list(self.frames).index(name)

    def _ends(self, section: TrackedSection) -> tuple[int, int]:
        between = section.take("between")
        if not isinstance(between, list) or len(between) != 2 or between[0] == between[1]:
            told = "missing" if between is None else repr(between)
            raise LabError(f"{section.where}: between is {told}; name the two frames whose origins it joins")
        if _GROUND in between:
            raise LabError(f"{section.where}: joins {_GROUND} itself; give that point a frame of its own")
        first, second = (self._frame(section, name) for name in between)
        return first, second

    def _joint(self, section: TrackedSection) -> int | None:
        name = section.take("joint")
        if name is not None and not (isinstance(name, str) and name in self.joints):
            raise LabError(f"{section.where}: there is no joint {name!r}; there are {', '.join(self.joints)}")
        return None if name is None else self.joints[name]

    def _steps(self, section: TrackedSection, frame: str) -> tuple[Step, ...]:
        path = section.take("path", [])
        if not isinstance(path, list):
            raise LabError(f"{section.where}: path is {path!r}; write a list of steps, e.g. [{{ x_mm = 100 }}]")
        if wrong := [content for content in path if not isinstance(content, dict)]:
            raise LabError(f"{section.where}: a step is {wrong[0]!r}; write it as {{ x_mm = 100 }}")
        steps = [
            self._step(TrackedSection(f"{section.where}, step {i + 1}", content)) for i, content in enumerate(path)
        ]
        kinds = [step.kind for step in steps]
        if twice := [kind for kind in kinds if kinds.count(kind) > 1]:
            raise LabError(f"{section.where}: {twice[0]} is there twice; put a frame between")
        return tuple(steps)

    def _step(self, section: TrackedSection) -> Step:
        numbers = {kind: section.optional(kind, ANGLES if len(kind) == 2 else LENGTHS) for kind in get_args(Kind)}
        kinds = [(kind, number) for kind, number in numbers.items() if number is not None]
        joint, passive, exact = self._joint(section), section.flag("passive"), section.flag("exact")
        section.refuse_the_rest(_OF_STEP)
        if len(kinds) != 1:
            raise LabError(f"{section.where}: {len(kinds)} motions; give {_OF_STEP}")
        if (joint is not None) + passive + exact > 1:
            raise LabError(f"{section.where}: a step has a joint, is passive, or is exact; keep one")
        kind, value = kinds[0]
        step = Step(kind, value, exact, joint, passive)
        self._refuse_unfit(section, step, value)
        return step

    def _refuse_unfit(self, section: TrackedSection, step: Step, value: float) -> None:
        """Refuse a step of another kind than its joint, and one that is too long."""
        if step.joint is not None and self.slides[step.joint] == step.is_turn:
            moves, kind = ("turns", "revolute") if step.is_turn else ("slides", "prismatic")
            raise LabError(
                f"{section.where}: {step.kind} {moves}, but joint {self._names[step.joint]} does not; "
                f"make the joint {kind}, or let another step name it"
            )
        if step.is_turn and abs(value) > 2 * np.pi:
            raise LabError(f"{section.where}: {step.kind} is {DEGREES.text(value, 6)}; give at most a full turn")
        if abs(value) not in LENGTH_M:
            raise LabError(f"{section.where}: {step.kind} is {value:.6g} m; give at most {LENGTH_M.most:g} m")

    def _rod(self, section: TrackedSection, name: str) -> Rod:
        ends, joint, exact = self._ends(section), self._joint(section), section.flag("exact")
        length = section.optional("length", LENGTHS)
        section.refuse_the_rest("name, between, length_mm (or _m), joint, exact")
        if joint is None:
            if length is None:
                raise LabError(f"{section.where}: length is missing; give length_mm or a joint that sets it")
            if not length > 0:
                raise LabError(f"{section.where}: length is {MM.text(length, 6)}; give more than zero")
        else:
            if not self.slides[joint]:
                raise LabError(
                    f"{section.where}: its length cannot be joint {self._names[joint]}, which turns; make it prismatic"
                )
            if exact:
                raise LabError(f"{section.where}: exact is for rods whose length no joint sets; leave it out")
        return Rod(name, ends, length or 0.0, exact, joint)
