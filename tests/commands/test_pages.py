"""Pages as a browser shows and prints them: on a desk, a tablet and a phone, light and dark, and on paper."""

import io
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import matplotlib.image as images
import numpy as np
import pytest
from helpers.browser import BROWSERS, Browser, installed, opened
from helpers.drawing import nothing_drawn
from helpers.html_page import Page
from matplotlib.colors import to_rgb

import lab
from lab.cli import main
from lab.commands.calibrate.load_run import load_run
from lab.core import se3
from lab.formats.measurement_csv import write_measurements
from lab.render.style import AFTER, BEFORE, luminance

pytestmark = [pytest.mark.figures, pytest.mark.thorough]

LOOK = (Path(__file__).parents[1] / "helpers" / "page_look.js").read_text(encoding="utf-8")
SCREENS = [(1400, "light"), (1400, "dark"), (768, "light"), (390, "light"), (390, "dark")]
PAPER_PX = 695  # A4 within the page's margins
MOST_SHEETS = {"run": 8, "plan": 4, "inspect": 3, "verify": 3, "compensate": 4, "compare": 3, "trend": 4, "certify": 4}
DETAILS = """
certificate = { number = "42", date = 2026-03-31, issued_by = "Us", operator = "A <b>B</b>", place = "Hall 3" }
robot.serial_number = "R1"
instrument = { serial_number = "T1", certificate = "C1" }
environment = { temperature_c = 20.5, robot_temperature_k = { limit = 1 }, expansion_ppm_per_k = 12 }
"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if (program := installed()) is None:
        pytest.skip(f"no Chromium here ({', '.join(BROWSERS)}): the pages are not opened")
    with opened(program, tmp_path_factory.mktemp("home")) as browser:
        yield browser


@pytest.fixture(scope="module")
def pages(tmp_path_factory, drawn_run: Path, drawn_plan: Path, drawn_study: Path) -> dict[str, Path]:
    """The page of each command that writes one, by its name."""
    folder = tmp_path_factory.mktemp("pages")
    day = lab.simulate("irb120", poses=60, seed=7, targets=("p1", "p2", "p3")).measurements
    joints = day.joints.copy()
    joints[30:, 2] -= 0.5e-3  # the zero of the third joint moved between two days
    day = replace(day, joints=joints)
    history = folder / "history"
    with nothing_drawn():
        for i, at in enumerate(("2026-01-10", "2026-02-11")):
            part = day.take(range(30 * i, 30 * i + 30))
            lab.identify(part, robot="irb120", instrument="uniform-8um", date=at).save(history / f"run{i}")
    calibrated = load_run(drawn_run)
    arm, values = calibrated.estimate.geometry
    again = lab.simulate("irb120", poses=8, seed=7).measurements
    moved = replace(again, points=again.points + np.array([2e-4, 0, 0]))
    write_measurements(folder / "again.csv", moved, calibrated.robot.chain.prismatic)
    Ts = arm.tool(0.5 * arm.chain.random_joints(6, np.random.default_rng(1)), values)[0]
    rows = np.column_stack([1e3 * Ts[:, :3, 3], se3.quaternion_from_rotation(Ts[:, :3, :3])])
    lines = ["x_mm,y_mm,z_mm,qw,qx,qy,qz", *(",".join(map(repr, map(float, row))) for row in rows)]
    (folder / "targets.csv").write_text("\n".join(lines))
    (folder / "details.toml").write_text(DETAILS)
    commands = {
        "inspect": ["irb120"],
        "verify": [drawn_run, folder / "again.csv"],
        "compensate": [folder / "targets.csv", "--run", drawn_run],
        "certify": [history / "run0", "--details", folder / "details.toml"],
        "compare": [history / "run0", history / "run1"],
        "trend": [history],
    }
    for name, arguments in commands.items():
        assert main([name, *map(str, arguments), "--out", str(folder / name), "--json"]) in (0, 1)
    drawn = {each.name: each / "report.html" for each in (drawn_run, drawn_plan, drawn_study)}
    return drawn | {name: folder / name / "report.html" for name in commands}


def test_a_browser_shows_and_prints_every_page(pages: dict[str, Path], browser: Browser) -> None:
    """No complaint, nothing scrolls aside, no text is cut off or pale, every figure has its size, few sheets."""
    wrong = {}
    for name, path in pages.items():
        figures = list(Page(path).figures)
        browser.open(path)
        for width, scheme, media in [*((*each, "screen") for each in SCREENS), (PAPER_PX, "light", "print")]:
            browser.show(width, scheme, media)
            told = browser.run(LOOK)
            assert told["texts"] > 40 and told["figures"] == figures
            small = [size for size in told["sizes"] if size[0] < 0.6 * min(width, 480) or min(size[1:]) < 4]
            if found := told["wrong"] + small:
                wrong[name, width, scheme, media] = found
        pdf = browser.pdf()
        sheets = len(re.findall(rb"/Type\s*/Page\b", pdf))
        assert pdf.startswith(b"%PDF") and 1 <= sheets <= MOST_SHEETS.get(name, 8), (name, sheets)
        assert not browser.complaints
    assert not wrong, "\n".join(f"{where}: {what}" for where, found in wrong.items() for what in found)


PLACES = """
[...document.querySelectorAll("h1, .card .verdict, .numbers p, .card p:last-child")].map((each) => {
  const box = each.getBoundingClientRect();
  return [each.textContent.trim(), box.bottom + scrollY];
})
"""


def test_the_first_screens_say_how_good_and_what_next(pages: dict[str, Path], browser: Browser) -> None:
    browser.open(pages["run"])
    for width, room in ((1400, 900), (390, 2 * 844)):
        browser.show(width)
        shown = dict(browser.run(PLACES))
        assert any("irb120" in text for text in shown) and any("good" in text for text in shown)
        assert {text.split()[0] for text in shown} >= {"before", "after", "Next:"}
        assert max(shown.values()) < room, shown


PIXELS = """
(() => {
  const canvas = document.querySelector(".scene canvas");
  const copy = document.createElement("canvas").getContext("2d");
  [copy.canvas.width, copy.canvas.height] = [canvas.width, canvas.height];
  copy.drawImage(canvas, 0, 0);
  const bytes = copy.getImageData(0, 0, canvas.width, canvas.height).data;
  let painted = 0, sum = 0;
  for (let i = 0; i < bytes.length; i += 4) if (bytes[i + 3]) { painted += 1; sum += (i % 9973) * bytes[i]; }
  return [painted, sum, document.querySelector(".scene output").textContent];
})()
"""


def pointer(browser: Browser, kind: str, x: float, y: float) -> None:
    browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)


@pytest.mark.parametrize("name", ["run", "plan"])
def test_the_arm_is_drawn_turned_and_clicked(pages: dict[str, Path], browser: Browser, name: str) -> None:
    browser.open(pages[name])
    browser.show(1400)
    painted, first, text = browser.run(PIXELS)
    assert painted > 5_000 and text.startswith("pose ")
    box = browser.run(
        "(() => { const b = document.querySelector('.scene canvas').getBoundingClientRect();"
        "return [b.left, b.top, b.width, b.height]; })()"
    )
    middle = box[0] + box[2] / 2, box[1] + box[3] / 2
    pointer(browser, "mousePressed", *middle)
    pointer(browser, "mouseMoved", middle[0] + 120, middle[1] + 20)
    pointer(browser, "mouseReleased", middle[0] + 120, middle[1] + 20)
    painted, turned, _ = browser.run(PIXELS)
    assert painted > 5_000 and turned != first
    browser.run("document.querySelector('.scene [name=arm]').click()")
    assert browser.run(PIXELS)[0] < painted  # the arm alone is hidden
    rows = "[...document.querySelectorAll('.scene tbody tr')]"
    first_pose = text.split()[1].rstrip(",")
    other = f"{rows}.find((row) => row.cells[0].textContent !== '{first_pose}')"
    browser.run(f"{other}.click()")
    told = browser.run("document.querySelector('.scene tr.chosen td').textContent")
    assert browser.run(PIXELS)[2].startswith(f"pose {told},") and told != first_pose
    place = browser.run(
        "[...document.querySelectorAll('.labels span')].map((s) => [s.textContent, s.offsetLeft, s.offsetTop])"
    )
    assert told in [each[0] for each in place]
    assert not browser.complaints


def test_a_page_reads_without_its_script(pages: dict[str, Path], browser: Browser) -> None:
    try:
        browser.call("Emulation.setScriptExecutionDisabled", value=True)
        browser.open(pages["run"])
        browser.show(1400)
    finally:
        browser.call("Emulation.setScriptExecutionDisabled", value=False)
    seen = Page(pages["run"])
    assert "arm" in seen.figures and pages["run"].stat().st_size < 2e6


def test_every_eye_tells_before_from_after(pages: dict[str, Path], browser: Browser) -> None:
    """The pixels drawn in either colour, as a deuteranope or a grey print shows them: words, bars, dots, lines."""
    kinds, told = ("none", "deuteranopia", "achromatopsia"), {}
    try:
        for name, path in pages.items():
            browser.open(path)
            browser.run("document.querySelectorAll('canvas').forEach((each) => each.remove())")  # an arm is orange too
            browser.show(1400)
            shown = []
            for kind in kinds:
                browser.call("Emulation.setEmulatedVisionDeficiency", type=kind)
                shown.append(images.imread(io.BytesIO(browser.picture()), format="png")[..., :3])
            masks = [np.abs(shown[0] - to_rgb(colour)).max(axis=2) < 0.01 for colour in (BEFORE, AFTER)]
            if min(mask.sum() for mask in masks) <= 50:  # a page that shows one of them alone, or neither
                continue
            for kind, seen in zip(kinds, shown, strict=True):
                light, dark = (luminance(seen[mask].mean(axis=0)) + 0.05 for mask in masks)
                told[name, kind] = light / dark
    finally:
        browser.call("Emulation.setEmulatedVisionDeficiency", type="none")
    assert {name for name, _ in told} == {"run", "compensate"}
    assert min(told.values()) > 2.0, told
