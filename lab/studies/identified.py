"""Identify single campaigns of a study as `lab calibrate` does: simulate, fit by every step of the pipeline, validate.

A campaign that cannot be identified is a row, too: of no numbers, with the reason.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from lab.calibration.fitter import Fitter
from lab.calibration.identification import Identification
from lab.calibration.weights import Noise
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM, MRAD
from lab.kinematics.effects.effect_registry import CAMPAIGN_SPECIFIC
from lab.kinematics.parameter import Parameter
from lab.library.virtual_arm import draw_conditions, perturbed_arm, requested_conditions, truth_of
from lab.noise.instruments import Instrument
from lab.options.virtual_campaign import VirtualCampaign
from lab.prediction.validation import TruthComparison, compare_with_truth, errors_of, validate_file
from lab.robots.robot import Robot
from lab.simulation.effects import true_parameters
from lab.simulation.tracking import VirtualMeasurement, recorded
from lab.simulation.true_robot import TrueRobot
from lab.verdict.fitted import Fitted
from lab.verdict.pipeline import FITTING, run_steps

__all__ = ["NOT_CONVERGED", "RANK_DEFICIENT", "identified_campaigns", "parameter_errors"]

NOT_CONVERGED, RANK_DEFICIENT = "not converged", "rank deficient"
_NONE = float("nan")
_NUMBERS = ("fresh_mean_mm", "fresh_p95_mm", "fresh_worst_mm", "length_rms_mm", "angle_rms_mrad",
            "link_length_rms_mm", "link_angle_rms_mrad", "mixed_rms", "nees", "before_mm")  # fmt: skip


def parameter_errors(off: Array, parameters: Sequence[Parameter]) -> dict[str, Array]:
    """Return the root mean squares ``(b,)`` of errors ``(b, f)`` (SI) of lengths, of angles, and of both together.

    Those of the links are of the arm's own dimensions alone.
    """
    angular = np.array([each.is_angle for each in parameters], dtype=bool)
    linear = np.array([each.kind == "length" for each in parameters], dtype=bool)
    link = np.array([each.is_link for each in parameters], dtype=bool)
    lengths, angles = MM.of(off[:, linear]), off[:, angular]
    return {
        "length_rms_mm": _rms(lengths),
        "angle_rms_mrad": MRAD.of(_rms(angles)),
        "link_length_rms_mm": _rms(MM.of(off[:, linear & link])),
        "link_angle_rms_mrad": MRAD.of(_rms(off[:, angular & link])),
        "mixed_rms": _rms(np.concatenate([lengths, angles], axis=1)),
    }


def _rms(values: Array) -> Array:
    """Return root mean squares ``(b,)`` of ``(b, f)``; NaN for no columns."""
    return np.sqrt((values**2).mean(axis=1)) if values.shape[1] else np.full(len(values), np.nan)


def identified_campaigns(
    robot: Robot,
    options: VirtualCampaign,
    device: Instrument,
    draws: int,
    joints: Array,
    fresh: Array,
    set_there: Mapping[str, Array],
) -> dict[str, Array]:
    """Identify all campaigns with one robot, each alone, and return a row each.

    Args:
        options: of the robot and its fit.
        device: the instrument.
        joints: ``(n, joints)`` of the measured poses.
        fresh: ``(m, joints)`` of the validation poses.
        set_there: conditions ``(n,)`` that a plan sets at the measured poses.
    """
    campaigns = _Campaigns(robot, options, device, perturbed_arm(robot, options), joints, fresh, set_there)
    rows = [campaigns.row(draw) for draw in range(draws)]
    kinds = {"converged": bool, "steps": np.int32, "lost": np.int32, "failure": object}
    return {name: np.array([row[name] for row in rows], dtype=kinds.get(name, np.float64)) for name in rows[0]}


class _Campaigns:
    """Campaigns with one robot, which differ in the noise."""

    def __init__(
        self,
        robot: Robot,
        options: VirtualCampaign,
        device: Instrument,
        real: TrueRobot,
        joints: Array,
        fresh: Array,
        set_there: Mapping[str, Array],
    ) -> None:
        self._robot, self._options, self._device, self._real, self._joints = robot, options, device, real, joints
        requested = requested_conditions(robot, options)
        rngs = rng_for(options.seed, "conditions"), rng_for(options.seed, "fresh")
        self._conditions, later = (
            draw_conditions(real, options, len(poses), rng, requested)
            for poses, rng in zip((joints, fresh), rngs, strict=True)
        )
        self._conditions |= set_there
        there = real.points(fresh, options.targets, later)
        met = np.isfinite(there).all(axis=(1, 2))
        self._fresh = recorded(
            real, fresh[met], options.targets, there[met], {name: column[met] for name, column in later.items()}
        )
        self._unmet = int((~met).sum())

    def row(self, draw: int) -> dict[str, Any]:
        """Return the row of one campaign."""
        empty = {"converged": False, "steps": 0, **dict.fromkeys(_NUMBERS, _NONE), "lost": self._unmet}
        try:
            state, placed = self._fitted(draw)
            lost = self._unmet + len(self._joints) - len(state.given)
            return empty | self._measures(state, placed) | {"lost": lost}
        except LabError as error:
            return empty | {"failure": f"refused: {error}"}

    def _fitted(self, draw: int) -> tuple[Fitted, Mapping[str, Array]]:
        options, sensor = self._options, self._options.kind()
        noise = rng_for(options.seed, "noise", draw)
        poses = VirtualMeasurement(
            self._real, self._joints, options.targets, self._device, noise, options.readings, self._conditions
        )
        found = sensor.simulate(poses, options)
        data = found.measurements
        kind = sensor.weighted_by(self._device, data)
        fitter = Fitter(
            self._robot,
            kind.targets(data),
            data,
            kind,
            kind.noise(Noise(self._device)),
            options.fitting.to_si(),
            options.seed,
        )
        return run_steps(Fitted(fitter, fitter.observed().with_points()), FITTING), found.placed

    def _measures(self, state: Fitted, placed: Mapping[str, Array]) -> dict[str, Any]:
        found = state.identification
        before, after = (MM.of(each) for each in self._errors(state))
        failure = "" if found.status == "converged" else NOT_CONVERGED
        hidden = state.unshown and not state.fitter.options.search  # parameters of groups that were requested
        if hidden or found.unobservable:
            failure = RANK_DEFICIENT
        measures = {
            "converged": not failure,
            "steps": found.fit.iterations,
            "failure": failure,
            "fresh_mean_mm": after.mean(),
            "fresh_p95_mm": np.quantile(after, 0.95),
            "fresh_worst_mm": after.max(),
            "before_mm": before.mean(),
        }
        comparison = self._compared(found, placed)
        if comparison is None:
            return measures
        parameters = [found.model.parameters[i] for i in found.fit.free]
        sizes = {name: size[0] for name, size in parameter_errors(comparison.error[None], parameters).items()}
        return measures | sizes | {"nees": comparison.nees_per_parameter}

    def _errors(self, state: Fitted) -> tuple[Array, Array]:
        """Return the errors (m) of all validation points before and after; the base of an arm at fixtures is fitted."""
        found, fresh, fitter = state.identification, self._fresh, state.fitter
        if fitter.kind.in_instrument_frame:
            errors = errors_of(found, fresh)
            both = errors.before, errors.after
        else:
            groups = [group for group in state.groups if group not in CAMPAIGN_SPECIFIC]
            arm = self._robot.arm_with(fresh.targets, groups)
            model = arm if state.process is None else state.process.added_to(arm)
            validation = validate_file(found, model, fresh, found.unplaced)
            assert validation.errors is not None
            both = validation.errors.before, validation.errors.after
        before, after = (each[np.isfinite(each)] for each in both)
        return before, after

    def _compared(self, found: Identification, placed: Mapping[str, Array]) -> TruthComparison | None:
        """Compare the parameters with the truth; None where it is not single."""
        truth = truth_of(self._real, self._robot.arm(self._options.targets))
        if truth is not None:
            truth = replace(truth, effects=true_parameters(self._real.effects))
            truth = self._options.kind().observed_truth(truth, found, self._real, placed)
        return None if truth is None else compare_with_truth(found, truth)
