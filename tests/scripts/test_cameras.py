"""The studies of cameras, at a size that runs in seconds; those that need more than the lab skip without it."""

from importlib.util import find_spec
from pathlib import Path

import pytest
from camera_and_tracker import Options as TogetherOptions
from camera_and_tracker import answer as together
from camera_coverage import Options as CoverageOptions
from camera_coverage import answer as coverage
from camera_detection import Options as DetectionOptions
from camera_detection import one_set
from hand_eye import Options as HandEyeOptions
from hand_eye import answer as hand_eye
from helpers.robots import UNLICENSED
from public_camera_set import Options as PublicOptions
from public_camera_set import answer as public_set

from lab.core.errors import LabError

pytestmark = pytest.mark.thorough
PUBLIC = UNLICENSED / "robot_arm_w_color_camera_real.zip"


@pytest.mark.parametrize("case", ["hand", "tracker"])
def test_campaigns_are_exact_without_noise_and_cover_the_truth(case: str) -> None:
    found = coverage(CoverageOptions(campaigns=6, exact=1, cases=(case,))).values[case]
    assert found["noise_free_error_largest"] < 1e-9 and 0.85 < found["coverage_mean"] <= 1
    assert 0.5 < found["nees_per_parameter"] < 1.7


def test_an_unknown_case_is_refused() -> None:
    with pytest.raises(LabError, match="--cases nothing: unknown"):
        coverage(CoverageOptions(cases=("nothing",)))


def test_a_camera_shows_the_links_and_a_board_their_size() -> None:
    ranks = together(TogetherOptions(campaigns=0)).values["ranks"]
    assert ranks["camera, known board"][1:] == ranks["tracker, points"][1:] == [18, 8]
    assert ranks["camera, board of unknown size"][1:] == [17, 7]


def test_the_fit_of_all_corners_is_better_than_closed_forms() -> None:
    methods = hand_eye(HandEyeOptions(sets=5)).values["methods"]
    assert all(each["mean_ratio_position"] < 0.5 for name, each in methods.items() if name != "fit of all corners")


@pytest.mark.skipif(find_spec("cv2") is None, reason="OpenCV is not installed")
def test_an_arm_is_identified_from_rendered_pictures(tmp_path: Path) -> None:
    found = one_set(DetectionOptions(poses=16), 1, "charuco", tmp_path)
    assert found["corners_found"] > 0.8 and found["after_mm"] < 0.2 * found["before_mm"]


@pytest.mark.skipif(not PUBLIC.is_file(), reason="the public set is not beside the checkout")
def test_a_public_set_is_identified() -> None:
    found = public_set(PublicOptions(data=PUBLIC, pictures=100)).values
    assert found["reprojection_rms_px"] < 1.0 and found["across_mm"] < 3


def test_a_missing_set_is_named(tmp_path: Path) -> None:
    with pytest.raises(LabError, match="there is no such file"):
        public_set(PublicOptions(data=tmp_path / "none.zip"))
