"""The recording of corrected targets: where its places stand, how they are magnified, and what it says."""

from dataclasses import replace

import numpy as np
import pytest
from closed_loop import PATH_POINTS, close_loop, reachable_cube
from closed_loop_recording import HOLD, loop_scene, record_loop
from helpers.recordings import FLOAT32, column, in_world, needs_vulkan, rrd, statics, views_of

from lab.commands.calibrate.run import VirtualCampaign, calibrate
from lab.compensation.iso9283 import CYCLES, accuracy, cube_positions, repeatability
from lab.core import se3
from lab.core.errors import LabError
from lab.noise.instruments import instrument
from lab.render.document import format_magnification
from lab.render.style import RGB_AFTER, RGB_BEFORE
from lab.simulation.meshes import body_poses
from lab.simulation.model import FLANGE

pytestmark = pytest.mark.usefixtures("strict_recordings")

TARGETS = 20
STEPS = [*range(2 * PATH_POINTS), *range(2 * PATH_POINTS, 2 * PATH_POINTS + 5 * HOLD, HOLD)]


@pytest.fixture(scope="module")
def outcome():
    return calibrate(VirtualCampaign(seed=7, poses=30))


@pytest.fixture(scope="module")
def loop(outcome):
    return close_loop(outcome, reachable_cube(outcome.robot, "p1"), instrument("uniform-8um"), 7, targets=TARGETS)


@pytest.fixture(scope="module")
def recording(outcome, loop, tmp_path_factory):
    path = tmp_path_factory.mktemp("loop") / "loop.rrd"
    record_loop(path, outcome, loop)
    return path


def courses(loop):
    return {"circle": loop.circle, "line": loop.line, "poses": loop.poses}


def magnified(outcome, course, when, factor):
    """Where a place is drawn, worked out in the tracker's frame."""
    mean = getattr(course, when).mean(axis=0)
    return in_world(outcome, course.wanted + factor * (mean - course.wanted))


@pytest.mark.thorough
def test_rerun_verifies_it(recording, home):
    done = rrd(home, "verify", recording)
    assert done.returncode == 0, done.stderr
    assert recording.stat().st_size < 4e6


@pytest.mark.thorough
def test_every_step_is_there(recording):
    for entity, name in [
        ("/world/arm/link3", "Transform3D:translation"),
        ("/world/here/wanted", "Points3D:positions"),
        ("/world/here/before", "Arrows3D:vectors"),
        ("/world/here/after/mm", "Points3D:labels"),
    ]:
        assert column(recording, entity, name, "step")[0] == STEPS, entity


def test_what_was_commanded_is_where_it_was_commanded(recording, outcome, loop):
    for world in ("world", "close"):
        for name, every in (("circle", 2), ("line", 2), ("poses", 1)):
            read = statics(recording, f"/{world}/commanded/{name}", "Points3D:positions")
            wanted = in_world(outcome, courses(loop)[name].wanted)[::every]
            np.testing.assert_allclose(read, wanted, rtol=0, atol=2 * FLOAT32)  # m, of about 1 m
    assert statics(recording, "/world/commanded/poses", "Points3D:labels") == ["P1", "P2", "P3", "P4", "P5"]
    wanted = np.concatenate([in_world(outcome, course.wanted) for course in courses(loop).values()])
    here = np.array(column(recording, "/world/here/wanted", "Points3D:positions", "step")[1])[:, 0]
    np.testing.assert_allclose(here, wanted, rtol=0, atol=2 * FLOAT32)


def test_what_was_attained_is_magnified_as_the_tag_says(recording, outcome, loop):
    shown = loop_scene(outcome, loop)
    for when in ("before", "after"):
        entity = f"/world/attained/{when}"
        assert statics(recording, f"{entity}/factor", "Points3D:labels") == [
            f"{when} {format_magnification(shown.factor)}"
        ]
        for name in ("circle", "line"):
            (read,) = statics(recording, f"{entity}/{name}", "LineStrips3D:strips")
            places = magnified(outcome, courses(loop)[name], when, shown.factor)
            if name == "circle":
                places = np.concatenate([places, places[:1]])
            np.testing.assert_allclose(read, places, rtol=0, atol=2 * FLOAT32)
        vectors = statics(recording, f"{entity}/poses", "Arrows3D:vectors")
        wanted = in_world(outcome, loop.poses.wanted)
        arrows = magnified(outcome, loop.poses, when, shown.factor) - wanted
        np.testing.assert_allclose(vectors, arrows, rtol=0, atol=2 * FLOAT32)
        tips = [magnified(outcome, course, when, shown.factor) for course in courses(loop).values()]
        read = np.array(column(recording, f"/world/here/{when}", "Arrows3D:vectors", "step")[1])[:, 0]
        here = np.array(column(recording, "/world/here/wanted", "Points3D:positions", "step")[1])[:, 0]
        np.testing.assert_allclose(here + read, np.concatenate(tips), rtol=0, atol=4 * FLOAT32)
    for name, course in courses(loop).items():
        read = statics(recording, f"/close/attained/after/{name}", "Points3D:positions")
        places = magnified(outcome, course, "after", shown.factor_close)
        np.testing.assert_allclose(read, places, rtol=0, atol=2 * FLOAT32)
        spokes = statics(recording, f"/close/attained/after/{name}/from_commanded", "LineStrips3D:strips")
        ends = np.stack([in_world(outcome, course.wanted), places], axis=1)
        np.testing.assert_allclose(spokes, ends, rtol=0, atol=2 * FLOAT32)


