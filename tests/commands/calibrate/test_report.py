"""Reports as a person gets them: one file each that needs nothing else, with the numbers of ``result.json``."""

import json
import os
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.html_page import Page
from helpers.robots import data_file

from lab.campaign.option_groups import ArmEffects, Fitting
from lab.campaign.options import VirtualCampaign
from lab.cli import main
from lab.commands.calibrate.error_map import error_map
from lab.commands.calibrate.figures import has_correction
from lab.commands.calibrate.load_run import read_calibrated
from lab.commands.calibrate.options import MeasuredCampaign
from lab.commands.calibrate.run import calibrate, identify
from lab.commands.calibrate.scene import world_of
from lab.commands.compensate.options import CompensateOptions
from lab.commands.provenance import command_line
from lab.core import se3
from lab.formats.measurement_csv import write_measurements
from lab.render.format import short
from lab.render.page import write_page
from lab.render.units import display_unit

SECTIONS = ["Before and after calibration", "Where in the workspace the errors are", "Uncertainty and goodness of fit",
            "Parameters", "Identifiability and conditioning", "The arm at its poses", "What was done"]  # fmt: skip
FIGURES = ["errors-figure", "where", "corrections", "singular-values-figure", "arm"]
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
NASTY = """<script>alert("$x_1$")</script>&'<b>"""


@pytest.fixture(scope="module")
def outcome():
    return calibrate(VirtualCampaign(seed=7))


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> Path:
    """Runs of every command that writes a report."""
    folder = tmp_path_factory.mktemp("runs")
    for command in ("calibrate --seed 7 --out run", "design --candidates 200 --starts 1 --poses 12 --out plan"):
        assert main([*command.split()[:-1], str(folder / command.split()[-1]), "--json"]) == 0
    grid = 'name = "grid"\nrobots = 4\ndraws = 4\nfresh = 20\n[factors]\ncriterion = "random"\nposes = [12, 20]\n'
    (folder / "grid.toml").write_text(grid)
    study = ["study", str(folder / "grid.toml"), "--out", str(folder / "study"), "--workers", "1", "--json"]
    assert main(study) == 0
    return folder


def written(path: Path, outcome) -> Page:
    write_page(path, outcome.document())
    assert path.stat().st_size < 1e6
    return Page(path)


def test_a_run_has_its_sections_and_figures(runs: Path) -> None:
    seen = Page(runs / "run" / "report.html")
    assert seen.headings[1:] == SECTIONS and list(seen.figures) == FIGURES
    for figure in seen.figures.values():
        assert figure["svg"] and len(figure["caption"]) > 40
    assert seen.source.count("<svg") == 9 and seen.tags.count("h1") == 1 and 'lang="en"' in seen.source
    assert "lab calibrate --seed 7" in seen.text and "numpy" in seen.text and "seconds" not in seen.text
    config = json.loads((runs / "run" / "config.json").read_text())
    assert config["model_sha256"] in seen.text and config["versions"]["mujoco"] in seen.text
    assert (runs / "run" / "report.html").stat().st_size < 1e6


def test_its_numbers_are_those_of_the_result(runs: Path, outcome) -> None:
    seen = Page(runs / "run" / "report.html")
    result = json.loads((runs / "run" / "result.json").read_text())
    assert (
        seen.headings[0]
        == f"irb120: {short(result['before_mm']['mean'])} → {short(result['after_mm']['mean'])} mm, good"
    )
    for row in seen.table("", "mean", "rms"):
        errors = result[f"{row[0]}_mm"]
        for cell, key in zip(row[1:], ("mean", "rms", "p95", "max", "count"), strict=True):
            assert seen.number(cell) == pytest.approx(errors[key], rel=5e-3)
    rows = seen.table("parameter", "unit", "nominal", "estimated")
    stored = json.loads((runs / "run" / "parameters.json").read_text())
    assert [row[0] for row in rows] == [each["name"] for each in stored]
    for row, each, found in zip(rows, stored, outcome.parameters, strict=True):
        scale, unit, digits = display_unit(found.parameter)
        half = 0.5001 * 10**-digits
        assert row[1] == unit and seen.number(row[2]) == pytest.approx(scale * each["nominal"], abs=half)
        if each["status"] != "identified":
            assert row[3:6] == ["", "", ""] and row[6].startswith("fixed at nominal; aliased with ")
            continue
        low, high = (scale * end for end in each["interval_95"])
        assert seen.number(row[3]) == pytest.approx(scale * each["estimate"], abs=half)
        assert seen.number(row[5]) == pytest.approx((high - low) / 2, rel=5.1e-3)
        drawn = each["name"].startswith("link")
        assert has_correction(found) is drawn
        assert (row[4] != "") is drawn
        if drawn:
            assert seen.number(row[4]) == pytest.approx(scale * (each["estimate"] - each["nominal"]), abs=half)
    pairs = seen.table("strongly correlated parameters")
    assert [row[0] for row in pairs] == [" and ".join(each["parameters"]) for each in result["correlated"]]


