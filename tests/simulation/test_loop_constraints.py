"""Mechanisms in MuJoCo: its constraints, closed by Newton, against our own closures, serial arms and closed forms."""

from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np
import pytest
from helpers.robots import ROOT, RX130, perturbed

from lab.core.se3 import Array
from lab.formats.mechanism_toml import read_mechanism
from lab.kinematics.closed.closed_arm import ClosedArm
from lab.kinematics.closed.loop_closure import BASE, Frame, Pin, Rod, Step, Tree
from lab.kinematics.closed.mechanism import Mechanism
from lab.kinematics.serial.serial_arm import SerialArm
from lab.simulation.closed_robot import closed_mjcf, closed_qpos, closed_spec

ROUNDING_M = 1e-12  # of sums of lengths about 1 m, where no pose is near a singularity
FILES = ("rpr2/mechanism", "rpr3/mechanism", "delta/mechanism", "delta/small", "delta/six_rods")
HEIGHT_M = 1.6


@dataclass(frozen=True)
class Case:
    """A mechanism with targets, and the parameters of one that may be off."""

    mechanism: Mechanism
    tool: dict[str, Array]
    values: Array
    height_m: float | None = HEIGHT_M

    @property
    def arm(self) -> ClosedArm:
        return ClosedArm(self.mechanism, tuple(self.tool))

    @property
    def full(self) -> Array:
        return np.concatenate([self.values, *self.tool.values()])

    @property
    def spec(self) -> mujoco.MjSpec:
        return closed_spec(self.mechanism, self.full, self.tool, self.height_m)

    def drawn(self, joints: Array) -> Array:
        return self.mechanism.assembled(joints, self.mechanism.nominal_values).configuration.passive

    def home(self, count: int) -> Array:
        return np.repeat(self.drawn(self.mechanism.home[None]), count, axis=1)

    def settled(self, joints: Array, passive: Array) -> tuple[Array, Array]:
        """Targets on the base in MuJoCo, and which poses are refused."""
        model = self.spec.compile()
        qpos, jumped = closed_qpos(model, self.mechanism, self.full, joints, passive)
        return self.points(model, qpos), jumped

    def points(self, model: mujoco.MjModel, qpos: Array) -> Array:
        data, sites = mujoco.MjData(model), [model.site(name).id for name in self.tool]
        points = np.empty((len(qpos), len(sites), 3))
        for i, row in enumerate(qpos):
            data.qpos[:] = row
            mujoco.mj_kinematics(model, data)
            points[i] = data.site_xpos[sites]
        return points - [0.0, 0.0, self.height_m or 0.0]

    def joints(self, count: int) -> Array:
        return self.mechanism.random_joints(count, np.random.default_rng(1))


def with_every_constant(tree: Tree) -> Tree:
    """The same with nothing taken for granted."""
    paths = [tuple(replace(step, exact=False) for step in frame.path) for frame in tree.frames]
    bodies = tuple(replace(frame, path=path) for frame, path in zip(tree.frames, paths, strict=True))
    return replace(tree, frames=bodies, rods=tuple(replace(rod, exact=False) for rod in tree.rods))


@cache
def described(name: str) -> Case:
    """A shipped mechanism, every number of which is off."""
    file = read_mechanism(ROOT / "models" / f"{name}.toml")
    mechanism = replace(file.mechanism, tree=with_every_constant(file.mechanism.tree))
    tool = file.tool | {"off centre": np.array([0.03, -0.02, -0.05])}
    return off(mechanism, tool, 0.1 if "six" in name else 0.5)


def off(mechanism: Mechanism, tool: dict[str, Array], milli: float, seed: int = 0) -> Case:
    draws = np.random.default_rng(seed).standard_normal(len(mechanism.nominal_values))
    draws[:6] = 0.0
    return Case(mechanism, tool, mechanism.nominal_values + 1e-3 * milli * draws)


def mechanism_of(name: str, limits: dict[str, tuple[float, float]], slides: bool, tree: Tree) -> Mechanism:
    n, ends = len(limits), np.array(list(limits.values()))
    return Mechanism(
        name=name,
        joint_names=tuple(limits),
        prismatic=(slides,) * n,
        sign=np.where(np.arange(n) % 2, -1.0, 1.0),
        lower=ends[:, 0],
        upper=ends[:, 1],
        speed=np.full(n, np.nan),
        acceleration=np.full(n, np.nan),
        tree=tree,
    )


