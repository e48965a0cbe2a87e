"""Parts of one's own by name: effects, sensors, instruments and error terms do what they say, and are refused well."""

from dataclasses import dataclass, replace

import numpy as np
import own_parts
import pytest

import lab
from lab import extension_points
from lab.core.errors import LabError
from lab.extension_points import add, added, registered
from lab.kinematics.effects.effect import VirtualEffect
from lab.kinematics.effects.effect_registry import CANDIDATES, effect, own_effect
from lab.library.virtual_arm import perturbed_arm
from lab.noise.error_term import TERMS, own_term, terms_with
from lab.noise.instruments import instrument, is_isotropic, observing
from lab.options.option_groups import Effects
from lab.options.virtual_campaign import VirtualCampaign
from lab.pose_selection.criteria import CRITERIA, criterion
from lab.robots.load_robot import load_virtual
from lab.sensors.sensor_registry import sensor_named

ROBOT = load_virtual("irb120")


@pytest.fixture(autouse=True)
def parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The parts of the example, in this test alone."""
    monkeypatch.setattr(extension_points, "_given", {})
    monkeypatch.setattr(extension_points, "_reported", set())
    for part in (own_parts.Runout, own_parts.LowBeam, own_parts.Photogrammetry, own_parts.Bow):
        add(part)


def test_an_effect_is_simulated_as_it_is_fitted() -> None:
    """With the true waves as parameters the model predicts the virtual arm's points."""
    options = VirtualCampaign(
        position_sigma_mm=0.0, rotation_sigma_mrad=0.0, effects=Effects(own_effects=("runout:mrad=0.5",))
    )
    real = perturbed_arm(ROBOT, options)
    (part,) = (each for each in real.effects.parts if isinstance(each, own_parts.TrueRunout))
    assert 0.1e-3 < part.waves_rad.std() < 1e-3
    arm = ROBOT.arm_with(("p1",), ["runout"])
    values = np.concatenate([ROBOT.model.values_before(arm.rigid, real.T_world_tracker), part.waves_rad.ravel()])
    values[len(arm.rigid.names) - 3 : len(arm.rigid.names)] = ROBOT.tool["p1"]
    joints = ROBOT.chain.random_joints(20, np.random.default_rng(0))
    np.testing.assert_allclose(arm.points(joints, values), real.points(joints, ("p1",)), atol=1e-9)
    step, (_, jacobian) = 1e-6, arm.observe(joints, values)
    for i in range(len(arm.rigid.names), len(values)):
        moved = step * (np.arange(len(values)) == i)
        slope = (arm.points(joints, values + moved) - arm.points(joints, values - moved)) / (2 * step)
        np.testing.assert_allclose(jacobian[..., i], slope, atol=1e-7)


def test_effects_of_packages_leave_the_draws_of_others_as_they_are() -> None:
    """Also of each other: a stream belongs to an effect's name."""
    add(type("Another", (own_parts.Runout,), {"name": "another"}))
    alone, beside = (
        perturbed_arm(ROBOT, VirtualCampaign(effects=Effects(harmonic_mrad=0.2, own_effects=own))).effects.parts
        for own in (("runout:mrad=1",), ("another:mrad=1", "runout:mrad=1"))
    )
    usual = perturbed_arm(ROBOT, VirtualCampaign(effects=Effects(harmonic_mrad=0.2))).effects.parts
    np.testing.assert_array_equal(alone[-1].waves_rad, beside[-1].waves_rad)
    assert not np.array_equal(beside[-2].waves_rad, beside[-1].waves_rad)
    joints = np.ones((3, 6))
    for one, other in zip(usual, alone, strict=False):
        if hasattr(one, "joint_offsets") and type(one).__name__ == "ReadingHarmonics":
            np.testing.assert_array_equal(one.joint_offsets(joints, None), other.joint_offsets(joints, None))