def test_the_same_seed_gives_the_same_bytes(runs: Path, outcome, tmp_path: Path) -> None:
    written(tmp_path / "again.html", replace(outcome, seconds=99.0))
    assert (tmp_path / "again.html").read_bytes() == (runs / "run" / "report.html").read_bytes()


def test_what_a_user_named_is_escaped(tmp_path: Path) -> None:
    """The names of files, robots, poses and targets are text, in the page as in its pictures."""
    bad = calibrate(VirtualCampaign(seed=2, effects=ArmEffects(bad_share=0.08, bad_mm=(5.0, 50.0))))
    target = "a$b<i>&"
    data = replace(bad.measurements, targets=(target,), ids=tuple(f"{NASTY}{i}" for i in range(len(bad.measurements))))
    file = tmp_path / f"{NASTY.replace('/', '')}.csv"
    write_measurements(file, data, bad.robot.chain.prismatic)
    options = MeasuredCampaign(file, noise_mm=0.005)
    found = identify(options)
    assert found.fit.outliers and found.fitted.targets == (target,)
    model = found.robot.model
    named = replace(found.robot, model=replace(model, chain=replace(model.chain, name=NASTY)))
    found = replace(found, robot=named, warnings=(f"{NASTY} of a warning",))
    seen = written(tmp_path / "report.html", found)
    assert seen.headings[0].startswith(NASTY) and seen.items == [f"{NASTY} of a warning"]
    assert found.fit.outliers[0].id in [row[0] for row in seen.table("pose", "line")]
    assert f"arm at pose {NASTY}" in seen.text  # in a picture, where dollars might begin a formula
    assert f"tool.{target}.x" in [row[0] for row in seen.table("parameter")]
    assert "<i>" not in seen.source and "alert(" in seen.text


CASES = {
    "exact, without a known noise": (VirtualCampaign(seed=1, poses=9, instrument="exact"), "good", set()),
    "bad": (VirtualCampaign(seed=1, gate_mm=1e-4), "bad", set()),
    "three targets, robust": (
        VirtualCampaign(
            seed=2, targets=("p1", "p2", "p3"), effects=ArmEffects(bad_share=0.1), fitting=Fitting(robust=True)
        ),
        "good",
        set(),
    ),
    "nothing differs": (VirtualCampaign(seed=1, position_sigma_mm=0, rotation_sigma_mrad=0), "good", set()),
}


@pytest.mark.parametrize("case", CASES)
def test_virtual_runs_of_every_end_are_told(case: str, tmp_path: Path) -> None:
    options, verdict, missing = CASES[case]
    found = calibrate(options)
    assert found.verdict.word == verdict
    seen = written(tmp_path / "report.html", found)
    assert set(seen.figures) == set(FIGURES) - missing and seen.headings[0].endswith(verdict)
    assert found.verdict.reason in seen.text and seen.items == list(found.warnings)
    assert ("Outliers: " in " ".join(seen.headings)) is bool(found.fit.outliers)


def test_a_run_that_is_not_judged(outcome, tmp_path: Path) -> None:
    file = tmp_path / "few.csv"
    write_measurements(file, outcome.measurements.take(range(11)), outcome.robot.chain.prismatic)
    options = MeasuredCampaign(file)
    seen = written(tmp_path / "report.html", identify(options))
    assert seen.headings[0] == "irb120: identified, not validated" and "Verdict: not validated" in seen.text
    assert list(seen.figures) == FIGURES[1:]


def test_held_out_poses_are_drawn_where_they_are(outcome, tmp_path: Path) -> None:
    file = tmp_path / "all.csv"
    write_measurements(file, outcome.measurements, outcome.robot.chain.prismatic)
    options = MeasuredCampaign(file, holdout=0.3, instrument="uniform-8um")
    found = identify(options)
    seen = written(tmp_path / "report.html", found)
    assert "Shown are the poses of the hold-out set" in seen.figures["where"]["caption"]
    held = found.measurements.without(found.fitted.ids)
    shown = error_map(found, "position error")
    places = shown.sizes
    assert len(held) == 15 and sorted(places.sizes) == list(places.sizes) and shown.all_shown
    np.testing.assert_allclose(places.sizes, np.sort(found.validation.errors.after[:, 0]), rtol=1e-12)
    expected = se3.transform(world_of(found), held.points[:, 0])
    apart = np.linalg.norm(places.points[:, None] - expected, axis=2)
    assert sorted(apart.argmin(axis=1)) == list(range(15))
    np.testing.assert_allclose(apart.min(axis=1), places.sizes, rtol=1e-6)  # its error, measured less predicted


