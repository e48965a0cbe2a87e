"""Run a virtual campaign: simulate a measurement session, identify from it, and validate against the truth."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from lab.calibration.weights import Noise
from lab.core.checks import Check
from lab.core.errors import option_name
from lab.core.measurements import Measurements
from lab.core.progress import Stage, stages
from lab.core.se3 import Array
from lab.core.units import MM
from lab.kinematics.effects.effect_registry import CAMPAIGN_SPECIFIC
from lab.library.calibration_result import CalibrationResult
from lab.library.simulate import MeasurementSession, SimulatedTruth, measurement_session
from lab.library.virtual_arm import truth_of
from lab.options.call_options import options_of, takes
from lab.options.named_instruments import named_instrument
from lab.options.virtual_campaign import VirtualCampaign
from lab.prediction.validation import Validation, compare_with_truth, errors_of, validate_file
from lab.robots.load_robot import load_virtual
from lab.robots.robot import Robot
from lab.simulation.effects import true_parameters
from lab.simulation.true_robot import TrueOpenRobot
from lab.verdict.fit_checks import note
from lab.verdict.fitted import Fitted
from lab.verdict.pipeline import STEPS, Step, chosen_steps, judged, refuse_missing_steps, run_steps, start

__all__ = ["Assessment", "calibrate"]


@takes(VirtualCampaign)
def calibrate(
    robot: str | Path | Robot | VirtualCampaign = "irb120",
    *,
    steps: Mapping[str, Step] | None = None,
    **options: Any,
) -> CalibrationResult:
    """Run a virtual campaign: simulate a measurement session, identify the robot from it, and validate it on new poses.

    Args:
        robot: a model's name, a path, or a loaded robot; or all options in one object.
        steps: of the identification, as ``lab.identify`` takes them; the lab's step ``validate`` is on exact points of
            the virtual robot at poses that were not measured.
        options: those of ``lab calibrate``, by name: ``poses``, ``seed``, ``targets``, ``instrument``, ``model`` and
            so on; ``instrument`` may be a name, a file, or an ``Instrument``, ``effects`` is a ``lab.Effects``,
            ``estimator`` may be an ``Estimator``, and ``sampler`` a ``Sampler``.

    Returns:
        The identified parameters, with base and points in the instrument's frame, and how well they predict.

    Raises:
        LabError: an option is unknown or makes no sense; the message says what is valid.

    Example:
        >>> import lab
        >>> result = lab.calibrate("irb120", poses=50, seed=7, targets=("p1", "p2"))
        >>> result.to_dict()["verdict"]
        'good'
    """
    if isinstance(robot, VirtualCampaign):
        requested, loaded = robot, load_virtual(robot.robot, robot.cell)
    else:
        loaded = load_virtual(robot)
        requested = options_of("lab.calibrate", VirtualCampaign, {"robot": loaded.source, **options})
        loaded = loaded.placed_in(requested.cell)
    with stages("calibrating") as stage:
        stage("simulate the measurements")
        session, placed = measurement_session(requested, loaded)
        return _identified(session, placed, chosen_steps(steps), stage)


def _identified(
    session: MeasurementSession,
    placed: Mapping[str, Array],
    steps: Mapping[str, Step],
    stage: Stage,
) -> CalibrationResult:
    """Identify from a measurement session, and validate on poses that were not measured, against the truth."""
    options, robot = session.options, session.robot
    noise = Noise(named_instrument(options.instrument), readings=options.readings)
    if options.noise_mm is not None:
        noise = Noise(None, MM.to_si(options.noise_mm))
    fit, judging = options.fitting.to_si(), options.judgement()
    refuse_missing_steps(steps, fit, judging)
    state = start(robot, session.measurements, options.kind(), noise, fit, judging, seed=options.seed)
    source = options.plan or f"{option_name('poses')} {options.poses}"
    state = replace(state, source=str(source), checks=tuple(map(note, robot.warnings)))
    started = time.perf_counter()
    state = judged(run_steps(state, Assessment(session, placed).in_place_of_validation(steps), stage))
    seconds = time.perf_counter() - started
    truth = SimulatedTruth(session.true_robot, session.outliers, state.comparison)
    return CalibrationResult(options, robot, state, seconds, truth)


@dataclass(frozen=True)
class Assessment:
    """Steps that know the truth of a simulated session.

    Attributes:
        placed: what is identified beside the arm (``SimulatedReadings.placed``).
        fresh: exact points at poses that were not measured; those of the session, if not given.
    """

    session: MeasurementSession
    placed: Mapping[str, Array]
    fresh: Measurements | None = None

    def in_place_of_validation(self, steps: Mapping[str, Step]) -> Mapping[str, Step]:
        """Return steps with a validation on new poses instead of the lab's."""
        assessed = dict[str, Step]()
        for name, step in steps.items():
            if name == "validate" and step is STEPS[name]:
                assessed |= {"validate": self.validate, "compare with the truth": self.compare}
            else:
                assessed[name] = step
        return assessed

    def validate(self, state: Fitted) -> Fitted:
        """Validate on exact points at poses that were not measured.

        The base of an arm at fixtures is fitted first, with the tool where no reading shows it.
        """
        session, identification, fitter = self.session, state.identification, state.fitter
        fresh = session.validation if self.fresh is None else self.fresh
        checks = _unreached("validation poses", fresh)
        if fitter.kind.in_instrument_frame:
            if not (session.options.occlusion or isinstance(session.true_robot, TrueOpenRobot)):  # it reaches all poses
                checks = _unreached("poses", session.measurements) + checks
            validation = Validation("fresh", errors_of(identification, fresh), rows=fresh)
        else:
            groups = [group for group in state.groups if group not in CAMPAIGN_SPECIFIC]
            arm = session.robot.arm_with(fresh.targets, groups)
            model = arm if state.process is None else state.process.added_to(arm)
            placed_anew = validate_file(identification, model, fresh, identification.unplaced)
            validation = replace(placed_anew, judged_by="fresh", checks=())
        return replace(state, validation=validation).with_checks(checks)

    def compare(self, state: Fitted) -> Fitted:
        """Compare the parameters with the true ones, where these are unique."""
        session, real = self.session, self.session.true_robot
        truth = truth_of(real, session.robot.arm(session.options.targets))
        if truth is not None:
            truth = replace(truth, effects=true_parameters(real.effects))
            truth = session.options.kind().observed_truth(truth, state.identification, real, self.placed)
        if truth is None:
            return state.with_checks([Check("truth.aliased", "noted")])
        return replace(state, comparison=compare_with_truth(state.identification, truth))


def _unreached(what: str, data: Measurements) -> list[Check]:
    """Report poses that the nominal model reaches and the real robot does not; assembly-mode jumps do not count."""
    if not (lost := np.flatnonzero(~data.seen.any(axis=1))).size:
        return []
    where = {"what": what, "lost": len(lost), "count": len(data), "first": data.ids[lost[0]]}
    return [Check("validation.singular", "noted", data=where)]
