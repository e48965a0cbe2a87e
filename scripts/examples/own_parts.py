"""Parts of your own: an effect, a sensor, an instrument, an error term and a sampler of arms."""

from dataclasses import dataclass, replace

import numpy as np
import tyro

import lab
from lab.kinematics.effects.effect import Effect, FittedGroup, MovesJoints, SimulatedEffect, VirtualEffect
from lab.kinematics.parameter import joint_parameter
from lab.noise.error_term import ErrorTerm
from lab.sensors.points import PointSensor


# Effect: gears that run out three times a turn
def _waves(joints):
    return np.stack([np.sin(3 * joints), np.cos(3 * joints)], axis=-1)  # (n, joints, 2)


def fitted_runout(facts):
    size = facts.chain.size
    parameters = [joint_parameter("runout", axis, wave) for axis in range(size) for wave in ("sin3", "cos3")]

    def offsets(joints, conditions, values):
        derivative = np.einsum("njw,jk->njkw", _waves(joints), np.eye(size)).reshape(*joints.shape, -1)
        return derivative @ values, derivative

    return Effect("runout", tuple(parameters), offsets)


@dataclass(frozen=True)
class TrueRunout(SimulatedEffect, MovesJoints):
    waves_rad: np.ndarray  # (joints, 2)

    @classmethod
    def none(cls, joints):
        return cls(np.zeros((joints, 2)))

    def joint_offsets(self, joints, conditions):
        return (_waves(joints) * self.waves_rad).sum(axis=-1)


@dataclass(frozen=True)
class Runout(VirtualEffect):
    name, draws, groups = "runout", 1, (FittedGroup("runout", fitted_runout),)

    mrad: float = 0.0  # an option: the size of each wave (1 sigma)

    def simulated(self, arm, rngs):
        return TrueRunout(1e-3 * self.mrad * rngs[0].standard_normal((arm.chain.size, 2)))


# Sensor: points, of which the beam is lost wherever the target is below a height
@dataclass(frozen=True)
class LowBeam(PointSensor):
    name = "low-beam"

    def simulate(self, poses, setup):
        found = super().simulate(poses, setup)
        points = found.measurements.points
        hidden = points[..., 2:] < np.quantile(points[..., 2], 0.1)
        return replace(found, measurements=replace(found.measurements, points=np.where(hidden, np.nan, points)))


# Instrument: noise that grows with the square of the range
@dataclass(frozen=True, eq=False, repr=False)
class Photogrammetry(lab.Instrument):
    name: str = "photogrammetry"
    kind: str = "spherical"

    def covariance(self, points, readings=1):
        sigma = 10e-6 * (points**2).sum(axis=-1) / readings**0.5  # m at 1 m
        return sigma[..., None, None] ** 2 * np.eye(3)

    def sample(self, points, rng, readings=1):
        sigma = 10e-6 * (points**2).sum(axis=-1, keepdims=True) / readings**0.5
        return points + sigma * rng.standard_normal(points.shape)


# Error term: a base that moves away and comes back, by the square of the time
class Bow(ErrorTerm):
    name = kind = "bow"
    structure, family = "lasting", "moving"

    def shape(self, of):
        return of.shift * (of.along**2 - (of.along**2).mean())[:, None, None]

    def describe(self, size, carry):
        return (f"the base bows by {1e6 * size:.0f} µm (1σ per axis) over the campaign",)


# Sampler of arms: errors of manufacture within tolerances, none beyond
class Tolerances(lab.Sampler):
    name = "tolerances"

    def draw(self, rng, shape):
        return rng.uniform(-np.sqrt(3), np.sqrt(3), shape)


def main():
    """Use it."""
    options = {"sampler": Tolerances(), "effects": lab.Effects(own_effects=(Runout(mrad=0.1),))}
    options |= {"observe": LowBeam, "instrument": Photogrammetry()}
    for model in ("geometric", Runout):
        result = lab.calibrate("irb120", poses=80, seed=7, model=model, **options)
        named, points = result.options.fitting.model, result.measurements.seen.sum()
        print(f"{named}: {result.after.mean:.4f} mm, {points} points, {result.verdict.word}")

    day = lab.simulate("irb120", poses=80, seed=7)
    along = np.linspace(-1, 1, 80) ** 2
    moved = day.measurements.points + 50e-6 * along[:, None, None] * np.array([0.6, 0.8, 0.0])
    bowed = replace(day.measurements, points=moved)
    result = lab.identify(bowed, instrument="uniform-8um", error_terms=(Bow(),))
    print(*result.state.noise.shared.descriptions)


if __name__ == "__main__":
    tyro.cli(main, description=__doc__)
