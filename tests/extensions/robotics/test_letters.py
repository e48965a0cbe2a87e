"""Models in letters: Jacobians, their inverses, inverses and programs agree with an own product of matrices."""

import ctypes
import itertools
import shutil
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy
from helpers.any_chain import random_chain

from lab.core.errors import LabError
from lab.extensions.robotics.kinematics.letters import ModelsInLetters, inverse_in_letters
from lab.extensions.robotics.kinematics.nominal_models import inverse_of_jacobian
from lab.extensions.robotics.kinematics.solve_kinematics import solve_kinematics
from lab.extensions.robotics.kinematics.symbolic import formula_text, symbolic_chain, textbook
from lab.extensions.robotics.kinematics.symbolic_inverse import symbolic_inverse
from lab.formats.formula_program import programs_text
from lab.kinematics.inverse.closed_form import closed_form_of
from lab.kinematics.serial.chain import Chain
from lab.robots.load_robot import load_robot

STEP = 1e-5
CHAINS = {name: load_robot(name).chain for name in ("irb120", "versatran", "scara", "planar3r", "ur5")}
ANY = {convention: random_chain(convention, np.random.default_rng(3)) for convention in ("distal", "craig")}  # type: ignore[arg-type]


def turned(axis: int, angle: float) -> np.ndarray:
    T, (i, j) = np.eye(4), [k for k in range(3) if k != axis]
    T[i, i] = T[j, j] = np.cos(angle)
    T[i, j], T[j, i] = -np.sin(angle), np.sin(angle)
    return T if axis != 1 else T.T


def shifted(axis: int, length: float) -> np.ndarray:
    T = np.eye(4)
    T[axis, 3] = length
    return T


def frames(chain: Chain, joints: Sequence[float]) -> list[np.ndarray]:
    """The poses of frame 0 to n by the table's four motions, the textbook's way."""
    found = [np.eye(4)]
    for i, (theta, d, a, alpha, _) in enumerate(chain.table):
        moved = chain.sign[i] * joints[i]
        theta, d = (theta, d + moved) if chain.prismatic[i] else (theta + moved, d)
        z, x = turned(2, theta) @ shifted(2, d), shifted(0, a) @ turned(0, alpha)
        found.append(found[-1] @ (z @ x if chain.convention == "distal" else x @ z))
    return found


def differences(chain: Chain, joints: np.ndarray, frame: int, point: np.ndarray) -> np.ndarray:
    """The Jacobian (6, n) in a frame's axes by central differences of the pose."""
    here, columns = frames(chain, joints), []
    for i in range(chain.size):
        ahead, back = (frames(chain, joints + sign * STEP * np.eye(chain.size)[i])[-1] for sign in (1, -1))
        rate = (ahead - back) / (2 * STEP)
        spin = rate[:3, :3] @ here[-1][:3, :3].T
        R = here[frame][:3, :3].T
        columns.append([*(R @ (rate[:3, :3] @ point + rate[:3, 3])), *(R @ [spin[2, 1], spin[0, 2], spin[1, 0]])])
    return np.array(columns).T


def numbers(matrix: Any, chain: Chain, letters: dict[str, float], joints: np.ndarray) -> np.ndarray:
    symbols = [*symbolic_chain(chain).joints, *(sympy.Symbol(name, real=True) for name in letters)]
    return np.array(sympy.lambdify(symbols, matrix, "numpy")(*joints, *letters.values()), dtype=float)


@pytest.mark.parametrize("chain", [CHAINS["scara"], ANY["craig"]], ids=lambda c: c.convention)
def test_jacobian_in_letters_is_that_of_differences_in_every_frame(chain: Chain) -> None:
    joints, letters = chain.random_joints(1, np.random.default_rng(1))[0], symbolic_chain(chain)
    for frame in range(0, chain.size + 1, 1 if chain.name == "scara" else 2):
        J = numbers(letters.jacobian(frame), chain, letters.letters, joints)
        np.testing.assert_allclose(J, differences(chain, joints, frame, np.zeros(3)), rtol=0, atol=1e-8)


