"""What can be identified: the literature's counts, the aliases, and the gauge of any arm."""

import numpy as np
import pytest
from helpers.robots import IRB120, RX130, SCARA, SCEMI, TX40, VERSATRAN, chain_of, perturbed, somewhere

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.compiled import kernels
from lab.kinematics.gauge import base_set, base_set_of, independent_columns
from lab.kinematics.serial.axes_to_dh import JointAxes, chain_from_axes, parameters_from_axes
from lab.kinematics.serial.serial_arm import SerialArm
from lab.robots.load_robot import load_robot

MM = 1e-3


def links_of(arm: SerialArm, *, beta: bool) -> list[int]:
    return [i for i, name in enumerate(arm.names) if name.startswith("link") and (beta or not name.endswith("beta"))]


def rank_of(arm: SerialArm, tool: Array, columns: list[int]) -> int:
    values = arm.nominal({"p1": tool})
    _, jacobian = arm.observe(arm.chain.random_joints(200, np.random.default_rng(0)), values)
    return len(independent_columns(jacobian.reshape(-1, len(arm.names)), columns))


def test_the_ranks_of_the_thesis_case() -> None:
    """facts: 24 or 25 link parameters, at the flange's origin and at a point off axis 6."""
    arm = SerialArm(IRB120.chain)
    origin, off_axis = np.zeros(3), np.array([0.040, 0.030, 0.050])
    everything = list(range(len(arm.names)))
    assert rank_of(arm, origin, links_of(arm, beta=False)) == 19
    assert rank_of(arm, origin, links_of(arm, beta=True)) == 20
    assert rank_of(arm, off_axis, links_of(arm, beta=False)) == 22
    assert rank_of(arm, off_axis, links_of(arm, beta=True)) == 23
    assert len(everything) == 34
    assert rank_of(arm, off_axis, everything) == 27


def test_the_aliases_of_the_thesis_case() -> None:
    """Dropping d2, d5, a5, theta6, alpha6 hides them: d2 in d3 one to one, a5 in theta5, d5 in alpha5."""
    arm = SerialArm(IRB120.chain)
    links = links_of(arm, beta=False)
    dropped = ["link2.d", "link5.d", "link5.a", "link6.theta", "link6.alpha"]
    order = [i for i in range(len(links)) if arm.names[links[i]] not in dropped]
    order += [i for i in range(len(links)) if i not in order]
    _, jacobian = arm.observe(arm.chain.random_joints(200, np.random.default_rng(0)), arm.nominal({"p1": np.zeros(3)}))
    found = base_set_of(jacobian.reshape(-1, len(arm.names))[:, links], order)
    assert [arm.names[links[i]] for i in found.fixed] == dropped

    def coefficient(kept: str, fixed: str) -> float:
        names = [arm.names[links[i]] for i in found.identifiable]
        return float(found.alias[names.index(kept), dropped.index(fixed)])

    assert coefficient("link3.d", "link2.d") == pytest.approx(1)
    assert coefficient("link5.theta", "link5.a") == pytest.approx(-1 / (72 * MM))
    assert coefficient("link5.alpha", "link5.d") == pytest.approx(1 / (72 * MM))
    assert np.abs(found.alias[:, [3, 4]]).max() < 1e-9  # theta6 and alpha6 move the flange's origin nowhere


@pytest.mark.parametrize(("targets", "rank"), [(1, 27), (2, 30), (3, 33)])
def test_the_gauge_of_the_irb120(targets: int, rank: int) -> None:
    arm = SerialArm(IRB120.chain, ("p1", "p2", "p3")[:targets])
    kept = [arm.names[i] for i in base_set(arm, arm.nominal()).identifiable]
    assert len(kept) == rank
    links = [name for name in kept if name.startswith("link")]
    inner = [f"link{i}.{c}" for i in (3, 4, 5) for c in ("theta", "d", "a", "alpha")]
    assert links == ["link1.a", "link1.alpha", "link2.theta", "link2.a", "link2.alpha", "link2.beta", *inner]


@pytest.mark.parametrize(
    ("chain", "rank", "condition"),
    [
        (RX130, 27, 23.2),
        (TX40, 27, 18.0),
        (SCEMI, 27, 20.9),
        (SCARA, 17, 11.4),
        (VERSATRAN, 23, 11.3),
        (IRB120.chain, 27, 19.4),
        (load_robot("panda").chain, 31, None),
    ],
    ids=lambda value: getattr(value, "name", None),
)
def test_the_counts_of_other_arms(chain, rank: int, condition: float | None) -> None:
    """facts: 4R + 2P + 3 for each; the condition to a half, for other limits and lengths than ours may be meant."""
    arm = SerialArm(chain)
    structure = base_set(arm, arm.nominal())
    assert len(structure.identifiable) == rank
    if condition is None:
        return
    _, jacobian = arm.observe(chain.random_joints(1000, np.random.default_rng(0)), arm.nominal())
    columns = jacobian.reshape(-1, len(arm.names))[:, structure.identifiable]
    assert np.linalg.cond(columns / np.linalg.norm(columns, axis=0)) == pytest.approx(condition, rel=0.5)


