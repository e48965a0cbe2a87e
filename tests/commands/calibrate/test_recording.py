from dataclasses import replace

import numpy as np
import pytest
from helpers.campaigns import TWO, calibration, session
from helpers.recordings import FLOAT32, column, in_world, needs_vulkan, rrd, statics, views_of
from helpers.robots import ROOT

import lab
from lab.calibration.identification import identify
from lab.core import se3
from lab.core.number_text import format_magnification
from lab.kinematics.serial.serial_arm import SerialArm
from lab.prediction.ellipsoids import ellipsoids, mapping_ellipsoids, position_covariance
from lab.report.scene import MOST_POSES, drawn_rows, magnification
from lab.report.views.calibration_recording import record
from lab.report.views.calibration_scene import scene
from lab.simulation.load_model import load_model
from lab.simulation.meshes import body_poses, shells
from lab.simulation.robot_model import FLANGE

pytestmark = pytest.mark.usefixtures("strict_recordings")


@pytest.mark.thorough
def test_rerun_verifies_it(recording, home):
    done = rrd(home, "verify", recording)
    assert done.returncode == 0, done.stderr
    assert recording.stat().st_size < 4e6


def test_every_pose_is_there(recording, outcome):
    n = len(outcome.fitted)
    for entity, name in [
        ("/world/arm/link3", "Transform3D:translation"),
        ("/world/targets/measured", "Points3D:positions"),
        ("/world/errors/before", "Arrows3D:vectors"),
        ("/world/ellipsoid/mapping/axes", "Arrows3D:vectors"),
        ("/world/ellipsoid/uncertainty/shape", "Ellipsoids3D:half_sizes"),
        ("/error_log10_mm/after", "Scalars:scalars"),
    ]:
        assert column(recording, entity, name)[0] == list(range(n)), entity


def test_points_are_where_they_were_measured_and_predicted(recording, outcome):
    fitted, identification = outcome.fitted, outcome.identification
    expected = {
        "measured": fitted.points,
        "predicted_before": identification.model.points(fitted.joints, identification.nominal_aligned),
        "predicted_after": identification.model.points(fitted.joints, identification.values),
    }
    for name, points in expected.items():
        read = np.array(column(recording, f"/world/targets/{name}", "Points3D:positions")[1])
        world = in_world(outcome, points.reshape(-1, 3)).reshape(points.shape)
        np.testing.assert_allclose(read, world, rtol=0, atol=2 * FLOAT32)  # m, of about 1 m


@pytest.mark.parametrize("name", ["mapping", "uncertainty"])
def test_ellipsoids_are_those_computed(recording, outcome, name):
    fitted, identification = outcome.fitted, outcome.identification
    shapes = (
        mapping_ellipsoids(identification, fitted.joints)
        if name == "mapping"
        else ellipsoids(position_covariance(identification, fitted.joints))
    )
    factor = getattr(scene(outcome), name).factor
    label = statics(recording, f"/world/ellipsoid/{name}/factor", "Points3D:labels")
    assert label == [format_magnification(factor)]
    entity = f"/world/ellipsoid/{name}"
    halves = np.array(column(recording, f"{entity}/shape", "Ellipsoids3D:half_sizes")[1])[:, 0]
    np.testing.assert_allclose(halves, factor * shapes.half_lengths, rtol=FLOAT32, atol=0)
    axes = np.array(column(recording, f"{entity}/axes", "Arrows3D:vectors")[1])  # (n, 3 axes, 3)
    rotation = in_world(outcome, np.eye(3)) - in_world(outcome, np.zeros((1, 3)))  # rows: the tracker's axes
    expected = factor * np.swapaxes(shapes.axes * shapes.half_lengths[:, None, :], 1, 2) @ rotation
    np.testing.assert_allclose(axes, expected, rtol=0, atol=FLOAT32)  # m, of about 0.1 m
    quaternions = np.array(column(recording, f"{entity}/shape", "Ellipsoids3D:quaternions")[1])[:, 0]  # xyzw
    turned = se3.rotation_from_quaternion(quaternions[:, [3, 0, 1, 2]])
    np.testing.assert_allclose(turned * halves[:, None, :], np.swapaxes(axes, 1, 2), rtol=0, atol=4 * FLOAT32)
    centers = np.array(column(recording, f"{entity}/shape", "Ellipsoids3D:centers")[1])[:, 0]
    targets = identification.model.points(fitted.joints, identification.values)[:, 0]
    np.testing.assert_allclose(centers, in_world(outcome, targets), rtol=0, atol=2 * FLOAT32)


