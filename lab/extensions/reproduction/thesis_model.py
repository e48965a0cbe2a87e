"""Compute chapter III of Mahdadi and Bouafia 2020: direct and inverse model of the IRB 120."""

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.reproduction.answer import ComparedValue, formula, holds, number, word
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.source_models import (
    as_row,
    link_matrices,
    matrix_formulas,
    matrix_numbers,
    placements,
    sampled,
    serial,
)
from lab.kinematics.inverse.closed_form import closed_form_of
from lab.robots.load_robot import load_virtual

if TYPE_CHECKING:
    from lab.report.document import Picture

__all__ = ["MODEL_ITEMS", "printed_links"]

_LIMITS = ((-165, 165), (-110, 110), (-110, 70), (-160, 160), (-120, 120), (-400, 400))  # °, table III.1
_TABLE = (  # table III.2: theta - q and alpha in °, d and a in mm
    ("0", "290", "0", "-90"), ("-90", "0", "270", "0"), ("0", "0", "70", "-90"),
    ("0", "302", "0", "90"), ("0", "0", "0", "-90"), ("180", "72", "0", "0"),
)  # fmt: skip
_LINKS = (
    "c1 | 0 | −s1 | 0; s1 | 0 | c1 | 0; 0 | −1 | 0 | 290; 0 | 0 | 0 | 1",
    "cos(q2 − π/2) | −sin(q2 − π/2) | 0 | 270 cos(q2 − π/2); sin(q2 − π/2) | cos(q2 − π/2) | 0 | 270 sin(q2 − π/2);"
    "0 | 0 | 1 | 0; 0 | 0 | 0 | 1",
    "c3 | 0 | −s3 | 70 c3; s3 | 0 | c3 | 70 s3; 0 | −1 | 0 | 0; 0 | 0 | 0 | 1",
    "c4 | 0 | s4 | 0; s4 | 0 | −c4 | 0; 0 | 1 | 0 | 302; 0 | 0 | 0 | 1",
    "c5 | 0 | −s5 | 0; s5 | 0 | c5 | 0; 0 | −1 | 0 | 0; 0 | 0 | 0 | 1",
    "−c6 | s6 | 0 | 0; −s6 | −c6 | 0 | 0; 0 | 0 | 1 | 72; 0 | 0 | 0 | 1",
)
_POSE = (-44.11, 383.46, 786.00, 77.71, -0.38, 170.88)  # III.2.2: x y z mm, w p r °
_SOLUTIONS = (  # table III.3, °
    ("100.00", "100.00", "100.00", "100.00", "-80.00", "-80.00", "-80.00", "-80.00"),
    ("27.12", "27.12", "40.00", "40.00", "-40.00", "-40.00", "-27.12", "-27.12"),
    ("-64.90", "-64.90", "-89.00", "-89.00", "-64.90", "-64.90", "-89.00", "-89.00"),
    ("-38.99", "141.01", "-30.00", "150.00", "158.99", "-21.01", "156.37", "-23.63"),
    ("30.72", "-30.72", "40.00", "-40.00", "63.70", "-63.70", "53.32", "-53.32"),
    ("120.98", "-59.02", "110.00", "-70.00", "95.80", "-84.20", "100.78", "-79.22"),
)


def _limits() -> tuple[ComparedValue, ...]:
    chain = serial("irb120")[0].chain
    sides = (("from", chain.lower), ("to", chain.upper))
    answers: list[ComparedValue] = []
    for i, pair in enumerate(_LIMITS[:5]):
        answers += as_row(f"q{i + 1} from, to", (
            number(f"q{i + 1} {side}", str(value), float(np.rad2deg(limit[i])), "°")
            for value, (side, limit) in zip(pair, sides, strict=True)
        ))  # fmt: skip
    return *answers, *as_row("q6 from, to, turns", (
        number(f"q6 {side}, turns", text, float(limit[5] / (2 * np.pi)), "turns")
        for text, (side, limit) in zip(("-1.11", "1.11"), sides, strict=True)
    ))  # fmt: skip


