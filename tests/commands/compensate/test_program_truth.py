"""Programs on hidden robots, whose controllers compute with nominal kinematics: errors before and after correction.

The tool is the program's own, in the physical flange. What no reflector shows (the flange along and about the last
axis where the places of the targets are not as stated, the base along and about the first) stays, and is expected.
"""

from pathlib import Path

import numpy as np
import pytest
from helpers.controller_programs import LANGUAGES
from helpers.hidden_robots import Day, Trial, calibrated_day, hidden_cell, tried

from lab.library.corrected_program import flange_note

pytestmark = pytest.mark.thorough


@pytest.fixture(scope="module")
def days(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Day]:
    """An arm with targets as stated, with targets 6 mm away from there, with one target, and with its pose measured."""
    cell = hidden_cell(tmp_path_factory.mktemp("cell"), "irb120")
    kinds = {"stated": (3, 0.0, "points"), "elsewhere": (3, 6.0, "points"), "one": (1, 0.0, "points")}
    return {
        name: calibrated_day(cell, 4, targets, off_mm, poses=20, springs=False, observe=observe)
        for name, (targets, off_mm, observe) in {**kinds, "pose": (1, 0.0, "pose")}.items()
    }


def trial(days: dict[str, Day], name: str, folder: Path, language: str = "rapid") -> Trial:
    return tried(days[name], folder, language, np.random.default_rng(5), 8)


@pytest.mark.parametrize("name", ["stated", "pose"])
def test_stated_targets_make_the_program_true_to_its_tool(name: str, days: dict[str, Day], tmp_path: Path) -> None:
    """Relative to each other, targets err thirty times less than before."""
    done = trial(days, name, tmp_path)
    assert done.before.shape.mean() > 0.5e-3
    assert done.after.shape.mean() < 0.05e-3 and done.after.shape.max() < 0.12e-3
    assert done.within_shape.all() and done.within_base.all()
    assert flange_note(done.result.reference, done.result.expected.flange_95_m) == ""


@pytest.mark.parametrize("name", ["elsewhere", "one"])
def test_an_unknown_flange_is_the_first_sentence_and_in_the_expected_error(
    name: str, days: dict[str, Day], tmp_path: Path
) -> None:
    done = trial(days, name, tmp_path)
    result = done.result.to_dict()
    assert result["verdict"] == "doubtful" and not result["program"]["flange"]["orientation_known"]
    assert done.after.shape.mean() < done.before.shape.mean()
    assert 0.2e-3 < done.result.expected.shape_95_m.max() < 3e-3
    assert done.within_shape.all() and done.within_base.all()
    sizes = result["program"]["expected_95_mm"]
    assert 0.2 < sizes["flange"]["max"] < sizes["base"]["max"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "language"), [("ur5e", "urscript"), *(("irb120", each) for each in LANGUAGES if each != "urscript")]
)
@pytest.mark.parametrize("targets", [3, 1])
def test_programs_of_many_hidden_robots(robot: str, language: str, targets: int, tmp_path: Path) -> None:
    """Half of the robots have their targets up to 10 mm from where they are stated.

    Targets of one program err together, so that a share over 20 robots is known to a few per cent. An offset that
    tolerances of the last link explain is not noticed (below about 1.5 mm): one robot in fourteen may have it. Of
    those whose targets are as stated, one in fifty is not believed to be so.
    """
    cell, stated, trials = hidden_cell(tmp_path, robot), [], []
    for seed in range(20):
        rng = np.random.default_rng([seed, targets])
        off_mm = rng.uniform(0, 10) if seed % 2 else 0.0
        done = tried(calibrated_day(cell, 100 + seed, targets, off_mm), tmp_path, language, rng)
        trials.append(done)
        if not off_mm and done.result.reference.flange.turned:
            stated.append(done)
    if targets == 3:
        assert len(stated) >= 8
        assert np.mean([each.after.shape.mean() for each in stated]) < 0.05e-3
        assert max(each.after.shape.max() for each in stated) < 0.12e-3
        assert all(each.within_shape.mean() > 0.9 for each in stated)
    for each in ("within_shape", "within_base"):
        assert np.concatenate([getattr(done, each) for done in trials]).mean() > 0.85
    assert not any(done.after.shape.mean() > done.before.shape.mean() for done in trials)
    assert sum(done.after.true.mean() > done.before.true.mean() for done in trials) <= 1
