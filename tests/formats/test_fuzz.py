"""Files of every kind, valid ones with something changed: each is read, or refused in one line; nothing else happens.

The changes know the structure of a file: a line or a key is doubled, left out, moved or exchanged, a value becomes one
that is hostile, bytes are cut or turned. The long run (``-m slow``) tries as many as ``LAB_FUZZ`` says.
"""

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers.bad_input import ARM_TOML, ARM_URDF, ARM_XML, csv
from helpers.robots import ROOT
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lab.campaign.config_file import read_options
from lab.campaign.option_groups import ArmEffects
from lab.campaign.options import VirtualCampaign
from lab.commands.payload.known_payload import read_hand_load
from lab.core.errors import LabError
from lab.formats.dh_table_toml import read_table
from lab.formats.load_csv import read_loads, read_mounting
from lab.formats.measurement_csv import read_measurements
from lab.formats.mechanism_toml import read_mechanism
from lab.formats.target_csv import read_targets
from lab.simulation.load_mjcf_urdf import load_model
from lab.studies.grid import read_study

JOINTS, SLIDES = ("q1", "q2", "rail"), (False, False, True)
RUNS = "time_s,q1_rad,q2_rad,rail_m,tau1_nm,tau2_nm,f3_n,run\n" + "".join(
    f"{0.01 * i:.2f},{0.1 * i:.3f},0.2,0.1,{i}.5,1.25,-3,{'loaded' if i < 12 else 'unloaded'}\n" for i in range(24)
)
STUDY = """\
name = "s"
robots = 2
draws = 2
[factors]
criterion = ["O1", "random"]
poses = [12, 20]
effects = ["none", "soft"]
[effects.soft]
stiffness_nm_per_rad = 1e5
[parameters.few]
fix = ["link1.*"]
"""
SENSOR = "[base]\ntilt_x_deg = 1.5\n[sensor]\nsign = -1\nrotation_vector_deg = [0, 0, 30]\n"
LOAD = json.dumps({"mass_kg": 1.5, "com_m": [0, 0, 0.1], "covariance_of_mass_and_moment": np.eye(4).tolist()})
CONFIG = json.dumps({"command": "calibrate", "options": {"poses": 5, "effects": {"gear_ppm": 3.0}}, "model_sha256": ""})
MECHANISM = (ROOT / "models" / "rpr3" / "mechanism.toml").read_text()

Reader = Callable[[Path], object]


def _of_a_run(path: Path) -> object:
    """The load of a run of ``lab payload`` whose other files are as they should be."""
    beside = path.with_name("config.json")
    beside.write_text("{}")
    try:
        return read_hand_load(path.parent, accept_edited=True)
    finally:
        beside.unlink()


KINDS: dict[str, tuple[str, str, Reader]] = {
    "measurements": ("m.csv", csv(), lambda path: read_measurements(path, JOINTS, SLIDES)),
    "targets": ("t.csv", csv(), lambda path: read_targets(path, JOINTS, SLIDES)),
    "runs": ("r.csv", RUNS, lambda path: read_loads(path, JOINTS, SLIDES)),
    "table": ("a.toml", ARM_TOML, read_table),
    "mechanism": ("k.toml", MECHANISM, read_mechanism),
    "study": ("s.toml", STUDY, read_study),
    "mounting": ("b.toml", SENSOR, read_mounting),
    "MJCF": ("a.xml", ARM_XML, load_model),
    "URDF": ("a.urdf", ARM_URDF, load_model),
    "config": ("config.json", CONFIG, lambda path: read_options(path, "calibrate", VirtualCampaign)),
    "load": ("load.json", LOAD, _of_a_run),
}
HOSTILE = (
    "", "nan", "-inf", "1e999", "-0", "9" * 400, "1e-320", "0x10", "true", "null", '""', "[]", "{}", "[[[[]]]]",
    "=cmd|' /C calc'!A0", "../../x", "p.1", "\x00", "\ud7ff", "٣", "a" * 5000, "1;2", "'", '"', "#", "1_000",
    ".".join("a" * 40), "[" * 2000, "\N{BYTE ORDER MARK}", "\r", "2026-01-01", "12:00:00", "%s%n", "<!--", "]]>",
)  # fmt: skip
_MARKS = ",=;\n\t \"'[]{}<>:/"


def _pieces(text: str) -> list[str]:
    """Words and what separates them."""
    pieces, word = [], ""
    for c in text:
        if c in _MARKS:
            pieces += [word, c] if word else [c]
            word = ""
        else:
            word += c
    return [*pieces, word]


@st.composite
def changed(draw: st.DrawFn, text: str) -> bytes:
    """A valid file with one to three things changed."""
    for _ in range(draw(st.integers(1, 3))):
        pieces = _pieces(text) if draw(st.booleans()) else text.splitlines(keepends=True)
        i, j = (draw(st.integers(0, max(len(pieces) - 1, 0))) for _ in range(2))
        match draw(st.sampled_from(["value", "double", "drop", "swap", "insert", "cut"])):
            case "value" if pieces:
                pieces[i] = draw(st.sampled_from(HOSTILE))
            case "double" if pieces:
                pieces[i:i] = [pieces[i]] * draw(st.sampled_from([1, 2, 60]))
            case "drop":
                del pieces[i : i + draw(st.integers(1, 5))]
            case "swap" if pieces:
                pieces[i], pieces[j] = pieces[j], pieces[i]
            case "insert":
                pieces.insert(i, draw(st.one_of(st.text(max_size=20), st.sampled_from(HOSTILE))))
            case "cut":
                del pieces[i:]
        text = "".join(pieces)
    content = text.encode("utf-8", "surrogatepass")
    if draw(st.integers(0, 9)) == 0 and content:
        at = draw(st.integers(0, len(content) - 1))
        content = content[:at] + draw(st.binary(max_size=4)) + content[at + 1 :]
    return content


def read_or_refused(kind: str, content: bytes, folder: Path) -> None:
    name, _, reader = KINDS[kind]
    path = folder / name
    path.write_bytes(content)
    try:
        with np.errstate(all="ignore"):
            reader(path)
    except LabError as error:
        assert "\n" not in str(error).strip() and str(error).strip()
    assert [each.name for each in folder.iterdir()] == [name]  # no log


def _fuzzed(kind: str, examples: int, folder: Path) -> None:
    @settings(
        max_examples=examples,
        derandomize=examples < 1000,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(content=changed(KINDS[kind][1]))
    def tried(content: bytes) -> None:
        read_or_refused(kind, content, folder)

    tried()


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_as_it_should_be_is_read(kind: str, tmp_path: Path) -> None:
    name, text, reader = KINDS[kind]
    (tmp_path / name).write_text(text)
    assert reader(tmp_path / name) is not None


@pytest.mark.sampled(3)
@pytest.mark.parametrize("kind", KINDS)
def test_a_changed_file_is_read_or_refused(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    _fuzzed(kind, 15, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_many_changed_files_are_read_or_refused(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    _fuzzed(kind, int(os.environ.get("LAB_FUZZ", "1000")), tmp_path)


def test_effects_of_a_study_are_the_options_of_a_campaign(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(STUDY)
    assert read_study(tmp_path / "s.toml").effects["soft"] == ArmEffects(stiffness_nm_per_rad=1e5)
