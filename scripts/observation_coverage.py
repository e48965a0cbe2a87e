"""Every kind of observation on virtual arms: exact without noise, its noise floor, and its intervals against truth.

Arms stand in MuJoCo, each with poses and fixtures of its own. Each is identified whole without noise, and once with
it: the error on fresh poses is compared with what the covariance predicts. Then noise is drawn many times more: with
the Jacobian of each draw's own measurements, one Gauss-Newton step from the truth gives the estimate to first order,
and each 95 % interval holds the truth or does not.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from shared import Answer, Document, Flag, Section, named_values, paragraphs, run_script

from lab.calibration.identify import Identification, identify
from lab.calibration.observation import observation_of
from lab.calibration.statistics.joint_rounding import by_joint_positions
from lab.calibration.weights import Noise, weigh
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import load_virtual
from lab.campaign.virtual_robot import truth_of
from lab.commands.calibrate.run import MeasurementSession, measurement_session
from lab.core import se3
from lab.core.errors import LabError
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.formats.orientations import orientation_texts, read_orientations
from lab.kinematics.model import Model
from lab.noise.instruments import Instrument, PoseInstrument, instrument
from lab.sensors.fixtures import Fixtures
from lab.sensors.self_contact import SelfContact
from lab.sensors.virtual_sensor import VirtualSensor

CASES: Mapping[str, tuple[str, int]] = {  # of each kind: the instrument, and how many poses
    "points": ("leica-at960", 40),
    "pose": ("krypton-k600", 30),
    "cable": ("draw-wire", 80),
    "socket": ("ball-in-socket", 60),
    "plane": ("touch-probe", 90),
    "cube": ("touch-probe", 90),
    "sphere-plate": ("ball-in-socket", 40),
    "ball-bar": ("ball-in-socket", 80),
    "dial": ("dial-indicator", 80),
    "pixels": ("exact", 25),
    "self-contact": ("uniform-8um", 60),
}
_PX = 0.1  # noise of a corner in a picture
_TORSO = ("torso", ("left.p1", "right.p1"))  # of self-contact, which takes an arm of two tips
_REACH = 1.959963984540054
_FRESH = 200


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: int = 20
    """Virtual arms of each kind."""
    draws: int = 50
    """Of the noise, for each arm."""
    robot: str = "irb120"
    """Which arm; self-contact is of the torso."""
    kinds: tuple[str, ...] = tuple(CASES)
    """Kinds of observation."""
    json: Flag = False
    """Print one JSON object."""


@dataclass(frozen=True)
class MeasuredArm:
    """One virtual arm, measured without noise.

    Attributes:
        kind: with the weights of the instrument.
        slopes: ``(n, d, joints)`` of what vanishes in contact by the joints, NaN in rows of other readings.
        truth: ``(p,)`` of the exact identification's model.
    """

    day: MeasurementSession
    kind: VirtualSensor
    device: Instrument
    slopes: Array
    exact: Identification
    truth: Array

    @property
    def noise(self) -> Noise:
        """What weighs the readings."""
        return self.kind.noise(Noise(self.device))

    def nominal(self) -> tuple[Model, Array]:
        """The arm measured by points, with its nominal parameters."""
        arm = self.day.robot.arm(self.day.options.targets)
        return arm, arm.nominal(self.day.robot.tool)

    def noisy(self, rng: np.random.Generator) -> tuple[Model, Measurements]:
        """The observation model and the measurements with new noise."""
        data = _with_noise(self.day.measurements, self.device, self.slopes, rng)
        arm, nominal = self.nominal()
        return self.kind.observation(arm, data, nominal)

    def errors_m(self, values: Array) -> Array:
        """How far ``(m, 3)`` m the model's points with these parameters are from those with the true ones."""
        arm, _ = self.nominal()
        joints = self.day.robot.chain.random_joints(_FRESH, rng_for(self.day.options.seed, "fresh"))
        size = len(arm.names)
        return np.asarray((arm.points(joints, values[:size]) - arm.points(joints, self.truth[:size]))[:, 0])


def _with_noise(data: Measurements, device: Instrument, slopes: Array, rng: np.random.Generator) -> Measurements:
    """Exact measurements as the instrument would have read them; contacts by the joints' shortest move."""
    touching = np.isfinite(slopes).all(axis=(1, 2))
    if touching.any():
        noise = device.sample(np.zeros((int(touching.sum()), slopes.shape[1])), rng)
        joints = data.joints.copy()
        joints[touching] += (np.linalg.pinv(slopes[touching]) @ noise[..., None])[..., 0]
        data = replace(data, joints=joints)
        if touching.all():
            return data
    if "u_px" in data.conditions:
        places = {name: data.conditions[name] + _PX * rng.standard_normal(len(data)) for name in ("u_px", "v_px")}
        return replace(data, conditions={**data.conditions, **places})
    for column in {"cable_mm", "dial_mm"} & set(data.conditions):
        lengths = device.sample(data.conditions[column][:, None] / 1e3, rng)[:, 0]
        return replace(data, conditions={**data.conditions, column: 1e3 * lengths})
    systematic = device.errors.sample(data.points, rng.spawn(1)[0])
    read = replace(data, points=device.sample(data.points, rng) + systematic)
    if "p1_qw" not in data.other:
        return read
    assert isinstance(device, PoseInstrument)
    exact = se3.rotation_from_quaternion(read_orientations(data, "p1"))
    turned = orientation_texts("p1", device.sample_rotations(exact, rng), np.ones(len(data), dtype=np.bool_))
    return replace(read, other={**data.other, **turned})


