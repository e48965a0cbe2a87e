"""Rods and legs of a mechanism, which no body is, in its recordings: read back from the files."""

import numpy as np
import pytest
import rerun as rr
from helpers.campaigns import calibration
from helpers.recordings import column, rrd, statics
from rerun.chunk import RrdReader

from lab.library import virtual_arm as virtual_arm
from lab.library.calibrate import calibrate
from lab.options.virtual_campaign import VirtualCampaign
from lab.report.recording import LEGS
from lab.report.views.calibration_recording import record
from lab.report.views.calibration_scene import scene

POSES = 20
ROUNDED = 4e-7  # m: float32 of about 2 m
STRIPS = "LineStrips3D:strips"


@pytest.fixture(scope="module", autouse=True)
def quick():
    """Strict recordings, of campaigns that are judged by few poses."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(virtual_arm, "FRESH_POSES", 20)
        rr.set_strict_mode(True)
        yield
        rr.set_strict_mode(False)


@pytest.fixture(scope="module", params=["delta", "rpr2"])
def recorded(request, tmp_path_factory):
    outcome = calibrate(VirtualCampaign(robot=request.param, seed=4, poses=POSES))
    path = tmp_path_factory.mktemp("recording") / f"{request.param}.rrd"
    record(path, outcome)
    return path, outcome


def lines(path, timeline="pose"):
    """Index (of seconds, in ns), and lines (n, legs, 2, 3) in the world."""
    reader, rows = RrdReader(path), {}
    for chunk in reader.stream(store=reader.recordings()[0]).filter(content=f"/{LEGS}"):
        batch = chunk.to_record_batch()
        if timeline in batch.schema.names and STRIPS in batch.schema.names:
            index = batch.column(timeline).cast("int64").to_pylist()
            rows.update(zip(index, batch.column(STRIPS).to_pylist(), strict=True))
    return sorted(rows), np.array([rows[i] for i in sorted(rows)])


def long_sides(drawn, rods):
    """Of rods their lines (n, rods, 1, 2, 3); of parallelograms the two (n, rods, 2, 2, 3) that are as long as rods."""
    return drawn.reshape(len(drawn), rods, -1, 2, 3)[:, :, :2]


def entities(path):
    reader = RrdReader(path)
    return {str(chunk.entity_path) for chunk in reader.stream(store=reader.recordings()[0])}


def body_places(path, body):
    """Where a body's shell stands (n, 3), or (1, 3) where it never moves: by MuJoCo."""
    name = "Transform3D:translation"
    index, places = column(path, f"/world/arm/{body}", name)
    return np.array(places)[:, 0] if index else np.array(statics(path, f"/world/arm/{body}", name))


@pytest.mark.thorough
def test_every_leg_joins_the_bodies_that_it_is_between(recorded, home):
    """The lines are of our kinematics, the bodies stand where MuJoCo has the identified mechanism."""
    path, outcome = recorded
    assert rrd(home, "verify", path).returncode == 0
    index, drawn = lines(path)
    assert index == list(range(POSES))
    tree = outcome.robot.chain.tree
    drawn = long_sides(drawn, len(tree.rods)).mean(axis=2)
    for i, rod in enumerate(tree.rods):
        base_side = min(rod.ends, key=lambda end: tree.loose[end])
        far = next(end for end in rod.ends if end != base_side)
        for side, end in enumerate((base_side, far)):
            np.testing.assert_allclose(drawn[:, i, side] - body_places(path, tree.frames[end].name), 0, atol=ROUNDED)
    assert np.ptp(drawn[:, :, 1], axis=0).max() > 0.1  # m: it moves


@pytest.mark.thorough
def test_legs_are_as_long_as_identified(recorded):
    """Of a rod its length at every pose, of a leg its reading and the offset: not the drawing's."""
    path, outcome = recorded
    model, values = outcome.identification.model, outcome.identification.values
    rods = outcome.robot.chain.tree.rods
    sides = long_sides(lines(path)[1], len(rods))
    lengths, off = np.linalg.norm(sides[..., 1, :] - sides[..., 0, :], axis=3), []
    for i, rod in enumerate(rods):
        constant = values[model.names.index(f"{rod.name}.length")]
        reading = 0.0 if rod.joint is None else outcome.fitted.joints[:, rod.joint]
        expected = np.broadcast_to(constant + reading, POSES)[:, None]
        np.testing.assert_allclose(lengths[:, i] - expected, 0, atol=2 * ROUNDED)
        off.append(abs(constant - rod.length_m))
    assert max(off) > 1e-4  # m: the drawing's would be seen


def test_a_serial_arm_has_no_legs_and_no_entity_for_them(tmp_path):
    outcome = calibration(poses=12)
    shown = scene(outcome)
    assert shown.legs.ends.shape == (12, 0, 2, 3) and shown.legs.measured == ()
    record(tmp_path / "serial.rrd", outcome)
    found = entities(tmp_path / "serial.rrd")
    assert "/world/arm/link3" in found and f"/{LEGS}" not in found
    assert "/world/instrument/stand" not in found  # its model has a tracker of its own
