"""Errors of an arm at its poses: one magnification for all kinds, and nothing where nothing was measured."""

import numpy as np
import pytest
from helpers.recordings import column, statics

from lab.campaign.robot import load_robot
from lab.commands.error_recording import ErrorScene, PointErrors, record_errors
from lab.core import se3
from lab.render.document import Document
from lab.render.style import RGB_AFTER, RGB_BEFORE

pytestmark = pytest.mark.usefixtures("strict_recordings")


def test_kinds_share_a_magnification_and_gaps_stay_gaps(tmp_path) -> None:
    robot, rng = load_robot("scara"), np.random.default_rng(1)
    arm = robot.arm(("p1",))
    values, joints = arm.nominal({"p1": np.array([0.0, 0.0, -0.1])}), arm.chain.random_joints(4, rng)
    values[:6] = [0.4, -0.2, 0.1, 0.3, -0.5, 0.2]  # the base, seen from the instrument
    points = arm.points(joints, values)
    points[2] = np.nan
    kinds = [
        PointErrors(name, "from a to b", colour, name, size * rng.normal(size=points.shape))
        for name, colour, size in (("large", RGB_BEFORE, 1e-3), ("small", RGB_AFTER, 1e-4))
    ]
    scene = ErrorScene(
        robot.model, arm, values, joints, "abcd", points, "points", kinds, np.array([1e-5, 2e-5, np.nan, 1e-5])
    )
    path = tmp_path / "recording.rrd"
    record_errors(path, robot.name, "0" * 32, scene, Document("Errors", ()))
    labels = [statics(path, f"/world/errors/{each.name}/factor", "Points3D:labels")[0] for each in kinds]
    assert labels[0].removeprefix("large") == labels[1].removeprefix("small")
    factor = float(labels[0].split("×")[1].replace(",", ""))
    for each in kinds:
        rows, vectors = column(path, f"/world/errors/{each.name}", "Arrows3D:vectors")
        lengths = [np.linalg.norm(vector[0]) / factor for vector in vectors if vector]
        assert rows == [0, 1, 2, 3] and not vectors[2]
        turned = se3.exp(values[3:6]).T @ each.vectors[0, 0]  # into frame 0, which stands upright in the world
        np.testing.assert_allclose(np.array(vectors[0][0]) / factor, turned, rtol=1e-4)
        np.testing.assert_allclose(lengths, np.linalg.norm(each.vectors[[0, 1, 3], 0], axis=1), rtol=1e-5)
    rows, radii = column(path, "/world/magnified/expected", "Ellipsoids3D:half_sizes")
    assert rows == [0, 1, 3] and np.ptp(np.array(radii)[0, 0]) == 0
    np.testing.assert_allclose(np.array(radii)[1, 0, 0] / np.array(radii)[0, 0, 0], 2, rtol=1e-6)
    assert column(path, "/world/magnified/name", "Points3D:labels")[1] == [["a"], ["b"], ["d"]]