def _sizes() -> tuple[ComparedValue, ...]:
    """Compare reach and depth of the wrist's centre by a grid of joints 2 and 3, and the mass of all bodies."""
    arm, values = serial("irb120")
    steps = 121
    q2, q3 = (np.linspace(arm.chain.lower[i], arm.chain.upper[i], steps) for i in (1, 2))
    joints = np.zeros((steps**2, 6))
    joints[:, 1], joints[:, 2] = np.repeat(q2, steps), np.tile(q3, steps)
    centre = MM.of(arm.frame(joints, values, 4)[:, :3, 3])
    shoulder = np.array([0.0, 0.0, 290.0])
    return (
        number("reach of the wrist's centre", "580", float(np.linalg.norm(centre - shoulder, axis=1).max()), "mm"),
        number("depth below the base", "112", -float(centre[:, 2].min()), "mm"),
        number("mass", "25", float(load_virtual("irb120").model.model.body_mass[1:].sum()), "kg"),
    )


def _dh_table() -> tuple[ComparedValue, ...]:
    table = serial("irb120")[0].chain.table
    answers: list[ComparedValue] = []
    for i, row in enumerate(_TABLE):
        theta, d, a, alpha, _ = table[i]
        ours = (np.rad2deg(theta), MM.of(d), MM.of(a), np.rad2deg(alpha))
        answers += as_row(f"link {i + 1}: θ − q, d, a, α", (
            number(f"link {i + 1} {name}", text, float(value), "mm" if name in "da" else "°")
            for name, text, value in zip(("θ − q", "d", "a", "α"), row, ours, strict=True)
        ))  # fmt: skip
    return tuple(answers)


def printed_links(joints: Array) -> tuple[Array, Array]:
    """Return link matrices ``(n, 6, 4, 4)`` (m) by the printed table III.2, and its rows theta, d, a, alpha, SI."""
    rows = np.array(_TABLE, dtype=np.float64) * (np.pi / 180, 1e-3, 1e-3, np.pi / 180)
    links = [
        link_matrices("distal", theta + joints[:, i], *(np.full(len(joints), each) for each in (d, a, alpha)))
        for i, (theta, d, a, alpha) in enumerate(rows)
    ]
    return np.stack(links, axis=1), rows


def _general_link() -> tuple[ComparedValue, ...]:
    theta, alpha, d, a = np.random.default_rng(0).uniform(-3, 3, (4, 20))
    printed = (
        "cos(θ) | −sin(θ) cos(α) | sin(θ) sin(α) | a cos(θ); sin(θ) | cos(θ) cos(α) | −cos(θ) sin(α) | a sin(θ);"
        "0 | sin(α) | cos(α) | d; 0 | 0 | 0 | 1"
    )
    exact = link_matrices("distal", theta, d, a, alpha)
    return matrix_formulas("T", printed, exact, {"θ": theta, "α": alpha, "d": d, "a": a})


def _links() -> tuple[ComparedValue, ...]:
    robot = sampled("irb120", 1e3)
    return tuple(
        answer
        for i, printed in enumerate(_LINKS)
        for answer in matrix_formulas(f"T{i},{i + 1}", printed, robot.between(i, i + 1), robot.variables)
    )


def _example(degrees: tuple[float, ...], printed: str) -> tuple[ComparedValue, ...]:
    arm, values = serial("irb120")
    T = arm.tool(np.deg2rad([degrees]), values)[0][0] * np.where(np.arange(4) == 3, 1e3, 1.0)
    T[3, 3] = 1.0
    return matrix_numbers("T0,6", printed, T, ("", "", "", "mm"))


def _example_a() -> tuple[ComparedValue, ...]:
    return _example((0, 0, 0, 0, 0, 0), "0|0|1|374; 0|1|0|0; -1|0|0|630; 0|0|0|1")


def _example_b() -> tuple[ComparedValue, ...]:
    return _example((0, 0, -90, -90, 90, -90), "-1|0|0|-70; 0|0|-1|-72; 0|-1|0|862; 0|0|0|1")


