# ruff: noqa: E501 (lines of programs are as long as they are)
"""Programs of a generator are read, and come back the same but for their targets; rotations by SciPy's library."""

from pathlib import Path

import numpy as np
import pytest
from helpers.controller_programs import END, EULER, LANGUAGES, PULSES, Written, posed, program, read_back, spelt
from helpers.robots import IRB120
from scipy.spatial.transform import Rotation

from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.formats.programs.languages import languages, read_program
from lab.formats.programs.program_text import Number, Outside, ProgramText, TargetText, replaced, values_of, written

NUMBERED = {"fanuc": ("UTOOL[2]", "UFRAME[3]"), "jbi": ("TOOL[2]", "USER[3]")}  # frames that a text only numbers


def outside(made: Written) -> Outside:
    names = NUMBERED.get(made.language, ())
    frames = {
        name: tuple(float(each) for each in spelt(made.language, T, 10))
        for name, T in zip(names, (made.T_flange_tool, made.T_robot_base), strict=False)
    }
    return Outside(frames, tuple(PULSES) if made.language == "jbi" else ())


def read(made: Written) -> ProgramText:
    path = Path("a" + END[made.language])
    return read_program(path, made.content.decode("latin-1"), IRB120.chain, None, outside(made))[1]


def random_program(language: str, seed: int) -> Written:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 8))
    poses = np.array([posed(Rotation.random(random_state=rng), rng.uniform(-0.9, 0.9, 3)) for _ in range(count)])
    base = np.eye(4) if language == "urscript" else posed(Rotation.random(random_state=rng), rng.uniform(-1, 1, 3))
    tool = posed(Rotation.random(random_state=rng), rng.uniform(-0.2, 0.2, 3))
    return program(language, poses, rng.uniform(-2, 2, (int(rng.integers(0, 4)), 6)), tool, base, rng)


def digits_of(target: TargetText, part: slice) -> int:
    return max(each.digits for each in target.numbers[part])


def rewritten(text: str, found: ProgramText, change: Array) -> str:
    """The text with every pose multiplied by a change ``(4, 4)``."""
    edits: list[tuple[Number, str]] = []
    for target in found.targets:
        if target.spelling is None:
            continue
        values = target.spelling.spelt(target.spelling.pose(target.values) @ change, target.values)
        edits += [(each, written(each, value, 0)) for each, value in zip(target.numbers, values.tolist(), strict=True)]
    return replaced(text, edits)


def check(language: str, seed: int) -> None:
    made = random_program(language, seed)
    text, found = made.content.decode("latin-1"), read(made)
    assert not found.uncorrected
    poses = [each for each in found.targets if each.spelling is not None]
    joints = np.array([each.joints for each in found.targets if each.spelling is None]).reshape(-1, 6)
    assert len(poses) == len(made.poses) and len(joints) == len(made.joints)
    if language != "urscript":  # there a pose may stand in a variable or in the move
        assert len(found.moves) == (0 if language == "val3" else len(found.targets))
    np.testing.assert_allclose(joints, made.joints, atol=1e-3)
    for target, T_made in zip(poses, made.poses, strict=True):
        np.testing.assert_allclose(found.frames[target.tool], made.T_flange_tool, atol=1e-7)
        np.testing.assert_allclose(found.frames[target.base], made.T_robot_base, atol=1e-7)
        assert target.spelling is not None
        ours = target.spelling.pose(target.values)
        np.testing.assert_allclose(ours, read_back(language, target.values), atol=1e-12)  # another library
        T = made.poses[np.abs(made.poses - ours).max(axis=(1, 2)).argmin()] if language == "urscript" else T_made
        np.testing.assert_allclose(ours, T, atol=2e-3)  # of the printed digits

    assert rewritten(text, found, np.eye(4)).encode("latin-1") == made.content  # zero correction: the same bytes
    change = posed(Rotation.from_rotvec([2e-3, -1e-3, 3e-3]), np.array([1e-3, -2e-3, 0.5e-3]))
    new = rewritten(text, found, change)
    marks = {i for each in found.targets for number in each.numbers
             for i in range(number.start - 8, number.start + len(number.text) + 8)}  # fmt: skip
    assert "".join(each for each in text if each not in "0123456789.- ") == "".join(
        each for each in new if each not in "0123456789.- "
    )
    first = next((i for i, (a, b) in enumerate(zip(text, new, strict=False)) if a != b), 0)
    assert first in marks and new.count("\n") == text.count("\n")
    again = read(
        Written(language, new.encode("latin-1"), made.poses, made.joints, made.T_flange_tool, made.T_robot_base)
    )
    for before, after in zip(found.targets, again.targets, strict=True):
        if before.spelling is None:
            assert [each.text for each in before.numbers] == [each.text for each in after.numbers]
            continue
        wanted = read_back(language, before.values) @ change
        got = read_back(language, after.values)
        place = 10.0 ** -digits_of(before, slice(0, 3)) / before.spelling.per_m
        unit = {"rapid": 2.0, "urscript": 1.0}.get(language, np.pi / 180)
        turn = 10.0 ** -digits_of(before, slice(3, None)) * unit
        np.testing.assert_allclose(got[:3, 3], wanted[:3, 3], atol=0.51 * place)
        off = Rotation.from_matrix(got[:3, :3].T @ wanted[:3, :3]).magnitude()
        assert off < 1.6 * turn
        assert [each.digits for each in before.numbers] == [each.digits for each in after.numbers]


