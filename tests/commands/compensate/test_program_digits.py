"""Corrected programs executed by independent controllers: each target's text carries its correction, or it stays."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from helpers.controller_programs import END, LANGUAGES, PULSES, configuration, posed, program, spelt
from helpers.estimates import with_values
from helpers.simulated_controllers import Controller, NominalArm, Stop
from scipy.spatial.transform import Rotation

from lab.core.se3 import Array
from lab.formats.programs.program_text import ArmShape
from lab.library import compensate as command
from lab.library.calibrate import calibrate
from lab.library.calibration_result import CalibrationResult
from lab.library.compensation_result import CompensationResult
from lab.library.load_run import CalibrationRun, calibrated_by
from lab.options.compensation import CompensateOptions
from lab.options.virtual_campaign import VirtualCampaign

TOOL = posed(Rotation.from_rotvec([0.3, 0, 0.1]), np.array([0.01, 0.02, 0.1]))
TABLE = posed(Rotation.from_rotvec([0.1, 0.2, 0.3]), np.array([0.3, 0.1, 0.2]))
MEMORY = {"UTOOL[2]": TOOL, "TOOL[2]": TOOL, "UFRAME[3]": TABLE, "USER[3]": TABLE}
ROBOTS = {
    "rapid": ("irb120",), "urscript": ("ur5", "ur10"), "krl": ("rx130", "scemi"), "val3": ("tx40", "rx130"),
    "fanuc": ("scemi", "tx40"), "jbi": ("rx130", "tx40"),
}  # fmt: skip
COARSE_PULSES = np.array([15.0, 15.0, 12.0, -40.0, 30.0, 20.0])
REPEATS = np.array([0.01, 0.005])  # mm and degrees that no arm repeats: a loss below is none


@cache
def calibrated(robot: str) -> CalibrationRun:
    return calibrated_by(calibrate(VirtualCampaign(robot=robot, seed=7)), Path("run"))


def hidden(run: CalibrationRun, seed: int, size: float = 1.0) -> CalibrationRun:
    """A calibrated arm whose links are 0.3 mm and 1 mrad (1 sigma) from the nominal ones, times the size."""
    rng = np.random.default_rng(seed)
    is_length = [name.rsplit(".", 1)[1] in ("x", "y", "z", "a", "d") for name in run.estimate.arm.names]
    moved = size * np.where(is_length, 0.3e-3, 1e-3) * rng.standard_normal(len(is_length))
    of_links = [not name.startswith("tool") for name in run.estimate.arm.names]
    values = run.estimate.nominal + np.where(of_links, moved, 0.0)
    return replace(run, estimate=with_values(run.estimate, values))


def controller_of(language: str, run: CalibrationRun, pulses: Array = PULSES) -> Controller:
    chain = run.robot.chain
    arm = NominalArm(chain.table[:, :4], chain.sign, chain.convention == "craig")
    return Controller(language, arm, MEMORY, pulses)


def options_for(language: str, path: Path, content: bytes, pulses: Array = PULSES, **more: object) -> CompensateOptions:
    path.write_bytes(content)
    names = {"fanuc": ("UTOOL[2]", "UFRAME[3]"), "jbi": ("TOOL[2]", "USER[3]")}.get(language, ())
    frames = "; ".join(f"{name}={','.join(spelt(language, MEMORY[name], 10))}" for name in names)
    of_jbi = tuple(pulses.tolist()) if language == "jbi" else ()
    return CompensateOptions(
        Path("run"), program=path, controller=language, frames=frames, pulses_per_deg=of_jbi, no_check=True, **more
    )


def taught(run: CalibrationRun, count: int, rng: np.random.Generator) -> Array:
    """Joint positions ``(count, 6)`` rad away from limits and singularities."""
    chain, found = run.robot.chain, np.empty((0, 6))
    while len(found) < count:
        some = rng.uniform(-1.2, 1.2, (50, 6)) + np.array([0, -0.9, 0.9, 0, 0, 0])
        some[:, 4] = np.abs(some[:, 4]) + 0.4
        some = some[~chain.beyond_limits(some, -0.1).any(axis=1)]
        least = np.linalg.svd(run.estimate.nominal_inverse(0).tool(some)[1], compute_uv=False)[:, -1]
        found = np.concatenate([found, some[least > 0.04]])
    return found[:count]


def made(
    language: str,
    run: CalibrationRun,
    digits: int,
    rng: np.random.Generator,
    count: int = 3,
    pulses: Array = PULSES,
) -> bytes:
    """A program through as many poses as joint positions, with so many digits of mm and degrees (of m and rad).

    Some of the joint positions are a whole turn of the last axis on.
    """
    arm, joints = controller_of(language, run).arm, taught(run, 2 * count, rng)
    turned = joints + np.array([0, 0, 0, 0, 0, 2 * np.pi]) * rng.choice([-1, 1], (2 * count, 1))
    joints = np.where(run.robot.chain.beyond_limits(turned, -0.05).any(axis=1)[:, None], joints, turned)
    T_base = np.eye(4) if language == "urscript" else TABLE
    Ts = np.array([np.linalg.inv(T_base) @ arm.flange(q) @ TOOL for q in joints[:count]])
    shape = ArmShape.of(run.robot.chain)
    where = [configuration(language, shape, q) for q in (joints[:count] + np.pi) % (2 * np.pi) - np.pi]
    places = digits - 3 if language == "urscript" else digits
    content = program(language, Ts, joints[count:], TOOL, T_base, rng, where, places).content
    if language == "jbi" and pulses is not PULSES:
        for i, q in enumerate(np.rad2deg(joints[count:])):
            line = rf"C{i:05d}=.*?(?=\r?\n)".encode()
            content = re.sub(line, f"C{i:05d}={','.join(str(round(x)) for x in q * pulses)}".encode(), content)
    return content


@dataclass(frozen=True)
class Trip:
    """A target that went to the robot: its size and loss (mm, degrees), and whether the lab says it is corrected."""

    correction: Array
    lost: Array
    corrected: bool

    @property
    def share(self) -> float:
        """Of the correction, what the text has lost: in place or in rotation, the larger."""
        return float((self.lost / np.maximum(self.correction, 1e-12)).max())

    @property
    def is_carried(self) -> bool:
        """Whether the text has the correction to a tenth, or to what no arm repeats."""
        return bool((self.lost <= np.maximum(0.1 * self.correction, REPEATS)).all())


def trips(controller: Controller, run: CalibrationRun, before: bytes, result: CompensationResult) -> list[Trip]:
    """Send a program and its corrected text to the hidden robot, and compare where it comes to rest.

    A target for which the lab found no solution is left out, once its numbers are seen to be the same.
    """
    assert result.program is not None
    old, new = before.decode("latin-1"), result.program.content.decode("latin-1")
    reachable = np.flatnonzero(np.isfinite(result.found.joints + result.targets.joints).all(axis=1)).tolist()
    asked = {i: controller.arm.flange(result.targets.joints[i]) for i in reachable}
    rows, near = list[int](), list[Array]()
    for stop in controller.stops(old):
        T = _flange(controller.arm, stop)
        row = min(asked, key=lambda i: float(_apart(T, asked[i]).sum()))
        rows.append(row if _apart(T, asked[row]).max() < 1e-4 else -1)
        near.append(result.targets.joints[row])
    was, now = controller.execute(old, near), controller.execute(new, near)
    found = []
    for first, stop, row, q_was, q_now in zip(
        controller.stops(old), controller.stops(new), rows, was, now, strict=True
    ):
        if row < 0:
            np.testing.assert_array_equal(_flange(controller.arm, first), _flange(controller.arm, stop))
        else:
            corrected = bool(result.found.converged[row])
            if not corrected:
                np.testing.assert_array_equal(q_now, q_was)
            T_was, T_now, T_exact = (_real(run, stop, q) for q in (q_was, q_now, result.found.joints[row]))
            found.append(Trip(_apart(T_was, T_exact), _apart(T_now, T_exact), corrected))
    return found


def _flange(arm: NominalArm, stop: Stop) -> Array:
    if stop.joints is not None:
        return arm.flange(stop.joints)
    assert stop.T_base_tool is not None
    return stop.T_root_base @ stop.T_base_tool @ np.linalg.inv(stop.T_flange_tool)


def _real(run: CalibrationRun, stop: Stop, joints: Array) -> Array:
    """Where the hidden robot has the stop's tool; of joint positions its measured point."""
    arm, values = run.estimate.geometry
    T = arm.tool(joints[None], values)[0][0].copy()
    if stop.joints is None:
        T[:3, 3] -= T[:3, :3] @ values[-3 * len(arm.targets) :][:3]
        T = T @ stop.T_flange_tool
    return T


