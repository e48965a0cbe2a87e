"""Cameras and boards: projection, closed forms, and the files that describe them."""

from pathlib import Path

import numpy as np
import pytest

from lab.core import se3
from lab.core.errors import LabError
from lab.extensions.cameras.closed_forms import board_poses, hand_eye, mean_pose, robot_world
from lab.extensions.cameras.geometry import INTRINSICS, distorted, projected, sight_lines
from lab.extensions.cameras.rig import PX, Board, Camera, Rig, read_rig

LENS = np.array([1.2, 1.3, 0.64, 0.48, -0.2, 0.1, 0.001, -0.002, 0.03])
STEP = 1e-30


def poses(rng: np.random.Generator, count: int, turn: float = 1.0) -> np.ndarray:
    return se3.pose(se3.exp(turn * rng.standard_normal((count, 3))), rng.standard_normal((count, 3)))


def test_derivatives_of_the_projection_are_those_of_complex_steps() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.3, 0.3, (20, 2)), rng.uniform(0.5, 1, 20)])
    _, by_point, by_lens = projected(points, LENS)
    for j in range(3):
        moved = points + 1j * STEP * np.eye(3)[j]
        np.testing.assert_allclose(projected(moved, LENS)[0].imag / STEP, by_point[..., j], atol=1e-13)
    for j in range(len(INTRINSICS)):
        moved = LENS + 1j * STEP * np.eye(len(LENS))[j]
        np.testing.assert_allclose(projected(points, moved)[0].imag / STEP, by_lens[..., j], atol=1e-13)


def test_distortion_is_removed_again_and_without_terms_is_none() -> None:
    flat = np.random.default_rng(1).uniform(-0.4, 0.4, (30, 2))
    np.testing.assert_array_equal(distorted(flat, np.zeros((30, 5)))[0], flat)
    places = projected(np.column_stack([flat, np.ones(30)]), LENS)[0]
    np.testing.assert_allclose(sight_lines(places, LENS), flat, atol=1e-14)
    assert np.abs((places - LENS[2:4]) / LENS[:2] - flat).max() > 0.01


@pytest.mark.parametrize("flat_board", [True, False])
def test_a_board_is_placed_exactly_also_where_corners_are_missing(flat_board: bool) -> None:
    rng = np.random.default_rng(2)
    corners = Board().corners.copy()
    if not flat_board:
        corners[:, 2] = 0.02 * rng.standard_normal(len(corners))
    Ts = se3.pose(se3.exp(0.4 * rng.standard_normal((8, 3))), [-0.08, -0.05, 0.5] + 0.05 * rng.standard_normal((8, 3)))
    points = corners @ np.swapaxes(Ts[:, :3, :3], 1, 2) + Ts[:, None, :3, 3]
    seen = points[..., :2] / points[..., 2:]
    seen[rng.random(seen.shape[:2]) < 0.5] = np.nan
    found, residual = board_poses(corners, seen)
    np.testing.assert_allclose(found, Ts, atol=1e-12)
    assert residual.max() < 1e-12
    lost, _ = board_poses(corners, np.where(np.arange(len(corners))[:, None] < 3, seen, np.nan))
    assert np.isnan(lost).any(axis=(1, 2)).all()


def test_closed_forms_of_cameras_in_the_hand_are_exact() -> None:
    rng = np.random.default_rng(3)
    X, Z = poses(rng, 2)
    As = poses(rng, 8)
    Bs = se3.inverse(Z) @ As @ X
    found_x, found_z = robot_world(As, Bs)
    np.testing.assert_allclose(found_x, X, atol=1e-12)
    np.testing.assert_allclose(found_z, Z, atol=1e-12)
    np.testing.assert_allclose(hand_eye(As, Bs), X, atol=1e-12)
    np.testing.assert_allclose(mean_pose(np.stack([X, X])), X, atol=1e-15)


def test_corners_lie_where_the_kind_of_board_has_them() -> None:
    board = Board(kind="checkerboard", columns=3, rows=2, square_mm=20.0)
    np.testing.assert_allclose(board.corners[4], [0.02, 0.02, 0.0])
    tags = Board(kind="apriltag", columns=2, rows=1, tag_mm=30.0, gap_mm=10.0)
    np.testing.assert_allclose(1e3 * tags.corners[4:], [[40, 0, 0], [70, 0, 0], [70, 30, 0], [40, 30, 0]])
    own = Board(kind="points", points_mm=((0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3)))
    np.testing.assert_allclose(1e3 * own.corners[3], [0, 0, 3])


def test_numbers_of_corners_lead_back_to_camera_board_and_corner() -> None:
    rig = Rig((Camera(name="a"), Camera(name="b")), (Board(name="c"), Board(name="d", columns=4, rows=3)))
    for camera, board, corner in ((0, 0, 53), (1, 0, 0), (1, 1, 11)):
        number = rig.number(camera, board, corner)
        assert tuple(int(each[0]) for each in rig.parts(np.array([number]))) == (camera, board, corner)


def test_a_file_is_read(tmp_path: Path) -> None:
    file = tmp_path / "cameras.toml"
    file.write_text(
        '[[camera]]\nname = "wall"\nfixed_to = "world"\nfocal_px = [900, 910.5]\nintrinsics = "prior"\n'
        '[[board]]\nfixed_to = "hand"\nkind = "apriltag"\ncolumns = 2\nrows = 1\n[simulated]\nnoise_px = 0.3\n'
    )
    rig = read_rig(file)
    assert rig.cameras[0].name == "wall" and rig.boards[0].kind == "apriltag" and rig.simulated.noise_px == 0.3
    np.testing.assert_allclose(PX.of(rig.cameras[0].intrinsic_values[:2]), [900, 910.5])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[[camera]]\n', "no boards"),
        ('[[camera]]\nfocal_px = [0, 1]\n[[board]]\n', "focal_px"),
        ('[[camera]]\nfocal_px = [1200]\n[[board]]\n', "focal_px has 1 numbers; give 2"),
        ('[[camera]]\n[[camera]]\n[[board]]\n', "two cameras are called 'camera'"),
        ('[[camera]]\n[[board]]\ncolumns = 54\nrows = 1\n', "lie on a line"),
        ('[[camera]]\n[[board]]\ncolumns = 2\nrows = 1\n', "at least 4"),
        ('[[camera]]\nposition_mm = [0, 0, 0]\n[[board]]\n', "give both"),
        ('[[camera]]\n[[board]]\n[simulated]\nmissed = 1.5\n', "shares"),
        ('[[camera]]\nlens = "wide"\n[[board]]\n', "'lens' is no option"),
        ('camera = 3\n', "list of tables"),
        ('[room]\nx = 1\n', "room: unknown"),
    ],
)  # fmt: skip
def test_a_file_that_makes_no_sense_is_refused_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "cameras.toml"
    file.write_text(text)
    with pytest.raises(LabError) as refusal:
        read_rig(file)
    assert said in str(refusal.value) and str(file) in str(refusal.value) and "\n" not in str(refusal.value)
