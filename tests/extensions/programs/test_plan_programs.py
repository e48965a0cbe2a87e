"""Programs of whole plans in every language, read back by the lab's own reader and compared with plan.csv."""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.robots import IRB120

import lab
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.extensions.programs.rapid import Rapid
from lab.formats.measurement_csv import read_measurements
from lab.formats.programs.languages import languages, read_program
from lab.formats.programs.program_text import Outside, ProgramText, postures_of
from lab.formats.programs.protocol import Language, MeasuringTour
from lab.library.design import DesignResult

WALL = """
[[obstacle]]
name = "wall"
shape = "box"
size_mm = [300, 20, 900]
position_mm = [420, 0, 450]
"""
DECLARED = {  # names of positions in each language
    "RAPID": r"CONST jointtarget (\w+):=", "FANUC": r"^P\[(\d+)\]\{", "JBI": r"^(C\d{5})=",
}  # fmt: skip
NAMED = {  # names of programs, where a controller finds them by the names of their files
    "KRL": r"^DEF (\w+)\(\)",
    "FANUC": r"^/PROG +(\w+)",
    "VAL3": r'<Program name="(\w+)">',
    "JBI": r"^//NAME (\w+)",
}


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> DesignResult:
    """A plan with repeated poses, with waypoints around a wall, and with a change of the payload: two programs."""
    cell = tmp_path_factory.mktemp("cell") / "cell.toml"
    cell.write_text(WALL)
    loaded = {"model": "geometric+compliance", "payload_kg": (0.0, 2.0)}
    made = lab.design("irb120", cell=cell, poses=12, reference_every=3, candidates=60, starts=1, **loaded)
    assert isinstance(made, DesignResult)
    assert made.tour.via > 0 and made.payload_changes > 0
    return made


def programs(folder: Path, language: Language) -> Iterator[tuple[Path, str, ProgramText]]:
    """Each program of a plan's folder in the order of the tour, and what the lab's reader finds in it."""
    for path in sorted(folder.glob(f"*{language.suffix}")):
        outside = Outside({"TOOL[0]": (0.0,) * 6} if language.name == "JBI" else {})
        text = path.read_bytes().decode("ascii")
        yield path, text, read_program(path, text, IRB120.chain, language.name.lower(), outside)[1]


def expected(language: Language, rows: Measurements) -> Array:
    """What a program holds of rows: joint positions (rad), or poses of the flange."""
    if language.name != "JBI":
        return rows.joints
    arm = IRB120.arm(("p1",))
    postures = postures_of(arm, arm.nominal(IRB120.tool), rows.joints)
    assert postures is not None
    return postures.Ts_frame0_last


@pytest.mark.parametrize("language", languages(), ids=lambda each: each.name)
def test_a_program_drives_to_the_rows_of_its_plan(language: Language, plan: DesignResult, tmp_path: Path) -> None:
    """Row by row; a pose that is measured again has a name of its own, so that none hides another."""
    replace(plan, options=replace(plan.options, controller=language.name.lower())).write_files(tmp_path)
    rows = read_measurements(tmp_path / "plan.csv", IRB120.chain.joint_names, IRB120.chain.prismatic, points=False)
    assert {"1_2", "12"} < set(rows.ids) and any(name.startswith("via") for name in rows.ids)
    reached = list[Array]()
    read = list(programs(tmp_path, language))
    assert len(read) == plan.payload_changes + 1
    for path, text, found in read:
        assert not found.uncorrected
        if language.name in NAMED:
            name = re.search(NAMED[language.name], text.replace("\r\n", "\n"), re.MULTILINE)
            assert name is not None and name[1].lower() == re.sub(r"\W", "_", path.stem).lower()
        if language.name in DECLARED:
            names = [name.lower() for name in re.findall(DECLARED[language.name], text, re.MULTILINE)]
            assert names and len(set(names)) == len(names)
        for move in found.moves:
            target = found.targets[move.target]
            reached.append(target.joints if target.spelling is None else target.spelling.pose(target.values))
        if reached and np.array_equal(reached[-1], reached[0]):
            reached.pop()  # home: the next program begins there, too
    reached.append(reached[0])
    np.testing.assert_allclose(reached, expected(language, rows), atol=1e-5)


def test_names_of_a_module_differ_for_any_ids() -> None:
    """Ids that RAPID cannot hold, that differ in their case alone, or only where a name is cut."""
    ids = ("12", "1_2", "012", "1 2", "A", "a", "", "x" * 40 + "1", "x" * 40 + "2", "ä")
    stops = np.random.default_rng(1).uniform(-1, 1, (len(ids) + 2, 6))
    stops[-1] = stops[0]
    tour = MeasuringTour("arm", stops, np.array([-1, *range(len(ids)), -1]), ids)
    text = Rapid().measuring_tour(tour).decode("ascii")
    names = re.findall(r"CONST jointtarget (\w+):=", text)
    assert len({name.lower() for name in names}) == len(ids) + 1 and all(len(name) <= 32 for name in names)
    found = Rapid().read(text, Outside())
    reached = np.array([found.targets[move.target].joints for move in found.moves])
    np.testing.assert_allclose(reached, stops, atol=1e-8)
    assert "pose012," in text and "pose001_2," in text