@pytest.mark.parametrize(
    ("name", "rows", "options"),
    [
        ("irb120_cable_robotcali_1042.csv", 130, {"observe": "cable", "fitting": Fitting(prior=True), "holdout": 0.3}),
        ("panda_sockets_mukca_3.csv", None, {"observe": "socket", "robot": "panda.toml"}),
        (
            "ur10_ipa_D.csv",
            120,
            {"observe": "pose", "orientation": "intrinsic-xyz", "robot": "ur10.toml", "holdout": 0.3},
        ),
    ],
)
def test_whatever_was_observed_gives_a_report(name: str, rows, options, tmp_path: Path) -> None:
    file = tmp_path / name
    lines = data_file(name).read_text().splitlines(keepends=True)
    file.write_text("".join(lines[: rows and rows + 1]))
    if "robot" in options:
        options = options | {"robot": str(data_file(options["robot"]))}
    asked = MeasuredCampaign(file, **options)
    found = identify(asked)
    seen = written(tmp_path / "report.html", found)
    assert set(seen.figures) == set(FIGURES)
    words = {"cable": "error of the cable's length", "socket": "distance from the socket", "pose": "position error"}
    assert words[asked.observe] in seen.text and found.verdict.word in seen.text
    assert len(seen.table("parameter")) == len(found.parameters)


def test_a_command_line_gives_the_options_back(tmp_path: Path, capsys) -> None:
    assert command_line("calibrate", VirtualCampaign()) == "lab calibrate"
    effects, fitting = (
        ArmEffects(payload_kg=(0.0, 3.0), bad_share=0.05),
        Fitting(robust=True, fix=("link4.d", "tool.*")),
    )
    told = command_line("calibrate", VirtualCampaign(seed=3, effects=effects, fitting=fitting))
    assert told == "lab calibrate --seed 3 --robust --fix 'link4.d,tool.*' --payload-kg 0,3 --bad-share 0.05"
    told = command_line("identify", MeasuredCampaign(Path("a b.csv"), holdout=0.3, refit=("base",)))
    assert told == "lab identify 'a b.csv' --holdout 0.3 --refit base"
    assert command_line("compensate", CompensateOptions(Path("t.csv"), Path("run"))) == "lab compensate t.csv --run run"


def test_a_plan_says_what_it_promises(runs: Path) -> None:
    seen = Page(runs / "plan" / "report.html")
    result = json.loads((runs / "plan" / "result.json").read_text())
    assert seen.headings == ["irb120: 12 poses to measure", "How many poses", "Where the poses are",
                             "How good the choice is", "What was done"]  # fmt: skip
    assert set(seen.figures) == {"curve-figure", "poses-figure"}
    assert f"within {result['promise_mm']:.4f} mm in 95 %" in seen.text
    for row, step in zip(seen.table("poses", "RMS, mm"), result["curve"], strict=True):
        assert [seen.number(cell) for cell in row] == pytest.approx(list(step.values()), rel=5e-3)
    assert len(seen.table("index")) == len(result["indices"]) and "D-efficiency" in seen.text


def test_corrected_targets_are_listed_and_those_that_fail(runs: Path, tmp_path: Path) -> None:
    """Also where a single target is there, and where none is reached."""
    calibrated = read_calibrated(runs / "run")
    arm, values = calibrated.geometry
    Ts = arm.tool(0.7 * arm.chain.random_joints(12, np.random.default_rng(1)), values)[0]
    Ts[3, :3, 3] += 5.0
    quaternions = se3.quaternion_from_rotation(Ts[:, :3, :3])
    lines = [f"{NASTY.replace(',', '')}{i}," + ",".join(repr(float(v)) for v in (*(1e3 * T[:3, 3]), *q))
             for i, (T, q) in enumerate(zip(Ts, quaternions, strict=True))]  # fmt: skip
    lines = [line.replace('"', "") for line in lines]
    for name, rows, reached in (("all", slice(None), 11), ("one", slice(0, 1), 1), ("none", slice(3, 4), 0)):
        (tmp_path / f"{name}.csv").write_text("\n".join(["id,x_mm,y_mm,z_mm,qw,qx,qy,qz", *lines[rows]]) + "\n")
        out = tmp_path / name
        targets = str(tmp_path / f"{name}.csv")
        main(["compensate", targets, "--run", str(runs / "run"), "--out", str(out), "--json"])
        seen, result = Page(out / "report.html"), json.loads((out / "result.json").read_text())
        assert result["converged"] == reached and seen.headings[0].startswith(f"irb120: {reached} of ")
        assert set(seen.figures) == ({"moved-figure", "where"} if reached else set())
        for each in result["failed"]:
            assert [each["id"], each["reason"]] in seen.table("target", "why it is not reached")
        if reached:
            assert short(result["correction_mm"]["mean"]) in seen.text
            assert len(seen.table("target", "q1, °")) == reached


