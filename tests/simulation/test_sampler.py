"""Samplers of arms: what they draw is what a virtual arm gets, in the standard deviations of the options."""

from dataclasses import replace

import numpy as np
import pytest

import lab
from lab import extension_points
from lab.core.errors import LabError
from lab.extension_points import add
from lab.library.virtual_arm import perturbed_arm
from lab.options.virtual_campaign import VirtualCampaign
from lab.robots.load_robot import load_virtual
from lab.simulation.sampler import Sampler, sampler_named
from lab.simulation.true_robot import perturbed_bodies

ROBOT = load_virtual("irb120")


@pytest.fixture(autouse=True)
def _own_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The samplers of a test, in it alone."""
    monkeypatch.setattr(extension_points, "_given", {})


class Same(Sampler):
    """Every error is one standard deviation."""

    name = "same"

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        return np.ones(shape)


class Broken(Same):
    def __init__(self, made: object) -> None:
        self.made = made

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        if isinstance(self.made, Exception):
            raise self.made
        return np.asarray(self.made)


def test_every_body_is_off_by_what_is_drawn() -> None:
    options = VirtualCampaign(position_sigma_mm=0.25, rotation_sigma_mrad=2.0, offset_sigma_mrad=3.0)
    real = perturbed_arm(ROBOT, replace(options, sampler=add(Same())))
    for name in perturbed_bodies(ROBOT.model):
        body, nominal = real.model.body(name), ROBOT.model.model.body(name)
        np.testing.assert_allclose(body.pos - nominal.pos, 0.25e-3)
        turned = 2 * np.arccos(min(1.0, abs(float(body.quat @ nominal.quat))))
        assert turned == pytest.approx(2e-3 * np.sqrt(3), rel=1e-3)
    np.testing.assert_allclose(real.joint_offset, 3e-3)


def test_tables_and_mechanisms_are_drawn_alike() -> None:
    table = perturbed_arm(ROBOT, VirtualCampaign(dh_only=True, rotation_sigma_mrad=0.0, sampler=add(Same())))
    truth = table.truth(("p1",))
    lengths = [i for i, name in enumerate(truth.arm.names) if name in ("link2.a", "link3.a", "link4.a")]
    nominal = truth.arm.nominal(ROBOT.tool)
    np.testing.assert_allclose((truth.values - nominal)[lengths], 0.5e-3, rtol=1e-6)
    delta = load_virtual("delta")
    real = perturbed_arm(delta, VirtualCampaign(robot="delta", rotation_sigma_mrad=0.0, sampler=add(Same())))
    off = real.values - delta.model.chain.nominal_values
    assert set(np.round(1e3 * off, 9)) == {0.0, 0.5}


BAD = {
    "another shape": (np.zeros(3), r"sampler 'same': draw returns numbers of shape \(3,\); return shape \(8, 6\)"),
    "not finite": (np.full((8, 6), np.nan), "draw returns numbers with nan at"),
    "raises": (ZeroDivisionError("by zero"), "sampler 'same': draw raises ZeroDivisionError: by zero; repair it"),
    "refuses": (LabError("no such arm"), "sampler 'same': no such arm"),
}


@pytest.mark.parametrize("case", BAD)
def test_impossible_draws_are_refused_in_one_line(case: str) -> None:
    made, said = BAD[case]
    with pytest.raises(LabError, match=said):
        lab.simulate(ROBOT, poses=5, sampler=Broken(made))


def test_a_call_takes_an_object_and_names_it() -> None:
    day, usual = (lab.simulate("irb120", poses=8, seed=7, sampler=each) for each in (Same, "normal"))
    assert day.options.sampler == "same"
    assert np.linalg.norm(day.measurements.points - usual.measurements.points, axis=2).mean() > 1e-4
    np.testing.assert_array_equal(day.measurements.joints, usual.measurements.joints)  # other draws stay


def test_what_is_no_sampler_is_refused() -> None:
    with pytest.raises(LabError, match=r"'sampler' is 3; give a name, or a lab.Sampler"):
        lab.simulate(sampler=3)
    with pytest.raises(LabError, match="sampler 'normal': the lab has one of that name; give yours another"):
        lab.simulate(sampler=type("Twin", (Same,), {"name": "normal"}))
    with pytest.raises(LabError, match="sampler uniform: unknown; give one of normal"):
        sampler_named("uniform")