@pytest.mark.parametrize("language", LANGUAGES)
def test_programs_come_back_the_same_but_for_their_targets(language: str) -> None:
    for seed in range(4):
        check(language, seed)


SPECIAL = {
    "nothing": [0, 0, 0],
    "half a turn about z": [0, 0, 180],
    "minus half a turn about z": [0, 0, -180],
    "half a turn about x": [180, 0, 0],
    "minus half a turn about x": [-180, 0, 0],
    "upside down": [180, 0, 30],
    "gimbal lock up": [25, 90, 40],
    "gimbal lock down": [-70, -90, 110],
    "nearly locked": [10, 89.9999, 20],
}


@pytest.mark.parametrize("turn", SPECIAL)
@pytest.mark.parametrize("language", LANGUAGES)
def test_half_turns_and_gimbal_lock(language: str, turn: str) -> None:
    """Unchanged they stay as they are; turned a little they are right, and near to what was written."""
    spelling = next(each for each in languages() if each.name.lower() == language).spelling
    if language in EULER:
        was = np.array([100.0, -200.0, 300.0, *SPECIAL[turn]])
    else:
        T = posed(Rotation.from_euler("xyz", SPECIAL[turn], degrees=True), np.array([0.1, -0.2, 0.3]))
        was = np.array([float(each) for each in spelt(language, T, 9)])
    T = spelling.pose(was)
    np.testing.assert_allclose(T, read_back(language, was), atol=1e-12)
    np.testing.assert_allclose(spelling.spelt(T, was), was, atol=1e-10)
    for change in ([1e-3, 0, 0], [0, 2e-3, 0], [0, 0, -1e-3], [1e-3, 1e-3, -2e-3]):
        new = T.copy()
        new[:3, :3] = T[:3, :3] @ Rotation.from_rotvec(change).as_matrix()
        values = spelling.spelt(new, was)
        # adding to a rounded quaternion keeps what was rounded
        np.testing.assert_allclose(read_back(language, values)[:3, :3], new[:3, :3], atol=2e-9)
        assert (np.abs(values[3:]) <= 180.0).all() or language in ("rapid", "urscript")
        if language in ("rapid", "urscript") or "lock" not in turn:
            assert min(np.abs(values[3:] - was[3:] - shift).max() for shift in shifts(language)) < 0.3


