"""A torso whose hands touch: exact recovery, what contacts alone leave free, files, and the simulation."""

from dataclasses import replace

import numpy as np
import pytest

from lab.calibration.identify import identify
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import load_robot
from lab.campaign.virtual_robot import truth_of
from lab.commands.calibrate.run import MeasurementSession, measurement_session
from lab.core.errors import LabError
from lab.core.measurements import Measurements, measured
from lab.core.random import rng_for
from lab.kinematics.gauge import base_set
from lab.sensors.self_contact import SelfContact, SelfContactSensor

BOTH = ("left.p1", "right.p1")
TORSO = load_robot("torso")
ARM = TORSO.arm(BOTH)
NOMINAL = ARM.nominal(TORSO.tool)
SENSOR = SelfContactSensor()
ALONE = SelfContact(ARM, NOMINAL, 0, ((0, 1),))


def session_of(seed: int = 2, **options: object) -> MeasurementSession:
    given = {"observe": "self-contact", "targets": BOTH, "poses": 60, "instrument": "exact", "seed": seed, **options}
    return measurement_session(VirtualCampaign("torso", **given), TORSO)[0]


def with_contacts(*cells: str) -> Measurements:
    data = measured(TORSO.chain.joint_names, np.zeros((len(cells), 13)), (), np.empty((len(cells), 0, 3)))
    return replace(data, other={"contact": cells})


def test_simulated_hands_touch_without_a_collision() -> None:
    session = session_of()
    data = session.measurements
    touching = np.array([bool(cell) for cell in data.other["contact"]])
    assert touching.sum() == 30 and not data.seen[touching].any() and data.seen[~touching].all()
    points = session.true_robot.points(data.joints[touching], BOTH)
    np.testing.assert_allclose(points[:, 0], points[:, 1], atol=1e-11)
    assert not TORSO.chain.beyond_limits(data.joints, 0.0).any()
    assert len(np.unique(data.joints[touching].round(3), axis=0)) == 30


def test_points_and_contacts_give_the_robot_exactly() -> None:
    session = session_of()
    model, rows = SENSOR.observation(ARM, session.measurements, NOMINAL)
    found = identify(model, rows, NOMINAL)
    truth = truth_of(session.true_robot, ARM)
    assert truth is not None and found.status == "converged"
    assert SENSOR.observed_truth(truth, found, session.true_robot, {}) is truth
    np.testing.assert_allclose(found.values, truth.values, atol=1e-9)


def test_contacts_alone_show_the_shape_and_not_the_size() -> None:
    """What is free: the base (6), the axis that both arms share (4, as where it stands is the base's), and the size."""
    structure = base_set(ALONE, NOMINAL)
    both = base_set(ARM, NOMINAL)
    free = {ARM.names[i] for i in structure.identifiable}
    assert len(free) == len(both.identifiable) - 11
    assert not any(name.startswith("base.") for name in free)
    assert ALONE.unsized and ARM.names[ALONE.scale_link] not in free
    data = session_of(poses=120).measurements
    contacts = data.take(np.flatnonzero([bool(cell) for cell in data.other["contact"]]))
    model, rows = SENSOR.observation(ARM, replace(contacts, targets=(), points=np.empty((60, 0, 3))), NOMINAL)
    found = identify(model, rows, NOMINAL)
    assert found.lacks_size and np.abs(found.residuals).max() < 1e-12
    lengths = np.array([parameter.kind == "length" for parameter in ARM.parameters])
    larger = np.where(lengths, 1.01 * found.values, found.values)
    np.testing.assert_allclose(model.points(rows.inputs(model.conditions), larger), 0.0, atol=1e-12)


def test_the_truth_of_contacts_is_in_their_gauge() -> None:
    session = session_of(poses=120)
    data = session.measurements
    contacts = data.take(np.flatnonzero([bool(cell) for cell in data.other["contact"]]))
    model, rows = SENSOR.observation(ARM, replace(contacts, targets=(), points=np.empty((60, 0, 3))), NOMINAL)
    found, known = identify(model, rows, NOMINAL), truth_of(session.true_robot, ARM)
    assert known is not None
    truth = SENSOR.observed_truth(known, found, session.true_robot, {})
    assert truth is not None
    np.testing.assert_allclose(truth.values, found.values, atol=1e-8)
    assert np.abs(known.values - found.values).max() > 1e-4


def test_one_measured_hand_gives_the_other_by_contact() -> None:
    """The right hand, which the tracker never saw, is known as soon as it touches the left one."""
    session = session_of(poses=120)
    data = session.measurements
    data = replace(data, targets=("left.p1",), points=data.points[:, :1])
    assert SENSOR.targets(data) == BOTH
    model, rows = SENSOR.observation(ARM, data, NOMINAL)
    assert model.targets == ("left.p1", "contact")
    found = identify(model, rows, NOMINAL)
    fresh = TORSO.chain.random_joints(50, rng_for(1, "fresh"))
    exact = session.true_robot.points(fresh, BOTH)
    np.testing.assert_allclose(ARM.points(fresh, found.values), exact, atol=1e-8)


def test_structure_poses_are_in_contact_and_derivatives_of_differences() -> None:
    model = SelfContact(
        TORSO.arm((*BOTH, "right.p2")), TORSO.arm((*BOTH, "right.p2")).nominal(TORSO.tool), 2, ((0, 1), (0, 2))
    )
    inputs = model.structure_joints(6, rng_for(0, "structure"))
    assert inputs[:, -1].tolist() == [0, 1] * 3
    np.testing.assert_allclose(model.points(inputs, model.nominal_arm)[:, -1], 0.0, atol=1e-11)
    step, values = 1e-6, model.nominal_arm + 0.01
    jacobian = model.observe(inputs, values)[1]
    moved = [
        (model.points(inputs, values + step * row) - model.points(inputs, values - step * row)) / (2 * step)
        for row in np.eye(len(values))
    ]
    np.testing.assert_allclose(jacobian, np.stack(moved, axis=-1), atol=1e-8)


@pytest.mark.parametrize("cell", ["left.p1", "left.p1=left.p2", "left.p1=right.p1=left.p2", "=", "left.p1 right.p1"])
def test_a_cell_that_is_no_pair(cell: str) -> None:
    with pytest.raises(LabError, match=r"column contact: .*no pair of points on two tips"):
        SENSOR.targets(with_contacts("", cell))


def test_a_file_without_contacts() -> None:
    with pytest.raises(LabError, match=r"no row has a contact: .*left.p1=right.p1"):
        SENSOR.observation(ARM, with_contacts("", ""), NOMINAL)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"contact_share": 1.0}, "contact.share 1: give a share above 0 and below 1"),
        ({"targets": ("left.p1", "left.p2")}, "takes targets on two tips"),
    ],
)
def test_a_simulation_that_cannot_be(options: dict[str, object], says: str) -> None:
    with pytest.raises(LabError, match=says):
        session_of(**options)
