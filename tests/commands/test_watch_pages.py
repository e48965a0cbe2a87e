"""Pages that watch an arm, in a browser: the arm, its verdict, its error and what next come first."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.browser import Browser
from helpers.drawing import nothing_drawn

import lab
from lab.cli import main
from lab.formats.measurement_csv import write_measurements

pytestmark = [pytest.mark.figures, pytest.mark.thorough]

LOOK = (Path(__file__).parents[1] / "helpers" / "page_look.js").read_text(encoding="utf-8")
MOVED_RAD = 0.5e-3
ON = "2026-03-20"


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory, seven_run: Path, drawn_study: Path) -> dict[str, Path]:
    """The page of each command, of an arm A-1 whose third joint's zero moved between January and February."""
    folder = tmp_path_factory.mktemp("watched")
    day = lab.simulate("irb120", poses=70, seed=7).measurements
    joints = day.joints.copy()
    joints[30:, 2] -= MOVED_RAD
    day = replace(day, joints=joints)
    runs = folder / "runs"
    with nothing_drawn():
        for i, at in enumerate(("2026-01-10", "2026-02-11")):
            part = day.take(range(30 * i, 30 * i + 30))
            run = lab.identify(part, robot="irb120", instrument="uniform-8um", date=at, serial="A-1", gate_mm=0.05)
            run.save(runs / at)
        write_measurements(folder / "new.csv", day.take(range(60, 70)), (False,) * 6)
        verified = ["verify", str(runs / "2026-01-10"), str(folder / "new.csv"), "--date", "2026-03-10", "--json"]
        assert main([*verified, "--out", str(runs / "check")]) == 1
    commands = {
        "verify": [runs / "2026-01-10", folder / "new.csv"],
        "history": [runs, "--on", ON],
        "two": [runs / "2026-01-10", runs / "2026-02-11"],
        "certify": [runs / "2026-01-10"],
    }
    for name, arguments in commands.items():
        assert main(
            ["history" if name == "two" else name, *map(str, arguments), "--out", str(folder / name), "--json"]
        ) in (0, 1)
    assert main(["certify", str(seven_run), "--out", str(folder / "example"), "--json"]) == 0
    found = {name: folder / name / "report.html" for name in (*commands, "example")}
    return found | {"study": drawn_study / "report.html"}


PLACES = """
[...document.querySelectorAll("h1, .card .verdict, .card .numbers b, .card .note, .card .note + p")].map((each) =>
  [each.tagName + " " + each.textContent.trim(), each.getBoundingClientRect().bottom + scrollY])
"""
SAID = {  # of each page: the arm, the answer, a number's unit, and how the next step begins
    "verify": ("irb120 A-1", "bad", " mrad", "Set the zero of joint 3 anew"),
    "history": ("irb120 A-1", "changed between 2026-01-10 and 2026-02-11", " mm", "Use the calibration of 2026-02-11"),
    "two": ("irb120 A-1", "changed", " mm", "Use the calibration of 2026-02-11"),
    "certify": ("irb120 A-1", "conforms", " mm", "State what is missing in --details"),
    "example": ("irb120", "EXAMPLE", " mm", "Measure the real arm"),
    "study": ("irb120", "20 poses", " mm", "Give 5 robots or more"),
}


@pytest.mark.parametrize("name", SAID)
def test_the_first_screens_say_what_arm_how_good_and_what_next(
    pages: dict[str, Path], browser: Browser, name: str
) -> None:
    browser.open(pages[name])
    for width, room in ((1400, 900), (390, 2 * 844)):
        browser.show(width)
        shown = dict(browser.run(PLACES))
        arm, answer, unit, step = SAID[name]
        assert any(arm in text for text in shown) and any(answer in text for text in shown), shown
        assert any(text.startswith("B ") and text.endswith(unit) for text in shown), shown
        assert any(text.startswith(f"P Next: {step}") for text in shown), shown
        assert max(shown.values()) < room, (width, shown)


def test_nothing_is_cut_pale_or_scrolls_aside_on_screens_and_paper(pages: dict[str, Path], browser: Browser) -> None:
    wrong = {}
    for name, path in pages.items():
        browser.open(path)
        for width, scheme, media in ((1400, "light", "screen"), (390, "light", "screen"), (390, "dark", "screen"),
                                     (695, "light", "print")):  # fmt: skip
            browser.show(width, scheme, media)
            if found := browser.run(LOOK)["wrong"]:
                wrong[name, width, scheme, media] = found
        assert not browser.complaints
    assert not wrong, "\n".join(f"{where}: {what}" for where, found in wrong.items() for what in found)


MARK = """
(() => {
  scrollTo(0, document.body.scrollHeight / 2);
  const mark = document.querySelector(".mark");
  if (!mark) return null;
  const box = mark.getBoundingClientRect();
  const style = getComputedStyle(mark);
  return [mark.textContent, style.position, style.display !== "none" && +style.opacity > 0.05,
    box.top < innerHeight / 2 && box.bottom > innerHeight / 2, document.elementFromPoint(700, 300) !== mark];
})()
"""


def test_the_certificate_of_a_virtual_arm_is_marked_on_every_screen_and_sheet(
    pages: dict[str, Path], browser: Browser
) -> None:
    """What is fixed stays while the page scrolls, and is on every sheet; nobody signs an example."""
    for media in ("screen", "print"):
        browser.open(pages["certify"])
        browser.show(1400, "light", media)
        assert browser.run(MARK) is None
        browser.open(pages["example"])
        browser.show(1400, "light", media)
        assert browser.run(MARK) == ["EXAMPLE", "fixed", True, True, True]
    pages_of = {name: pages[name].read_text() for name in ("certify", "example")}
    assert {name: "EXAMPLE" in text.split("</h1>")[0] for name, text in pages_of.items()} == {
        "certify": False,
        "example": True,
    }
    assert {name: ">Signature<" in text for name, text in pages_of.items()} == {"certify": True, "example": False}


def test_the_scene_of_a_verification_is_the_errors_that_the_table_states(
    pages: dict[str, Path], browser: Browser
) -> None:
    browser.open(pages["verify"])
    browser.show(1400)
    rows = browser.run("[...document.querySelectorAll('.scene tbody tr')].map((r) => +r.cells[1].textContent)")
    stated = float(np.mean(rows))
    mean = browser.run("+[...document.querySelectorAll('table tr')].find((r) => r.textContent.trim().startsWith"
                       "('observed')).cells[1].textContent")  # fmt: skip
    assert len(rows) == 10 and mean == pytest.approx(stated, rel=0.01)
    assert browser.run("document.querySelector('.scene output').textContent").startswith("pose ")