def _inverse_of_a_pose() -> tuple[ComparedValue, ...]:
    """Compare the inverse by transposing, entry by entry, with the inverse of the lab's T0,6."""
    T = sampled("irb120", 1e3).between(0, 6)
    v = {f"{letter}{axis}": T[:, i, j] for j, letter in enumerate("noap") for i, axis in enumerate("xyz")}
    rows = [f"{k}x | {k}y | {k}z | −(px {k}x + py {k}y + pz {k}z)" for k in "noa"]
    return (
        word("left side", "T0,6 = T0,6⁻¹", "T6,0 = T0,6⁻¹", right="T6,0 = T0,6⁻¹",
             erratum="a pose is not its own inverse: the left side is the pose of frame 0 in frame 6"),
        number("T0,6(4,4)", "0", float(T[:, 3, 3].mean()), right="1",
               erratum="the last row of a pose is 0 0 0 1, not 0 0 0 0"),
        *matrix_formulas("T6,0", "; ".join([*rows, "0 | 0 | 0 | 1"]), np.asarray(np.linalg.inv(T), dtype=float), v),
    )  # fmt: skip


@cache
def _wrist() -> tuple[dict[str, Array], Array, Array]:
    """Sample the letters of equations III.18 to III.31, the wrist's centre (mm) and R0,6."""
    robot = sampled("irb120", 1e3)
    T, q = robot.between(0, 6), robot.variables
    centre = robot.between(0, 4)[:, :3, 3]
    x, y, z = (centre - np.array([0.0, 0.0, 290.0])).T
    names = {f"{letter}{axis}": T[:, i, j] for j, letter in enumerate("noa") for i, axis in enumerate("xyz")}
    c1, s1, c3, s3 = np.cos(q["q1"]), np.sin(q["q1"]), np.cos(q["q3"]), np.sin(q["q3"])
    letters = {
        **q, **names, "px": T[:, 0, 3], "py": T[:, 1, 3], "pz": T[:, 2, 3], "xp": x, "yp": y, "zp": z,
        "r": np.sqrt(x**2 + y**2 + z**2), "A": -302 * s3 + 70 * c3 + 270, "B": 302 * c3 + 70 * s3,
        "C": x * c1 + y * s1, "D": -z, "β": np.full(len(x), np.arctan2(70, 302)),
    }  # fmt: skip
    return letters, centre, T[:, :3, :3]


def _centre() -> tuple[ComparedValue, ...]:
    letters, centre, _ = _wrist()
    printed = ("2 c1 (151 c23 + 35 s23 + 135 s2)", "2 s1 (151 c23 + 35 s23 + 135 s2)",
               "290 − 302 s23 + 70 c23 + 270 c2")  # fmt: skip
    by_pose = ("−72 ax + px", "−72 ay + py", "−72 az + pz − 290")
    return (
        *(formula(f"III.18 {'xyz'[i]}", text, centre[:, i], letters) for i, text in enumerate(printed)),
        *(formula(f"III.19 {'xyz'[i]}p", text, letters[f"{'xyz'[i]}p"], letters) for i, text in enumerate(by_pose)),
    )


def _shoulder() -> tuple[ComparedValue, ...]:
    """Compare equations III.21 to III.28, the printed q1 to q4 as A to D."""
    v = _wrist()[0]
    q2, q3 = v["q2"], v["q3"]
    t = np.sin(q3 - v["β"])
    return (
        formula("III.21 A s2 + B c2", "C", v["A"] * np.sin(q2) + v["B"] * np.cos(q2), v),
        formula("III.21 B s2 − A c2", "D", v["B"] * np.sin(q2) - v["A"] * np.cos(q2), v),
        formula("III.24 −302 s3 + 70 c3", "42251/135 + r^2/540", -302 * np.sin(q3) + 70 * np.cos(q3), v,
                right="−42251/135 + r^2/540", erratum="the constant −(270² + 70² + 302²)/540 has lost its sign"),
        formula("III.25 the equation before it", "−151 s3 + 35 s3", -151 * np.sin(q3) + 35 * np.cos(q3), v,
                right="−151 s3 + 35 c3", erratum="half of III.24, whose second term is 70 c3: s3 stands for c3"),
        formula("III.25 sin(θ3 − β)", "(270^2 + 70^2 + 302^2 − r^2)/(2 (270) √(70^2 + 302^2))", t, v),
        formula("III.27 s2", "(A C + D B)/(A^2 + B^2)", np.sin(q2), v),
        formula("III.27 c2", "(B C + A D)/(A^2 + B^2)", np.cos(q2), v, right="(B C − A D)/(A^2 + B^2)",
                erratum="the sign of the second product: (B C + A D)/r² does not solve equations III.21"),
        formula("III.28 θ2", "atan2(A C + D B, B C + A D)", np.arctan2(np.sin(q2), np.cos(q2)), v, angle=True,
                right="atan2(A C + D B, B C − A D)", erratum="as III.27"),
    )  # fmt: skip