def test_the_way_through_a_plan_is_the_arms(recording, tmp_path):
    """From pose to pose with all joints moving together, as the arm does: no straight chord."""
    lab.write_measurements(tmp_path / "plan.csv", session(seed=4, poses=12).measurements)
    outcome = lab.calibrate("irb120", seed=4, plan=tmp_path / "plan.csv")
    record(tmp_path / "planned.rrd", outcome)
    (strip,) = statics(tmp_path / "planned.rrd", "/world/path", "LineStrips3D:strips")
    arm, values = outcome.rigid(outcome.identification.values)
    middle = (outcome.fitted.joints[2] + outcome.fitted.joints[3]) / 2  # halfway of a move
    halfway = in_world(outcome, arm.points(middle[None], values)[:, 0])
    assert np.linalg.norm(np.array(strip) - halfway, axis=1).min() < 1e-5
    with pytest.raises(AssertionError):  # of random poses
        statics(recording, "/world/path", "LineStrips3D:strips")


def test_the_arrows_are_the_errors_times_the_factor_shown(recording, outcome):
    shown, fitted, identification = scene(outcome), outcome.fitted, outcome.identification
    for entity, name, values, factor in (
        ("errors/before", "before", identification.nominal_aligned, shown.factor_before),
        ("errors/after", "after", identification.values, shown.factor_before),  # one factor: lengths can be compared
        ("magnified/after", "after", identification.values, shown.factor_after),
    ):
        vectors = np.array(column(recording, f"/world/{entity}", "Arrows3D:vectors")[1])[:, 0]
        predicted = identification.model.points(fitted.joints, values)[:, 0]
        errors = in_world(outcome, fitted.points[:, 0]) - in_world(outcome, predicted)  # measured less predicted
        np.testing.assert_allclose(vectors, factor * errors, rtol=1e-6, atol=factor * 1e-14)
        lengths = np.linalg.norm(fitted.points[:, 0] - predicted, axis=1)
        assert statics(recording, f"/world/{entity}/factor", "Points3D:labels") == [
            f"{name} {format_magnification(factor)}"
        ]
        logarithms = np.array(column(recording, f"/error_log10_mm/{name}", "Scalars:scalars")[1])[:, 0]
        np.testing.assert_allclose(10**logarithms, 1e3 * lengths, rtol=1e-12)  # scalars are float64


def test_the_drawn_hand_carries_the_predicted_targets(outcome):
    """The shells stand as the identified arm does, to rounding: the flange and the tool give the points."""
    identification, robot = outcome.identification, outcome.robot.model
    arm, joints = identification.model, outcome.fitted.joints
    carrier = robot.model.body(int(robot.model.site(FLANGE).bodyid[0])).name
    Ts_world_flange = body_poses(robot, arm, identification.values, joints)[carrier]
    drawn = se3.transform(Ts_world_flange, arm.split(identification.values)[2])[:, 0]
    np.testing.assert_allclose(drawn, in_world(outcome, arm.points(joints, identification.values)[:, 0]), atol=1e-12)


@pytest.mark.thorough
def test_unseen_targets_are_left_out(tmp_path, home):
    outcome = calibration(seed=3, targets=TWO)
    points = outcome.fitted.points.copy()
    points[4], points[5, 0], points[6, 1] = np.nan, np.nan, np.nan
    fitted = replace(outcome.fitted, points=points)
    arm = outcome.robot.arm(fitted.targets)
    identification = identify(arm, fitted, arm.nominal(outcome.robot.tool))
    path = tmp_path / "unseen.rrd"
    fitter = replace(outcome.state.fitter, data=fitted)
    state = replace(outcome.state, rows=fitted, identification=identification, fitter=fitter)
    record(path, replace(outcome, state=state))
    assert rrd(home, "verify", path).returncode == 0
    for entity, name in (
        ("/world/targets/measured", "Points3D:positions"),
        ("/world/errors/after", "Arrows3D:vectors"),
    ):
        index, rows = column(path, entity, name)
        assert index == list(range(50))
        assert [len(row or []) for row in rows] == [2, 2, 2, 2, 0, 1, 1, *[2] * 43]
        assert np.isfinite(np.concatenate([row for row in rows if row])).all()
    assert 4 not in column(path, "/error_log10_mm/after", "Scalars:scalars")[0]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("poses", [9, 50])
def test_without_noise_known_or_estimated_there_is_no_uncertainty(tmp_path, home, poses):
    """Nine poses of one target give as many equations as parameters: sigma stays unknown; with 50 it is zero."""
    outcome = calibration(seed=1, poses=poses, instrument="exact")
    sigma = outcome.identification.sigma_m
    assert np.isnan(sigma) if poses == 9 else sigma < 1e-12
    path = tmp_path / "unknown.rrd"
    record(path, outcome)
    assert rrd(home, "verify", path).returncode == 0
    assert column(path, "/world/ellipsoid/uncertainty/axes", "Arrows3D:vectors") == ([], [])
    assert len(column(path, "/world/ellipsoid/mapping/axes", "Arrows3D:vectors")[0]) == poses