def test_an_effect_is_tried_only_by_its_name() -> None:
    assert "runout" not in CANDIDATES
    assert effect("runout", ROBOT.chain, None).parameters[0].name == "joint1.sin3"


@dataclass(frozen=True)
class Simulated(VirtualEffect):
    """An effect without a group to fit."""

    name = "none_fitted"

    def simulated(self, arm, rngs):
        return None


PLAIN = type("Plain", (Simulated,), {"name": "plain"})
WRONG_EFFECTS = {
    "runup": "own.effects runup: unknown; packages add none_fitted, plain, runout",
    "runout:rad=1": "own.effects runout:rad=1: 'rad' is no option, or given twice; there are mrad",
    "runout": "own.effects runout: its size is 0",
    "runout:mrad=1:mrad=2": "'mrad' is no option, or given twice",
    "runout:mrad=x": "'x' is no number",
    "runout:mrad=-1": "give a number from 0 to",
    "plain": "effect 'plain': .* is no dataclass; decorate it by @dataclass",
}


@pytest.mark.parametrize("given", WRONG_EFFECTS)
def test_a_wrong_effect_is_refused(given: str) -> None:
    add(Simulated)
    add(PLAIN())
    with pytest.raises(LabError, match=WRONG_EFFECTS[given]):
        Effects(own_effects=(given,)).check()
    with pytest.raises(LabError, match="an effect is given twice"):
        Effects(own_effects=("runout", "runout:mrad=1")).check()
    with pytest.raises(LabError, match="none_fitted: this effect is simulated alone; it has no group of its name"):
        effect("none_fitted", ROBOT.chain, None)
    assert own_effect("runout") is own_parts.Runout


def test_a_sensor_measures_and_its_readings_are_identified() -> None:
    result = lab.calibrate("irb120", poses=40, seed=3, observe="low-beam", instrument="photogrammetry")
    assert result.measurements.seen.sum() == 36 and result.verdict.word == "good"
    assert not [text for text in result.warnings if "assembly mode" in text]
    assert sensor_named("low-beam") is own_parts.LowBeam


def test_a_sensor_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(extension_points._given["lab.sensors"], "high-beam", own_parts.LowBeam)  # as by an entry point
    for name, said in {
        "high-beam": "'low-beam' is registered in lab.sensors as 'high-beam'",
        "mid": "give one of points",
    }.items():
        with pytest.raises(LabError, match=said):
            lab.calibrate("irb120", poses=20, observe=name)
    with pytest.raises(LabError, match=r"'observe' is .*, which is a sampler; give a lab.sensors.virtual_sensor"):
        lab.calibrate("irb120", poses=20, observe=own_parts.Tolerances())