def _slopes(model: Model, data: Measurements, truth: Array) -> Array:
    """``(n, d, joints)``: of what vanishes in contact, the last observed number, by the joints; NaN without contact."""
    size = data.joints.shape[1]
    if not ((isinstance(model, Fixtures) and model.contact) or isinstance(model, SelfContact)):
        return np.full((len(data), 1, size), np.nan)
    slopes = by_joint_positions(model, data.inputs(model.conditions), truth, size)[:, -1]
    return np.where(data.seen[:, -1, None, None], slopes, np.nan)


def measured_arm(robot_name: str, name: str, device: Instrument, poses: int, seed: int) -> MeasuredArm:
    """One arm, its exact measurements of the kind ``name``, and its truth as they show it.

    Args:
        device: whose noise weighs them.

    Raises:
        LabError: the arm's parameters have no single truth.
    """
    robot_name, targets = _TORSO if name == "self-contact" else (robot_name, ("p1",))
    options = VirtualCampaign(robot_name, observe=name, poses=poses, instrument="exact", seed=seed, targets=targets)
    if name == "pixels":
        options = replace(options, noise_px=_PX)
    robot = load_virtual(robot_name)
    day, placed = measurement_session(options, robot)
    kind = options.kind().weighted_by(device, day.measurements)
    arm = robot.arm(targets)
    nominal = arm.nominal(robot.tool)
    model, data = kind.observation(arm, day.measurements, nominal)
    exact = identify(model, data, nominal)
    known = truth_of(day.true_robot, arm)
    truth = None if known is None else kind.observed_truth(known, exact, day.true_robot, placed)
    if truth is None:
        raise LabError(f"--robot {robot_name}: its parameters have no single truth; take a serial arm")
    values = exact.values.copy()  # what no reading shows is as it is taken
    free = list(exact.fit.free)
    values[free] = truth.of([exact.model.names[i] for i in free])
    return MeasuredArm(day, kind, device, _slopes(exact.model, data, values), exact, values)


def study(options: Options, name: str) -> dict[str, float]:
    """One kind over all arms and draws."""
    exact_m, floors, covered, squares = 0.0, [], [], []
    for seed in range(options.robots):
        arm = measured_arm(options.robot, name, instrument(CASES[name][0]), CASES[name][1], seed)
        rng = rng_for(seed, "noise")
        exact_m = max(exact_m, float(np.abs(arm.exact.values - arm.truth)[list(arm.exact.fit.free)].max()))
        model, data = arm.noisy(rng)
        found = identify(model, data, arm.nominal()[1], arm.noise)
        floors.append(_floor(arm, found))
        for _ in range(options.draws):
            z, square = _standardized(arm, *arm.noisy(rng))
            covered.append(np.abs(z) < _REACH)
            squares.append(square)
    held = np.array([each.mean() for each in covered])
    each = np.mean([row[: min(map(len, covered))] for row in covered], axis=0)
    return {
        "campaigns": float(len(covered)),
        "noise_free_error_largest": exact_m,
        "floor_over_predicted": float(np.sqrt(np.mean([a**2 for a, _ in floors]) / np.mean([b**2 for _, b in floors]))),
        "floor_mm": float(1e3 * np.mean([a for a, _ in floors])),
        "coverage_mean": float(held.mean()),
        "coverage_standard_error": float(held.std() / np.sqrt(len(held))),
        "coverage_least": float(each.min()),
        "coverage_largest": float(each.max()),
        "nees_per_parameter": float(np.mean(squares)),
    }


def _floor(arm: MeasuredArm, found: Identification) -> tuple[float, float]:
    """Root mean square error on fresh poses in m, and what the covariance predicts of it."""
    free, size = list(found.fit.free), len(arm.nominal()[0].names)
    of_arm = [i for i, parameter in enumerate(free) if parameter < size]
    joints = arm.day.robot.chain.random_joints(_FRESH, rng_for(arm.day.options.seed, "fresh"))
    rates = arm.nominal()[0].observe(joints, arm.truth[:size])[1][:, 0][..., [free[i] for i in of_arm]]
    covariance = found.covariance[np.ix_(of_arm, of_arm)]
    predicted = np.einsum("mdi,ij,mdj->m", rates, covariance, rates).mean()
    error = (arm.errors_m(found.values) ** 2).sum(axis=1).mean()
    return float(np.sqrt(error)), float(np.sqrt(predicted))


def _standardized(arm: MeasuredArm, model: Model, data: Measurements) -> tuple[Array, float]:
    """Errors ``(f,)`` of the estimates in standard deviations, and e' C^-1 e / f."""
    free = list(arm.exact.fit.free)
    observed, _ = weigh(observation_of(model), data, arm.noise)
    predicted, jacobian = model.observe(observed.inputs, arm.truth)
    extra, slopes = arm.exact.extra_residuals(arm.truth)
    rows = np.concatenate([observed.apply(jacobian[..., free]), slopes[:, free]])
    left = np.concatenate([observed.apply(observed.points - predicted), extra])
    triangle = np.linalg.qr(rows, mode="r")
    error = np.linalg.lstsq(rows, left)[0]
    inverse = np.linalg.inv(triangle)
    return np.asarray(error / np.sqrt((inverse**2).sum(axis=1))), float(((triangle @ error) ** 2).mean())


def answer(options: Options) -> Answer:
    """All kinds, one after another.

    Raises:
        LabError: a kind is unknown.
    """
    if unknown := [name for name in options.kinds if name not in CASES]:
        raise LabError(f"--kinds {unknown[0]}: unknown; give some of {', '.join(CASES)}")
    results = {name: study(options, name) for name in options.kinds}
    sections = (Section(name, paragraphs(named_values(result))) for name, result in results.items())
    return Answer(results, Document("Every kind of observation", tuple(sections)))


if __name__ == "__main__":
    run_script("observation_coverage")