def _first_joint() -> tuple[ComparedValue, ...]:
    """Check equations III.23 and III.26 with both signs, each at its positions."""
    v = _wrist()[0]
    facing, bent = v["C"] > 0, np.cos(v["q3"] - v["β"]) > 0
    t = np.sin(v["q3"] - v["β"])
    root = np.sqrt(1 - t**2)
    third = np.where(bent, np.arctan2(t, root), np.arctan2(t, -root)) + v["β"]
    first = np.where(facing, np.arctan2(v["yp"], v["xp"]), np.arctan2(-v["yp"], -v["xp"]))
    return (
        holds("III.23 θ1, both roots", float(np.abs(np.exp(1j * first) - np.exp(1j * v["q1"])).max())),
        holds("III.26 θ3, both roots", float(np.abs(np.exp(1j * third) - np.exp(1j * v["q3"])).max())),
    )


def _last_joints() -> tuple[ComparedValue, ...]:
    v = _wrist()[0]
    c4, s4, c5, s5, c6, s6 = (f(v[f"q{i}"]) for i in (4, 5, 6) for f in (np.cos, np.sin))
    in_plane = "(c1 ax + s1 ay)"
    v = v | {"s5": s5}
    return (
        formula("III.30 −c4 s5", f"{in_plane} s23 + az c23", -c4 * s5, v),
        formula("III.30 −s4 s5", "s1 ax − c1 ay", -s4 * s5, v),
        formula("III.30 c5", f"−az s23 + {in_plane} c23", c5, v),
        formula("III.30 −c6 s5", "−nz s23 + (c1 nx + s1 ny) c23", -c6 * s5, v),
        formula("III.30 s6 s5", "−oz s23 + (c1 ox + s1 oy) c23", s6 * s5, v),
        formula("III.31 θ5", f"w atan2(√(1 − (−az s23 + {in_plane} c23)^2), −az s23 + {in_plane} c23)",
                np.arctan2(s5, c5), v | {"w": np.sign(s5)}, angle=True),
        formula("III.31 θ4", f"atan2((−s1 ax + c1 ay)/s5, (−{in_plane} s23 − az c23)/s5)", np.arctan2(s4, c4), v,
                angle=True),
        formula("III.31 θ6", "atan2((−oz s23 + (c1 ox + s1 oy) c23)/s5, (nz s23 − (c1 nx + s1 ny) c23)/s5)",
                np.arctan2(s6, c6), v, angle=True),
    )  # fmt: skip


@cache
def _eight_solutions() -> Array:
    """Return the solutions ``(8, 6)`` rad of section III.2.2 in table III.3's order; NaN without a closed form."""
    arm, values = serial("irb120")
    form = closed_form_of(arm.dh_chain(values))
    if form is None:
        return np.full((8, 6), np.nan)
    x, angles = np.array(_POSE[:3]) / 1e3, np.deg2rad(_POSE[3:])
    found = form.solve(se3.pose(se3.rotation_from_roll_pitch_yaw(angles), x)[None]).joints[0]
    printed = np.deg2rad(np.array(_SOLUTIONS, dtype=np.float64).T)
    apart = np.abs(np.exp(1j * found[None]) - np.exp(1j * printed[:, None])).max(axis=2)
    apart[~np.isfinite(apart)] = np.inf
    return np.asarray(found[apart.argmin(axis=1)])