def _apart(T_a: Array, T_b: Array) -> Array:
    """Distance and angle ``(2,)`` of two poses: mm and degrees."""
    turn = Rotation.from_matrix(T_a[:3, :3].T @ T_b[:3, :3]).magnitude()
    return np.array([1e3 * np.linalg.norm(T_a[:3, 3] - T_b[:3, 3]), np.rad2deg(turn)])


GoAndSee = Callable[..., tuple[list[Trip], CompensationResult]]


@pytest.fixture
def go_and_see(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> GoAndSee:
    """Correct a program for a hidden robot, and send both texts there."""

    def there(
        language: str, run: CalibrationRun, content: bytes, pulses: Array = PULSES, **more: object
    ) -> tuple[list[Trip], CompensationResult]:
        monkeypatch.setattr(command, "load_run", lambda *_, **__: run)
        path = tmp_path / f"p{END[language]}"
        result = command.compensate(options_for(language, path, content, pulses, **more))
        return trips(controller_of(language, run, pulses), run, content, result), result

    return there


def assert_carried(found: list[Trip], result: CompensationResult) -> None:
    """Every corrected target is carried; every other one is named with its reason, and the exit code is 1."""
    for each in found:
        assert each.is_carried or not each.corrected, each
    assert result.program is not None
    left = result.program.uncorrected
    assert all(any(reason in each.reason for each in left) for _, reason in result.failed)
    corrected = set(result.program.rows[result.reached].tolist())
    lines = {each.line for each in left}
    assert all(i in corrected or each.line in lines for i, each in enumerate(result.program.targets))
    assert result.exit_code == int(bool(result.failed) or len(result.program.rows) < len(result.program.targets))
    assert result.to_dict()["converged"] == len(result.to_dict()["program"]["corrected"]) == len(result.reached)


DECIMAL = re.compile(r"(?<![\w.+-])-?\d+\.\d+(?![\w.])")


def disguised(text: str, rng: np.random.Generator) -> str:
    """The same numbers with signs, exponents, and without zeros at their ends."""

    def other(found: re.Match[str]) -> str:
        number = Decimal(found[0])
        sign, digits, exponent = number.as_tuple()
        first, rest = str(digits[0]), "".join(map(str, digits[1:]))
        minus = "-" if sign else ""
        forms = [
            found[0],
            f"{minus or '+'}{found[0].lstrip('-')}",
            f"{minus}{first}.{rest or '0'}E{int(exponent) + len(rest):+d}",
            re.sub(r"^(-?)0\.", r"\1.", found[0]),
            re.sub(r"\.0*$", "", found[0]) if not int(number * 1000) % 1000 else found[0],
        ]
        return str(rng.choice(forms))

    lines = text.splitlines(keepends=True)
    return "".join(line if line.startswith("<?xml") else DECIMAL.sub(other, line) for line in lines)


MOVES = {
    "rapid": r"Move[LJ] p\d+,", "krl": r"$^", "urscript": r"move\w\((?:get_inverse_kin\()?Waypoint",
    "fanuc": r"[JL] P\[\d", "val3": r"$^", "jbi": r"MOV[JL] C",
}  # fmt: skip


@pytest.mark.parametrize("language", LANGUAGES)
def test_few_digits_carry_the_correction(language: str, seven: CalibrationResult, go_and_see: GoAndSee) -> None:
    """One digit, in numbers with exponents, signs and no point, beyond half a turn; each move is made twice."""
    run, rng = hidden(calibrated_by(seven, Path("run")), seed=1), np.random.default_rng(1)
    odd = disguised(text := made(language, run, 1, rng, count=2).decode("latin-1"), rng)
    again = re.sub(rf"^[^\r\n]*{MOVES[language]}[^\r\n]*\r?\n", r"\g<0>\g<0>", odd, flags=re.MULTILINE)
    found, result = go_and_see(language, run, again.encode("latin-1"))
    assert odd != text and len(result.reached) == 4 and (len(found) > 4 or again == odd)
    assert np.abs(result.found.joints).max() > np.pi
    assert max(each.correction[0] for each in found) > 0.3 and all(each.corrected for each in found)
    assert_carried(found, result)


@pytest.mark.slow
@pytest.mark.parametrize("language", LANGUAGES)
def test_study_of_few_digits(language: str, go_and_see: GoAndSee) -> None:
    """Twelve hidden robots, a tenth as far from nominal in each third case, by four numbers of digits."""
    count = 0
    for seed in range(12):
        run = hidden(calibrated(ROBOTS[language][seed % len(ROBOTS[language])]), seed, 0.1 if seed % 3 == 2 else 1.0)
        for digits in range(4):
            content = made(language, run, digits, np.random.default_rng([seed, digits]))
            found, result = go_and_see(language, run, content)
            count += len(found)
            assert_carried(found, result)
    assert count > 200


def test_whole_pulses_refuse_what_they_lose(seven: CalibrationResult, go_and_see: GoAndSee) -> None:
    """Pulses of a fifteenth of a degree: what they round away is listed, and stays; what they carry is written."""
    run = hidden(calibrated_by(seven, Path("run")), seed=3)
    content = made("jbi", run, 3, np.random.default_rng(3), count=6, pulses=COARSE_PULSES)
    found, result = go_and_see("jbi", run, content, COARSE_PULSES)
    assert_carried(found, result)
    refused = [name for name, reason in result.failed if "whole pulses lose" in reason]
    assert 0 < len(refused) == len(found) - len(result.reached)
    assert result.exit_code == 1 and result.to_dict()["verdict"] == "bad"
    assert result.program is not None
    for name in refused:  # another way: the nearest pulses bring the hidden robot to where they say
        exact = result.found.joints[result.targets.ids.index(name)]
        per_rad = np.rad2deg(COARSE_PULSES)
        T_exact, T_pulses = (_real(run, Stop(q), q) for q in (exact, np.round(exact * per_rad) / per_rad))
        lost = _apart(T_exact, T_pulses)
        T_was = _real(run, Stop(exact), result.targets.joints[result.targets.ids.index(name)])
        assert (lost > 0.99 * np.maximum(0.1 * _apart(T_was, T_exact), REPEATS)).any()
        assert any(each.reason.startswith(f"{name}: whole pulses lose") for each in result.program.uncorrected)


@pytest.mark.parametrize(("language", "most"), [("fanuc", (3, 3)), ("jbi", (3, 4))])
def test_listings_get_no_more_digits_than_controllers_print(
    language: str, most: tuple[int, int], seven: CalibrationResult, go_and_see: GoAndSee
) -> None:
    """Unless they are asked for: --digits is the least of all numbers."""
    run = hidden(calibrated_by(seven, Path("run")), seed=4, size=0.03)
    content = made(language, run, 1, np.random.default_rng(4), count=2)
    found, result = go_and_see(language, run, content)
    assert_carried(found, result)
    assert result.program is not None
    places = [len(each) for each in re.findall(rb"-?\d+\.(\d+)(?:,| *mm| *deg|\s)", result.program.content)]
    assert 2 <= max(places) <= max(most)
    found, result = go_and_see(language, run, content, digits=6)
    assert_carried(found, result)
    assert result.program is not None
    assert re.search(rb"\d+\.\d{6}\b", result.program.content)
