"""Compute the RX 130's geometric parameters (equations 1.1 to 1.6, table 1, figures 1 to 3) of a thesis."""

import numpy as np

from lab.core import se3
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.reproduction.answer import ComparedValue, formula, holds, number, word
from lab.extensions.reproduction.item import Item, Missing, Source, with_exercises
from lab.extensions.reproduction.source_models import SAMPLES, as_row, link_matrices, matrix_formulas, sampled, serial
from lab.kinematics.gauge import base_set_of
from lab.kinematics.serial.khalil_frames import khalil_frame, pose_of
from lab.kinematics.serial.serial_arm import SerialArm

__all__ = ["STAUBLI"]

_TABLE = (  # of the RX 130: α in °, d and r in mm, θ - q in °
    (0, 0, 0, 0), (-90, 0, -90, 0), (0, 625, 90, 0), (90, 0, 0, 625), (-90, 0, 0, 0), (90, 0, 0, 110),
)  # fmt: skip
_X, _Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def _turn(axis: Array, angle: Array) -> Array:
    return se3.pose(se3.exp(angle[:, None] * axis), np.zeros((len(angle), 3)))


def _along(axis: Array, length: Array) -> Array:
    return se3.pose(np.tile(np.eye(3), (len(length), 1, 1)), length[:, None] * axis)


def _link() -> tuple[ComparedValue, ...]:
    alpha, d, theta, r = rng_for(0, "arm").uniform(-3, 3, (4, SAMPLES))
    exact = link_matrices("craig", theta, r, d, alpha)
    right = {
        "(1,1)": "cos(θ)", "(1,2)": "−sin(θ)", "(1,3)": "0", "(1,4)": "d", "(2,1)": "cos(α) sin(θ)",
        "(2,2)": "cos(α) cos(θ)", "(2,3)": "−sin(α)", "(2,4)": "−r sin(α)", "(3,1)": "sin(α) sin(θ)",
        "(3,2)": "sin(α) cos(θ)", "(3,3)": "cos(α)", "(3,4)": "r cos(α)",
    }  # fmt: skip
    return matrix_formulas("T", "", exact[:, :3], {"α": alpha, "d": d, "θ": theta, "r": r}, right)


def _whole() -> tuple[ComparedValue, ...]:
    """Check 1.1: Z, the matrices 1.2 of the RX 130 and E give the tool's point of the lab's direct model."""
    robot = sampled("rx130")
    arm, values = robot.arm, robot.values.copy()
    base, tool = rng_for(0, "arm").uniform(-1, 1, (2, 6))
    Z, E = pose_of(base), pose_of(tool)
    values[:6] = np.concatenate([Z[:3, 3], se3.log(Z[:3, :3])])
    values[-3:] = E[:3, 3]
    T, zero = np.tile(Z, (SAMPLES, 1, 1)), np.zeros(SAMPLES)
    for j, (alpha, d, theta, r) in enumerate(np.array(_TABLE) * (np.pi / 180, 1e-3, np.pi / 180, 1e-3)):
        T = T @ link_matrices("craig", theta + robot.joints[:, j], zero + r, zero + d, zero + alpha)
    return (holds("1.1: Z 0Tn E", float(np.abs((T @ E)[:, :3, 3] - arm.points(robot.joints, values)[:, 0]).max())),)


def _frames() -> tuple[ComparedValue, ...]:
    """Check 1.3 and 1.5: a pose by six parameters, and back."""
    rows = rng_for(0, "arm").uniform([-3, -1, 0.2, -1, -3, -1], [3, 1, 2.9, 1, 3, 1], (SAMPLES, 6))
    gamma, b, alpha, d, theta, r = rows.T
    exact = _turn(_Z, gamma) @ _along(_Z, b) @ _turn(_X, alpha) @ _along(_X, d) @ _turn(_Z, theta) @ _along(_Z, r)
    forth = max(float(np.abs(pose_of(row) - T).max()) for row, T in zip(rows, exact, strict=True))
    back = max(float(np.abs(pose_of(khalil_frame(T).values) - T).max()) for T in exact)
    moved = np.stack([(pose_of(rows[0] + step) - pose_of(rows[0] - step)).ravel() / 2e-6 for step in 1e-6 * np.eye(6)])
    return (
        number("parameters that locate a frame", "6", int(np.linalg.matrix_rank(moved, tol=1e-4))),
        holds("1.3, 1.5: a pose of six parameters", forth),
        holds("and the six parameters of a pose", back),
    )


def _grouped() -> tuple[ComparedValue, ...]:
    """Check 1.4 and 1.6: about one axis turns add up, and so do lengths along it."""
    rows = rng_for(0, "arm").uniform(-1, 1, (SAMPLES, 8))
    gamma, b, alpha, d, theta, r, theta_1, r_1 = rows.T
    first = _turn(_Z, gamma) @ _along(_Z, b) @ _turn(_X, alpha) @ _along(_X, d)
    apart = first @ _turn(_Z, theta) @ _along(_Z, r) @ _turn(_Z, theta_1) @ _along(_Z, r_1)
    grouped = first @ _turn(_Z, theta + theta_1) @ _along(_Z, r + r_1)
    columns = np.stack([
        (_first_link(rows[0] + step) - _first_link(rows[0] - step)).ravel() / 2e-6 for step in 1e-6 * np.eye(8)
    ])  # fmt: skip
    return (
        holds("1.4: θz and rz group with θ1 and r1 where α1 = d1 = 0", float(np.abs(apart - grouped).max())),
        number(
            "independent of γz, bz, αz, dz, θz, rz, θ1, r1",
            "",
            int(np.linalg.matrix_rank(columns, tol=1e-4)),
            right="6",
        ),
        number("independent parameters between neighbouring frames, at most", "4", _between()),
    )