@pytest.mark.sampled(5)
@pytest.mark.parametrize(
    "name", (*FILES, "rrr3/mechanism", "prr3/mechanism", "hexapod/mechanism", "rps3/mechanism", "rpr3/shared_pin")
)
def test_mujoco_and_our_closures_agree_whatever_is_off(name: str):
    case = described(name)
    joints = case.joints(100)
    points, jumped = case.settled(joints, case.drawn(joints))
    ours = case.arm.points(joints, case.full)
    both = ~jumped & np.isfinite(ours).all(axis=(1, 2))
    assert both.mean() > 0.99  # near a fold one of the two may not follow
    np.testing.assert_allclose(points[both], ours[both], rtol=0, atol=ROUNDING_M)


def two_legs() -> tuple[Case, Case]:
    """The 2-RPR by rods, and by legs that turn and slide, pinned; the second leg's reading counts backwards."""
    anchors = [
        Frame("A1", BASE, (Step("x", 0.01), Step("y", -0.02))),
        Frame("A2", BASE, (Step("x", 0.59), Step("y", 0.03))),
    ]
    point = Frame("P", BASE, (Step("x", 0.3, passive=True), Step("y", 0.5, passive=True)))
    rods = (Rod("leg1", (2, 0), 0.004, joint=0), Rod("leg2", (2, 1), 1.2, joint=1))
    by_rods = Tree((*anchors, point), rods, (), 2)
    legs = [
        Frame("leg1", 0, (Step("rz", 1.0, passive=True),)),
        Frame("leg2", 1, (Step("rz", 2.0, passive=True),)),
        Frame("end1", 2, (Step("x", 0.004, joint=0),)),
        Frame("end2", 3, (Step("x", 1.2, joint=1),)),
    ]
    by_pin = Tree((*anchors, *legs), (), (Pin("P", (4, 5), (0, 1)),), 4)
    limits, tool = {"rho1": (0.4, 0.75), "rho2": (0.45, 0.8)}, {"p1": np.zeros(3)}
    rods_, pin = (mechanism_of("2-RPR", limits, True, tree) for tree in (by_rods, by_pin))
    return Case(rods_, tool, rods_.nominal_values), Case(pin, tool, pin.nominal_values)


def test_legs_that_turn_and_slide_stand_where_rods_do():
    rods, pin = two_legs()
    joints = rods.joints(200)
    expected = rods.arm.points(joints, rods.full)
    for case in (rods, pin):
        points, jumped = case.settled(joints, case.drawn(joints))
        assert not jumped.any()
        np.testing.assert_allclose(points, expected, rtol=0, atol=ROUNDING_M)


def four_bar(turn: str = "rz") -> Case:
    """Crank 0.1, coupler 0.3, rocker 0.2 on a ground of 0.25, upright or lying: the crank can go round (Grashof)."""
    bars = (
        Frame("crank", BASE, (Step(turn, 0.0, joint=0),)),
        Frame("coupler", 0, (Step("x", 0.1), Step(turn, 0.6, passive=True))),
        Frame("pin a", 1, (Step("x", 0.3),)),
        Frame("rocker", BASE, (Step("x", 0.25), Step(turn, 1.1, passive=True))),
        Frame("pin b", 3, (Step("x", 0.2),)),
    )
    tree = Tree(bars, (), (Pin("ab", (2, 4), (0, 1) if turn == "rz" else (0, 2)),), 1)
    mechanism = mechanism_of("four-bar", {"turn": (-np.pi, np.pi)}, False, tree)
    return Case(mechanism, {"p1": np.array([0.3, 0.0, 0.0])}, mechanism.nominal_values, None)


@pytest.mark.parametrize("turn", ["rz", "ry"])
@pytest.mark.parametrize("side", [1, -1])
def test_a_four_bar_goes_round_in_the_mode_of_its_start(turn: str, side: int):
    case, ground = four_bar(turn), np.array([0.25, 0.0])
    angle = np.linspace(-np.pi, np.pi, 181)
    crank = 0.1 * np.column_stack([np.cos(angle), np.sin(angle)])
    across = ground - crank  # the pin is where circles about the crank's end and the ground meet
    apart = np.linalg.norm(across, axis=1, keepdims=True)
    along = (apart**2 + 0.3**2 - 0.2**2) / (2 * apart)
    normal = side * np.column_stack([-across[:, 1], across[:, 0]])
    pin = crank + (along * across + np.sqrt(0.3**2 - along**2) * normal) / apart
    coupler, rocker = (np.arctan2(*(pin - start).T[::-1]) for start in (crank, ground))
    near = np.random.default_rng(6).uniform(-0.1, 0.1, (2, 181))
    points, jumped = case.settled(angle[:, None], np.array([coupler - angle, rocker]) + near)
    assert not jumped.any()
    found = points[:, 0, :2] if turn == "rz" else points[:, 0, [0, 2]] * [1, -1]
    np.testing.assert_allclose(found, pin, rtol=0, atol=ROUNDING_M)


