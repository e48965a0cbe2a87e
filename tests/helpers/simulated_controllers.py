"""Controllers that execute a program in each language on their nominal arm, written from the languages' manuals.

Nothing of the lab is used: programs are read by Python's own parsers (``ast`` for RAPID's aggregates, ``exec`` for
URScript, ``xml`` for VAL 3) or line by line, rotations are SciPy's, and the inverse is Newton's method on the
Denavit-Hartenberg table. Configuration data are not read: among the inverse's solutions a controller takes the one
near to where the target was taught, which is given to it.
"""

import ast
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


@dataclass(frozen=True)
class NominalArm:
    """A Denavit-Hartenberg table: theta, d, a, alpha of six joints (rad, m), and whether it is modified (Craig)."""

    table: Array
    sign: Array
    craig: bool

    def flange(self, joints: Array) -> Array:
        """The pose ``(4, 4)`` (m) of the last frame in frame 0."""
        T = np.eye(4)
        for (theta, d, a, alpha), sign, q in zip(self.table, self.sign, joints, strict=True):
            turned = _pose(Rotation.from_euler("z", theta + sign * q), [0, 0, d])
            bent = _pose(Rotation.from_euler("x", alpha), [a, 0, 0])
            T = T @ bent @ turned if self.craig else T @ turned @ bent
        return T

    def inverse(self, T_wanted: Array, near: Array) -> Array:
        """The joint positions ``(6,)`` rad that bring the flange there, from ``near`` on; NaN where none are found."""
        q = near.copy()
        for _ in range(60):
            T = self.flange(q)
            error = _twist(T, T_wanted)
            if np.abs(error).max() < 1e-12:
                return q
            jacobian = np.stack([_twist(T, self.flange(q + step)) / 1e-6 for step in 1e-6 * np.eye(6)], axis=1)
            move = np.linalg.lstsq(jacobian, error, rcond=None)[0]
            q = q + move * min(1.0, 0.3 / max(np.abs(move).max(), 1e-12))
        return q if np.abs(_twist(self.flange(q), T_wanted)).max() < 1e-9 else np.full(6, np.nan)


def _twist(T_from: Array, T_to: Array) -> Array:
    """How far ``(6,)`` (m, rad) one pose is from another."""
    turn = Rotation.from_matrix(T_to[:3, :3] @ T_from[:3, :3].T).as_rotvec()
    return np.concatenate([T_to[:3, 3] - T_from[:3, 3], turn])