def test_one_sees_that_it_misses_before_and_hits_after(outcome, loop):
    """At one scale the red is off by a good part of the cube, the green by less than a line is thick."""
    shown = loop_scene(outcome, loop)
    before, after = (
        np.linalg.norm(shown.whole.drawn(when, shown.factor) - shown.whole.wanted, axis=1)
        for when in ("before", "after")
    )
    assert 0.08 < before.mean() / shown.side_m < 0.25
    assert after.max() < 0.004 * shown.side_m
    left = np.linalg.norm(shown.whole.drawn("after", shown.factor_close) - shown.whole.wanted, axis=1)
    assert 0.05 < left.mean() / shown.side_m < 0.25 and shown.factor_close > 100 * shown.factor


def test_errors_are_the_measured_ones(recording, loop):
    for k, when in enumerate(("before", "after")):
        labels = column(recording, f"/world/here/{when}/mm", "Points3D:labels", "step")[1]
        said = [float(label.split()[1]) for (label,) in labels]
        mm = 1e3 * np.concatenate([course.errors[k].mean(axis=0) for course in courses(loop).values()])
        np.testing.assert_allclose(said, mm, rtol=0, atol=0.006 if when == "before" else 6e-5)
        for name, course in courses(loop).items():
            read = np.array(column(recording, f"/error_mm/{when}/{name}", "Scalars:scalars", "step")[1])[:, 0]
            np.testing.assert_allclose(read, 1e3 * course.errors[k].mean(axis=0), rtol=1e-12)


def test_the_cube_holds_its_poses_in_the_plane_that_is_looked_at(outcome, loop):
    shown, cube = loop_scene(outcome, loop), loop.cube
    lengths = np.linalg.norm(shown.edges[:, 0] - shown.edges[:, 1], axis=1)
    assert len({frozenset(map(tuple, edge.round(9))) for edge in shown.edges}) == 12
    np.testing.assert_allclose(lengths, cube.side_m, atol=1e-12)
    middle = shown.edges.mean(axis=(0, 1))
    np.testing.assert_allclose(shown.whole.wanted[STEPS.index(2 * PATH_POINTS)], middle, atol=1e-12)  # P1
    np.testing.assert_allclose((shown.whole.wanted - middle) @ shown.normal, 0, atol=1e-12)
    corners = np.unique(shown.edges.reshape(-1, 3).round(9), axis=0) - middle
    farthest = (shown.courses["poses"].wanted[1:] - middle) / 0.8  # 10 % of a half diagonal from the corners
    assert max(np.linalg.norm(corners - corner, axis=1).min() for corner in farthest) < 1e-8
    reach = np.linalg.norm(cube_positions(cube.side_m), axis=1).max()
    assert reach == pytest.approx(0.8 * np.sqrt(3) / 2 * cube.side_m)


def test_the_arm_is_drawn_where_its_targets_are(outcome, loop):
    """At the corrected readings the drawn flange carries the tool to the commanded places, as identified."""
    robot, arm = outcome.robot.model, outcome.identification.model
    shown = loop_scene(outcome, loop)
    carrier = robot.model.body(int(robot.model.site(FLANGE).bodyid[0])).name
    joints = np.concatenate([course.corrected for course in courses(loop).values()])
    values = outcome.identification.values
    np.testing.assert_array_equal(shown.bodies[carrier], body_poses(robot, arm, values, joints)[carrier])
    tool = se3.transform(shown.bodies[carrier], arm.split(values)[2])[:, 0]
    np.testing.assert_allclose(tool, shown.whole.wanted, rtol=0, atol=1e-6)  # m: what the schemes agree to


