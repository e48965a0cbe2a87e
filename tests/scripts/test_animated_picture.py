"""The animated picture of the README: what its file holds, and what its frames show."""

from pathlib import Path

import numpy as np
import pytest
from animated_picture import (
    COMMAND,
    DATA,
    DESCRIPTION,
    FRAME_MS,
    FRAMES,
    SIZE,
    Options,
    Scene,
    answer,
    drawn,
    frame_figure,
    shrunk,
)
from helpers.pages import README
from helpers.robots import ROOT
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

import lab
from lab.core.errors import LabError

SHOWN_WIDE, SMALLEST = 800, 14  # pixels of a page, and of its text


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Errors of 1 mm that a calibration makes a tenth, on an arm that moves a little."""
    robot, rng = lab.load_robot("ur5"), np.random.default_rng(3)
    arm = robot.arm(("p1",))
    values = arm.nominal(robot.tool)
    joints = np.linspace(0.2, 0.6, FRAMES)[:, None] * np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0])
    before = rng.normal(size=(120, 3))
    before *= 1e-3 / np.linalg.norm(before, axis=1, keepdims=True)
    points = arm.points(rng.uniform(-1, 1, (120, 6)), values)[:, 0]
    return Scene(robot, arm, values, points, before, before / 10, joints, "a headline")


def test_the_file_is_small_moves_for_six_seconds_and_names_its_command() -> None:
    path = ROOT / "docs" / "pictures" / "real_arm.webp"
    assert path.stat().st_size <= 1.5e6 and "docs/pictures/real_arm.webp" in README.text
    with Image.open(path) as picture:
        assert (picture.size, picture.n_frames) == (SIZE, FRAMES) and picture.info["loop"] == 0
        assert picture.getexif()[DESCRIPTION].splitlines()[0] == COMMAND
    assert 5.5 <= FRAMES * FRAME_MS / 1000 <= 6.5
    assert f".venv/bin/{COMMAND}".replace(DATA, Path(DATA).name) in README.text  # which `lab example` writes there


@pytest.mark.figures
@pytest.mark.parametrize("number", [0, FRAMES // 2, FRAMES - 1])
def test_its_text_can_be_read_and_stays_in_the_picture(scene: Scene, number: int) -> None:
    figure = frame_figure(scene, number)
    renderer = FigureCanvasAgg(figure).get_renderer()
    for text in figure.texts:
        assert text.get_fontsize() * figure.dpi / 72 * SHOWN_WIDE / SIZE[0] >= SMALLEST, text.get_text()
        box = text.get_window_extent(renderer)
        assert box.x0 >= 0 and box.x1 <= SIZE[0] and box.y0 >= 0 and box.y1 <= SIZE[1], text.get_text()


@pytest.mark.figures
def test_the_number_beside_the_arrows_is_the_mean_of_their_errors(scene: Scene) -> None:
    for number in (0, FRAMES // 2, FRAMES - 1):
        texts = [text.get_text() for text in frame_figure(scene, number).texts]
        (shown,) = (float(text.removesuffix(" mm")) for text in texts if text.endswith(" mm"))
        assert shown == pytest.approx(1 - 0.9 * shrunk(number), rel=0.05)
        assert "arrows: errors × 100" in texts  # 1 mm is drawn as 100 mm
    assert [shrunk(0), shrunk(FRAMES - 1)] == [0, 1] and 0 < shrunk(FRAMES // 2) < 1
    assert np.all(np.diff([shrunk(number) for number in range(FRAMES)]) >= 0)


@pytest.mark.thorough
@pytest.mark.figures
def test_arrows_shrink_and_a_frame_is_the_same_each_time(scene: Scene) -> None:
    first, again, last = (np.asarray(drawn(scene, number)).astype(int) for number in (0, 0, FRAMES - 1))
    assert (first == again).all()
    vermilion = [int(((each[..., 0] > 180) & (each[..., 2] < 60)).sum()) for each in (first, last)]
    assert vermilion[0] > 5000 > 10 > vermilion[1]


def test_a_place_that_is_none_is_told(tmp_path, scene: Scene, monkeypatch) -> None:
    monkeypatch.setattr("animated_picture.measured_scene", lambda: scene)
    monkeypatch.setattr("animated_picture.FRAMES", 1)
    with pytest.raises(LabError, match="cannot be written"):
        answer(Options(tmp_path / "none" / "picture.webp"))