def test_jacobian_of_the_versatran_is_the_course_s() -> None:
    """Mallem 2011, section 8.5, with the misprints of rows 2, 5 and 6 mended."""
    J = symbolic_chain(CHAINS["versatran"]).jacobian()
    assert [[textbook(J[i, j]) for j in range(6)] for i in range(6)] == [
        ["−q3 c1", "0", "−s1", "0", "0", "0"],
        ["−q3 s1", "0", "c1", "0", "0", "0"],
        ["0", "1", "0", "0", "0", "0"],
        ["0", "0", "0", "−s1", "−c1 s4", "c1 c4 s5 − s1 c5"],
        ["0", "0", "0", "c1", "−s1 s4", "c1 c5 + s1 c4 s5"],
        ["1", "0", "0", "0", "−c4", "−s4 s5"],
    ]
    with pytest.raises(LabError, match="give one of 0 to 6"):
        symbolic_chain(CHAINS["versatran"]).jacobian(7)


def test_inverse_of_the_jacobian_in_letters() -> None:
    """By blocks for the VERSATRAN; the course's 'to complete' (section 7.2) of the PRP carrier, worked out by hand."""
    chain = CHAINS["versatran"]
    letters, joints = symbolic_chain(chain), np.array([0.3, 0.5, 0.6, 0.4, 0.7, 0.2])
    back = inverse_in_letters(letters.jacobian())
    np.testing.assert_allclose(numbers(back, chain, {}, joints) @ differences(chain, joints, 0, np.zeros(3)), np.eye(6),
                               rtol=0, atol=1e-7)  # fmt: skip
    assert [textbook(back[0, j]) for j in range(6)] == ["−c1 / q3", "−s1 / q3", "0", "0", "0", "0"]
    jacobian = symbolic_chain(load_robot("carrier/prp").chain).jacobian()
    assert [[textbook(jacobian[i, j]) for j in range(3)] for i in range(3)] == [
        ["0", "−d3 s2 − q3 s2", "c2"], ["0", "d3 c2 + q3 c2", "s2"], ["1", "0", "0"],
    ]  # fmt: skip
    carrier = inverse_in_letters(jacobian)
    assert [[textbook(carrier[i, j]) for j in range(3)] for i in range(3)] == [
        ["0", "0", "1"], ["−s2 / (d3 + q3)", "c2 / (d3 + q3)", "0"], ["c2", "s2", "0"],
    ]  # fmt: skip
    assert inverse_in_letters(symbolic_chain(CHAINS["irb120"]).jacobian()) is None  # its origin is off the wrist


@pytest.mark.thorough
def test_a_tool_point_at_the_wrist_takes_the_table_s_letter() -> None:
    chain = CHAINS["irb120"]
    wanted = {"matrices": True, "inverse_jacobian": True, "inverse": False}
    joints = np.array([0.3, 0.2, -0.4, 0.5, 0.7, 0.1])
    for frame in (3, 0):
        found = ModelsInLetters.of(chain, frame, np.array([0.0, 0.0, -0.072]), None, **wanted)
        if frame == 3:
            assert all(found.jacobian[i, j] == 0 for i in range(3) for j in range(3, 6))
            assert formula_text(found.inverse_jacobian[0, 1]) == "−1 / (a2 s2 + a3 s23 + d4 c23)"
        back = numbers(found.inverse_jacobian, chain, found.chain.letters, joints)
        J = differences(chain, joints, frame, np.array([0, 0, -0.072]))
        np.testing.assert_allclose(back @ J, np.eye(6), rtol=0, atol=1e-6)
    other = ModelsInLetters.of(chain, 0, np.array([0.03, 0.0, 0.1]), None, **wanted)
    assert other.letter_values()["tx_mm"] == 30 and other.letter_values()["tz_mm"] == 100
    J = numbers(other.jacobian, chain, other.chain.letters, joints)
    np.testing.assert_allclose(J, differences(chain, joints, 0, np.array([0.03, 0, 0.1])), rtol=0, atol=1e-8)


def executed(text: str) -> dict[str, Callable[..., list[float]]]:
    space: dict[str, Any] = {}
    exec(text, space)
    return space