def _pose(rotation: Rotation, place: Sequence[float] | Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation.as_matrix(), place
    return T


@dataclass(frozen=True)
class Stop:
    """What a controller is told to reach: joint positions ``(6,)`` rad, or a pose (m) of its tool in its base."""

    joints: Array | None = None
    T_base_tool: Array | None = None
    T_flange_tool: Array = field(default_factory=lambda: np.eye(4))
    T_root_base: Array = field(default_factory=lambda: np.eye(4))


@dataclass(frozen=True)
class Controller:
    """A controller with what it keeps in its memory: tools and frames ``(4, 4)`` (m), pulses per degree ``(6,)``."""

    language: str
    arm: NominalArm
    memory: dict[str, Array] = field(default_factory=dict)
    pulses_per_deg: Array = field(default_factory=lambda: np.ones(6))

    def stops(self, text: str) -> list[Stop]:
        """What the program reaches, one after the other."""
        return _READERS[self.language](text, self)

    def execute(self, text: str, near: Sequence[Array]) -> Array:
        """Joint positions ``(stops, 6)`` rad at which the arm comes to rest; NaN where it reaches no solution.

        Args:
            near: for each stop, the joint positions at which it was taught.
        """
        reached = []
        for stop, taught in zip(self.stops(text), near, strict=True):
            if stop.joints is not None:
                reached.append(stop.joints)
                continue
            assert stop.T_base_tool is not None
            T_flange = stop.T_root_base @ stop.T_base_tool @ np.linalg.inv(stop.T_flange_tool)
            reached.append(self.arm.inverse(T_flange, taught))
        return np.array(reached)


def _angles(letters: str, values: Sequence[float]) -> Array:
    """A pose from mm and three angles in degrees."""
    return _pose(Rotation.from_euler(letters, values[3:6], degrees=True), np.array(values[:3]) / 1e3)


def _rapid(text: str, controller: Controller) -> list[Stop]:
    """Persistent data and constants, then the moves of the procedures."""
    code = re.sub(r'"[^"\n]*"|!.*', lambda found: '""' if found[0][0] == '"' else "", text.replace("\r\n", "\n"))
    data: dict[str, Any] = {}

    def value(source: str) -> Any:
        for word, python in (("TRUE", "True"), ("FALSE", "False")):
            source = re.sub(rf"\b{word}\b", python, source, flags=re.IGNORECASE)
        return ast.literal_eval(source.strip())

    def posed(pair: Any) -> Array:
        (place, (w, x, y, z)) = pair[0], pair[1]
        return _pose(Rotation.from_quat([x, y, z, w]), np.array(place) / 1e3)

    declared = re.compile(r"\b(?:CONST|PERS|VAR)\s+(\w+)\s+(\w+)\s*:=([^;]*);", re.IGNORECASE)
    for found in declared.finditer(code):
        if found[1].lower() in ("robtarget", "jointtarget", "tooldata", "wobjdata"):
            data[found[2].lower()] = value(found[3])
    stops = []
    for found in re.finditer(r"\bMove(AbsJ|J|L)\s+([^;]*);", code, re.IGNORECASE):
        source = found[2].strip()
        if source.startswith("["):
            depth = np.cumsum([{"[": 1, "]": -1}.get(each, 0) for each in source])
            end = int(np.flatnonzero(depth == 0)[0]) + 1
            target, rest = value(source[:end]), source[end:]
        else:
            name, rest = re.match(r"(\w+)(.*)", source, re.DOTALL).groups()  # type: ignore[union-attr]
            target = data[name.lower()]
        tool, _, work_object = rest.split(",")[-1].partition("\\")
        if found[1].lower() == "absj":
            stops.append(Stop(np.deg2rad(np.array(target[0], dtype=float))))
            continue
        T_tool = np.eye(4) if tool.strip().lower() == "tool0" else posed(data[tool.strip().lower()][1])
        T_base = np.eye(4)
        if named := re.match(r"\s*WObj\s*:=\s*(\w+)", work_object, re.IGNORECASE):
            *_, user, frame = data[named[1].lower()]
            T_base = posed(user) @ posed(frame)
        stops.append(Stop(None, posed(target), T_tool, T_base))
    return stops


def _krl(text: str, controller: Controller) -> list[Stop]:
    """Statements end with the line; a structure's parts are named."""
    frames = {"TOOL": np.eye(4), "BASE": np.eye(4)}
    positions: dict[str, str] = {}
    stops = []

    def parts(source: str) -> dict[str, float]:
        return {key.upper(): float(value) for key, value in re.findall(rf"\b([A-Z]\w*)\s+({_NUMBER})", source, re.I)}

    def posed(source: str) -> Array:
        if source.strip().upper() == "$NULLFRAME":
            return np.eye(4)
        found = parts(source)
        return _angles("ZYX", [found[key] for key in "XYZABC"])

    for line in (each.partition(";")[0].strip() for each in text.splitlines()):
        if named := re.match(r"\$(TOOL|BASE)\s*=\s*(.*)$", line, re.IGNORECASE):
            frames[named[1].upper()] = posed(named[2])
        elif declared := re.match(r"(?:DECL\s+)?(?:E6POS|POS|E6AXIS|AXIS)\s+(\w+)\s*=\s*(\{.*\})", line, re.IGNORECASE):
            positions[declared[1].upper()] = declared[2]
        elif moved := re.match(r"S?(?:PTP|LIN)\s+(\{[^}]*\}|\w+)", line, re.IGNORECASE):
            source = moved[1] if moved[1][0] == "{" else positions[moved[1].upper()]
            found = parts(source)
            if "X" in found:
                stops.append(Stop(None, posed(source), frames["TOOL"], frames["BASE"]))
            else:
                stops.append(Stop(np.deg2rad([found[f"A{i}"] for i in range(1, 7)])))
    return stops


class _P:
    """URScript's p[x, y, z, rx, ry, rz]."""

    def __getitem__(self, values: tuple[float, ...]) -> Array:
        return _pose(Rotation.from_rotvec(values[3:]), values[:3])


def _urscript(text: str, controller: Controller) -> list[Stop]:
    """URScript is run as the Python that it nearly is: p[...] is an index, and calls are calls."""
    stops: list[Stop] = []
    T_tcp = [np.eye(4)]

    def move(target: Any, **_: float) -> None:
        if isinstance(target, list):
            stops.append(Stop(np.array(target, dtype=float)))
        else:
            stops.append(Stop(None, target, T_tcp[0]))

    def set_tcp(T: Array) -> None:
        T_tcp[0] = T

    known: dict[str, Any] = {
        "p": _P(), "movej": move, "movel": move, "set_tcp": set_tcp, "get_inverse_kin": lambda T, **_: T,
        "pose_trans": lambda T_a, T_b: T_a @ T_b, "True": True, "False": False,
    }  # fmt: skip
    for other in ("set_payload", "textmsg", "set_digital_out", "sleep"):
        known[other] = lambda *_, **__: None
    lines = (re.sub(r"^\s*(?:global|local)\s+", "", line).strip() for line in text.splitlines())
    kept = [line for line in lines if not re.match(r"def\b|end\b", line)]
    exec("\n".join(kept), {"__builtins__": {}}, known)
    return stops


def _fanuc(text: str, controller: Controller) -> list[Stop]:
    """Motions behind /MN, in the order of their lines, to positions behind /POS."""
    program, _, data = text.partition("/POS")
    positions: dict[str, Stop] = {}
    for block in re.finditer(r'P\[(\d+)(?::"[^"]*")?\]\s*\{(.*?)\};', data, re.DOTALL):
        fields = {key: float(value) for key, value in re.findall(rf"\b([XYZWPR]|J[1-6])\s*=\s*({_NUMBER})", block[2])}
        frames = re.search(r"UF\s*:\s*(\d+)\s*,\s*UT\s*:\s*(\d+)", block[2])
        if "J1" in fields:
            positions[block[1]] = Stop(np.deg2rad([fields[f"J{i}"] for i in range(1, 7)]))
            continue
        assert frames is not None
        T_base, T_tool = (
            np.eye(4) if number == "0" else controller.memory[f"{kind}[{number}]"]
            for kind, number in zip(("UFRAME", "UTOOL"), frames.groups(), strict=True)
        )
        positions[block[1]] = Stop(None, _angles("xyz", [fields[key] for key in "XYZWPR"]), T_tool, T_base)
    return [positions[found[1]] for found in re.finditer(r"^\s*\d+:\s*[JL]\s+P\[(\d+)", program, re.MULTILINE)]


def _val3(text: str, controller: Controller) -> list[Stop]:
    """The points and joint positions of an application's data, in their order; the one tool is used."""
    frames, tools = {"world": np.eye(4)}, {"flange": np.eye(4)}
    stops = []
    keys = ("x", "y", "z", "rx", "ry", "rz")
    values = [
        (data.get("type"), data.get("name"), value.attrib)
        for data in ElementTree.fromstring(text.encode("utf-8")).iter()
        if data.tag.endswith("Data")
        for value in data
    ]
    for kind, name, given in values:
        if kind in ("frame", "tool"):
            known = frames if kind == "frame" else tools
            father = known[given["fatherId"].removesuffix("[0]")]
            known[str(name)] = father @ _angles("XYZ", [float(given[key]) for key in keys])
    (tool,) = (T for name, T in tools.items() if name != "flange")
    for kind, _, given in values:
        if kind == "pointRx":
            T = _angles("XYZ", [float(given[key]) for key in keys])
            stops.append(Stop(None, T, tool, frames[given["fatherId"].removesuffix("[0]")]))
        elif kind == "jointRx":
            stops.append(Stop(np.deg2rad([float(given[f"j{i}"]) for i in range(1, 7)])))
    return stops


def _jbi(text: str, controller: Controller) -> list[Stop]:
    """Pseudo instructions hold for the positions below them; motor pulses are whole."""
    state: dict[str, str] = {}
    positions: dict[str, Stop] = {}
    stops = []
    for line in text.splitlines():
        if pseudo := re.match(r"///(\w+)\s*(.*)", line):
            state[pseudo[1]] = pseudo[2].strip()
        elif placed := re.match(r"(C\d+)=(.*)", line):
            values = placed[2].split(",")
            if state["POSTYPE"] == "PULSE":
                pulses = np.array([int(each) for each in values[:6]])  # a point would be refused
                positions[placed[1]] = Stop(np.deg2rad(pulses / controller.pulses_per_deg))
                continue
            T_tool = np.eye(4) if state["TOOL"] == "0" else controller.memory[f"TOOL[{state['TOOL']}]"]
            T_base = controller.memory[f"USER[{state['USER']}]"] if state["POSTYPE"] == "USER" else np.eye(4)
            positions[placed[1]] = Stop(None, _angles("xyz", [float(each) for each in values[:6]]), T_tool, T_base)
        elif moved := re.match(r"MOV[JL]\s+(C\d+)", line):
            stops.append(positions[moved[1]])
    return stops


_READERS: dict[str, Callable[[str, Controller], list[Stop]]] = {
    "rapid": _rapid, "krl": _krl, "urscript": _urscript, "fanuc": _fanuc, "val3": _val3, "jbi": _jbi,
}  # fmt: skip
