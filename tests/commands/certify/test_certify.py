"""``lab certify`` on runs of a virtual robot that were measured as a real one is."""

import hashlib
import json
import shutil
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from helpers.drawing import nothing_drawn
from helpers.robots import ROOT

import lab
from lab.cli.main import main
from lab.compensation.iso9283 import repeatability
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.whole_folder import checksum_lines
from lab.formats.measurement_csv import read_measurements, write_measurements
from lab.library.certificate_inputs import digests_of
from lab.library.certificate_result import Certificate
from lab.library.certify import certify
from lab.options.command_options import CertifyOptions
from lab.report.view import document_of

TRACKER = """
name = "Tracker"
[noise]
radial_um = 5
transverse_um = 5
[systematic]
transit_tilt_urad = { standard = 4, freedom = 12 }
range_offset_um = { standard = 1 }
range_scale_ppm = { limit = 2 }
centring_lateral_um = { limit = 3 }
nest_um = { standard = 3 }
"""
DETAILS = """
[certificate]
number = "42"
date = 2026-03-31
issued_by = "Us"
operator = "A <b>B</b>"
place = "Hall 3"
[robot]
serial_number = "R1"
[instrument]
serial_number = "T1"
certificate = "C1"
[reflector]
serial_number = "S1"
[environment]
temperature_c = 20.5
robot_temperature_k = { limit = 1 }
expansion_ppm_per_k = 12
"""
SCATTER_M = 10e-6
thorough = pytest.mark.thorough  # runs of a measurement session stand behind these


def visited(day: Measurements, times: int) -> Measurements:
    """Each pose so many times, with a scatter of the robot and noise of the instrument of its own."""
    rng = np.random.default_rng(5)
    rows = day[np.repeat(np.arange(len(day)), times)]
    ids = tuple(str(i) for i in range(len(rows)))
    scatter = np.hypot(SCATTER_M, 5e-6) * rng.standard_normal((len(rows), 1, 3))
    return replace(rows, points=rows.points + scatter, ids=ids)