SOLVED = {
    "versatran": (4, [1, 2, 1, 2, 3, 3]), "scara": (2, [1, 3, 8]), "planar3r": (2, [3, 8]),
    "scorbot": (4, [2, 3, 3, 8]),
    "carrier/prp": (2, [1, 2, 1]), "carrier/spherical": (4, [2, 2, 1]), "carrier/anthropomorphic": (4, [2, 8]),
}  # fmt: skip
SIX = {"irb120": (8, [2, 7, 2, 3, 3]), "ur5": (8, [2, 2, 3, 3, 8])}


def every_root_meets_the_pose(name: str, count: int, types: list[int]) -> None:
    chain = load_robot(name).chain
    models = ModelsInLetters.of(chain, 0, np.zeros(3), None, matrices=False, inverse_jacobian=False, inverse=True)
    found = models.inverse
    assert found is not None and [each.type for each in found.found] == types
    solve = executed(programs_text(models.programs("arm"), "python"))["arm_inverse"]
    for joints in chain.random_joints(5, np.random.default_rng(4)):
        wanted, solutions = frames(chain, joints)[-1], []
        for signs in itertools.product((1.0, -1.0), repeat=len(found.signs)):
            try:
                solution = solve(wanted[:3].ravel(), *([signs] if signs else []))
            except ValueError:  # no real root: this pose has fewer solutions
                continue
            solutions.append(solution)
            reached = frames(chain, solution)[-1]
            rows = (slice(0, 3), 3) if found.by_place else (slice(0, 3), slice(0, 4))
            np.testing.assert_allclose(reached[rows], wanted[rows], rtol=0, atol=1e-9)
        apart = np.array(solutions)[:, None] - np.array(solutions)[None]
        apart = np.where(chain.prismatic, apart, np.angle(np.exp(1j * apart)))
        form = closed_form_of(chain, np.zeros(3))
        assert form is not None and len(solutions) == (form.solve(wanted[None]).gap_m == 0).sum() <= count
        assert (np.abs(apart).max(axis=2) > 1e-6).sum() == len(solutions) * (len(solutions) - 1)
        away = np.angle(np.exp(1j * (np.array(solutions) - joints)))
        assert np.abs(away).max(axis=1).min() < 1e-9  # the joint positions that it came from


@pytest.mark.parametrize("name", SOLVED)
def test_inverse_in_letters_gives_every_solution(name: str) -> None:
    every_root_meets_the_pose(name, *SOLVED[name])


@pytest.mark.thorough
@pytest.mark.parametrize("name", SIX)
def test_inverse_in_letters_of_six_joints_gives_every_solution(name: str) -> None:
    every_root_meets_the_pose(name, *SIX[name])


@pytest.mark.thorough
def test_an_arm_that_needs_a_quartic_has_no_inverse_in_letters() -> None:
    assert symbolic_inverse(symbolic_chain(load_robot("panda").chain)) is None


def test_programs_in_python_and_c_give_the_same_numbers(tmp_path: Path) -> None:
    chain = CHAINS["scara"]
    models = ModelsInLetters.of(chain, 2, np.zeros(3), None, matrices=True, inverse_jacobian=False, inverse=True)
    programs, joints = models.programs("scara"), np.array([0.3, 0.5, 0.1, 0.2])
    made = executed(programs_text(programs, "python"))
    np.testing.assert_allclose(
        np.reshape(made["scara_pose"](joints), (3, 4)), frames(chain, joints)[-1][:3], atol=1e-12
    )
    J = np.reshape(made["scara_jacobian"](joints), (6, 4))
    np.testing.assert_allclose(J, differences(chain, joints, 2, np.zeros(3)), rtol=0, atol=1e-8)
    matlab = programs_text(programs, "matlab")
    assert matlab.count("function out = ") == 3 == matlab.count("\nend\n") and "[" not in matlab.split("out = [")[0]
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    (tmp_path / "model.c").write_text(programs_text(programs, "c"))
    command = [compiler, "-shared", "-fPIC", "-o", str(tmp_path / "model.so"), str(tmp_path / "model.c"), "-lm"]
    subprocess.run(command, check=True, capture_output=True)
    library, out = ctypes.CDLL(str(tmp_path / "model.so")), (ctypes.c_double * 24)()
    library.scara_jacobian((ctypes.c_double * 4)(*joints), out)
    np.testing.assert_allclose(np.reshape(list(out), (6, 4)), J, rtol=0, atol=1e-15)


