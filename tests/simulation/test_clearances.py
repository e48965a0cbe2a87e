"""The model of a plan: solid targets, and shapes that touch as soon as they are nearer than their clearance."""

import mujoco
import numpy as np
import pytest
from helpers.scenes import MODEL, small_arm

from lab.core.random import rng_for
from lab.noise.instruments import INSTRUMENTS
from lab.simulation.collisions import collides
from lab.simulation.free_path import INCIDENCE_MARGIN_RAD, Clearances, path_step, planning_model, reflector_radii

GAUGE, TRACKER = INSTRUMENTS["uniform-8um"], INSTRUMENTS["leica-at960"]


def test_a_reflector_is_as_large_as_its_site_or_as_those_of_its_instrument() -> None:
    small, large = reflector_radii(MODEL, ("p1",), GAUGE), reflector_radii(MODEL, ("p1",), TRACKER)
    assert small == pytest.approx([0.00635]) and large[0] in (pytest.approx(0.00635), pytest.approx(0.01905))


def test_more_clearance_leaves_fewer_poses_and_none_is_what_there_was() -> None:
    joints = MODEL.chain.random_joints(400, rng_for(0, "poses"))
    none, some, wide = (
        collides(planning_model(MODEL, ("p1",), GAUGE, Clearances(each, each)), joints) for each in (0.0, 0.02, 0.1)
    )
    assert (some | ~none).all() and (wide | ~some).all() and none.sum() < some.sum() < wide.sum()
    assert (none | ~collides(MODEL, joints)).all()  # what touches without targets touches with them


def test_a_plan_keeps_its_distance_from_the_largest_angle_of_a_reflector() -> None:
    acceptance = planning_model(MODEL, ("p1",), TRACKER, Clearances()).acceptance_rad
    assert acceptance == pytest.approx(np.deg2rad(30) - INCIDENCE_MARGIN_RAD)
    assert path_step(MODEL) == 1e-3


def test_two_boxes_that_are_near_each_other_are_found(tmp_path) -> None:
    """Boxes at random, at most 19.9 mm apart: none is overlooked where 20 mm are kept (MuJoCo's own test: 1 in 150)."""
    box = '<geom name="box" type="box" size=".069 .05 .052"/>'
    model = small_arm(tmp_path, on_hand=box, extra='<geom name="block" type="box" size=".15 .2 .12" pos=".6 .3 .5"/>')
    planned = planning_model(model, ("p1",), GAUGE, Clearances(0.02, 0.0))
    joints = model.chain.random_joints(20_000, rng_for(0, "poses"))
    data, shapes = mujoco.MjData(model.model), [model.model.geom(name).id for name in ("box", "block")]
    near = []
    for i, qpos in enumerate(model.qpos(joints)):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model.model, data)
        if 0 < mujoco.mj_geomDistance(model.model, data, *shapes, 0.02, None) < 0.0199:
            near.append(i)
    assert len(near) > 100 and collides(planned, joints[near]).all()
