"""Pages as a browser shows and prints them: nothing cut, the answer first, the arm in motion, points with names."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.browser import Browser
from helpers.campaigns import run_of, session
from helpers.html_page import Page

from lab.cli.main import main
from lab.core import se3
from lab.formats.measurement_csv import write_measurements
from lab.library.load_run import load_run

pytestmark = [pytest.mark.figures, pytest.mark.thorough]

LOOK = (Path(__file__).parents[1] / "helpers" / "page_look.js").read_text(encoding="utf-8")
SCREENS = [(1400, "light", "screen"), (768, "light", "screen"), (390, "dark", "screen"), (695, "light", "print")]
SQUARE = """id,move,x_mm,y_mm,z_mm,qw,qx,qy,qz
start,joint,300,-100,400,0,0,1,0
a,line,400,-100,400,0,0,1,0
b,joint,300,100,400,0,0,1,0
"""
MOVING = ("plan", "trajectory")  # whose slider runs over time
# on every screen and on paper
LOOKED_AT = ("run", "plan", "study", "inspect", "verify", "history", "compensate", "certify")
SCENES = (*MOVING, "compensate", "inspect")


@pytest.fixture(scope="module")
def pages(
    browser: Browser, request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Path]:
    """The page of each command, by its name; made where there is a browser."""
    folder, names = tmp_path_factory.mktemp("pages"), ("drawn_run", "drawn_plan", "drawn_study", "dated_runs")
    drawn_run, drawn_plan, drawn_study, dated_runs = map(request.getfixturevalue, names)
    calibrated = load_run(drawn_run)
    arm, values = calibrated.estimate.geometry
    again = session(poses=8, seed=7).measurements
    moved = replace(again, points=again.points + np.array([2e-4, 0, 0]))
    write_measurements(folder / "again.csv", moved, calibrated.robot.chain.prismatic)
    Ts = arm.tool(0.5 * arm.chain.random_joints(6, np.random.default_rng(1)), values)[0]
    rows = np.column_stack([1e3 * Ts[:, :3, 3], se3.quaternion_from_rotation(Ts[:, :3, :3])])
    lines = ["x_mm,y_mm,z_mm,qw,qx,qy,qz", *(",".join(map(repr, map(float, row))) for row in rows), "9000,0,0,1,0,0,0"]
    (folder / "targets.csv").write_text("\n".join(lines))
    (folder / "square.csv").write_text(SQUARE)
    commands = {
        "inspect": ["scara"],
        "verify": [drawn_run, folder / "again.csv"],
        "history": [dated_runs],
        "certify": [run_of(poses=30, seed=7)],
        "compensate": [folder / "targets.csv", "--run", drawn_run],
        "trajectory": [folder / "square.csv"],
    }
    for name, arguments in commands.items():
        recorded = ["--no-recording"] if name in ("verify", "compensate", "trajectory") else []
        out = ["--out", str(folder / name), "--json"]
        assert main([name, *map(str, arguments), *recorded, *out]) in (0, 1), name
    drawn = {each.name: each / "report.html" for each in (drawn_run, drawn_plan, drawn_study)}
    return drawn | {name: folder / name / "report.html" for name in commands}


LETTERS = """
[...document.querySelectorAll("figure svg text")].filter((each) => each.textContent.trim()).map((each) => {
  const to = each.getScreenCTM();
  return [parseFloat(getComputedStyle(each).fontSize) * Math.hypot(to.a, to.b), each.textContent];
})
"""
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


def test_nothing_is_cut_pale_small_or_without_a_name(pages: dict[str, Path], browser: Browser) -> None:
    """On every screen and on paper; letters of charts have 10 px; who does not see a page can read it."""
    wrong = {}
    for name in LOOKED_AT:
        path = pages[name]
        assert path.stat().st_size < 2e6
        figures = list(Page(path).figures)
        browser.open(path)
        for width, scheme, media in SCREENS:
            browser.show(width, scheme, media)
            told = browser.run(LOOK)
            small = [each for each in browser.run(LETTERS) if each[0] < 9.99] if media == "screen" else []
            assert told["figures"] == figures
            if found := [*told["wrong"], *small]:
                wrong[name, width, scheme, media] = found
        if found := browser.run(STRUCTURE):
            wrong[name, "structure"] = found
        assert browser.pdf().startswith(b"%PDF") and not browser.complaints
    assert not wrong, "\n".join(f"{where}: {what}" for where, found in wrong.items() for what in found)


@pytest.mark.parametrize("name", SCENES)
def test_the_arm_is_drawn_and_moves(pages: dict[str, Path], browser: Browser, name: str) -> None:
    browser.open(pages[name])
    browser.show(1400)
    browser.run("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(0))))")  # laid out
    scene = "document.querySelector('.scene')"
    picture, text = f"{scene}.querySelector('canvas').toDataURL()", f"{scene}.querySelector('output').textContent"
    first = browser.run(picture)
    browser.run(f"{scene}.querySelector('[name=arm]').click()")
    assert browser.run(picture) != first  # it was drawn
    browser.run(f"{scene}.querySelector('[name=arm]').click()")
    assert browser.run(picture) == first
    slider, button = (f"{scene}.querySelector('{each}')" for each in ("input[type=range]", "button"))
    moments = int(browser.run(f"{slider}.max")) + 1
    assert browser.run(f"{button}.hidden") == (moments < 2)
    assert (moments < 2) == (name == "inspect")
    if moments > 1:
        told = browser.run(text)
        assert (re.search(r"\d\.\d\d s$", told) is not None) == (name in MOVING)
        browser.run(f"{slider}.value = {moments - 1}; {slider}.dispatchEvent(new Event('input'))")
        assert browser.run(text) != told and browser.run(picture) != first
        watched = f"{scene}.querySelector('output'), {{childList: true, characterData: true, subtree: true}}"
        changed = f"new Promise((done) => new MutationObserver(() => done(true)).observe({watched}))"
        assert browser.run(f"{button}.click(); {changed}")  # played from the beginning on
        browser.run(f"{button}.click()")
    assert not browser.complaints


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
    """By mouse and keyboard: one point is ringed in every chart that has it, and chosen in the scene."""
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
