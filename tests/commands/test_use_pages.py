"""Pages of the commands that use an arm, in a browser: the answer first, the arm in motion, nothing cut."""

import re
from pathlib import Path

import numpy as np
import pytest
from helpers.browser import Browser

from lab.cli import main
from lab.commands.calibrate.load_run import load_run
from lab.core import se3

pytestmark = [pytest.mark.figures, pytest.mark.thorough]

LOOK = (Path(__file__).parents[1] / "helpers" / "page_look.js").read_text(encoding="utf-8")
SQUARE = """id,move,x_mm,y_mm,z_mm,qw,qx,qy,qz
start,joint,300,-100,400,0,0,1,0
a,line,400,-100,400,0,0,1,0
b,joint,300,100,400,0,0,1,0
"""
MOVING = ("design", "trajectory", "dynamics", "payload")  # whose slider runs over time
NAMES = (*MOVING, "compensate", "next", "workspace", "kinematics", "inspect")


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory, seven_run: Path, drawn_plan: Path) -> dict[str, Path]:
    """The page of each command, by its name."""
    folder = tmp_path_factory.mktemp("pages")
    arm, values = load_run(seven_run).estimate.geometry
    Ts = arm.tool(0.5 * arm.chain.random_joints(6, np.random.default_rng(1)), values)[0]
    rows = np.column_stack([1e3 * Ts[:, :3, 3], se3.quaternion_from_rotation(Ts[:, :3, :3])])
    lines = ["x_mm,y_mm,z_mm,qw,qx,qy,qz", *(",".join(map(repr, map(float, row))) for row in rows), "9000,0,0,1,0,0,0"]
    (folder / "targets.csv").write_text("\n".join(lines))
    (folder / "square.csv").write_text(SQUARE)
    simulated = ["--simulate", "--rounds", "0", "--rate-hz", "100"]
    commands = {
        "compensate": [folder / "targets.csv", "--run", seven_run, "--no-recording"],
        "next": [seven_run, "--accuracy-mm", "0.001", "--candidates", "200", "--no-recording"],
        "trajectory": [folder / "square.csv", "--no-recording"],
        "dynamics": ["--robot", "course2r", *simulated, "--no-recording"],
        "payload": ["--robot", "irb120", "--payload-kg", "1", *simulated, "--no-recording"],
        "workspace": ["planar3r", "--no-recording"],
        "kinematics": ["irb120", "--pose=-44.11,383.46,786,77.71,-0.38,170.88", "--no-recording"],
        "inspect": ["scara"],
    }
    for name, arguments in commands.items():
        assert main([name, *map(str, arguments), "--out", str(folder / name), "--json"]) in (0, 1), name
    return {"design": drawn_plan / "report.html"} | {name: folder / name / "report.html" for name in commands}


PLACES = """
[...document.querySelectorAll("h1, .card .verdict, .numbers p, .card p:last-child")].map((each) =>
  [each.textContent.trim(), each.getBoundingClientRect().bottom + scrollY])
"""


@pytest.mark.parametrize("name", NAMES)
def test_the_answer_and_the_next_step_come_first(pages: dict[str, Path], browser: Browser, name: str) -> None:
    """On the first screen of a desk, on the first two of a phone; and nothing is cut or scrolls aside."""
    assert pages[name].stat().st_size < 2e6
    browser.open(pages[name])
    for width, room in ((1400, 900), (390, 2 * 844)):
        browser.show(width)
        shown = browser.run(PLACES)
        assert len(shown) >= 4 and any(text.startswith("Next:") for text, _ in shown)
        assert max(bottom for _, bottom in shown) < room, shown
        assert browser.run(LOOK)["wrong"] == []
    assert not browser.complaints


@pytest.mark.parametrize("name", NAMES)
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
    assert (moments < 2) == (name in ("workspace", "inspect"))
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


def test_a_page_reads_without_its_script(pages: dict[str, Path], browser: Browser) -> None:
    """The scene is hidden, and the rest of the page is there."""
    try:
        browser.call("Emulation.setScriptExecutionDisabled", value=True)
        browser.open(pages["trajectory"])
        browser.show(1400)
    finally:
        browser.call("Emulation.setScriptExecutionDisabled", value=False)
    shown = "[document.querySelector('.stage').offsetHeight, document.querySelector('.card').offsetHeight]"
    stage, card = browser.run(shown)
    assert stage == 0 and card > 100
