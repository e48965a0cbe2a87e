"""Sections 8.3, 8.8 and 8.9: the SCEMI and the SCARA, whose tables and models the course leaves to the reader."""

import numpy as np

from lab.extensions.reproduction.answer import Answer, formula, number, word
from lab.extensions.reproduction.item import Item
from lab.extensions.reproduction.models import matrix_formulas, sampled, serial
from lab.kinematics.inverse.closed_form import closed_form_of

__all__ = ["ARM_ITEMS"]

_SCEMI = (  # link matrices, m
    "c1 | −s1 | 0 | 0; s1 | c1 | 0 | 0; 0 | 0 | 1 | 0", "c2 | −s2 | 0 | 0; 0 | 0 | −1 | 0; s2 | c2 | 0 | 0",
    "c3 | −s3 | 0 | 0.5; s3 | c3 | 0 | 0; 0 | 0 | 1 | 0", "c4 | −s4 | 0 | 0; 0 | 0 | 1 | 0.5; −s4 | −c4 | 0 | 0",
    "c5 | −s5 | 0 | 0; 0 | 0 | −1 | 0; s5 | c5 | 0 | 0", "c6 | −s6 | 0 | 0; 0 | 0 | 1 | 0.1; −s6 | −c6 | 0 | 0",
)  # fmt: skip
_SCARA = (
    "c1 | −s1 | 0 | 0; s1 | c1 | 0 | 0; 0 | 0 | 1 | 0", "c2 | −s2 | 0 | 0.4; s2 | c2 | 0 | 0; 0 | 0 | 1 | 0",
    "1 | 0 | 0 | 0.25; 0 | 1 | 0 | 0; 0 | 0 | 1 | q3", "c4 | −s4 | 0 | 0; s4 | c4 | 0 | 0; 0 | 0 | 1 | 0",
)  # fmt: skip


def _places(text: str) -> dict[str, str]:
    """Entries of a matrix by their places."""
    rows = [row.split("|") for row in text.split(";")]
    return {f"({i + 1},{j + 1})": entry.strip() for i, row in enumerate(rows) for j, entry in enumerate(row)}


def _matrices(name: str, links: tuple[str, ...]) -> tuple[Answer, ...]:
    robot = sampled(name)
    return tuple(
        answer
        for i, text in enumerate(links)
        for answer in matrix_formulas(
            f"T{i},{i + 1}", "", robot.between(i, i + 1)[:, :3], robot.variables, _places(text)
        )
    )


def _table(name: str) -> tuple[Answer, ...]:
    """σ, α and a of each joint; θ or r is the joint's."""
    chain = serial(name)[0].chain
    return tuple(
        answer
        for i in range(chain.size)
        for answer in (
            number(f"σ{i + 1}", "", float(chain.prismatic[i]), digits=0),
            number(f"α{i + 1}", "", float(np.rad2deg(chain.table[i, 3])), "°", digits=0),
            number(f"a{i + 1}", "", 1e3 * float(chain.table[i, 2]), "mm", digits=0),
        )
    )


def _scemi() -> tuple[Answer, ...]:
    return (*_table("scemi"), *_matrices("scemi", _SCEMI))


def _six_hinges() -> tuple[Answer, ...]:
    """The three singularities of a 6R arm with a spherical wrist, by the Jacobian of the wrist's centre."""
    robot = sampled("scemi")
    form = closed_form_of(robot.arm.dh_chain(robot.values))
    assert form is not None
    centre = robot.arm.chain.table.copy()
    centre[5, 1] = 0.0
    arm = type(robot.arm)(robot.arm.chain.with_table(centre), ("p1",))
    J = arm.tool(robot.joints, arm.nominal({"p1": np.zeros(3)}))[1]
    right = "−0.5 · 0.5 c3 s5 (0.5 s23 − 0.5 c2)"
    names = ", ".join(sorted(factor.name for factor in form.determinant.factors if factor.terms))
    return (
        formula("det J", "", np.linalg.det(J), robot.variables, right=right),
        word("the singularities", "", names),
    )


def _scara() -> tuple[Answer, ...]:
    robot = sampled("scara")
    T, J = robot.between(0, 4), robot.jacobian()
    v = robot.variables | {"x": T[:, 0, 3], "y": T[:, 1, 3], "z": T[:, 2, 3]}
    kinds = "".join("P" if slides else "R" for slides in robot.arm.chain.prismatic[:3])
    direct = {"x": "0.4 c1 + 0.25 c12", "y": "0.4 s1 + 0.25 s12", "z": "q3"}
    reduced = J[:, [0, 1, 2, 5]]
    rows = {f"({i},{j})": "0" for i in range(1, 5) for j in range(1, 5)} | {
        "(1,1)": "−y", "(1,2)": "−0.25 s12", "(2,1)": "x", "(2,2)": "0.25 c12", "(3,3)": "1", "(4,1)": "1",
        "(4,2)": "1", "(4,4)": "1",
    }  # fmt: skip
    elbow = v | {"w": np.sign(np.sin(v["q2"]))}
    shoulder = "atan2(y (0.4 + 0.25 c2) − x 0.25 s2, x (0.4 + 0.25 c2) + y 0.25 s2)"
    q1 = np.arctan2(np.sin(v["q1"]), np.cos(v["q1"]))
    return (
        word("type of its first three joints", "RRR", kinds, erratum="the third joint of the drawn arm is a slide"),
        *_table("scara"),
        *_matrices("scara", _SCARA),
        *(formula(name, "", v[name], v, right=text) for name, text in direct.items()),
        formula("q2 of x, y", "", v["q2"], elbow, right="w acos((x^2 + y^2 − 0.4^2 − 0.25^2)/(2 · 0.4 · 0.25))"),
        formula("q1 of x, y, q2", "", q1, v, right=shoulder),
        *matrix_formulas("J of x, y, z and the turn", "", reduced, v, rows),
        formula("det of that J, by which the arm is singular", "", np.linalg.det(reduced), v, right="0.4 · 0.25 s2"),
    )


ARM_ITEMS = (
    Item("Section 8.3", "Table and link matrices of the SCEMI", _scemi, "lab kinematics scemi --symbolic",
         "The course leaves both blank. Lengths are representative: a3 = r4 = 0.5 m and r6 = 0.1 m."),
    Item("Section 8.8", "Singular positions of a 6R arm", _six_hinges, "lab inspect scemi",
         "Of the SCEMI, at the wrist's centre: the factors are zero at the elbow, the wrist and the shoulder."),
    Item("Section 8.9", "The SCARA with four joints", _scara, "lab kinematics scara --symbolic",
         "Lengths are representative: 0.4 and 0.25 m. w is the sign of sin q2, of the two roots."),
)  # fmt: skip
