"""Programs in each language, read back by parsers of the test's own: joints, waits, and frames by another library."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lab.core import se3
from lab.core.se3 import Array
from lab.extensions.programs.fanuc import FanucLs
from lab.extensions.programs.krl import Krl
from lab.extensions.programs.urscript import UrScript
from lab.extensions.programs.val3 import Val3
from lab.formats.programs.protocol import PAUSE_S, Language, MeasuringTour, TargetMoves

LANGUAGES: tuple[Language, ...] = (UrScript(), Krl(), FanucLs(), Val3())
N = r"(-?\d+(?:\.\d+)?)"
SIX = r",\s*".join([N] * 6)
IDS = ("1", "a b", "Ä;]]>", 'say "no"', "x" * 60)


def joints_in(language: Language, text: str) -> Array:
    """Joint positions ``(n, 6)`` rad in the order of the moves."""
    if language.name == "URScript":
        return np.array(re.findall(rf"^  movej\(\[{SIX}\], a=0.8, v=0.5\)$", text, re.MULTILINE), dtype=float)
    if language.name == "KRL":
        axes = ", ".join(f"A{i} {N}" for i in range(1, 7))
        return np.deg2rad(np.array(re.findall(rf"^PTP {{AXIS: {axes}}}$", text, re.MULTILINE), dtype=float))
    if language.name == "VAL3":
        code = ET.fromstring(text.encode()).find(".//{*}Code")
        assert code is not None and code.text
        found = re.findall(rf"jTo={{{SIX}}}\n  movej\(jTo,flange,mNomSpeed\)\n  waitEndMove\(\)", code.text)
        return np.deg2rad(np.array(found, dtype=float))
    order = [int(number) for number in re.findall(r"^ +\d+:J P\[(\d+)\] 20% FINE ;$", text, re.MULTILINE)]
    stored = dict(re.findall(r"^P\[(\d+)\]{\n(.*?)\n};$", text, re.MULTILINE | re.DOTALL))
    angles = [re.findall(rf"J\d= +{N} deg", stored[str(number)]) for number in order]
    return np.deg2rad(np.array(angles, dtype=float))


def frames_in(language: Language, text: str) -> list[Array]:
    """Poses of the tool and of the instrument's frame (m), by SciPy's rotations."""
    if language.name == "URScript":
        found = np.array(re.findall(rf"p\[{SIX}\]", text), dtype=float)
        return [se3.pose(Rotation.from_rotvec(each[3:]).as_matrix(), each[:3]) for each in found]
    if language.name == "KRL":
        found = np.array(re.findall(rf"= {{X {N}, Y {N}, Z {N}, A {N}, B {N}, C {N}}}", text), dtype=float)
        turns = [Rotation.from_euler("ZYX", each[3:], degrees=True) for each in found]
    elif language.name == "VAL3":
        found = np.array(re.findall(rf"tr\w+={{{SIX}}}", text), dtype=float)
        turns = [Rotation.from_euler("XYZ", each[3:], degrees=True) for each in found]
    else:
        found = np.array(re.findall(rf"!U(?:TOOL|FRAME) \w {N} ;", text), dtype=float).reshape(-1, 6)
        turns = [Rotation.from_euler("xyz", each[3:], degrees=True) for each in found]
    return [se3.pose(turn.as_matrix(), each[:3] / 1e3) for turn, each in zip(turns, found, strict=True)]


def written(content: bytes) -> str:
    text = content.decode("ascii")
    assert text.count("\n") == text.count("\r\n") or "\r" not in text
    return text.replace("\r\n", "\n")


def loose(language: Language) -> float:
    """Half of the last printed digit, and rounding: rad, m."""
    return {"URScript": 6e-9, "FANUC": 1e-5}.get(language.name, 2e-8)


TURNS = {
    "any": Rotation.from_rotvec([0.3, -1.2, 0.7]),
    "half a turn": Rotation.from_rotvec([0, 0, np.pi]),
    "upside down": Rotation.from_euler("xyz", [180, 0, 30], degrees=True),
    "gimbal lock of ZYX": Rotation.from_euler("ZYX", [25, 90, 0], degrees=True),
    "gimbal lock of XYZ": Rotation.from_euler("XYZ", [25, -90, 0], degrees=True),
}


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize("language", LANGUAGES, ids=lambda each: each.name)
def test_target_moves_hold_joints_and_frames_to_the_last_digit(language: Language, turn: str) -> None:
    rng = np.random.default_rng(1)
    stops, which = rng.uniform(-np.pi, np.pi, (8, 6)), np.array([-1, 0, 1, -1, 2, 3, 4, -1])
    stops[0] = [np.pi, -np.pi, 0.0, -1e-12, 2 * np.pi, 1e-9]
    T_tool = se3.pose(TURNS[turn].as_matrix(), np.array([0.03, -0.02, 0.1]))
    T_frame = se3.pose(TURNS["any"].as_matrix(), np.array([-1.6, 1.3, -1.1]))
    text = written(language.target_moves(TargetMoves("a robot – ß", IDS, stops, which, T_tool, T_frame)))
    np.testing.assert_allclose(joints_in(language, text), stops, atol=loose(language))
    for found, expected in zip(frames_in(language, text), (T_tool, T_frame), strict=True):
        np.testing.assert_allclose(found[:3, 3], expected[:3, 3], atol=5.1e-7)
        np.testing.assert_allclose(found[:3, :3], expected[:3, :3], atol=2 * loose(language))
    assert "-0.0" not in re.sub(r"-0\.0*[1-9]", "", text)
    assert text.count("target") >= 5 and "NOT CHECKED" not in text


@pytest.mark.parametrize("checked", [True, False])
@pytest.mark.parametrize("language", LANGUAGES, ids=lambda each: each.name)
def test_a_measuring_tour_waits_where_it_measures(language: Language, checked: bool) -> None:
    stops = np.random.default_rng(2).uniform(-1, 1, (5, 6))
    tour = MeasuringTour("arm", stops, np.array([-1, 1, -1, 0, -1]), ("7", "8"), checked)
    text = written(language.measuring_tour(tour))
    np.testing.assert_allclose(joints_in(language, text), stops, atol=loose(language))
    waits = [float(each) for each in re.findall(r"(?:sleep\(|WAIT SEC |delay\(|WAIT +)(\d+\.\d+)", text)]
    assert waits == [PAUSE_S] * 2
    assert text.index("pose 7") < text.index("via") < text.index("pose 8")
    assert ("NOT CHECKED FOR COLLISIONS" in text.replace(" ;\n", "\n")) == (not checked)
