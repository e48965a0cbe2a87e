"""The arm as a page draws it: what the script is given is the arm, its points and its errors."""

import base64
import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

import lab
from lab.core.se3 import transform
from lab.report.document import Document, Scene
from lab.report.page import to_html
from lab.report.page_scene import ArmScene, Arrows, coarse, moments, moving_arm, posed_arm, scene_json
from lab.report.scene import MagnifiedEllipsoids


def floats(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), "<f4")


@pytest.fixture(scope="module")
def scene() -> ArmScene:
    robot = lab.load_robot("irb120")
    arm = robot.arm(("p1",))
    joints = arm.chain.random_joints(3, np.random.default_rng(0))
    return posed_arm(robot.model, arm, arm.nominal(robot.tool), joints, ["a", "b<", "c"])


def test_the_script_gets_the_bodies_where_they_are(scene: ArmScene) -> None:
    data = json.loads(scene_json(scene))
    places = floats(data["places"]).reshape(3, len(scene.shells), 4, 4)  # column by column
    for number, shell in enumerate(scene.shells):
        np.testing.assert_allclose(np.swapaxes(places[:, number], 1, 2), scene.bodies[shell.body], atol=1e-6)
    np.testing.assert_allclose(floats(data["points"]).reshape(3, 3), scene.points, atol=1e-6)


def test_coarser_surfaces_stay_near_the_fine_ones(scene: ArmScene) -> None:
    shell = max(scene.shells, key=lambda each: len(each.faces))
    most = len(shell.faces) // 4
    vertices, faces = coarse(shell.vertices, shell.faces, most)
    assert 0 < len(faces) <= most
    size = np.ptp(shell.vertices, axis=0).max()
    assert cKDTree(shell.vertices).query(vertices)[0].max() < 0.1 * size
    np.testing.assert_allclose(vertices.min(axis=0), shell.vertices.min(axis=0), atol=0.1 * size)
    unchanged, all_faces = coarse(shell.vertices, shell.faces, len(shell.faces))
    assert len(all_faces) > len(faces) and len(unchanged) > len(vertices)


def test_errors_and_half_axes_keep_their_lengths(scene: ArmScene) -> None:
    errors = np.array([[1e-3, 0, 0], [0, 2e-3, 0], [np.nan] * 3])
    frames = np.broadcast_to(np.eye(3), (3, 3, 3))
    sizes = np.array([[3e-6, 2e-6, 1e-6]] * 3)
    drawn = replace(
        scene,
        arrows=(Arrows("before", errors, 50.0, (1, 2, 3)),),
        columns={"before": np.array([1e-3, 2e-3, np.nan])},
        ellipsoids=MagnifiedEllipsoids(scene.points, frames, 1e4 * sizes, 1e4),
    )
    data = json.loads(scene_json(drawn))
    (arrows,) = data["arrows"]
    np.testing.assert_allclose(floats(arrows["vectors"]).reshape(3, 3), np.nan_to_num(errors), atol=1e-9)
    assert arrows["factor"] == 50.0
    halves = floats(data["axes"]["halves"]).reshape(3, 3, 3)
    np.testing.assert_allclose(np.linalg.norm(halves, axis=2), 1e4 * sizes, rtol=1e-6)
    assert data["axes"]["lengths"][0] == ["0.00300 mm", "0.00200 mm", "0.00100 mm"]
    assert [row[1] for row in drawn.rows] == ["1.00", "2.00", ""]
    pale, dark = data["colours"][0], data["colours"][1]
    assert sum(pale) > sum(dark)


def test_a_pose_name_ends_no_script(scene: ArmScene) -> None:
    hostile = replace(scene, names=["a", "</script><b>", "c"])
    text = scene_json(hostile)
    assert "<" not in text and json.loads(text)["names"][1] == "</script><b>"
    page = to_html(Document("t", (Scene("arm", lambda: hostile, "An arm."),)))
    assert "</script><b>" not in page


def test_only_a_page_with_a_scene_has_its_script(scene: ArmScene) -> None:
    assert "webgl2" in to_html(Document("t", (Scene("arm", lambda: scene, "An arm."),)))
    assert "webgl2" not in to_html(Document("t", ()))


def test_a_point_of_a_shell_is_where_the_arm_has_it(scene: ArmScene) -> None:
    """An own product of the shell's vertices with the poses that the script is given."""
    data = json.loads(scene_json(scene))
    places = floats(data["places"]).reshape(3, len(scene.shells), 4, 4)
    last = len(scene.shells) - 1
    vertices = floats(data["shells"][last]["vertices"]).reshape(-1, 3)
    homogeneous = np.column_stack([vertices, np.ones(len(vertices))]) @ places[2, last]
    expected = transform(scene.bodies[scene.shells[last].body][2], vertices.astype(float))
    np.testing.assert_allclose(homogeneous[:, :3], expected, atol=1e-5)


def test_a_motion_stops_where_the_arm_is_at_its_poses(scene: ArmScene) -> None:
    """Of more moments than a page shows some are left out, but for the stops."""
    model = lab.load_robot("irb120").model
    arm = lab.load_robot("irb120").arm(("p1",))
    values, times = arm.nominal({"p1": np.array([0.03, 0.02, 0.1])}), np.linspace(0, 5, 1001)
    joints = np.sin(times[:, None] * np.arange(1, 7) / 3)
    stops = (0, 333, 1000)
    moving = moving_arm(model, arm, values, joints, times, stops, ["a", "b", "c"])
    shown = moments(1001, stops)
    assert 400 <= len(shown) <= 402 and set(stops) <= set(shown.tolist())
    np.testing.assert_array_equal(times[shown][moving.stops], times[list(stops)])
    there = posed_arm(model, arm, values, joints[list(stops)], ["a", "b", "c"])
    np.testing.assert_allclose(moving.points, there.points, atol=1e-12)
    for body, poses in there.bodies.items():
        np.testing.assert_allclose(moving.bodies[body][moving.stops], poses, atol=1e-12)
    data = json.loads(scene_json(moving))
    assert data["stops"] == moving.stops.tolist() and len(data["times"]) == len(shown) and moving.slider[0] == "time"
    (path,) = data["lines"]
    np.testing.assert_allclose(floats(path["points"]).reshape(-1, 3)[moving.stops], there.points, atol=1e-6)
    assert scene.slider == ("pose", 2)
