"""Effects of one's own: their errors name them, their columns are read, and a search tries them by name."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import own_effect
import own_parts
import pytest

import lab
from lab import extension_points
from lab.core.errors import LabError
from lab.extension_points import add
from lab.kinematics.effects import own
from lab.kinematics.effects.effect import (
    DisplacesReadings,
    Effect,
    FittedGroup,
    MovesJoints,
    PoseConditions,
    ShapesNoise,
    SimulatedEffect,
    VirtualEffect,
)
from lab.kinematics.effects.effect_registry import effect, own_columns
from lab.kinematics.parameter import joint_parameter
from lab.options.option_groups import Fitting
from lab.robots.load_robot import load_virtual

ROBOT = load_virtual("irb120")
OIL = "oil_C"


@pytest.fixture(autouse=True)
def parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The effects of a test, in it alone."""
    monkeypatch.setattr(extension_points, "_given", {})
    monkeypatch.setattr(extension_points, "_reported", set())
    monkeypatch.setattr(own, "_compared", {})


def _linear(facts: Any) -> tuple[tuple[Any, ...], Callable[..., Any]]:
    size = facts.chain.size
    parameters = tuple(joint_parameter("cosmix", axis, "cos2") for axis in range(size))

    def offsets(joints: np.ndarray, conditions: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        derivative = np.cos(2 * joints)[:, :, None] * np.eye(size)
        return derivative @ values, derivative

    return parameters, offsets


def _registered(changed: Callable[..., Any], group: str = "cosmix") -> None:
    """Register an effect whose function returns what ``changed`` makes of offsets and derivatives."""

    def fitted(facts: Any) -> Effect:
        parameters, offsets = _linear(facts)
        return Effect("cosmix", parameters, lambda *given: changed(*offsets(*given)))

    @dataclass(frozen=True)
    class Cosmix(VirtualEffect):
        name, groups = "cosmix", (FittedGroup(group, fitted),)
        mrad: float = 0.0

        def simulated(self, arm: Any, rngs: Any) -> None:
            return None

    add(Cosmix)


def _late(moved: np.ndarray, derivative: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.where(len(moved) > 8, np.nan, moved), derivative


WRONG: dict[str, tuple[Callable[..., Any], str]] = {
    "raises": (lambda moved, derivative: 1 / 0, "offsets raises ZeroDivisionError: division by zero; repair it"),
    "shape": (lambda moved, derivative: (moved[:, :5], derivative), r"offsets of shape \(8, 5\); return shape"),
    "nan": (lambda moved, derivative: (moved * np.nan, derivative), r"offsets with nan at \(0, 0\)"),
    "nan in a fit alone": (_late, "offsets with nan at"),
    "no derivative": (lambda moved, derivative: moved, r"returns ndarray; return two arrays, the offsets \(8, 6\) and"),
    "texts": (lambda moved, derivative: (moved, "x"), "offsets returns str; return derivatives of shape"),
    "sign": (lambda moved, derivative: (moved, -derivative), "wrong derivative by joint1.cos2: .* but by differences"),
    "one": (lambda moved, derivative: (moved, derivative * [1, 1, 1.01, 1, 1, 1]), "wrong derivative by joint3.cos2"),
}  # fmt: skip


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    while error is not None:
        yield error
        error = error.__cause__


@pytest.mark.parametrize("name", WRONG)
def test_an_error_in_the_fitted_function_names_the_effect_and_the_function(name: str) -> None:
    changed, said = WRONG[name]
    _registered(changed)
    data = lab.simulate("irb120", poses=20, seed=7).measurements
    with pytest.raises(LabError, match=f"effect 'cosmix': .*{said}") as raised:
        lab.identify(data, model="cosmix")
    assert "\n" not in str(raised.value)
    if name == "raises":
        assert any(isinstance(each, ZeroDivisionError) for each in _causes(raised.value))


def test_a_kink_is_no_wrong_derivative() -> None:
    """An effect that saturates has a right derivative on either side."""

    def fitted(facts: Any) -> Effect:
        parameter = joint_parameter("cosmix", 0, "limit")

        def offsets(joints: np.ndarray, conditions: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            moved, derivative = np.zeros(joints.shape), np.zeros((*joints.shape, 1))
            moved[:, 0] = np.abs(values[0])
            derivative[:, 0, 0] = np.sign(values[0])
            return moved, derivative

        return Effect("cosmix", (parameter,), offsets)

    own.fitted_own(FittedGroup("cosmix", fitted), _facts())


def _facts() -> Any:
    from lab.kinematics.effects.effect import ArmFacts

    return ArmFacts(ROBOT.chain)


def test_a_stack_that_is_none_is_refused() -> None:
    def fitted(facts: Any) -> Effect:
        parameters, _ = _linear(facts)

        def offsets(joints: np.ndarray, conditions: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            derivative = np.cos(2 * joints)[:, :, None] * np.eye(6)
            moved = np.einsum("njk,...k->...nj", derivative, values.reshape(-1, 6)[0])
            return (np.stack([moved, 2 * moved]) if values.ndim == 3 else moved), derivative

        return Effect("cosmix", parameters, offsets, stacks=True)

    with pytest.raises(LabError, match="effect 'cosmix': offsets of stacked parameters"):
        own.fitted_own(FittedGroup("cosmix", fitted), _facts())


def test_what_a_group_makes_is_checked() -> None:
    parameters, offsets = _linear(_facts())
    right = Effect("cosmix", parameters, offsets)
    for made, said in {
        5: "fitted returns int",
        replace(right, name="other"): "an Effect named 'other'; name it 'cosmix'",
        replace(right, moves="arm"): "moves 'arm'; give one of joints, frame",  # type: ignore[arg-type]
        replace(right, moves="links"): "give links from 0",
        replace(right, conditions="oil_C"): "return a tuple of names",  # type: ignore[arg-type]
        replace(right, typical=(1.0,)): "1 typical values; give one for each of 6",
    }.items():
        with pytest.raises(LabError, match=said):
            own.fitted_own(FittedGroup("cosmix", lambda _, made=made: made), _facts())  # type: ignore[misc]
    _registered(lambda moved, derivative: (moved, derivative), group="mixed")
    with pytest.raises(LabError, match="cosmix: its group is named mixed"):
        effect("cosmix", ROBOT.chain, None)


@dataclass(frozen=True)
class TrueOil(SimulatedEffect, MovesJoints):
    """Joints that move with the temperature of the oil."""

    rad_per_k: np.ndarray

    @classmethod
    def none(cls, joints: int) -> "TrueOil":
        return cls(np.zeros(joints))

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        return (OIL,)

    def joint_offsets(self, joints: np.ndarray, conditions: PoseConditions) -> np.ndarray:
        return (conditions.column(OIL) - 20)[:, None] * self.rad_per_k


class DrawnOil(TrueOil):
    def drawn_conditions(self, poses: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
        return {OIL: rng.uniform(20.0, 60.0, poses)}


def _fitted_oil(facts: Any) -> Effect:
    size = facts.chain.size
    parameters = tuple(joint_parameter("oil", axis, "oil") for axis in range(size))

    def offsets(joints: np.ndarray, conditions: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        derivative = (conditions[:, :1] - 20)[:, :, None] * np.eye(size)
        return derivative @ values, derivative

    return Effect("oil", parameters, offsets, (OIL,))


def _oil(kind: Callable[[np.ndarray], Any]) -> type[VirtualEffect]:
    @dataclass(frozen=True)
    class Oil(VirtualEffect):
        name, draws, groups = "oil", 1, (FittedGroup("oil", _fitted_oil),)
        urad_per_k: float = 0.0

        def simulated(self, arm: Any, rngs: Any) -> Any:
            return kind(1e-6 * self.urad_per_k * rngs[0].standard_normal(arm.chain.size))

    return Oil


@pytest.mark.thorough
def test_a_file_s_column_of_one_s_own_is_read(tmp_path: Path) -> None:
    add(_oil(DrawnOil))
    day = lab.simulate("irb120", poses=40, seed=7, effects=lab.Effects(own_effects=("oil:urad_per_k=20",)))
    file = tmp_path / "day.csv"
    lab.write_measurements(file, day.measurements)
    assert OIL in file.read_text().partition("\n")[0]
    assert own_columns(("oil", "compliance"), ROBOT.chain, None) == (OIL,)
    found = {
        name: lab.identify(given, robot="irb120", model=model)
        for name, given, model in (
            ("plain", file, "geometric"), ("memory", day.measurements, "oil"), ("file", file, "oil"),
        )
    }  # fmt: skip
    assert found["file"].after.mean == found["memory"].after.mean
    assert found["file"].after.mean < 0.5 * found["plain"].after.mean
    assert not [text for text in found["file"].warnings if OIL in text]
    data, spoiled = lab.read_measurements(file, "irb120"), tmp_path / "spoiled.csv"
    lab.write_measurements(spoiled, replace(data, other={OIL: ("warm",) * len(data)}))
    with pytest.raises(LabError, match=rf"line 2, column {OIL}: 'warm'"):
        lab.identify(spoiled, robot="irb120", model="oil")
    with pytest.raises(LabError, match=rf"line 2, column {OIL}: 'warm' is no finite number"):
        lab.identify(lab.read_measurements(spoiled, "irb120"), model="oil")


def test_a_column_that_nobody_makes_is_refused() -> None:
    add(_oil(TrueOil))
    with pytest.raises(LabError, match=r"effect 'oil': the lab makes no column oil_C, .* TrueOil.drawn_conditions"):
        lab.simulate("irb120", poses=10, effects=lab.Effects(own_effects=("oil:urad_per_k=20",)))
    with pytest.raises(LabError, match="condition oil_C is missing"):
        PoseConditions({}, 3, ROBOT.chain.joint_names).column(OIL)


class Raising(own_parts.TrueRunout):
    def joint_offsets(self, joints: np.ndarray, conditions: PoseConditions) -> np.ndarray:
        raise KeyError("gear")


class Narrow(own_parts.TrueRunout):
    def joint_offsets(self, joints: np.ndarray, conditions: PoseConditions) -> np.ndarray:
        return np.zeros((len(joints), 1))


class Short(DrawnOil):
    def drawn_conditions(self, poses: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
        return {OIL: np.zeros(2)}


class Displaced(TrueOil, DisplacesReadings):
    """Readings that an effect displaces."""

    is_on = True

    def conditions(self, joint_names: tuple[str, ...]) -> tuple[str, ...]:
        return ()

    def joint_offsets(self, joints: np.ndarray, conditions: PoseConditions) -> np.ndarray:
        return np.zeros(joints.shape)

    def displacements(self, poses: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros((poses, 2)), np.zeros(poses, dtype=bool)


class Unsure(Displaced, ShapesNoise):
    """Noise of which nobody knows whether it is on."""

    @property
    def is_on(self) -> bool:  # type: ignore[override]
        return bool(1 / 0)

    def displacements(self, poses: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        return np.zeros((poses, 3)), np.zeros(poses, dtype=bool)

    def shaped(self, noise: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return noise


@dataclass(frozen=True)
class Idle(SimulatedEffect):
    @classmethod
    def none(cls, joints: int) -> "Idle":
        return cls()


SIMULATED: dict[str, tuple[Callable[..., Any], str]] = {
    "raises": (lambda waves: Raising(np.zeros((6, 2))), r"Raising.joint_offsets raises KeyError: 'gear'; repair it"),
    "shape": (lambda waves: Narrow(np.zeros((6, 2))), r".*joint_offsets returns numbers of shape \(10, 1\); return"),
    "column": (lambda waves: Short(waves), r"Short.drawn_conditions returns a column oil_C of shape \(2,\)"),
    "none": (lambda waves: 1 / 0, "Oil.simulated raises ZeroDivisionError: division by zero; repair it"),
    "kind": (lambda waves: 5, "Oil.simulated returns int; return a lab.kinematics.effects.effect.SimulatedEffect"),
    "displaced": (lambda waves: Displaced(waves), r"Displaced.displacements returns displacements of shape \(10, 2\)"),
    "unsure": (lambda waves: Unsure(waves), "Unsure.is_on raises ZeroDivisionError: division by zero; repair it"),
    "idle": (lambda waves: Idle(), "Idle changes nothing; derive it also from one of MovesJoints"),
}  # fmt: skip


@pytest.mark.parametrize("name", SIMULATED)
def test_an_error_in_the_simulated_effect_names_it(name: str) -> None:
    kind, said = SIMULATED[name]
    add(_oil(kind))
    with pytest.raises(LabError, match=f"^effect 'oil': {said}"):
        lab.simulate("irb120", poses=10, effects=lab.Effects(own_effects=("oil:urad_per_k=20",)))


@pytest.mark.thorough
def test_auto_tries_a_group_of_a_package_where_it_is_named() -> None:
    add(own_parts.Runout)
    add(_oil(DrawnOil))
    effects = lab.Effects(own_effects=("oil:urad_per_k=10",))
    day = lab.simulate("irb120", poses=40, seed=7, effects=effects).measurements
    found = lab.identify(day, model="auto+oil")
    assert found.to_dict()["model"] == "geometric+oil"
    with pytest.raises(LabError, match=f"column {OIL} is missing"):
        lab.identify(replace(day, conditions={}), model="auto+oil")
    assert Fitting(model="runout+auto").to_si() == Fitting(model="auto+runout").to_si()
    assert Fitting(model="auto").to_si().further == ()
    with pytest.raises(LabError, match=r"auto.compliance: compliance is no such group as goes with auto"):
        lab.calibrate("irb120", poses=20, model="auto+compliance")
    with pytest.raises(LabError, match=r"model runot: no such group.*did you mean runout"):
        lab.calibrate("irb120", poses=20, model="auto+runot")


@pytest.mark.thorough
def test_what_an_effect_of_the_model_explains_is_no_step() -> None:
    oil = lab.Effects(own_effects=(own_effect.Oil(urad_per_k=5),))
    rows = lab.simulate("irb120", poses=60, seed=7, effects=oil).measurements
    alone, beside = (
        lab.identify(rows, robot="irb120", model=model, instrument="uniform-8um")
        for model in ("geometric", own_effect.Oil)
    )
    assert "joint_step" in {each.name for each in alone.diagnosis} and not beside.diagnosis


def test_a_run_reads_its_columns_and_asks_for_its_package_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A prediction from a file has the column without a warning."""
    add(_oil(DrawnOil))
    effects = lab.Effects(own_effects=("oil:urad_per_k=20",))
    day = lab.simulate("irb120", poses=40, seed=7, effects=effects)
    run = lab.identify(day.measurements, model="oil", instrument="uniform-8um")
    run.save(tmp_path / "run")
    file = tmp_path / "later.csv"
    lab.write_measurements(file, day.measurements)
    found = lab.predict(file, tmp_path / "run", force=True)
    assert not [text for text in found.warnings if OIL in text]
    bare = tmp_path / "bare.csv"
    lab.write_measurements(bare, replace(day.measurements, conditions={}))
    with pytest.raises(LabError, match=f"column {OIL} is missing"):
        lab.predict(bare, tmp_path / "run", force=True)
    assert lab.load_run(tmp_path / "run").estimate.effects == ("oil",)
    monkeypatch.setattr(extension_points, "_given", {})
    with pytest.raises(LabError, match=r"install (it|the package) again"):
        lab.load_run(tmp_path / "run")