def _first_link(row: Array) -> Array:
    """Return poses of frame 1 in the world at three positions of joint 1."""
    gamma, b, alpha, d, theta, r, theta_1, r_1 = row
    Z = pose_of(np.array([gamma, b, alpha, d, theta, r]))
    angles = theta_1 + np.array([0.0, 0.7, -1.1])
    return np.asarray(Z @ _turn(_Z, angles) @ _along(_Z, np.full(3, r_1)))


def _between() -> int:
    """Count the identifiable parameters of an inner link that is not between parallel axes: of link 4."""
    arm, values = _off_axis()
    joints = arm.chain.random_joints(200, rng_for(0, "structure"))
    J = arm.observe(joints, values)[1].reshape(-1, len(values))
    return int(np.linalg.matrix_rank(J[:, [i for i, name in enumerate(arm.names) if name.startswith("link4.")]]))


def _off_axis() -> tuple[SerialArm, Array]:
    """Return an RX 130 with a target off its last axis."""
    arm, values = serial("rx130")
    moved = values.copy()
    moved[-3:] = (0.03, 0.02, 0.1)
    return arm, moved


def _table() -> tuple[ComparedValue, ...]:
    table = serial("rx130")[0].chain.table
    answers: list[ComparedValue] = []
    for i, row in enumerate(_TABLE):
        theta, r, d, alpha, _ = table[i]
        ours = (np.rad2deg(alpha), MM.of(d), np.rad2deg(theta), MM.of(r))
        answers += as_row(f"link {i + 1}: α, d, θ − q, r", (
            number(f"{name} of link {i + 1}", "", float(mine), "mm" if name in "dr" else "°", right=f"{value}")
            for name, value, mine in zip(("α", "d", "θ − q", "r"), row, ours, strict=True)
        ))  # fmt: skip
    return tuple(answers)


def _identifiable() -> tuple[ComparedValue, ...]:
    arm, values = _off_axis()
    joints = arm.chain.random_joints(200, rng_for(0, "structure"))
    J = arm.observe(joints, values)[1].reshape(-1, len(values))
    names = list(arm.names)
    identifiable = len(base_set_of(J, range(len(names))).identifiable)
    without = [i for i, name in enumerate(names) if name != "link3.beta"]
    turned = ", ".join(name.removeprefix("link").removesuffix(".beta") for name in names if name.endswith(".beta"))
    return (
        word("neighbouring axes with a β: of joint", "", turned, right="3"),
        number("identifiable with β3, one target", "", identifiable, right="27"),
        number(
            "identifiable without β3", "", len(base_set_of(J[:, without], range(len(without))).identifiable), right="26"
        ),
    )


def _misaligned() -> tuple[ComparedValue, ...]:
    """Compute figure 3: the common normal of two axes, of which one is tilted by β about y from parallel."""
    beta, d = rng_for(0, "arm").uniform([1e-4, 0.1], [0.1, 1.0], (SAMPLES, 2)).T
    tilted = _along(_X, d) @ _turn(np.array([0.0, 1.0, 0.0]), beta)
    base = np.array([khalil_frame(T).values[1] for T in tilted])
    of_rx130 = _along(_X, serial("rx130")[0].chain.table[2:3, 2]) @ _turn(np.array([0.0, 1.0, 0.0]), np.array([1e-3]))
    along = abs(float(khalil_frame(of_rx130[0]).values[1]))
    return (
        formula("r of the common normal", "", base, {"β": beta, "d": d}, right="−d/tan(β)"),
        number("of the RX 130's 625 mm at 1 mrad", "", along, "m", right="625.0"),
    )


STAUBLI = Source(
    "staubli",
    "A thesis on the calibration of an RX 130 and the dynamics of a TX 40 (Centrale Nantes), up to section 1.4",
    with_exercises((
        Item("Equation 1.1", "The direct model with base and tool", _whole, "lab kinematics rx130 --tool-mm 30,20,100"),
        Item("Equation 1.2", "The matrix of a link", _link, "lab kinematics rx130 --symbolic"),
        Item("Equations 1.3, 1.5", "Base and tool in six parameters", _frames,
             "lab calibrate --robot rx130 --prior off --out base_and_tool",
             "parameters.json of the run has base and tool in these six as well."),
        Item("Equations 1.4, 1.6", "Grouped parameters", _grouped, "lab inspect rx130"),
        Item("Table 1", "Geometric parameters", _table, "lab inspect rx130",
             "The table's numbers are no part of the text; these are the RX 130's of models/rx130."),
        Item("Section 1.3.5", "β between parallel axes", _identifiable, "lab inspect rx130"),
        Item("Figure 3", "A small variation of an axis", _misaligned,
             note="Without β the parameter r of a misaligned axis jumps to minus d over the misalignment."),
    ), "staubli"),
    (
        Missing("Figures 1, 2", "Frames of base and tool", "illustrations of 1.3 and 1.5"),
        Missing("Introduction, 95 %", "The share of geometric errors", "a quotation of Judd and Knasinski 1990 without "
                "data; python scripts/experiments/geometric_share.py tells the share on virtual arms"),
        Missing("Section 1.2", "The four steps",
                "words: lab design, calibrate, identify and compensate are these steps"),
        Missing("Section 1.4, chapters 2 to 5, appendices", "Methods, results, dynamics",
                "the text breaks off at 1.4; python scripts/experiments/global_or_sequential.py compares the two "
                "methods"),
    ),
)  # fmt: skip
