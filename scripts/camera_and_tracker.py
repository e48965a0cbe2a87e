"""What a camera identifies of an arm, what a tracker does, and what both do together.

Virtual arms are measured by a tracker at some poses, and by a camera in the hand that sees a board at others. Ranks are
those of the Jacobian at many poses. The error of an arm is that of positions at new poses, after base and tool were
placed anew, as a camera alone shows neither; predicted by the covariance, and observed over many campaigns.
"""

from dataclasses import dataclass, replace

import numpy as np
from shared import Answer, Document, Flag, Section, Table, run_script, short

from lab.calibration.identify import Identification, identify
from lab.calibration.validation import validate_file
from lab.calibration.weights import Noise
from lab.campaign.options import VirtualCampaign
from lab.campaign.robot import Robot, load_virtual
from lab.commands.calibrate.run import MeasurementSession, measurement_session
from lab.core.se3 import Array
from lab.kinematics.gauge import base_set
from lab.kinematics.model import Model
from lab.kinematics.parameter import indices_of_groups
from lab.noise.instruments import instrument
from lab.sensors.cameras.rig import Rig, usual_rig
from lab.sensors.combined import CombinedSensor, combined_sensor
from lab.sensors.pixels import PixelSensor
from lab.sensors.points import PointSensor

_KINDS = ("tracker", "camera", "both")
_FRESH = 300


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    campaigns: int = 60
    """Campaigns, each with an arm, a board and noise of its own."""
    poses: int = 20
    """Poses of the tracker, and as many of the camera."""
    instrument: str = "optical-cmm"
    """The instrument of points."""
    robot: str = "irb120"
    """Which arm."""
    json: Flag = False
    """Print one JSON object."""


def ranks(robot: Robot) -> dict[str, tuple[int, int, int]]:
    """Return of each way to measure: identifiable parameters in all, of them the links', and lengths of the links."""
    day, _ = measurement_session(
        VirtualCampaign(robot.source, observe="points+pixels", poses=12, instrument="exact"), robot
    )
    arm, rig = robot.arm(("p1",)), usual_rig()
    nominal = arm.nominal(robot.tool)
    sized = Rig(rig.cameras, (replace(rig.boards[0], size="free"),))
    lens = Rig((replace(rig.cameras[0], intrinsics="free"),), rig.boards)
    joint = combined_sensor(("points", "pixels"))
    ways = {
        "tracker, points": PointSensor(),
        "camera, known board": PixelSensor(rig),
        "camera, board of unknown size": PixelSensor(sized),
        "camera with a free lens, known board": PixelSensor(lens),
        "tracker and camera, known board": joint((PointSensor(), PixelSensor(rig))),
        "tracker and camera, board of unknown size": joint((PointSensor(), PixelSensor(sized))),
    }
    found = {}
    for name, sensor in ways.items():
        rows = day.measurements.take(np.flatnonzero(sensor.rows(day.measurements)))
        model, data = sensor.observation(arm, rows, nominal)
        fitted = identify(model, data.with_points(), nominal)
        kept = [fitted.model.parameters[i] for i in base_set(fitted.model, fitted.values).identifiable]
        links = [each for each in kept if each.is_link]
        found[name] = (len(kept), len(links), sum(each.kind == "length" for each in links))
    return found


def _predicted(arm: Model, found: Identification, joints: Array) -> float:
    """Return the predicted error (m, root mean square) at joint positions, after base and tool are placed anew."""
    size = len(arm.names)
    free = [(k, i) for k, i in enumerate(found.fit.free) if i < size]
    rates = arm.observe(joints, found.values[:size])[1][:, 0].reshape(-1, size)
    placed, _ = np.linalg.qr(rates[:, indices_of_groups(arm.parameters, ["base", "tool"])])
    moved = rates[:, [i for _, i in free]]
    moved = moved - placed @ (placed.T @ moved)
    at = [k for k, _ in free]
    return float(np.sqrt(np.einsum("ri,ij,rj->", moved, found.covariance[np.ix_(at, at)], moved) / len(joints)))


def _campaign(robot: Robot, day: MeasurementSession, options: Options) -> dict[str, tuple[float, float]]:
    """Return the observed and the predicted error (m) of each way to measure."""
    arm, device = robot.arm(("p1",)), instrument(options.instrument)
    nominal, fresh = arm.nominal(robot.tool), day.validation.take(range(_FRESH))
    rig = usual_rig()
    camera = PixelSensor(rig, rig.simulated.noise_px)
    both = combined_sensor(("points", "pixels"))((PointSensor(), camera)).weighted_by(device, day.measurements)
    assert isinstance(both, CombinedSensor)
    found = {}
    for name, sensor in zip(_KINDS, (PointSensor(), camera, both), strict=True):
        rows = day.measurements.take(np.flatnonzero(sensor.rows(day.measurements)))
        model, data = sensor.observation(arm, rows, nominal)
        one = identify(model, data.with_points(), nominal, sensor.noise(Noise(device)))
        errors = validate_file(one, arm, fresh, ("base", "tool")).errors
        assert errors is not None
        found[name] = float(np.sqrt((errors.after**2).mean())), _predicted(arm, one, fresh.joints)
    return found


def answer(options: Options) -> Answer:
    """Compute the ranks, and simulate all campaigns."""
    robot, rows = load_virtual(options.robot), []
    counted = ranks(robot)
    rows = [(name, *map(str, numbers)) for name, numbers in counted.items()]
    sections = [Section("Ranks", (Table(("measured by", "identifiable", "of links", "lengths"), tuple(rows), ""),))]
    values: dict[str, object] = {"ranks": {name: list(numbers) for name, numbers in counted.items()}}
    if options.campaigns:
        each = {name: np.zeros((options.campaigns, 2)) for name in _KINDS}
        for seed in range(options.campaigns):
            virtual = VirtualCampaign(
                options.robot, observe="points+pixels", poses=options.poses, seed=seed, instrument=options.instrument
            )
            day, _ = measurement_session(virtual, robot)
            for name, pair in _campaign(robot, day, options).items():
                each[name][seed] = pair
        rms = {name: 1e3 * np.sqrt((both**2).mean(axis=0)) for name, both in each.items()}
        table = [
            (name, short(seen), short(said), short(rms["both"][0] / seen), short(rms["both"][1] / said))
            for name, (seen, said) in rms.items()
        ]
        head = ("measured by", "error, mm", "predicted", "both / this", "predicted")
        sections.append(Section("Errors", (Table(head, tuple(table), f"{options.campaigns} campaigns"),)))
        values["errors_mm"] = {name: {"observed": both[0], "predicted": both[1]} for name, both in rms.items()}
    return Answer(values, Document("Camera and tracker", tuple(sections)))


if __name__ == "__main__":
    run_script("camera_and_tracker")
