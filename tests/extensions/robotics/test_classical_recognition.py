"""Mechanisms closed numerically against the closed forms of the course: the same poses, there and back."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.robots import ROOT

from lab.core.errors import LabError
from lab.extensions.robotics.closed.classical_mechanisms import AZIMUTHS_RAD, Delta
from lab.extensions.robotics.closed.recognition import ClassicalModel, classical_model_of
from lab.formats.mechanism_toml import read_mechanism
from lab.kinematics.closed.loop_closure import BASE, Frame, Step
from lab.kinematics.closed.mechanism import Mechanism

MODELS = ROOT / "models"
POSES = 300
M, RAD = 1e-12, 1e-12  # agreement of places and of turns


def drawn(name: str) -> Mechanism:
    return read_mechanism(MODELS / f"{name}.toml").mechanism


def known(mechanism: Mechanism) -> ClassicalModel:
    course = classical_model_of(mechanism)
    assert course is not None
    return course


def missed(mechanism: Mechanism, poses: int) -> tuple[float, float]:
    """By how much the closed form misses random poses: passive values by its nearest mode, readings likewise."""
    course, joints = known(mechanism), mechanism.random_joints(poses, np.random.default_rng(1))
    passive = mechanism.assembled(joints, mechanism.nominal_values).configuration.passive.T
    direct = np.nanmin(np.abs(course.modes(joints) - passive[:, None]).max(axis=2), axis=1)
    inverse = np.nanmin(np.abs(course.inverse_solutions(passive) - joints[:, None]), axis=1)
    return float(direct.max()), float(inverse.max())


@pytest.mark.parametrize(
    ("name", "what"),
    [("rpr2/mechanism", "2-RPR"), ("rpr3/mechanism", "3-RPR"), ("delta/mechanism", "Delta"), ("delta/small", "Delta")],
)
def test_both_models_give_the_same_poses(name: str, what: str) -> None:
    assert known(drawn(name)).name == what
    direct, inverse = missed(drawn(name), POSES)
    assert direct < min(M, RAD) and inverse < min(M, RAD)


# other placements and orders of the same robots


def on_a_foot(mechanism: Mechanism) -> Mechanism:
    """Everything stands on a frame that is moved and turned, which is no parameter."""
    steps = [Step(kind, value, exact=True) for kind, value in (("x", 0.3), ("z", 2.0), ("rx", 0.4), ("ry", -2.2))]
    frames = (Frame("foot", BASE, (*steps, Step("rz", 0.7, exact=True))),)
    frames += tuple(replace(frame, on=frame.on + 1) for frame in mechanism.tree.frames)
    rods = tuple(replace(rod, ends=(rod.ends[0] + 1, rod.ends[1] + 1)) for rod in mechanism.tree.rods)
    return replace(
        mechanism, tree=replace(mechanism.tree, frames=frames, rods=rods, platform=mechanism.tree.platform + 1)
    )


def counted_otherwise(mechanism: Mechanism) -> Mechanism:
    """Every joint counts the other way."""
    return replace(mechanism, sign=-mechanism.sign, lower=-mechanism.upper, upper=-mechanism.lower)


def rods_reversed(mechanism: Mechanism) -> Mechanism:
    """The rods in another order, and each named from its other end."""
    rods = tuple(replace(rod, ends=rod.ends[::-1]) for rod in mechanism.tree.rods[::-1])
    return replace(mechanism, tree=replace(mechanism.tree, rods=rods))


def slides_swapped(mechanism: Mechanism) -> Mechanism:
    """The platform's slides in another order, which is left-handed."""

    def path(frame: Frame) -> tuple[Step, ...]:
        slides = [step for step in frame.path if step.passive and not step.is_turn]
        return (*slides[::-1], *frame.path[len(slides) :])

    frames = tuple(replace(frame, path=path(frame)) for frame in mechanism.tree.frames)
    return replace(mechanism, tree=replace(mechanism.tree, frames=frames))


def arms_from_elsewhere(mechanism: Mechanism) -> Mechanism:
    """Joints (of a leg, its length) have an offset."""
    frames = tuple(
        replace(frame, path=tuple(replace(s, value=s.value + 0.2) if s.joint is not None else s for s in frame.path))
        for frame in mechanism.tree.frames
    )
    rods = tuple(replace(rod, length_m=0.2) if rod.joint is not None else rod for rod in mechanism.tree.rods)
    shift = 0.2 * mechanism.sign
    return replace(
        mechanism,
        tree=replace(mechanism.tree, frames=frames, rods=rods),
        lower=mechanism.lower - shift,
        upper=mechanism.upper - shift,
    )