def test_the_summary_has_every_number_and_the_colours(recording, outcome, loop):
    text, shown = statics(recording, "/summary", "TextDocument:text")[0], loop_scene(outcome, loop)
    for row, course in (
        ("circle", loop.circle),
        ("line", loop.line),
        (f"P1 to P5, {CYCLES} cycles", loop.poses),
        ("all over the workspace", loop.targets),
    ):
        (line,) = [line for line in text.splitlines() if line.startswith(f"| **{row}**")]
        *cells, failed = [cell.strip() for cell in line.split("|")[2:-1]]
        before, after = (1e3 * errors for errors in course.errors)
        np.testing.assert_allclose([float(cell) for cell in cells[:2]], [before.mean(), before.max()], atol=0.006)
        np.testing.assert_allclose([float(cell) for cell in cells[2:]], [after.mean(), after.max()], atol=6e-5)
        assert failed == f"{course.failed} of {len(course.wanted) + course.failed}"
    for row, found, close in (
        ("AP before", accuracy(loop.poses.before, loop.poses.wanted), 0.006),
        ("AP after", accuracy(loop.poses.after, loop.poses.wanted), 6e-5),
        ("RP after", repeatability(loop.poses.after), 6e-5),
    ):
        (line,) = [line for line in text.splitlines() if line.startswith(f"| **{row}**")]
        np.testing.assert_allclose([float(cell) for cell in line.split("|")[2:-1]], 1e3 * found, atol=close)
    for words in (
        "**white**",
        "**red**",
        "**green**",
        format_magnification(shown.factor),
        format_magnification(shown.factor_close),
    ):
        assert words in text


def test_the_colours_are_the_campaigns(recording):
    for when, (r, g, b) in (("before", RGB_BEFORE), ("after", RGB_AFTER)):
        for entity, name in (
            (f"/world/attained/{when}/circle", "LineStrips3D:colors"),
            (f"/world/attained/{when}/poses", "Arrows3D:colors"),
            (f"/error_mm/{when}/circle", "SeriesLines:colors"),
        ):
            assert statics(recording, entity, name) == [r << 24 | g << 16 | b << 8 | 255], entity


def test_the_same_content_gives_an_equal_recording_and_another_does_not(recording, outcome, loop, tmp_path, home):
    for name, seed in (("same", 7), ("other", 8)):
        again = close_loop(outcome, loop.cube, instrument("uniform-8um"), seed, targets=TARGETS)
        record_loop(tmp_path / f"{name}.rrd", outcome, again)
    done = rrd(home, "compare", "--unordered", recording, tmp_path / "same.rrd")
    assert done.returncode == 0, done.stderr
    assert rrd(home, "compare", "--unordered", recording, tmp_path / "other.rrd").returncode != 0


def some(course, kept):
    """A course of which only these targets were reached."""
    rows = np.array(kept, dtype=int)
    return replace(
        course,
        wanted=course.wanted[rows],
        failed=len(course.wanted) - len(rows),
        uncorrected=course.uncorrected[rows],
        corrected=course.corrected[rows],
        before=course.before[:, rows],
        after=course.after[:, rows],
    )


def test_what_was_not_reached_is_left_out_and_counted(outcome, loop, tmp_path, home):
    part = replace(loop, line=some(loop.line, []), poses=some(loop.poses, [0, 2, 4]), targets=some(loop.targets, []))
    path = tmp_path / "part.rrd"
    record_loop(path, outcome, part)
    assert rrd(home, "verify", path).returncode == 0
    assert statics(path, "/world/commanded/poses", "Points3D:labels") == ["P1", "P3", "P5"]
    steps = [*range(PATH_POINTS), *range(PATH_POINTS, PATH_POINTS + 3 * HOLD, HOLD)]
    assert column(path, "/world/here/wanted", "Points3D:positions", "step")[0] == steps
    text = statics(path, "/summary", "TextDocument:text")[0]
    assert "| **line** | – | – | – | – | 100 of 100 |" in text and "2 of 5" in text
    record_loop(path, outcome, replace(part, poses=some(loop.poses, [])))
    assert rrd(home, "verify", path).returncode == 0
    text = statics(path, "/summary", "TextDocument:text")[0]
    assert "5 of 5" in text and "AP" not in text
    nothing = replace(part, circle=some(loop.circle, []), poses=some(loop.poses, []))
    with pytest.raises(LabError, match="irb120: nothing of circle"):
        record_loop(path, outcome, nothing)


@pytest.mark.thorough
@needs_vulkan
def test_no_view_complains(recording, home):
    views = views_of(recording, home, "step")
    assert {view.name for view in views} >= {"Commanded and attained", "Summary"} and len(views) == 5
    assert [(view.name, view.reports) for view in views if view.reports] == []