def test_a_tree_without_loops_is_a_serial_arm():
    arm = SerialArm(RX130)
    values = perturbed(arm, arm.nominal(), np.random.default_rng(3), 0.01, 0.01)
    values[:6] = 0.0
    links = []
    for i, (theta, d, a, alpha, beta) in enumerate(arm.split(values)[1]):
        steps = (Step("rx", alpha), Step("x", a), Step("ry", beta), Step("rz", theta, joint=i), Step("z", d))
        links.append(Frame(f"link{i + 1}", i - 1, steps))
    limits = dict.fromkeys(RX130.joint_names, (-2.6, 2.6))
    mechanism = replace(mechanism_of("6R", limits, False, Tree(tuple(links), (), (), 5)), sign=np.ones(6))
    case = Case(mechanism, {"p1": values[-3:]}, mechanism.nominal_values)
    joints = RX130.random_joints(200, np.random.default_rng(4))
    points, jumped = case.settled(joints, np.empty((0, 200)))
    assert not jumped.any()
    np.testing.assert_allclose(points, arm.points(joints, values), rtol=0, atol=ROUNDING_M)


@pytest.mark.parametrize("name", ["rpr2/mechanism", "rpr3/mechanism"])
def test_what_does_not_close_is_refused(name: str):
    case = described(name)
    n = case.mechanism.size
    joints = np.array([np.full(n, 0.1), case.mechanism.home, np.full(n, 0.05), np.full(n, np.nan)])
    points, jumped = case.settled(joints, case.home(4))
    assert jumped.tolist() == [True, False, True, True]
    assert np.isnan(points[jumped]).all() and np.isfinite(points[1]).all()


def plainly_settled(model: mujoco.MjModel, moved: dict[str, float]) -> mujoco.MjData:
    """A model's own equalities closed by what is not moved, with nothing else known of it."""
    data = mujoco.MjData(model)
    loose = [i for i in range(model.nv) if model.joint(i).name not in moved]
    for name, value in moved.items():
        data.joint(name).qpos[0] = value
    for _ in range(30):
        mujoco.mj_forward(model, data)
        rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        jacobian = data.efc_J.reshape(-1, model.nv)[rows][:, loose]
        data.qpos[loose] -= np.linalg.lstsq(jacobian, data.efc_pos[rows])[0]
    mujoco.mj_kinematics(model, data)
    return data


@pytest.mark.parametrize("name", FILES[2:])
def test_a_file_keeps_every_dimension(name: str):
    case = described(name)
    model = mujoco.MjModel.from_xml_string(closed_mjcf(case.spec))
    joints = case.joints(10) / 3
    expected = case.arm.points(joints, case.full)
    for reading, points in zip(joints, expected, strict=True):
        data = plainly_settled(model, dict(zip(case.mechanism.joint_names, reading, strict=True)))
        found = data.site_xpos[[model.site(name).id for name in case.tool]] - [0.0, 0.0, HEIGHT_M]
        np.testing.assert_allclose(found, points, rtol=0, atol=ROUNDING_M)


@pytest.mark.parametrize(
    "case", [*two_legs(), four_bar(), described("delta/six_rods")], ids=lambda case: case.mechanism.name
)
def test_a_drawing_rests_closed_within_its_limits_and_touches_nothing(case: Case):
    drawn = replace(case, values=case.mechanism.nominal_values)
    model = drawn.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    assert data.nefc == data.ne and np.abs(data.efc_pos).max() < ROUNDING_M
    expected = drawn.arm.points(case.mechanism.home[None], drawn.full)
    np.testing.assert_allclose(drawn.points(model, model.qpos0[None]), expected, rtol=0, atol=ROUNDING_M)
    passive = [case.mechanism.tree.name_of(f, s) for f, s in case.mechanism.tree.passive]
    rest = dict(zip(passive, case.home(1)[:, 0], strict=True))
    rest |= dict(zip(case.mechanism.joint_names, case.mechanism.home, strict=True))
    limits = dict(
        zip(case.mechanism.joint_names, zip(case.mechanism.lower, case.mechanism.upper, strict=True), strict=True)
    )
    assert {model.joint(i).name for i in range(model.njnt)} >= set(passive)
    for i in range(model.njnt):
        name = model.joint(i).name
        assert model.qpos0[i] == pytest.approx(rest[name], rel=0, abs=ROUNDING_M)
        assert tuple(model.jnt_range[i]) == limits.get(name, (0.0, 0.0))