def _solutions() -> tuple[ComparedValue, ...]:
    ours = np.rad2deg(_eight_solutions())
    return tuple(
        answer
        for k in range(8)
        for answer in as_row(f"{k + 1}: q1 to q6", (
            number(f"q{j + 1} of solution {k + 1}", row[k], float(ours[k, j]), "°") for j, row in enumerate(_SOLUTIONS)
        ))
    )  # fmt: skip


def _pictures(which: str) -> "tuple[Picture, ...]":
    arm, values = serial("irb120")
    rows = {
        "III.6": (("q = 0",), np.zeros((1, 6))),
        "III.7": (("0, 0, −90, −90, 90, −90",), np.deg2rad([[0.0, 0, -90, -90, 90, -90]])),
        "III.10": (tuple(f"solution {k + 1}" for k in range(8)), _eight_solutions()),
    }[which]
    return placements(arm, values, *rows) if np.isfinite(rows[1]).all() else ()


_KINEMATICS = "lab kinematics irb120"
_POSE_TEXT = ",".join(f"{value:g}" for value in _POSE)
MODEL_ITEMS = (
    Item("Figure III.1", "Size and mass of the IRB 120", _sizes,
         note="The figure is a drawing; the numbers are those of the text beside it, the lengths of the wrist's "
         "centre. No other command prints them: lab inspect has the reach of the last frame."),
    Item("Table III.1", "Ranges of the joints", _limits, "lab inspect irb120",
         "The range of joint 6, ±400°, is compared in turns."),
    Item("Equations III.1, III.2, III.5, IV.10", "Matrix of a link", _general_link, f"{_KINEMATICS} --symbolic",
         "III.1 is the product, the others the same matrix."),
    Item("Table III.2", "Denavit-Hartenberg table", _dh_table, "lab inspect irb120", "Figure III.4 is this table."),
    Item("Equations III.6 to III.11", "Link matrices, mm", _links, f"{_KINEMATICS} --matrices --symbolic"),
    Item("Equation III.12", "T0,6 with all joints at zero", _example_a, f"{_KINEMATICS} --joints 0,0,0,0,0,0"),
    Item("Figure III.6", "The arm with all joints at zero", command=f"{_KINEMATICS} --joints 0,0,0,0,0,0 --out zeros",
         pictures=lambda: _pictures("III.6")),
    Item("Equation III.13", "T0,6 at a second placement", _example_b, f"{_KINEMATICS} --joints 0,0,-90,-90,90,-90"),
    Item("Figure III.7", "The arm at the second placement",
         command=f"{_KINEMATICS} --joints 0,0,-90,-90,90,-90 --out second", pictures=lambda: _pictures("III.7")),
    Item("Equation III.15", "The inverse of a pose", _inverse_of_a_pose,
         note="No other command prints the inverse of a pose."),
    Item("Equations III.18, III.19", "The wrist's centre, mm", _centre, f"{_KINEMATICS} --symbolic --between 0 4"),
    Item("Equations III.21 to III.28", "Joints 2 and 3", _shoulder, f"{_KINEMATICS} --pose={_POSE_TEXT}",
         "The printed q1 to q4 are written A to D here, since q1 to q6 are the joints."),
    Item("Equations III.23, III.26", "Both roots of joints 1 and 3", _first_joint,
         f"{_KINEMATICS} --pose={_POSE_TEXT}"),
    Item("Equations III.30, III.31", "The wrist", _last_joints, f"{_KINEMATICS} --pose={_POSE_TEXT}",
         "w is the sign of sin θ5, of the two roots of III.31."),
    Item("Table III.3", "Eight solutions of a pose", _solutions, f"{_KINEMATICS} --pose={_POSE_TEXT}"),
    Item("Figure III.10", "The eight solutions", command=f"{_KINEMATICS} --pose={_POSE_TEXT} --out solutions",
         pictures=lambda: _pictures("III.10")),
)  # fmt: skip
