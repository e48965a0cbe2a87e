"""Simulate a measurement session: a D-optimal path from rest to rest, with and without the load."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lab.core.errors import LabError
from lab.core.linear_model import LinearModel
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM
from lab.extensions.dynamics.arm_simulation import (
    CarryingArm,
    LoadBench,
    RigidLoad,
    RunErrors,
    drawn_mounting,
    peak_torques,
)
from lab.extensions.dynamics.dynamics_options import SimulationOptions
from lab.extensions.dynamics.load_files import Mounting, PayloadSamples
from lab.extensions.dynamics.payload.excitation import (
    CHECKED,
    PERIOD_S,
    FourierPath,
    Limits,
    Regressor,
    design_path,
    design_poses,
    random_path,
)
from lab.kinematics.dynamics.rigid_body import LOAD, Dynamics, hand_motion, wrench_regressor
from lab.robots.robot import Robot
from lab.simulation.collisions import collides
from lab.simulation.robot_model import SerialModel

__all__ = ["MeasuringBench", "simulated_load"]

_STARTS, _MAX_TRIES = 20, 200  # random paths to begin with, and to find another one
_POSES = 20  # at rest, for a wrist sensor
_FORCE_N, _MOMENT_NM = 0.05, 0.002  # noise of a wrist sensor
_OFFSETS = (1.0, -2.0, 0.5, 0.02, -0.01, 0.03)  # N and Nm, of a wrist sensor
_DENSITY = 2700.0  # kg/m^3, aluminium
_MIN_SINGULAR_VALUE = 1e-9  # of the largest singular value
_RESERVE = 1.5  # of the nominal arm's torques on random paths: its largest torques, where none are given


def simulated_load(mass_kg: float, options: SimulationOptions) -> RigidLoad:
    """Return an aluminium ball."""
    radius = (0.75 * mass_kg / np.pi / _DENSITY) ** (1 / 3)
    return RigidLoad(mass_kg, MM.to_si(np.array(options.payload_mm)), 0.4 * mass_kg * radius**2 * np.eye(3))


@dataclass(frozen=True)
class MeasuringBench:
    """Simulated arm of a measurement session.

    Attributes:
        load: None for an arm without a load.
        couplings: C ``(J, J)`` of the drives; None where each turns its own joint.
    """

    robot: Robot
    options: SimulationOptions
    load: RigidLoad | None
    couplings: Array | None = None

    @property
    def _model(self) -> SerialModel:
        return self.robot.serial_model

    @property
    def mounting(self) -> Mounting:
        """Assumed mounting of the arm; the sensor reads the load's wrench on the hand."""
        return Mounting(drawn_mounting(self._model).gravity, -1.0)

    @cached_property
    def _given_torques(self) -> Array | None:
        """Largest torques ``(J,)`` of the joints; None where the robot's model lacks them."""
        try:
            return peak_torques(self._model)
        except LabError:
            return None

    @cached_property
    def largest_torques(self) -> Array:
        """Largest torques ``(J,)`` of the joints; without given ones, those of the nominal arm with a reserve."""
        if self._given_torques is not None:
            return self._given_torques
        limits, own = Limits.of(self._model.chain), CarryingArm(self._model, self.mounting.gravity)
        rng = rng_for(self.options.seed, "structure")
        needed = [np.abs(own.torques(*_checked(random_path(limits, rng)))).max(axis=0) for _ in range(3)]
        return np.asarray(_RESERVE * np.max(needed, axis=0))

    def errors(self) -> RunErrors:
        """Return the errors of the simulated arm and its sensors."""
        options, largest = self.options, self.largest_torques
        coulomb = options.friction_percent / 100 * largest
        tilt = np.deg2rad(options.base_tilt_deg or (0.0, 0.0))
        return RunErrors(
            torque_noise_nm=options.noise_percent / 100 * largest,
            coulomb_nm=coulomb,
            viscous_nm_s=coulomb / Limits.of(self._model.chain).speed,
            motor_inertia_kgm2=options.motor_inertia_kgm2,
            lag_s=options.lag_ms / 1e3,
            torque_filter_hz=options.filter_hz,
            force_noise_n=_FORCE_N,
            moment_noise_nm=_MOMENT_NM,
            wrench_offset=_OFFSETS,
            tilt_rad=(float(tilt[0]), float(tilt[1])),
        )

    def truth(self) -> dict[str, float]:
        """Return the standard parameters of drives and joints, by name."""
        errors, size = self.errors(), self._model.chain.size
        each = (("Ia", errors.motor_inertia_kgm2), ("Fc", errors.coulomb_nm), ("Fv", errors.viscous_nm_s))
        return {
            f"{kind}{j + 1}": float(value)
            for kind, values in each
            for j, value in enumerate(np.broadcast_to(values, size).tolist())
        }

    def designed(self, regressor: Regressor) -> FourierPath:
        """Design a D-optimal path for the regressor's identifiable parameters."""
        limits, strain = self._limits()
        states = np.concatenate(
            [_checked(random_path(limits, rng_for(self.options.seed, "structure", i))) for i in range(3)], axis=1
        )[:, ::25]
        rows = regressor(states[0], states[1], states[2])
        identifiable = LinearModel.of(rows.reshape(-1, rows.shape[2]), _MIN_SINGULAR_VALUE).identifiable

        def shown(joints: Array, speeds: Array, accelerations: Array) -> Array:
            return regressor(joints, speeds, accelerations)[..., identifiable]

        return design_path(
            shown, self.largest_torques, limits, self._collision_free, rng_for(self.options.seed, "design"),
            torque=strain, period_s=self._period_s, starts=1, rounds=self.options.rounds, at_rest=True, drawn=_STARTS,
        )  # fmt: skip

    def another(self) -> FourierPath:
        """Return a random path without collisions, to predict.

        Raises:
            LabError: none is found.
        """
        limits, strain = self._limits()
        rng = rng_for(self.options.seed, "fresh")
        for _ in range(_MAX_TRIES):
            path = random_path(limits, rng, self._period_s, at_rest=True)
            states = _checked(path)
            if self._collision_free(states[0]).all() and (np.abs(strain(*states)) <= limits.torque).all():
                return path
        raise LabError(f"none of {_MAX_TRIES} random paths keeps free of contacts: give the robot more room")

    def driven(self, path: FourierPath, run: int) -> PayloadSamples:
        """Simulate samples along a path, with the load if there is one, and without it; torques alone."""
        bench = LoadBench(self._model, self.load, self.mounting, self.errors(), self.couplings)
        rng = rng_for(self.options.seed, "noise", run)
        records = bench.moving(path.at, self.options.seconds, self.options.rate_hz, rng)
        return replace(records, wrench=None)

    def at_rest(self) -> PayloadSamples:
        """Simulate wrist-sensor readings in D-optimal static poses, with the load and without it."""
        arm = self.robot.serial_arm(("p1",))
        values, gravity = arm.nominal(self.robot.tool), self.mounting.gravity

        def regressor(joints: Array, speeds: Array, accelerations: Array) -> Array:
            motion = hand_motion(arm, values, joints, speeds, accelerations)
            shown = wrench_regressor(motion, gravity)[..., : LOAD.index("Ixx")]
            return np.concatenate([shown, np.broadcast_to(np.eye(6), (len(joints), 6, 6))], axis=2)

        sigma = np.repeat([_FORCE_N, _MOMENT_NM], 3)
        limits, strain = self._limits()
        rng = rng_for(self.options.seed, "design")
        poses = design_poses(regressor, sigma, _POSES, limits, self._collision_free, rng, torque=strain)
        bench = LoadBench(self._model, self.load, self.mounting, self.errors())
        return replace(bench.resting(poses, rng_for(self.options.seed, "noise")), torques=None)

    @property
    def _period_s(self) -> float:
        """Period of the path, of which the run is a multiple."""
        return self.options.seconds / max(1, round(self.options.seconds / PERIOD_S))

    def _limits(self) -> tuple[Limits, Dynamics]:
        strain = CarryingArm(self._model, self.mounting.gravity, self.load).torques
        given = self._given_torques
        torque = None if given is None else (1 - 2 * self.options.friction_percent / 100) * given
        return Limits.of(self._model.chain, torque=torque), strain

    def _collision_free(self, joints: Array) -> NDArray[np.bool_]:
        return ~collides(self._model, joints)


def _checked(path: FourierPath) -> tuple[Array, Array, Array]:
    """Return the states of a path at which its limits are checked."""
    return path.at(path.period_s * np.arange(CHECKED) / CHECKED)