def random_chain(rng: np.random.Generator, *, special: bool = True):
    """Three to seven joints, any types and convention; no two neighbouring axes coincide.

    Special ones have right angles and axes that meet; the others only parallel axes, now and then.
    """
    while True:
        n = int(rng.integers(3, 8))
        kinds = "".join(rng.choice(["R", "R", "P"], n))
        alpha = rng.choice([0.0, 90.0, -90.0, 35.0], n)
        a = rng.choice([0.0, 0.3, -0.2], n)
        d = rng.choice([0.0, 0.25], n)
        if not special:
            alpha = np.where(rng.random(n) < 0.3, 0.0, rng.uniform(20, 160, n))
            a, d = rng.uniform(0.1, 0.4, (2, n))
        convention = str(rng.choice(["distal", "craig"]))
        joins = list(range(n - 1)) if convention == "distal" else list(range(1, n))
        meets = [alpha[i] == 0 and (a[i] == 0 or "P" in kinds[j : j + 2]) for j, i in enumerate(joins)]
        if not any(meets) and kinds.count("R") >= 3:
            return chain_of("random", convention, kinds, alpha, a, rng.uniform(-90, 90, n), d)


def test_any_arm_has_one_vector_near_its_drawing() -> None:
    """20 random chains: the gauge has the full rank, and a perturbed arm's axes give its parameters back.

    The perturbation is of every parameter, those that the gauge fixes too: what comes back is
    another vector, with the same positions everywhere.
    """
    rng = np.random.default_rng(6)
    for _ in range(20):
        chain = random_chain(rng)
        arm = SerialArm(chain)
        start = somewhere(arm, rng)
        structure = base_set(arm, start)
        joints = chain.random_joints(200, rng)
        _, jacobian = arm.observe(joints, arm.rank_point(start))
        columns = jacobian.reshape(-1, len(arm.names))
        sizes = np.linalg.svd(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-12), compute_uv=False)
        assert len(structure.identifiable) == int((sizes > 1e-9 * sizes[0]).sum())
        true = perturbed(arm, start, rng, 1 * MM, 2 * MM)
        truth = parameters_from_axes(arm, axes_of(arm, true), start)
        np.testing.assert_allclose(arm.points(joints, truth.values), arm.points(joints, true), atol=1e-12)
        np.testing.assert_array_equal(truth.values[list(structure.fixed)], start[list(structure.fixed)])


def axes_of(arm: SerialArm, values: Array) -> JointAxes:
    moving = [motion for motion in arm.motions(values) if motion.joint is not None]
    origins = [np.zeros(3) if motion.origin is None else motion.origin[:3, 0] for motion in moving]
    directions = np.array([motion.axis[:3, 0] for motion in moving]) * arm.chain.sign[:, None]
    return JointAxes(np.array(origins), directions, arm.points(np.zeros((1, arm.chain.size)), values)[0])


def test_a_drawn_arm_comes_back_from_its_axes() -> None:
    """chain_from_axes: the same positions for random distal arms, whatever table it chooses."""
    rng = np.random.default_rng(8)
    for _ in range(20):
        chain = random_chain(rng)
        arm = SerialArm(chain)
        values = somewhere(arm, rng)
        axes = axes_of(arm, values)
        base = se3.pose(se3.exp(values[3:6]), values[:3])
        flange = arm.flange(np.zeros((1, chain.size)), values)[0]
        limits = chain.lower, chain.upper, chain.speed, chain.acceleration
        drawn, T_frame0 = chain_from_axes("drawn", chain.joint_names, chain.prismatic, axes, base, flange, limits)
        again = SerialArm(drawn)
        table = drawn.table
        last = se3.inverse(again.flange(np.zeros((1, chain.size)), again.assemble(np.zeros(6), table, np.zeros(3)))[0])
        tool = se3.transform(last @ se3.inverse(T_frame0), axes.targets)
        place = np.concatenate([T_frame0[:3, 3], se3.log(T_frame0[:3, :3])])
        joints = chain.random_joints(50, rng)
        np.testing.assert_allclose(
            again.points(joints, again.assemble(place, table, tool)), arm.points(joints, values), atol=1e-12
        )


def test_axes_that_no_such_chain_has_are_refused() -> None:
    """An axis 3 that lies in a plane across axis 2 never meets the plane in which Hayati's foot is sought."""
    arm = SerialArm(IRB120.chain)
    axes = axes_of(arm, arm.nominal())
    directions, origins = axes.directions.copy(), axes.origins.copy()
    directions[2], origins[2] = [1, 0, 0], [0, 0.1, 0.56]
    with pytest.raises(LabError, match="perturb less"):
        parameters_from_axes(arm, JointAxes(origins, directions, axes.targets), arm.nominal())


@pytest.mark.parametrize("compiled", [True, False])
def test_columns_that_others_span_are_not_independent(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not compiled:
        monkeypatch.setattr(kernels, "_CODE", None)
    rng = np.random.default_rng(8)
    columns = rng.standard_normal((40, 9))
    columns[:, 4] = columns[:, [0, 2]] @ [1.0, -3.0] + 1e-12 * rng.standard_normal(40)
    columns[:, 6] *= 1e-10  # moves nothing
    columns[:, 7] = columns[:, 1] + 1e-6 * rng.standard_normal(40)
    assert independent_columns(columns, range(9)) == (0, 1, 2, 3, 5, 7, 8)
    assert independent_columns(columns, [4, 2, 0, 8]) == (2, 4, 8)
    assert independent_columns(columns, [7, 6, 1]) == (1, 7)
