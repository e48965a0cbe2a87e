"""Pages as a browser shows and prints them: on a desk, a tablet and a phone, light and dark, and on paper."""

import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.browser import Browser
from helpers.drawing import nothing_drawn
from helpers.html_page import Page
from PIL import Image

import lab
from lab.cli import main
from lab.commands.calibrate.load_run import load_run
from lab.core import se3
from lab.formats.measurement_csv import write_measurements
from lab.render.style import AFTER, BEFORE, luminance, rgb

pytestmark = [pytest.mark.figures, pytest.mark.thorough]

LOOK = (Path(__file__).parents[1] / "helpers" / "page_look.js").read_text(encoding="utf-8")
SCREENS = [(1400, "light"), (1400, "dark"), (768, "light"), (390, "light"), (390, "dark")]
PAPER_PX = 695  # A4 within the page's margins
MOST_SHEETS = {"run": 8, "plan": 4, "inspect": 3, "verify": 3, "compensate": 4, "history": 4, "certify": 4}
DETAILS = """
certificate = { number = "42", date = 2026-03-31, issued_by = "Us", operator = "A <b>B</b>", place = "Hall 3" }
robot.serial_number = "R1"
instrument = { serial_number = "T1", certificate = "C1" }
environment = { temperature_c = 20.5, robot_temperature_k = { limit = 1 }, expansion_ppm_per_k = 12 }
"""


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
        "history": [history / "run0", history / "run1"],
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
            least = 0.6 * min(width, 480), 160  # of one of many small charts
            small = [size for *size, one_of_many in told["sizes"] if size[0] < least[one_of_many] or min(size[1:]) < 3]
            if found := told["wrong"] + small:
                wrong[name, width, scheme, media] = found
        pdf = browser.pdf()
        sheets = len(re.findall(rb"/Type\s*/Page\b", pdf))
        assert pdf.startswith(b"%PDF") and 1 <= sheets <= MOST_SHEETS.get(name, 8), (name, sheets)
        assert not browser.complaints
    assert not wrong, "\n".join(f"{where}: {what}" for where, found in wrong.items() for what in found)


def pointer(browser: Browser, kind: str, x: float, y: float) -> None:
    browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)


LETTERS = """
[...document.querySelectorAll("figure svg text")].filter((each) => each.textContent.trim()).map((each) => {
  const to = each.getScreenCTM();
  return [parseFloat(getComputedStyle(each).fontSize) * Math.hypot(to.a, to.b), each.textContent];
})
"""
BOXES = """
[...document.querySelectorAll(".panels, .table")].filter((each) => each.scrollWidth > each.clientWidth + 1 &&
  (each.tabIndex !== 0 || getComputedStyle(each).overflowX !== "auto")).map((each) => each.outerHTML.slice(0, 80))
"""


def test_letters_of_charts_are_never_small(pages: dict[str, Path], browser: Browser) -> None:
    """At least 10 px at every width; what does not fit is scrolled in its own box, also by a keyboard."""
    count, small = 0, {}
    for name, path in pages.items():
        browser.open(path)
        for width, media in ((1400, "screen"), (768, "screen"), (390, "screen"), (320, "screen"), (PAPER_PX, "print")):
            browser.show(width, media=media)
            letters = browser.run(LETTERS)
            count += len(letters)
            on_paper = media == "print" and name != "run"  # where a wide chart does not scroll
            if not on_paper and (found := [each for each in letters if each[0] < 9.99]):
                small[name, width] = found[:3]
            browser.run("new Promise((then) => requestAnimationFrame(() => requestAnimationFrame(then)))")
            if media == "screen" and (stuck := browser.run(BOXES)):
                small[name, width, "scrolled"] = stuck
    assert count > 1000 and not small, small


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
POINTED = """
[document.querySelector(".tip").hidden, document.querySelector(".tip").textContent,
 document.querySelectorAll(".ring").length,
 [...document.querySelectorAll("tr.pointed")].map((row) => row.cells[0].textContent)]
"""
TARGET = """
(() => {
  const svg = document.querySelector("#residuals svg"), line = svg.dataset.points.split("\\n")[7].split("\\t");
  const at = new DOMPoint(Number(line[0]), Number(line[1])).matrixTransform(svg.getScreenCTM());
  return [at.x, at.y, ...line.slice(2)];
})()
"""


