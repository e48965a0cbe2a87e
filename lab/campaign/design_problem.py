"""What a measuring day is planned for: the arm before the nominal tracker, candidates, sensitivities."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from lab.calibration.gauss_newton import whitening
from lab.campaign.instruments import named_instrument
from lab.campaign.options import DesignOptions
from lab.campaign.reachability import ReachabilityGraph, free_home, reachability
from lab.campaign.robot import Robot, load_virtual
from lab.core.errors import LabError
from lab.core.instruments import Instrument, is_isotropic, observing
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.formats.measurement_csv import read_measurements
from lab.kinematics.gauge import BaseSet, base_set
from lab.kinematics.joints import JointSpec
from lab.kinematics.model import RigidArm
from lab.pose_selection.criteria import Criterion, Scaling, criterion
from lab.pose_selection.exchange import Sensitivity, information
from lab.simulation.candidate_poses import Candidates, draw_candidates, feasibility
from lab.simulation.collisions import collides, random_poses, unchecked
from lab.simulation.model import RobotModel

__all__ = ["PoseProblem", "pose_problem"]

TEST_POSES = 500
MEASURED_SLACK = 1e-3  # rad or m: how far joint positions may lie beyond a data sheet's limits


@dataclass(frozen=True)
class PoseProblem:
    """A planning problem, from which designs of any size are chosen.

    Attributes:
        values: nominal parameters ``(p,)``, with the base before the nominal tracker.
        whitened: joint positions ``(n, joints)`` to Jacobians ``(n, r, f)`` of the base set in standard deviations.
        sensitivity: the same in the units of the scaling, which the criterion sees.
        pool: ``(m, r, f)``, sensitivities of the candidates.
        test: ``(t, 3, f)``, Jacobians (m) of the targets at random poses.
        already: ``(n0, joints)``, poses measured before.
        before: ``(n0, r, f)``, sensitivities there.
    """

    robot: Robot
    arm: RigidArm
    structure: BaseSet
    values: Array
    candidates: Candidates
    whitened: Sensitivity
    sensitivity: Sensitivity
    pool: Array
    goal: Criterion
    scaling: Scaling
    test: Array
    access: ReachabilityGraph
    already: Array
    before: Array
    warnings: tuple[str, ...]

    @property
    def measured(self) -> Array | None:
        """Information ``(f, f)`` of the poses measured before, as the criterion sees it; None without any."""
        return information(self.before) if len(self.before) else None


def pose_problem(options: DesignOptions, robot: Robot | None = None) -> PoseProblem:
    """Load the arm, draw candidates, and set up what a design needs.

    Raises:
        LabError: the robot, instrument, targets or criterion cannot be used, or hardly a pose is feasible.
    """
    robot = load_virtual(options.robot, options.cell) if robot is None else load_virtual(robot)
    if options.no_check:
        robot = replace(robot, model=unchecked(robot.model))
    device, scaling = _noisy(options.instrument), Scaling(options.scaling)
    model = robot.model
    arm = robot.arm(options.targets)
    values = model.values_before(arm, model.T_world_tracker)
    structure = base_set(arm, values)
    kept = list(structure.kept)
    rows = 3 * len(arm.targets)
    candidates = draw_candidates(
        model, options.targets, device, options.candidates, rng_for(options.seed, "candidates")
    )

    everywhere = whitening(device.covariance(np.ones(3)))  # of a device whose noise is the same at every point

    def observed(joints: Array) -> tuple[Array, Array]:
        """Points and their Jacobian of the base set; zeros for a pose that the arm cannot take."""
        points, jacobian = arm.observe(joints, values)
        return _finite(points), _finite(jacobian[..., kept])

    def unweighted(joints: Array) -> Array:
        return observed(joints)[1].reshape(len(joints), rows, len(kept))

    def whitened(joints: Array) -> Array:
        points, jacobian = observed(joints)
        white = everywhere if is_isotropic(device) else whitening(device.covariance(points))
        return (white @ jacobian).reshape(len(joints), rows, len(kept))

    jacobians = whitened if scaling.kind == "whitened" else unweighted
    pool = jacobians(candidates.joints)
    factors = scaling.columns([arm.parameters[i] for i in kept], pool)
    fresh = random_poses(model, TEST_POSES // len(arm.targets), rng_for(options.seed, "fresh"))
    test = unweighted(fresh).reshape(-1, 3, len(kept))  # every target counts
    home, warnings = _home(options, robot.chain, model, candidates.joints)
    already = _measured_before(options, robot)
    return PoseProblem(
        robot=robot,
        arm=arm,
        structure=structure,
        values=values,
        candidates=candidates,
        whitened=whitened,
        sensitivity=lambda joints: jacobians(joints) * factors,
        pool=pool * factors,
        goal=criterion(options.criterion, len(kept), test[::5] * factors),
        scaling=scaling,
        test=test,
        access=reachability(model, home, candidates.joints, feasibility(model, options.targets, device)),
        already=already,
        before=jacobians(already) * factors,
        warnings=(*robot.warnings, *warnings, *_unchecked(options)),
    )


def _unchecked(options: DesignOptions) -> tuple[str, ...]:
    return ("nothing was checked for collisions: --no-check",) if options.no_check else ()


def _finite(numbers: Array) -> Array:
    return numbers if np.isfinite(numbers).all() else np.nan_to_num(numbers)


def _noisy(name: str) -> Instrument:
    device = observing(named_instrument(name), "points")
    if device.kind == "exact":
        raise LabError("instrument 'exact' has no noise, so every design is as good: choose another instrument")
    return device


def _home(
    options: DesignOptions, chain: JointSpec, model: RobotModel, candidates: Array
) -> tuple[Array, tuple[str, ...]]:
    """What is asked for; else the robot's home, or a pose near it if the arm touches itself there."""
    if options.home:
        return _asked_home(options.home, chain, model), ()
    home = free_home(model, candidates)
    if np.array_equal(home, chain.home):
        return home, ()
    return home, (
        f"robot {chain.name} touches something at zero joint positions: the tour starts from a pose near them",
    )