def test_a_verification_says_good_or_what_has_moved(runs: Path, tmp_path: Path, outcome) -> None:
    points = outcome.measurements.points
    for name, shift, count in (("good", 0.0, 8), ("one", 0.0, 1), ("moved", 2e-4, 8)):
        data = replace(outcome.measurements, points=points + np.array([shift, 0, 0])).take(range(count))
        write_measurements(tmp_path / f"{name}.csv", data, outcome.robot.chain.prismatic)
        out = tmp_path / name
        code = main(["verify", str(runs / "run"), str(tmp_path / f"{name}.csv"), "--out", str(out), "--json"])
        seen, result = Page(out / "report.html"), json.loads((out / "result.json").read_text())
        assert code == (0 if result["good"] else 1) and result["good"] is (name != "moved")
        assert seen.headings[0] == f"irb120: {'still good' if result['good'] else 'no longer good'}"
        assert set(seen.figures) == {"errors-figure"} and short(result["promised_mm"]) in seen.text
        assert result["words"][1:] in seen.text
        if name == "moved":
            found = seen.table("what may have changed, the best first")
            assert found[0][0] == result["hypotheses"][0]["words"] and found[0][-1] == "yes"


LOOK = """<script>
const told = {wide: document.documentElement.scrollWidth, room: document.documentElement.clientWidth};
told.figures = [...document.querySelectorAll("figure")].map(figure => figure.id);
told.sizes = [...document.querySelectorAll("figure svg")].map(svg => {
  const box = svg.getBoundingClientRect();
  const text = [...svg.querySelectorAll("text")].map(each => each.getBoundingClientRect());
  const out = text.filter(t => t.left < box.left - 1 || t.right > box.right + 1 || t.bottom > box.bottom + 1);
  return [box.width, box.height, svg.querySelectorAll("path").length, text.length, out.length];
});
const kept = document.createElement("pre");
kept.id = "told";
kept.textContent = JSON.stringify(told);
document.body.append(kept);
</script>"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    """Opens a page in a headless Chromium with a home of its own; its output, and what its console says."""
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        pytest.skip(f"no Chromium here ({', '.join(BROWSERS)}): the pages are not opened")
    home = tmp_path_factory.mktemp("home")

    def opened(path: Path, *flags: str) -> tuple[str, list[str]]:
        alone = (f"--user-data-dir={home}", "--host-resolver-rules=MAP * ~NOTFOUND", "--enable-logging=stderr")
        command = [found, "--headless=new", "--no-sandbox", "--disable-gpu", *alone, *flags, path.as_uri()]
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=60, check=True, env=os.environ | {"HOME": str(home)}
        )
        return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]

    return opened


@pytest.mark.parametrize(
    ("name", "width"), [("run", 1100), ("run", 500), ("plan", 1100), ("plan", 500), ("study", 1100)]
)
def test_a_browser_shows_every_figure(name: str, width: int, runs: Path, browser, tmp_path: Path) -> None:
    """On a desk and on a phone: no complaint, every picture has its size, no text is cut off, nothing scrolls aside."""
    whole = (runs / name / "report.html").read_text(encoding="utf-8")
    copy = tmp_path / "report.html"
    copy.write_text(whole.replace("</body>", f"{LOOK}</body>"), encoding="utf-8")
    dom, said = browser(copy, f"--window-size={width},900", "--dump-dom")
    told = json.loads(re.search(r'<pre id="told">(.*?)</pre>', dom)[1])
    assert not said and told["wide"] <= told["room"]
    assert told["figures"] == list(Page(runs / name / "report.html").figures)
    for wide, high, paths, texts, cut in told["sizes"]:
        assert wide > 0.6 * min(width, 480) and high > 25 and paths > 5 and texts > 3 and cut == 0


def test_it_prints(runs: Path, browser, tmp_path: Path) -> None:
    for name, most in (("run", 6), ("plan", 4)):
        pdf = tmp_path / f"{name}.pdf"
        _, said = browser(runs / name / "report.html", "--no-pdf-header-footer", f"--print-to-pdf={pdf}")
        pages = len(re.findall(rb"/Type\s*/Page\b", pdf.read_bytes()))
        assert not said and pdf.read_bytes().startswith(b"%PDF") and 2 <= pages <= most