def hips_turned_over(mechanism: Mechanism) -> Mechanism:
    """Axes of hips point the other way."""
    frames = tuple(
        replace(frame, path=tuple(replace(s, value=s.value + np.pi) if s.kind == "rx" else s for s in frame.path))
        for frame in mechanism.tree.frames
    )
    changed = replace(mechanism, tree=replace(mechanism.tree, frames=frames))
    if frames == mechanism.tree.frames:
        return changed
    return replace(changed, lower=-mechanism.upper, upper=-mechanism.lower)


CHANGES = (hips_turned_over, on_a_foot, counted_otherwise, rods_reversed, slides_swapped, arms_from_elsewhere)


@pytest.mark.parametrize("name", ["rpr2/mechanism", "rpr3/mechanism", "delta/mechanism"])
def test_wherever_and_however_it_is_described(name: str) -> None:
    """Changed in every way at once."""
    changed = drawn(name)
    for change in CHANGES:
        changed = change(changed)
    model = known(changed).model
    assert known(changed).name == known(drawn(name)).name and max(missed(changed, 100)) < 2 * M  # on a foot, 2 m away
    if isinstance(model, Delta):
        assert model.base_radius_m == pytest.approx(0.567 / np.sqrt(12), abs=1e-12)


def test_a_delta_s_numbers_are_the_published_ones() -> None:
    course, published = (
        known(drawn("delta/mechanism")),
        Delta(0.567 / np.sqrt(12), 0.076 / np.sqrt(3), 0.524, 1.244, AZIMUTHS_RAD),
    )
    for name in ("base_radius_m", "platform_radius_m", "arm_m", "rod_m"):
        assert getattr(course.model, name) == pytest.approx(getattr(published, name), abs=1e-12)
    assert isinstance(course.model, Delta)
    np.testing.assert_allclose(course.model.azimuths_rad, AZIMUTHS_RAD, atol=1e-12)
    np.testing.assert_allclose(course.origin, 0.0, atol=1e-12)


# others


def moved(mechanism: Mechanism, name: str, by: float) -> Mechanism:
    """One parameter is off."""
    index = mechanism.names.index(name)
    values = mechanism.nominal_values + by * (np.arange(len(mechanism.nominal_values)) == index)
    dimensions, tree = mechanism.dimensions(values), mechanism.tree
    frames = tuple(
        replace(frame, path=tuple(replace(s, value=float(v)) for s, v in zip(frame.path, constants, strict=True)))
        for frame, constants in zip(tree.frames, dimensions.steps, strict=True)
    )
    rods = tuple(replace(rod, length_m=float(v)) for rod, v in zip(tree.rods, dimensions.lengths, strict=True))
    return replace(mechanism, tree=replace(tree, frames=frames, rods=rods))


@pytest.mark.parametrize("name", ["rod2.length", "elbow1.x", "arm3.z", "arm1.y", "arm2.rx", "arm2.rz", "wrist1.x"])
def test_a_delta_with_one_number_off_is_none(name: str) -> None:
    assert classical_model_of(moved(drawn("delta/mechanism"), name, 1e-6)) is None


def test_six_rods_and_other_robots_are_none() -> None:
    assert classical_model_of(drawn("delta/six_rods")) is None
    planar = drawn("rpr3/mechanism")
    out_of_plane = replace(planar.tree.frames[0], path=(*planar.tree.frames[0].path, Step("z", 0.01)))
    assert (
        classical_model_of(replace(planar, tree=replace(planar.tree, frames=(out_of_plane, *planar.tree.frames[1:]))))
        is None
    )
    delta = drawn("delta/mechanism")
    arm = delta.tree.frames[0]
    sliding = replace(arm, path=(*arm.path[:-1], Step("x", 0.0, joint=0)))
    slide = replace(
        delta,
        prismatic=(True, False, False),
        tree=replace(
            delta.tree, frames=(sliding, *(f if f.name != "arm1" else sliding for f in delta.tree.frames[1:]))
        ),
    )
    assert classical_model_of(slide) is None


def test_legs_alike_are_none_or_refused() -> None:
    planar = drawn("rpr3/mechanism")
    rods = (*planar.tree.rods[:2], replace(planar.tree.rods[2], ends=planar.tree.rods[0].ends))
    alike = replace(planar, tree=replace(planar.tree, rods=rods))
    assert classical_model_of(alike) is None
    with pytest.raises(LabError, match="singular"):
        alike.refuse_open()
