"""A virtual arm shows whole counts where its table names encoders, and the identification knows what they make."""

from pathlib import Path

import numpy as np
import pytest
from helpers.robots import ROOT

import lab
from lab.core.errors import LabError
from lab.formats.noise_model import noise_model_from_dict
from lab.kinematics.effects.effect_registry import EFFECTS
from lab.kinematics.effects.readings import EncoderCounts, EncoderRounding

DRIVES = "".join(f"\n[[drive]]\ngear_ratio = {gear}\ncounts_per_turn = 1000\n" for gear in (48, 48, 50, -46, 45, 32))
COUPLING = "\n[[coupling]]\ndrive = 6\njoint = 5\nratio = 32\n"


@pytest.fixture
def tx40(tmp_path: Path) -> Path:
    """A TX 40 whose table names coarse encoders; the drive of joint 6 turns with joint 5."""
    table = (ROOT / "models" / "tx40" / "robot.toml").read_text()
    path = tmp_path / "tx40.toml"
    path.write_text(table + DRIVES + COUPLING)
    return path


def test_joint_positions_are_whole_counts(tx40: Path) -> None:
    coarse, ideal = (lab.simulate(robot, poses=30, seed=1, instrument="exact") for robot in (tx40, "tx40"))
    encoders = coarse.robot.chain.encoders
    assert encoders is not None and ideal.robot.chain.encoders is None
    np.testing.assert_array_equal(coarse.measurements.joints, encoders.rounded(ideal.measurements.joints))
    np.testing.assert_array_equal(coarse.measurements.points, ideal.measurements.points)  # the arm stands as it stood
    assert 1e-5 < np.abs(coarse.measurements.joints - ideal.measurements.joints).max() < 2e-4
    assert isinstance(coarse.true_robot.effects.part(EncoderCounts), EncoderCounts) and EncoderRounding in EFFECTS


@pytest.mark.thorough
def test_known_counts_are_weighed_and_are_no_lack_of_fit(tx40: Path, tmp_path: Path) -> None:
    """Errors in variables that the table explains: no search for scatter, no lack of fit; without the table both.

    The error is predicted, and kept for another day, with the counts.
    """
    day = lab.simulate(tx40, poses=40, seed=2, targets=("p1", "p2", "p3"))
    known = lab.identify(day.measurements, robot=tx40, validate=day.validation)
    said = known.to_dict()
    assert known.state.noise.shared.is_given and said["adequate"]
    assert said["noise_mm"] == pytest.approx(0.008 / np.sqrt(3), rel=0.1)
    assert said["after_mm"]["rms"] < 2 * said["predicted_mm"]
    shared = noise_model_from_dict(said["noise_model"], {})
    np.testing.assert_array_equal(shared.counts_rad, known.state.noise.shared.counts_rad)
    np.testing.assert_allclose(
        shared.joint_covariance(6), known.robot.chain.encoders.covariance, rtol=1e-12, atol=1e-25
    )
    blind = lab.identify(day.measurements, robot="tx40", validate=day.validation, instrument="uniform-8um").to_dict()
    assert blind["adequate"] is False and blind["noise_model"]["joint_scatter_mrad"] > 0


def test_a_calibrated_table_keeps_its_encoders(tx40: Path, tmp_path: Path) -> None:
    robot = lab.load_robot(tx40)
    path = tmp_path / "calibrated.toml"
    path.write_text(robot.description("calibrated.toml", ("p1",), robot.arm(("p1",)).nominal(robot.tool)))
    kept, given = lab.load_robot(path).chain.encoders, robot.chain.encoders
    assert kept is not None and given is not None
    np.testing.assert_allclose(kept.counts, given.counts, rtol=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("counts_per_turn = 1000", "counts_per_turn = 0", "counts_per_turn is 0; give the counts of one motor turn"),
        ("counts_per_turn = 1000\n", "", r"\[\[drive\]\] 1 has no counts_per_turn; give it for all drives or for none"),
        ("\n[[drive]]\ngear_ratio = 32\ncounts_per_turn = 1000\n", "", r"5 \[\[drive\]\], but the robot has 6 joints"),
        ("joint = 5", "joint = 7", "give a number from 1 to 6"),
    ],
)
def test_what_cannot_be_is_refused(tx40: Path, old: str, new: str, what: str) -> None:
    tx40.write_text(tx40.read_text().replace(old, new, 1))
    with pytest.raises(LabError, match=what):
        lab.load_robot(tx40)