@pytest.fixture(scope="module")
def workplace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tracker's file, a certificate's, measurements, and runs of these."""
    folder = tmp_path_factory.mktemp("workplace")
    (folder / "tracker.toml").write_text(TRACKER)
    (folder / "details.toml").write_text(DETAILS)
    day = lab.simulate("irb120", poses=30, seed=1, targets=("p1", "p2"), instrument=str(folder / "tracker.toml"))
    write_measurements(folder / "once.csv", day.measurements, (False,) * 6)
    exact = lab.simulate("irb120", poses=15, seed=7, targets=("p1",), instrument="exact")
    write_measurements(folder / "repeated.csv", visited(exact.measurements, 4), (False,) * 6)
    with nothing_drawn(), pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        known = ["--instrument", "tracker.toml", "--holdout", "0.3", "--gate-mm", "0.1"]
        assert main(["identify", "once.csv", *known, "--out", "known"]) == 0
        assert main(["identify", "repeated.csv", "--out", "estimated"]) == 0
        assert main(["identify", "once.csv", "--noise-mm", "0.006", "--out", "given"]) == 0
    return folder


@pytest.fixture
def here(workplace: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(workplace)
    return workplace


def groups(found: Certificate) -> set[str]:
    return {line.quantity.group for line in found.budgets[0].lines}


@pytest.mark.pages
@thorough
def test_a_certificate_has_what_was_stated_and_measured(here: Path) -> None:
    found = certify(CertifyOptions(Path("known"), Path("details.toml")))
    told = found.to_dict()
    assert groups(found) == {"misalignment", "reflector", "temperature", "parameters"}
    assert told["missing"] == [] and told["instrument"] == "Tracker" and told["validated_on"] == "holdout"
    assert told["conformity"]["tolerance_mm"] == 0.1 and told["conformity"]["decision"] == "conforms"
    assert found.exit_code == 0 and not told["iso_9283"]["of_fitted_rows"] and told["iso_9283"]["poses"] == 9
    for budget in found.budgets:
        assert sum(line.share for line in budget.lines) == pytest.approx(1.0)
        assert budget.combined_m == pytest.approx(np.sqrt(sum(line.contribution_m**2 for line in budget.lines)))
        assert budget.drawn_m == pytest.approx(budget.propagated_m, rel=0.05)
    position, distance = found.budgets
    assert 1.6 <= position.coverage_factor <= 2 and 1.9 <= distance.coverage_factor <= 2.1
    assert told["budgets"]["position"]["freedom"] > 12  # that of the only line that has a finite number
    Path("early.toml").write_text(DETAILS.replace('certificate = "C1"', "certificate_date = 2026-04-01"))
    early = certify(CertifyOptions(Path("known"), Path("early.toml")))
    assert not early.issued and early.conformity is None and early.exit_code == 1
    assert early.to_dict()["implausible"][0]["impossible"]
    assert not found.is_example and not document_of(found).mark
    assert len(certify(CertifyOptions(Path("known"))).details.missing) == 10


@pytest.mark.pages
@thorough
def test_a_file_of_a_certificate_is_what_its_schema_says_and_its_bytes_are_the_same(here: Path, capsys) -> None:
    schema = json.loads((ROOT / "docs" / "reference" / "schemas" / "certificate.schema.json").read_text())
    asked = ["certify", "known", "--details", "details.toml", "--json"]
    assert main([*asked, "--out", "one"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert main([*asked, "--out", "two"]) == 0
    jsonschema.validate(told, schema)
    assert json.loads(Path("one/result.json").read_text()) == told and set(told) == set(schema["properties"])
    for name in ("result.json", "report.html", "config.json"):
        assert Path("one", name).read_bytes() == Path("two", name).read_bytes()
    assert "A &lt;b&gt;B&lt;/b&gt;" in Path("one/report.html").read_text()
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(told | {"conformity": told["conformity"] | {"decision": "surely"}}, schema)


@thorough
def test_decisions_have_exit_codes_and_say_their_rule(here: Path) -> None:
    found = certify(CertifyOptions(Path("known"), tolerance_mm=1e-3, statistic="max"))
    assert found.conformity is not None and found.conformity.decision == "does not conform" and found.exit_code == 1
    value = 1e3 * found.conformity.value_m
    near = CertifyOptions(Path("known"), tolerance_mm=value + 1e-4, statistic="max")
    assert certify(near).to_dict()["conformity"]["decision"] == "not decided"
    simple = certify(replace(near, decision_rule="simple"))
    assert simple.exit_code == 0
    assert certify(CertifyOptions(Path("given"))).conformity is None  # its run had no gate


@thorough
def test_repeated_poses_give_the_repeatability(here: Path) -> None:
    """Four visits to 15 poses: 135 degrees of freedom, so within 3 x 6 %."""
    found = certify(CertifyOptions(Path("estimated"), instrument="tracker.toml"))
    line = next(line for line in found.budgets[0].lines if line.quantity.group == "repeatability")
    seen = np.sqrt(SCATTER_M**2 + 5e-6**2 - (5e-6**2 + 3e-6**2 + 2 / 3 * 3e-6**2 / 3))  # less what the tracker has
    assert line.quantity.uncertainty.standard == pytest.approx(seen, rel=0.25)
    iso = found.to_dict()["iso_9283"]
    assert iso["cycles"] == [4, 4] and iso["poses"] == 15 and iso["of_fitted_rows"]
    assert iso["repeats"]["rows"] == ["fitted rows"] and iso["repeats"]["freedom"] == 135
    assert iso["pose_accuracy_mm"] is None and iso["distance_accuracy_mm"] is None  # fitted errors are no accuracy
    many = np.hypot(SCATTER_M, 5e-6) * np.random.default_rng(0).standard_normal((4, 2000, 3))
    assert iso["pose_repeatability_mm"]["mean"] == pytest.approx(1e3 * repeatability(many).mean(), rel=0.3)
    assert "pose repeatability" not in iso["not_measured"]
    assert "repeatability of the reflector's nest" not in {each.quantity.label for each in found.budgets[0].lines}
    unknown = certify(CertifyOptions(Path("estimated")))  # without the instrument all of it is the robot's
    lines = {line.quantity.group: line.quantity.uncertainty.standard for line in unknown.budgets[0].lines}
    assert lines["repeatability"] == pytest.approx(np.hypot(SCATTER_M, 5e-6), rel=0.2)


@thorough
def test_repeats_are_found_wherever_they_are(here: Path) -> None:
    """Held out and in the validation file, as in the fitted rows: each alone gives the repeatability."""
    runs = {
        "held": (["repeats_held.csv"], "rows held out"),
        "beside": (["once.csv", "--validate", "repeated_p1.csv"], "validation file"),
    }
    day = lab.simulate("irb120", poses=40, seed=7, targets=("p1",), instrument="exact").measurements
    rows = visited(day[[*np.repeat(np.arange(4), 5), *range(4, 40)]], 1)
    held = replace(rows, use=("test",) * 20 + ("calibrate",) * 36, marked=True)
    write_measurements(Path("repeats_held.csv"), held, (False,) * 6)
    write_measurements(Path("repeated_p1.csv"), visited(day[:10], 4), (False,) * 6)
    for name, (given, where) in runs.items():
        main(["identify", *given, "--noise-mm", "0.005", "--out", f"repeats_{name}"])
        found = certify(CertifyOptions(Path(f"repeats_{name}"), force=True))
        iso = found.to_dict()["iso_9283"]
        assert iso["repeats"]["rows"] == [where], name
        assert iso["repeats"]["scatter_mm"] == pytest.approx(1e3 * np.hypot(SCATTER_M, 5e-6), rel=0.35), name
        assert "repeatability" in groups(found) and iso["pose_repeatability_mm"] is not None


@thorough
def test_what_nothing_shows_is_said_with_its_remedy(here: Path) -> None:
    """A scale that nobody states is in no U; where no instrument is named, the statement rests on a U with it."""
    Path("scale.toml").write_text("[instrument]\nscale_ppm = { standard = 2 }\n")
    given = certify(CertifyOptions(Path("given"), tolerance_mm=0.5, force=True))
    assert any("scale" in each.description for each in given.unseen)
    assert given.with_unseen_m[0] > 1e-3 > given.budgets[0].expanded_m
    assert given.conformity is not None and given.conformity.expanded_m == given.with_unseen_m[0]
    assert given.conformity.decision == "not decided"
    stated = certify(CertifyOptions(Path("given"), Path("scale.toml"), tolerance_mm=0.5, force=True))
    assert not any("scale" in each.description for each in stated.unseen)
    assert any(line.quantity.label == "scale of the measurements" for line in stated.budgets[0].lines)
    assert stated.conformity is not None and stated.conformity.decision == "conforms"
    known = certify(CertifyOptions(Path("known")))  # whose tracker's file states its range's scale
    assert not any("scale" in each.description for each in known.unseen)


@thorough
def test_what_cannot_be_certified_is_refused_in_a_line(here: Path, capsys, tmp_path: Path) -> None:
    cases = {
        ("nowhere",): "nowhere",
        ("known", "--tolerance-mm", "0"): "--tolerance-mm 0: give a number above zero",
        ("known", "--details", "tracker.toml"): "unknown; valid are [certificate]",
        ("known", "--instrument", "details.toml"): "unknown; there are name, noise",
        ("known", "--instrument", "ruler"): "--instrument ruler: unknown",
        ("known", "--out", "known"): "an input of this run",
    }
    for asked, said in cases.items():
        assert main(["certify", *asked]) == 2, asked
        told = capsys.readouterr().err
        assert said in told and told.count("\n") == 1, (asked, told)
    edited = tmp_path / "edited"
    shutil.copytree("given", edited)
    text = (edited / "result.json").read_text()
    for word, doubts in (("bad", True), ("not judged", True), ("doubtful", False)):
        (edited / "result.json").write_text(
            text.replace('"verdict": "good"', f'"verdict": "{word}"').replace('"reasons": []', '"reasons": ["a doubt"]')
        )
        with pytest.raises(LabError, match="was changed since the run was written"):
            certify(CertifyOptions(edited))
        requested_solutions = CertifyOptions(edited, accept_edited=True)
        if doubts:
            with pytest.raises(LabError, match=f"verdict of this run is '{word}'"):
                certify(requested_solutions)
        told = certify(replace(requested_solutions, force=doubts)).to_dict()
        assert told["run_verdict"]["verdict"] == word and told["run_verdict"]["reasons"] == ["a doubt"]
    measured = (edited / "config.json").read_text()
    for kind in ("cable", "socket", "plane", "pose"):
        (edited / "config.json").write_text(measured.replace('"observe": "points"', f'"observe": "{kind}"'))
        with pytest.raises(LabError, match=f"--observe {kind}: "):
            certify(CertifyOptions(edited, accept_edited=True))


def test_a_virtual_robot_s_certificate_says_so(seven_run: Path) -> None:
    found = certify(CertifyOptions(seven_run))
    assert found.warnings[0].startswith("the robot is virtual")
    assert found.is_example and document_of(found).mark


@pytest.mark.pages
@thorough
def test_a_certificate_names_the_digests_of_its_data(here: Path, tmp_path: Path) -> None:
    """Of a run that was changed and listed anew, the digest is another one than on the paper."""
    found = certify(CertifyOptions(Path("known")))
    digests = found.to_dict()["run_sha256"]
    for name in ("measurements.csv", "parameters.json", "covariance.csv", "result.json", "SHA256SUMS"):
        assert digests[name] == hashlib.sha256(Path("known", name).read_bytes()).hexdigest()
    page = found.save(tmp_path / "certificate") / "report.html"
    assert all(each in page.read_text(encoding="utf-8") for each in digests.values())
    shutil.copytree("known", tmp_path / "changed")
    table = tmp_path / "changed" / "measurements.csv"
    table.write_text(table.read_text().replace("1", "2", 1))
    (tmp_path / "changed" / "SHA256SUMS").write_text(checksum_lines(tmp_path / "changed"))
    assert digests_of(tmp_path / "changed")["SHA256SUMS"] != digests["SHA256SUMS"]


@thorough
@pytest.mark.parametrize("name", ["report.html", "calibrated.py", "parameters.json"])
def test_any_changed_file_of_a_run_is_refused(name: str, here: Path, tmp_path: Path) -> None:
    shutil.copytree("known", tmp_path / "run")
    with (tmp_path / "run" / name).open("a") as file:
        file.write(" ")
    with pytest.raises(LabError, match=f"{name} was changed"):
        certify(CertifyOptions(tmp_path / "run"))
    accepted = certify(CertifyOptions(tmp_path / "run", accept_edited=True))
    assert any(f"{name} was changed" in said for said in accepted.warnings)


@thorough
def test_a_validation_file_shows_the_accuracy_of_the_calibrated_model(here: Path) -> None:
    rows = read_measurements(Path("once.csv"), tuple(f"q{i}" for i in range(1, 7)), (False,) * 6)
    write_measurements(Path("fit.csv"), rows[:22], (False,) * 6)
    write_measurements(Path("fresh.csv"), rows[np.arange(22, 30)], (False,) * 6)
    known = ["--instrument", "tracker.toml", "--no-recording"]
    assert main(["identify", "fit.csv", "--validate", "fresh.csv", *known, "--out", "filed"]) == 0
    refit = ["--refit", "base", "--out", "placed"]
    assert main(["identify", "fit.csv", "--validate", "fresh.csv", *known, *refit]) == 0
    found = certify(CertifyOptions(Path("filed")))
    iso = found.to_dict()["iso_9283"]
    assert not iso["of_fitted_rows"] and iso["poses"] == 8
    assert iso["pose_accuracy_mm"]["max"] <= found.to_dict()["after_mm"]["max"] * (1 + 1e-9)
    anew = certify(CertifyOptions(Path("placed")))  # the base of the run is not that of the validation
    assert anew.to_dict()["iso_9283"]["of_fitted_rows"]