def _asked_home(given: Sequence[float], chain: JointSpec, model: RobotModel) -> Array:
    """The joint positions ``(n,)`` that ``--home`` says."""
    said = f"--home {','.join(f'{number:g}' for number in given)}"
    if len(given) != chain.size or not np.isfinite(given).all():
        raise LabError(f"{said}: give one finite number for each of {', '.join(chain.joint_names)}")
    scale = np.where(chain.prismatic, 1e-3, np.pi / 180)
    home = np.array(given) * scale
    if (beyond := np.flatnonzero(chain.beyond_limits(home[None], 1e-9)[0])).size:
        raise LabError(f"{said}: {chain.said_beyond(int(beyond[0]), home[beyond[0]])}; start within")
    if why := chain.infeasibility_reason(home):
        raise LabError(f"{said}: {why}; start elsewhere")
    if collides(model, home[None])[0]:
        raise LabError(f"{said}: the arm touches itself or its surroundings there; start elsewhere")
    return home


def _measured_before(options: DesignOptions, robot: Robot) -> Array:
    """Poses ``(n0, joints)`` of the file to extend: those fully measured, or all of a plan not yet measured."""
    chain = robot.chain
    if options.extend is None:
        return np.empty((0, chain.size))
    rows = read_measurements(options.extend, chain.joint_names, chain.prismatic, points=False).only("calibrate")
    robot.refuse_beyond_limits(options.extend, rows, MEASURED_SLACK)
    robot.refuse_impossible(options.extend, rows)
    measured = rows.seen.all(axis=1)
    joints = rows.joints[measured] if measured.any() else rows.joints
    if not len(joints):
        raise LabError(f"{options.extend}: no row has use = calibrate; mark some, or leave --extend out")
    return joints