@pytest.mark.thorough
@needs_vulkan
def test_no_view_complains(recording, home):
    """Opened headless, every view of the blueprint shows its content without a warning."""
    views = views_of(recording, home)
    shown = {view.name.partition(" ×")[0] for view in views}
    assert shown >= {"Error after calibration", "Uncertainty (1σ)", "Summary", "Program"} and len(views) == 10
    assert [(view.name, view.reports) for view in views if view.reports] == []


@pytest.mark.parametrize("convention", ["distal", "craig"])
def test_a_chain_is_drawn_along_its_offsets(convention):
    """Every stretch of the strip is as long as its d or a, a slide's with its reading."""
    chain = load_model(ROOT / "models" / "irb120" / "scene.xml").chain
    rng = np.random.default_rng(5)
    table = rng.uniform(-1, 1, (6, 5))
    slides = (False, True, False, False, True, False)
    chain = replace(chain, convention=convention, table=table, prismatic=slides, parallel=(True,) * 6)
    joints = chain.random_joints(20, rng)
    strip = SerialArm(chain).corners(joints, SerialArm(chain).nominal())
    assert strip.shape == (20, 13, 3)
    along = np.abs(table[:, 1] + np.where(chain.prismatic, joints * chain.sign, 0.0))
    common = np.broadcast_to(np.abs(table[:, 2]), along.shape)
    lengths = np.linalg.norm(np.diff(strip, axis=1), axis=2)
    first, second = (along, common) if convention == "distal" else (common, along)
    np.testing.assert_allclose(lengths[:, ::2], first, atol=1e-12)
    np.testing.assert_allclose(lengths[:, 1::2], second, atol=1e-12)


def test_magnifications_are_round_and_near():
    for length in np.geomspace(1e-9, 10, 200):
        factor = magnification(length, 0.1)
        assert f"{factor:.0e}"[0] in "125"
        assert abs(np.log10(factor * length / 0.1)) <= np.log10(5 / 2) / 2 + 1e-9
    assert magnification(0.0, 0.1) == magnification(float("nan"), 0.1) == 1.0


def test_drawn_rows_span_all_poses():
    assert drawn_rows(7).tolist() == list(range(7))
    rows = drawn_rows(2773)
    assert len(rows) == MOST_POSES == len(set(rows.tolist())) and (rows[0], rows[-1]) == (0, 2772)


SHAPES = """<mujoco><worldbody><body name="a"><joint name="j"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<geom type="box" size="1 2 3" pos="9 0 0" quat="1 1 0 0"/></body>
<body name="b"><geom type="cylinder" size="1 2"/></body>
<body name="c"><geom type="capsule" size="1 2"/></body><body name="d"><geom type="sphere" size="2"/></body>
<body name="e"><geom type="ellipsoid" size="1 2 3"/></body><geom type="plane" size="1 1 1"/></worldbody></mujoco>"""


def test_shells_enclose_their_geoms(tmp_path):
    """The volume within the triangles, which are turned outward, is the primitive's, less what the facets cut off."""
    (tmp_path / "shapes.xml").write_text(SHAPES, encoding="utf-8")
    found = {shell.body: shell for shell in shells(load_model(tmp_path / "shapes.xml"))}
    ball = 4 / 3 * np.pi
    for body, volume in {"a": 48, "b": 4 * np.pi, "c": 4 * np.pi + ball, "d": 8 * ball, "e": 6 * ball}.items():
        shell = found.pop(body)
        corners = shell.vertices.astype(np.float64)[shell.faces]
        inside = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
        assert 0.98 * volume < inside < (1 + 1e-6) * volume, body
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        assert (np.einsum("fi,fi->f", normal, shell.normals[shell.faces].mean(axis=1)) > -1e-6).all(), body
        np.testing.assert_allclose(np.linalg.norm(shell.normals, axis=1), 1, atol=1e-6)
    assert not found


@pytest.mark.thorough
def test_poses_that_are_off_are_marked_and_keep_their_numbers(tmp_path, home):
    """What is left out is drawn where it was measured; the others stand at their rows of the file."""
    outcome = calibration(seed=2, bad_share=0.08, bad_mm=(5.0, 50.0), robust=True)
    assert len(outcome.state.outliers) >= 2 and {pose.id for pose in outcome.state.outliers} == set(
        outcome.truth.outliers
    )
    path = tmp_path / "off.rrd"
    record(path, outcome)
    assert rrd(home, "verify", path).returncode == 0
    index, _ = column(path, "/world/targets/measured", "Points3D:positions")
    assert index == [int(name) for name in outcome.fitted.ids] and len(index) == 50 - len(outcome.truth.outliers)
    shown = scene(outcome)
    for pose, named in zip(shown.outliers, outcome.state.outliers, strict=True):
        assert np.linalg.norm(pose.measured - pose.expected) == pytest.approx(named.size_m, rel=1e-3)
