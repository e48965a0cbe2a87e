"""Models that are too large, or read what is no file, are refused before MuJoCo reads them; real ones are not."""

import os
from pathlib import Path

import pytest
from helpers.bad_input import ARM_URDF, ARM_XML, swapped

from lab.core.errors import LabError
from lab.robots.robot_files import models_folder
from lab.simulation.load_model import load_model, refuse_unbounded_model


def asset(text: str) -> str:
    return swapped(ARM_XML, "<worldbody>", f"<asset>{text}</asset><worldbody>")


def chain(links: int) -> str:
    inner = ""
    for i in range(links):
        inner = f'<body name="b{i}" pos="0 0 0.1"><joint name="q{i}"/><geom size="0.01"/>{inner}</body>'
    return f"<mujoco><worldbody>{inner}</worldbody></mujoco>"


CASES = {
    "texture": (asset('<texture name="t" type="2d" builtin="flat" width="60000" height="60000"/>'), "pixels"),
    "height field": (asset('<hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/>'), "height field"),
    "replicate": (swapped(ARM_XML, "<worldbody>", '<worldbody><replicate count="10000000"/>'), "copies"),
    "joints": (chain(41), "41 joints of a robot are too many; give at most 40"),
    "depth": (chain(600), "levels of elements"),
    "nan": (
        swapped(ARM_XML, 'pos="0.1 0 0.3"', 'pos="0.1 NaN 0.3"'),
        "pos is '0.1 NaN 0.3'; give finite numbers",
    ),
    "inf": (swapped(ARM_XML, 'axis="0 0 1"', 'axis="0 0 -inf"'), "joint: axis is '0 0 -inf'"),
    "a device": (asset('<mesh name="m" file="/dev/zero"/>'), "/dev/zero is no regular file"),
    "a pipe": (asset('<mesh name="m" file="pipe"/>'), "pipe is no regular file"),
    "included": (swapped(ARM_XML, "<worldbody>", '<include file="more.xml"/><worldbody>'), "pixels"),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_too_much_is_refused(case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text, says = CASES[case]
    monkeypatch.chdir(tmp_path)
    os.mkfifo("pipe")
    Path("more.xml").write_text('<mujoco><asset><texture name="t" width="99999" height="99999"/></asset></mujoco>')
    Path("arm.xml").write_text(text)
    before = sorted(Path().iterdir())
    with pytest.raises(LabError) as told:
        load_model(Path("arm.xml"))
    assert says in str(told.value) and str(told.value).startswith("arm.xml")
    assert sorted(Path().iterdir()) == before  # no log of MuJoCo's


def test_an_infinite_number_in_a_urdf_is_refused(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(swapped(ARM_URDF, 'lower="-2"', 'lower="-inf"'))
    with pytest.raises(LabError, match="limit: lower is '-inf'"):
        load_model(tmp_path / "arm.urdf")


@pytest.mark.parametrize("path", sorted(models_folder().glob("*/*.xml")), ids=lambda path: path.parent.name)
def test_real_models_pass(path: Path) -> None:
    refuse_unbounded_model(path)


def test_what_is_allowed_at_most_is_loaded(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(chain(40))
    assert len(load_model(tmp_path / "arm.xml").chain.joint_names) == 40


def test_names_are_text_and_what_is_no_xml_is_not_passed_on(tmp_path: Path) -> None:
    """MuJoCo takes names as bytes, and what is no well-formed XML, of which nothing would be checked."""
    file, declared = tmp_path / "arm.xml", '<?xml version="1.0" encoding="latin-1"?>\n'
    for text in (swapped(ARM_XML, '"q2"', '"\xe92"'), swapped(ARM_XML, "</mujoco>", "")):
        file.write_bytes(text.encode("latin-1"))
        with pytest.raises(LabError, match="not a readable MJCF or URDF"):
            load_model(file)
    file.write_bytes((declared + swapped(ARM_XML, '"q2"', '"\xe92"')).encode("latin-1"))
    with pytest.raises(LabError, match=r"arm\.xml: has names that are not in UTF-8"):
        load_model(file)
    file.write_bytes((declared + swapped(ARM_XML, "<worldbody>", "<!-- \xe9 --><worldbody>")).encode("latin-1"))
    assert load_model(file) is not None