def test_a_quaternion_of_two_digits_is_turned_exactly() -> None:
    """Its length, 1 % from one, stays; what the controller makes of it has the whole turn."""
    spelling = next(each for each in languages() if each.name == "RAPID").spelling
    was = np.array([100.0, -200.0, 300.0, 0.45, -0.52, 0.72, 0.15])
    new = spelling.pose(was)
    new[:3, :3] = new[:3, :3] @ Rotation.from_rotvec([0.02, -0.03, 0.01]).as_matrix()
    values = spelling.spelt(new, was)
    assert abs(np.linalg.norm(was[3:]) - 1) > 5e-3
    np.testing.assert_allclose(np.linalg.norm(values[3:]), np.linalg.norm(was[3:]), atol=1e-12)
    np.testing.assert_allclose(read_back("rapid", values), new, atol=1e-12)


def shifts(language: str) -> list[Array]:
    """What may be added to angles, which stay between minus and plus half a turn."""
    if language not in EULER:
        return [np.zeros(4 if language == "rapid" else 3)]
    steps = (-360.0, 0.0, 360.0)
    return [np.array([a, b, c]) for a in steps for b in steps for c in steps]


@pytest.mark.parametrize(
    ("old", "value", "digits", "new"),
    [
        ("1.250", 1.2504, 0, "1.250"), ("1.250", 1.2506, 0, "1.251"), ("-0.00", 0.004, 0, "-0.00"),
        ("600", 600.4, 0, "600"), ("600", 600.4, 2, "600.40"), ("600.", 601.0, 0, "601."), (".5", 0.62, 2, ".62"),
        (".5", -0.62, 2, "-.62"), ("+1.0", 1.26, 0, "+1.3"), ("+1.0", -1.26, 0, "-1.3"), ("1.5E-05", 0.00032, 0, "0.000320"),
        ("1.5E+02", 152.0, 0, "152"), ("0", 0.0004, 6, "0.000400"), ("0.123456789012345", 0.123456789012345, 0, "0.123456789012345"),
        ("9E+09", 9e9, 3, "9E+09"), ("-180.000", -179.99951, 0, "-180.000"),
    ],
)  # fmt: skip
def test_a_number_takes_the_form_of_the_one_before(old: str, value: float, digits: int, new: str) -> None:
    assert written(Number(0, old), value, digits) == new


def test_numbers_that_are_aligned_to_the_right_stay_so() -> None:
    text = "X =    99.500  mm, Y =  -100.500  mm, Z=1.5"
    numbers = [Number(text.index(each), each) for each in ("99.500", "-100.500", "1.5")]
    assert replaced(text, list(zip(numbers, ("100.500", "-99.500", "-11.5"), strict=True))) == (
        "X =   100.500  mm, Y =   -99.500  mm, Z=-11.5"
    )
    assert values_of(numbers).tolist() == [99.5, -100.5, 1.5]


@pytest.mark.parametrize("language", LANGUAGES)
def test_spoilt_programs_are_read_or_told_in_a_line(language: str) -> None:
    """Bytes left out, doubled and put elsewhere: never a defect, and what is read comes back the same."""
    spoil(language, 12)


def spoil(language: str, count: int) -> None:
    rng, read_again = np.random.default_rng(9), 0
    made = random_program(language, 5)
    for _ in range(count):
        content = bytearray(made.content)
        for _ in range(int(rng.integers(1, 4))):
            at, other, length = (int(rng.integers(0, most)) for most in (len(content), len(content), 30))
            piece = content[at : at + length]
            if rng.random() < 0.5:
                del content[at : at + length]
            content[other:other] = piece if rng.random() < 0.7 else bytes(rng.integers(1, 256, 3).tolist())
        text = bytes(content).decode("latin-1")
        try:
            found = read_program(Path("a" + END[language]), text, IRB120.chain, None, outside(made))[1]
        except LabError as error:
            assert "\n" not in str(error) and str(error).startswith("a.")
            continue
        read_again += 1
        assert rewritten(text, found, np.eye(4)) == text
    assert read_again > count / 3


@pytest.mark.parametrize("language", ["rapid", "urscript"])
def test_brackets_that_nest_without_end_are_told(language: str) -> None:
    made = random_program(language, 1)
    deep = Written(language, made.content.replace(b"[", b"[" * 3000), made.poses, made.joints, made.T_flange_tool,
                   made.T_robot_base)  # fmt: skip
    with pytest.raises(LabError, match="nest deeper than any program's"):
        read(deep)