def test_inverse_jacobians_by_blocks_and_pseudo_inverses() -> None:
    """Mallem 2011, section 5.6, J⁺ with its misprint mended; against numpy's singular values."""
    rng = np.random.default_rng(5)
    for size, kind in ((3, "left"), (6, "inverse"), (7, "right")):
        J = rng.normal(size=(6, size))
        found = inverse_of_jacobian(J, min(6, size))
        assert found.kind == kind
        np.testing.assert_allclose(found.matrix, np.linalg.pinv(J), rtol=0, atol=1e-10)
    J = rng.normal(size=(6, 6))
    J[:3, 3:] = 0.0
    found = inverse_of_jacobian(J, 6)
    assert found.kind == "blocks" and (found.matrix[:3, 3:] == 0).all()
    np.testing.assert_allclose(J @ found.matrix, np.eye(6), rtol=0, atol=1e-10)
    J[:, 1] = J[:, 0]
    assert inverse_of_jacobian(J, 5).kind == "singular"
    np.testing.assert_allclose(J @ inverse_of_jacobian(J, 5).matrix @ J, J, rtol=0, atol=1e-10)


@pytest.mark.thorough
def test_the_command_has_jacobians_in_any_frame() -> None:
    joints = np.array([10.0, 20, 30, 40, 50, 60])
    for frame in (0, 2, 6):
        found = solve_kinematics(
            "irb120", joints=tuple(joints.tolist()), frame=str(frame), inverse_jacobian=True
        ).to_dict()
        placed = found["placements"][0]
        J = differences(CHAINS["irb120"], np.deg2rad(joints), frame, np.zeros(3))
        np.testing.assert_allclose(placed["jacobian"], J, rtol=0, atol=1e-8)
        np.testing.assert_allclose(np.array(placed["inverse_jacobian"]) @ J, np.eye(6), rtol=0, atol=1e-6)
    with pytest.raises(LabError, match="frame's number from 0 to 6"):
        solve_kinematics("irb120", frame="7")
    with pytest.raises(LabError, match="--frame -1: give base, tool"):
        solve_kinematics("irb120", frame="-1")
    with pytest.raises(LabError, match="has loops; give base or tool"):
        solve_kinematics("rpr2", frame="1")
    with pytest.raises(LabError, match="models in letters are of serial arms"):
        solve_kinematics("rpr2", symbolic_inverse=True)
    by_letters = solve_kinematics("planar3r", symbolic=True, symbolic_inverse=True, inverse_jacobian=True).to_dict()
    assert by_letters["symbolic"]["inverse"]["equations"][0]["type"] == 3
    assert by_letters["symbolic"]["jacobian"][1][2] == "a3 c123"


@pytest.mark.parametrize(("name", "count"), [("cylindrical", 2), ("prp", 2), ("spherical", 4)])
def test_carriers_are_placed_by_their_own_coordinates(name: str, count: int) -> None:
    """Mallem 2011, sections 7.1 and 7.2: x, y, z of cylindrical and polar coordinates, and T1, theta, L2 + T2 back."""
    x, y, z = 300.0, 400.0, 600.0
    turn, lift = np.rad2deg(np.arctan2(y, x)), np.rad2deg(np.arctan2(z, np.hypot(x, y)))
    for coordinates, place in (
        ("cylindrical", (turn, 500.0, z)),
        ("polar", (turn, lift, float(np.sqrt(x**2 + y**2 + z**2)))),
    ):
        found = solve_kinematics(f"carrier/{name}", pose=tuple(map(float, place)), coordinates=coordinates).to_dict()
        assert found["poses"][0]["solutions"] == count and found["poses"][0]["by"] == "closed form"
        for each in found["placements"]:
            np.testing.assert_allclose(each["position_mm"], [x, y, z], rtol=0, atol=1e-6)
            np.testing.assert_allclose(each[coordinates], place, rtol=0, atol=1e-6)
        assert coordinates in solve_kinematics(f"carrier/{name}", pose=place, coordinates=coordinates).summary()
    if name == "prp":
        np.testing.assert_allclose(found["placements"][0]["joints"], [z, turn, 500.0 - 500.0], rtol=0, atol=1e-6)
    with pytest.raises(LabError, match="says what --pose means"):
        solve_kinematics("scara", coordinates="polar")
