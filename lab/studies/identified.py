"""Identify single campaigns of a study as `lab calibrate` does, by its steps: simulate, fit, validate, compare.

A campaign that cannot be identified is a row, too: of no numbers, with the reason.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lab.calibration.weights import Noise
from lab.core.errors import LabError
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.core.units import MM, MRAD
from lab.kinematics.parameter import Parameter
from lab.library.calibrate import Assessment
from lab.library.simulate import measured_session
from lab.library.virtual_arm import draw_conditions, fresh_poses, perturbed_arm, requested_conditions
from lab.noise.instruments import Instrument
from lab.options.virtual_campaign import VirtualCampaign
from lab.robots.robot import Robot
from lab.simulation.tracking import VirtualMeasurement
from lab.verdict.fitted import Fitted
from lab.verdict.pipeline import FITTING, run_steps, start

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
    campaigns = _Campaigns(robot, options, device, joints, fresh, set_there)
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
        joints: Array,
        fresh: Array,
        set_there: Mapping[str, Array],
    ) -> None:
        self._robot, self._options, self._device, self._joints = robot, options, device, joints
        self._real, requested = perturbed_arm(robot, options), requested_conditions(robot, options)
        drawn = draw_conditions(self._real, options, len(joints), rng_for(options.seed, "conditions"), requested)
        self._conditions = {**drawn, **set_there}
        reached = fresh_poses(self._real, options, requested, fresh)
        met = np.isfinite(reached.points).all(axis=(1, 2))
        self._fresh, self._unmet = reached[met], int((~met).sum())

    def row(self, draw: int) -> dict[str, Any]:
        """Return the row of one campaign."""
        empty = {"converged": False, "steps": 0, **dict.fromkeys(_NUMBERS, _NONE), "lost": self._unmet}
        try:
            state = self._assessed(draw)
            lost = self._unmet + len(self._joints) - len(state.given)
            return empty | _measures(state) | {"lost": lost}
        except LabError as error:
            return empty | {"failure": f"refused: {error}"}

    def _assessed(self, draw: int) -> Fitted:
        """Simulate one campaign, fit it, and compare it with exact points and the truth."""
        options, noise = self._options, rng_for(self._options.seed, "noise", draw)
        session, placed = measured_session(
            options,
            self._robot,
            VirtualMeasurement(
                self._real, self._joints, options.targets, self._device, noise, options.readings, self._conditions
            ),
        )
        fit = options.fitting.to_si()
        state = start(self._robot, session.measurements, options.kind(), Noise(self._device), fit, seed=options.seed)
        assessment = Assessment(session, placed, self._fresh)
        judged = {"validate": assessment.validate, "compare with the truth": assessment.compare}
        return run_steps(state, {**FITTING, **judged})


def _measures(state: Fitted) -> dict[str, Any]:
    """Return the metrics of a campaign; without those of the parameters where the truth is not single."""
    identification, errors = state.identification, state.validation.errors
    assert errors is not None
    before, after = (MM.of(each[np.isfinite(each)]) for each in (errors.before, errors.after))
    failure = "" if identification.status == "converged" else NOT_CONVERGED
    hidden = state.unshown and not state.fitter.options.search  # parameters of groups that were requested
    if hidden or identification.unobservable:
        failure = RANK_DEFICIENT
    measures = {
        "converged": not failure,
        "steps": identification.fit.iterations,
        "failure": failure,
        "fresh_mean_mm": after.mean(),
        "fresh_p95_mm": np.quantile(after, 0.95),
        "fresh_worst_mm": after.max(),
        "before_mm": before.mean(),
    }
    if (comparison := state.comparison) is None:
        return measures
    parameters = [identification.model.parameters[i] for i in identification.fit.free]
    sizes = {name: size[0] for name, size in parameter_errors(comparison.error[None], parameters).items()}
    return measures | sizes | {"nees": comparison.nees_per_parameter}