def test_an_instruments_own_noise_weighs_its_points() -> None:
    device = instrument("photogrammetry")
    points = np.array([[1.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    drawn = device.sample(np.tile(points[:, None], (1, 20_000, 1)), np.random.default_rng(0)) - points[:, None]
    variances = np.array([np.cov(each.T).diagonal() for each in drawn])
    np.testing.assert_allclose(variances, np.diagonal(device.covariance(points), axis1=1, axis2=2), rtol=0.05)
    assert not is_isotropic(device) and observing(device, "points") is device
    with pytest.raises(LabError, match="photogrammetry measures points, not cable"):
        observing(device, "cable")
    assert lab.simulate("irb120", poses=5, instrument=device).options.instrument == "photogrammetry"
    with pytest.raises(LabError, match=r"give one of exact, .*photogrammetry"):
        instrument("sextant")


@pytest.mark.thorough
def test_an_error_term_is_found_where_it_is_and_named_and_else_not() -> None:
    day = lab.simulate("irb120", poses=60, seed=7)
    along = np.linspace(-1, 1, 60) ** 2
    bowed = replace(
        day.measurements, points=day.measurements.points + 50e-6 * along[:, None, None] * np.array([0.6, 0.8, 0])
    )
    with_term, without, clean = (
        lab.identify(data, instrument="uniform-8um", error_terms=terms).state.noise.shared
        for data, terms in ((bowed, ("bow",)), (bowed, ()), (day.measurements, ("bow",)))
    )
    assert with_term is not None and with_term.kinds == ("bow",) and 10e-6 < with_term.size("bow") < 80e-6
    assert without is None or "bow" not in without.kinds
    assert clean is None
    assert with_term.to_dict()["further"] == {"bow": with_term.size("bow")}
    assert [term.kind for term in terms_with(with_term.sizes)] == [*(term.kind for term in TERMS), "bow"]


class Wandering(own_parts.Bow):
    name = kind = "wandering-bow"
    structure = "autoregressive"


def test_a_wrong_error_term_is_refused() -> None:
    add(Wandering)
    with pytest.raises(LabError, match="error term 'wandering-bow': give it the structure lasting"):
        own_term("wandering-bow")
    with pytest.raises(LabError, match=r"error.terms bows: unknown; give one of .*bow, wandering-bow"):
        lab.identify(lab.simulate("irb120", poses=20).measurements, error_terms=("bows",))


def test_the_lab_s_own_names_are_kept(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    class Mine(lab.Criterion):
        name = "O1"

        def score(self, information: np.ndarray) -> np.ndarray:
            return -np.ones(information.shape[:-2])

    monkeypatch.setitem(extension_points._given, "lab.criteria", {"O1": Mine})  # as by an entry point
    assert "O1" not in added("lab.criteria", CRITERIA) and not isinstance(criterion("O1", 3), Mine)
    warned = capsys.readouterr().err
    assert warned == "lab: warning: 'O1' of lab.criteria is left out: the lab has one of that name; rename the entry\n"
    with pytest.raises(LabError, match="criterion 'O1': the lab has one of that name; give yours another"):
        lab.design("irb120", criterion=Mine())


def test_the_last_object_of_a_name_is_the_one_of_that_name() -> None:
    assert registered("lab.samplers") == ()
    day = lab.simulate("irb120", poses=5, sampler=own_parts.Tolerances)
    assert registered("lab.samplers") == ("tolerances",) and day.options.sampler == "tolerances"

    class Tight(own_parts.Tolerances):
        def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
            return 0.1 * super().draw(rng, shape)

    again = lab.simulate("irb120", poses=5, sampler="tolerances", parts=[Tight()])
    assert np.abs(again.measurements.points - day.measurements.points).max() > 1e-4

    class Needy(own_parts.Tolerances):
        def __init__(self, size: float) -> None:
            self.size = size

    with pytest.raises(LabError, match=r"it needs arguments .*; give an object"):
        lab.simulate("irb120", poses=5, sampler=Needy)
    with pytest.raises(LabError, match="is no part; give an object of a subclass"):
        lab.simulate("irb120", poses=5, parts=[3])


def test_a_function_is_a_part_of_one_method() -> None:
    def wide(rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        return rng.uniform(-np.sqrt(3), np.sqrt(3), shape)

    by_function, by_class = (
        lab.simulate("irb120", poses=5, seed=7, sampler=each) for each in (wide, own_parts.Tolerances())
    )
    assert by_function.options.sampler == "wide"
    np.testing.assert_array_equal(by_function.measurements.points, by_class.measurements.points)
    with pytest.raises(LabError, match=r"a function is not enough; give a lab.Instrument"):
        lab.simulate("irb120", poses=5, instrument=wide)


def test_options_of_an_effect_are_numbers() -> None:
    @dataclass(frozen=True)
    class Shaped(own_parts.Runout):
        shape: tuple[float, ...] = (1.0,)

    with pytest.raises(LabError, match=r"effect 'runout': option shape is \(1.0,\); give a number"):
        lab.Effects(own_effects=(Shaped(mrad=1.0),))
    assert lab.Effects(own_effects=(own_parts.Runout(mrad=0.1),)).own_effects == ("runout:mrad=0.1",)