def test_a_point_of_a_chart_says_its_pose_and_marks_its_row(pages: dict[str, Path], browser: Browser) -> None:
    """By mouse, finger and keyboard: one point is ringed in every chart that has it, and chosen in the scene."""
    browser.open(pages["run"])
    browser.show(1400)
    x, y, thing, _, text = browser.run(TARGET)
    assert browser.run(POINTED)[0] is True and thing == "pose" and text.endswith(" mm")
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x + 2, y=y + 1)
    hidden, told, rings, rows = browser.run(POINTED)
    assert hidden is False and told.startswith("pose ") and rows == [told.split(":")[0].removeprefix("pose ")]
    assert rings >= 9  # six joints, three axes
    pointer(browser, "mousePressed", x, y)
    pointer(browser, "mouseReleased", x, y)
    told = browser.run(POINTED)[1]
    assert browser.run(PIXELS)[2].startswith(told.split(":")[0] + ",")  # the scene shows it
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=2, y=2)
    assert browser.run(POINTED) == [True, told, 0, []]
    browser.run("document.activeElement.blur()")
    browser.run("document.querySelector('#residuals svg').focus({ focusVisible: true })")
    first = browser.run(POINTED)[1]
    for key, changes in (("ArrowRight", True), ("End", True), ("End", False), ("Home", True)):
        before = browser.run(POINTED)[1]
        browser.call("Input.dispatchKeyEvent", type="keyDown", key=key)
        assert (browser.run(POINTED)[1] != before) is changes, key
    assert browser.run(POINTED)[:2] == [False, first]
    browser.call("Input.dispatchKeyEvent", type="keyDown", key="Escape")
    assert browser.run(POINTED)[0] is True and not browser.complaints
    browser.call("Emulation.setTouchEmulationEnabled", enabled=True)
    try:
        browser.run("scrollTo(0, 0)")
        x, y, *_ = browser.run(TARGET)
        for kind, points in (("touchStart", [{"x": x, "y": y}]), ("touchEnd", [])):
            browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)
        browser.run("new Promise((then) => setTimeout(then, 100))")
        assert browser.run(POINTED)[0] is False
    finally:
        browser.call("Emulation.setTouchEmulationEnabled", enabled=False)


STRUCTURE = """
(() => {
  const wrong = [], all = (what) => [...document.querySelectorAll(what)];
  const name = (each) => (each.getAttribute("aria-label") ?? each.labels?.[0]?.textContent ?? each.textContent).trim();
  all("details").forEach((each) => { each.open = true; });
  const levels = all("h1, h2, h3, h4").map((each) => Number(each.tagName[1]));
  levels.forEach((level, i) => level > (levels[i - 1] ?? 0) + 1 && wrong.push(`${level} after ${levels[i - 1]}`));
  if (levels.filter((each) => each === 1).length !== 1) wrong.push("not one h1");
  if (all("main").length !== 1 || !document.documentElement.lang || !document.title) wrong.push("main, lang, title");
  all("nav, section[aria-label], [role=group], a, button, input, canvas, svg, summary").forEach((each) => {
    if (!name(each)) wrong.push(`no name: ${each.outerHTML.slice(0, 80)}`);
  });
  all("svg").forEach((each) => each.getAttribute("role") === "img" || wrong.push("svg without a role"));
  all("table").forEach((table) => {
    const head = table.tHead?.rows[0];
    if (head && ![...head.cells].some((cell) => cell.tagName === "TH")) wrong.push("a head without headings");
    all("th").forEach((th) => th.textContent.trim() || wrong.push("an empty heading"));
    const width = head?.cells.length ?? table.rows[0].cells.length;
    if ([...table.rows].some((row) => row.cells.length !== width)) wrong.push("rows of other widths");
  });
  const ids = all("[id]").map((each) => each.id);
  if (new Set(ids).size !== ids.length) wrong.push("two of one id");
  if (all("[tabindex]").some((each) => each.tabIndex > 0)) wrong.push("an order of its own");
  return [...new Set(wrong)];
})()
"""


def test_who_does_not_see_a_page_can_read_it(pages: dict[str, Path], browser: Browser) -> None:
    """Names, headings in order, landmarks, roles and heads of tables; that text is no paler than 4.5 to 1: above."""
    wrong = {}
    for name, path in pages.items():
        browser.open(path)
        browser.show(1400)
        if found := browser.run(STRUCTURE):
            wrong[name] = found
    assert not wrong, wrong


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
        seen, shown = Page(pages["run"]), browser.run("document.documentElement.innerText")
        charts = browser.run("[...document.querySelectorAll('figure svg')].map((each) => each.clientWidth)")
    finally:
        browser.call("Emulation.setScriptExecutionDisabled", value=False)
    assert "arm" in seen.figures and pages["run"].stat().st_size < 2e6
    assert len(charts) == seen.source.count("<svg") and min(charts) > 150
    for heading in seen.headings:
        assert heading in shown
    assert "play" not in shown.split("\n")  # no controls of what is not there


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
                shown.append(np.asarray(Image.open(io.BytesIO(browser.picture())))[..., :3] / 255)
            masks = [np.abs(shown[0] - np.array(rgb(colour)) / 255).max(axis=2) < 0.01 for colour in (BEFORE, AFTER)]
            if min(mask.sum() for mask in masks) <= 50:  # a page that shows one of them alone, or neither
                continue
            for kind, seen in zip(kinds, shown, strict=True):
                light, dark = (luminance(seen[mask].mean(axis=0)) + 0.05 for mask in masks)
                told[name, kind] = light / dark
    finally:
        browser.call("Emulation.setEmulatedVisionDeficiency", type="none")
    assert {name for name, _ in told} == {"run", "compensate"}
    assert min(told.values()) > 2.0, told
