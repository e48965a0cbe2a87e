"""An effect with a column of its own: joints that move with the temperature of the oil, in ``oil_C`` of a file."""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

import lab
from lab.kinematics.effects.effect import Effect, FittedGroup, MovesJoints, SimulatedEffect, VirtualEffect
from lab.kinematics.effects.effect_registry import effect
from lab.kinematics.parameter import joint_parameter

OIL = "oil_C"


def fitted_oil(facts):
    size = facts.chain.size
    parameters = [joint_parameter("oil", axis, "oil") for axis in range(size)]  # joint1.oil ...: rad per degree

    def offsets(joints, conditions, values):  # (n, joints), (n, 1): the column, (joints,)
        derivative = (conditions[:, :1] - 20)[:, :, None] * np.eye(size)  # (n, joints, joints)
        return derivative @ values, derivative

    return Effect("oil", tuple(parameters), offsets, conditions=(OIL,), plain=plain_oil)


def plain_oil(joints, conditions, values):
    """The offsets at one pose in plain Python: calibrated.py holds this text."""
    return [value * (conditions[0] - 20) for value in values]


@dataclass(frozen=True)
class TrueOil(SimulatedEffect, MovesJoints):
    rad_per_k: np.ndarray  # (joints,)

    @classmethod
    def none(cls, joints):
        return cls(np.zeros(joints))

    def conditions(self, joint_names):
        return (OIL,)

    def drawn_conditions(self, poses, rng):
        return {OIL: np.linspace(20, 60, poses) + rng.normal(0, 3, poses)}

    def joint_offsets(self, joints, conditions):
        return (conditions.column(OIL) - 20)[:, None] * self.rad_per_k

    def true_parameters(self):
        return {f"joint{i}.oil": float(value) for i, value in enumerate(self.rad_per_k, start=1)}


@dataclass(frozen=True)
class Oil(VirtualEffect):
    name, draws, groups = "oil", 1, (FittedGroup("oil", fitted_oil, "joints that move with the oil's temperature"),)

    urad_per_k: float = 0.0  # an option: the size (1 sigma)

    def simulated(self, arm, rngs):
        return TrueOil(1e-6 * self.urad_per_k * rngs[0].standard_normal(arm.chain.size))


def main():
    """Use it."""
    day = lab.simulate("irb120", poses=60, seed=7, effects=lab.Effects(own_effects=(Oil(urad_per_k=5),)))
    made = effect("oil", day.robot.chain, None)  # refuses a wrong derivative
    print(len(made.parameters), "parameters, derivatives compared with differences")

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "day.csv"
        lab.write_measurements(file, day.measurements)
        for model in ("geometric", Oil, ("auto", Oil)):
            result = lab.identify(file, robot="irb120", model=model, instrument="uniform-8um")
            named, fitted = result.options.fitting.model, result.to_dict()["model"]
            print(f"{named}: {fitted}, {result.after.mean:.4f} mm, {result.verdict.word}")


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
