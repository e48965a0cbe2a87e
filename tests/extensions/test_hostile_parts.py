"""Foreign code is met in one place: what a part raises, returns or prints is named in one line, and ends nothing."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import own_parts
import own_sensors
import pytest

import lab
from lab import extension_points
from lab.core.errors import LabError
from lab.kinematics.effects.effect import Effect, FittedGroup
from lab.robots.load_robot import load_virtual

ROBOT = load_virtual("irb120")
DATA = lab.simulate("irb120", poses=20, seed=7).measurements


@pytest.fixture(autouse=True)
def _own_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The parts of a test, in it alone."""
    monkeypatch.setattr(extension_points, "_given", {})


class Raised:
    """Raises an error in the place of a result."""

    def __init__(self, error: BaseException) -> None:
        self.error = error

    def __call__(self, right: Any) -> Any:
        raise self.error


HOSTILE: dict[str, tuple[Callable[[Any], Any], str]] = {  # what becomes of a right result, and what is said of it
    "raises": (Raised(ZeroDivisionError("by zero")), "raises ZeroDivisionError: by zero; repair it"),
    "ends": (Raised(SystemExit(3)), "raises SystemExit: 3; repair it"),
    "lines": (Raised(ValueError("first\nsecond")), "raises ValueError: first second; repair it"),
    "none": (lambda right: None, "returns NoneType"),
    "text": (lambda right: "right", "returns str"),
    "complex": (lambda right: right * 1j, "returns complex numbers"),
    "huge": (lambda right: right * 0 + 1e300, r"with 1e\+300 at"),
    "nan": (lambda right: right * np.nan, "with nan at"),
    "shape": (lambda right: np.zeros((2, 2, 2, 2)), "of shape .*; return shape"),
}


def _sampler(changed: Callable[[Any], Any]) -> None:
    class Hostile(lab.Sampler):
        name = "hostile"

        def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Any:
            return changed(rng.standard_normal(shape))

    lab.simulate("irb120", poses=3, sampler=Hostile)


def _instrument(method: str) -> Callable[[Callable[[Any], Any]], None]:
    def called(changed: Callable[[Any], Any]) -> None:
        class Hostile(own_parts.Photogrammetry):
            def sample(self, points: np.ndarray, rng: np.random.Generator, readings: int = 1) -> Any:
                right = super().sample(points, rng, readings)
                return changed(right) if method == "sample" else right

            def covariance(self, points: np.ndarray, readings: int = 1) -> Any:
                right = super().covariance(points, readings)
                return changed(right) if method == "covariance" else right

        device = Hostile("hostile")
        lab.identify(lab.simulate("irb120", poses=20, instrument=device).measurements, instrument=device)

    return called


def _sensor(changed: Callable[[Any], Any]) -> None:
    class Hostile(own_sensors.Wire):
        name = "hostile"

        def readings(self, Ts: np.ndarray, values: np.ndarray) -> Any:
            return changed(super().readings(Ts, values))

    lab.simulate("irb120", poses=3, observe=Hostile)


def _estimator(changed: Callable[[Any], Any]) -> None:
    def hostile(problem: lab.EstimationProblem) -> Any:
        _, jacobian = problem.linearized(problem.start)
        return changed(problem.start), np.linalg.inv(jacobian.T @ jacobian)

    lab.identify(DATA, instrument="uniform-8um", estimator=hostile)


def _error_term(changed: Callable[[Any], Any]) -> None:
    class Hostile(own_parts.Bow):
        name = kind = "hostile"

        def shape(self, of: Any) -> Any:
            return changed(super().shape(of))

    lab.identify(DATA, instrument="uniform-8um", error_terms=(Hostile,))


def _fitted_effect(changed: Callable[[Any], Any]) -> None:
    def fitted(facts: Any) -> Effect:
        right = own_parts.fitted_runout(facts)

        def offsets(*given: np.ndarray) -> tuple[Any, Any]:
            moved, derivative = right.offsets(*given)
            return changed(moved), derivative

        return Effect("hostile", right.parameters, offsets)

    @dataclass(frozen=True)
    class Hostile(own_parts.Runout):
        name, groups = "hostile", (FittedGroup("hostile", fitted),)

    lab.identify(DATA, model=Hostile)


def _simulated_effect(changed: Callable[[Any], Any]) -> None:
    class Turned(own_parts.TrueRunout):
        def joint_offsets(self, joints: np.ndarray, conditions: Any) -> Any:
            return changed(super().joint_offsets(joints, conditions))

    @dataclass(frozen=True)
    class Hostile(own_parts.Runout):
        name = "hostile"

        def simulated(self, arm: Any, rngs: Any) -> Any:
            return Turned(np.ones((arm.chain.size, 2)))

    lab.simulate("irb120", poses=3, effects=lab.Effects(own_effects=(Hostile(mrad=1.0),)))


PARTS = {
    "sampler 'hostile': draw": _sampler,
    "instrument 'hostile': sample": _instrument("sample"),
    "instrument 'hostile': covariance": _instrument("covariance"),
    "sensor 'hostile': readings": _sensor,
    "estimator 'hostile': estimate": _estimator,
    "error term 'hostile': shape": _error_term,
    "effect 'hostile': offsets": _fitted_effect,
    "effect 'hostile': Turned.joint_offsets": _simulated_effect,
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("how", HOSTILE)
def test_a_hostile_part_is_named_in_one_line(part: str, how: str) -> None:
    changed, said = HOSTILE[how]
    if (part, how) == ("effect 'hostile': offsets", "complex"):
        pytest.skip("complex steps of the joints are allowed there")
    with pytest.raises(LabError, match=rf"(^|memory: ){part} .*{said}") as raised:
        PARTS[part](changed)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("part", PARTS)
def test_the_same_parts_are_used_as_they_should_be(part: str) -> None:
    PARTS[part](lambda right: right)


WORDS = {
    "none": (lambda: None, "describe returns NoneType; return a tuple of texts"),
    "text": (lambda: "bows", "describe returns str; return a tuple of texts"),
    "numbers": (lambda: (1, 2), "describe returns tuple; return a tuple of texts"),
}


@pytest.mark.parametrize("how", WORDS)
def test_words_of_a_part_are_texts(how: str) -> None:
    returned, said = WORDS[how]

    class Hostile(own_parts.Bow):
        name = kind = "hostile"

        def describe(self, size: float, carry: float) -> Any:
            return returned()

    with pytest.raises(LabError, match=f"error term 'hostile': {said}"):
        Hostile().describe(1.0, 0.0)


def test_what_a_sensor_simulates_is_of_its_type() -> None:
    class Hostile(own_parts.LowBeam):
        name = "hostile"

        def simulate(self, poses: Any, setup: Any) -> Any:
            return super().simulate(poses, setup).measurements

    with pytest.raises(LabError, match=r"sensor 'hostile': simulate returns Measurements; return .*SimulatedReadings"):
        lab.simulate("irb120", poses=3, observe=Hostile)


def test_what_a_part_prints_is_no_part_of_the_json(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Any
) -> None:
    import json

    from lab.cli.main import main

    class Loud(own_parts.Tolerances):
        name = "loud"

        def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
            print("drawing")
            return super().draw(rng, shape)

    monkeypatch.setitem(extension_points._given, "lab.samplers", {"loud": Loud})  # as by an entry point
    code = main(
        ["calibrate", "--poses", "20", "--sampler", "loud", "--no-recording", "--json", "--out", str(tmp_path / "run")]
    )
    printed = capsys.readouterr()
    assert code == 0 and json.loads(printed.out)["verdict"] and "drawing" in printed.err
