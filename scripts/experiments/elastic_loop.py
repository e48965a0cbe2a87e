"""The loop of an arm with elastic links: weighed, measured, identified, corrected, and tried on chains of pieces.

The virtual arm's bodies are off, and its upper arm and forearm bend and twist as tubes of aluminium. A wrist sensor
weighs its payload; 60 designed poses, empty or with the payload, are measured at three targets by an instrument of
8 µm. Identified are the geometry alone, ``--model auto``, and the links as the round tubes that they are. Then targets
all over the workspace, and a circle as fast as the joints can, are corrected, and run on the same arm with its elastic
links as chains of rigid pieces on springs, which bear the true payload and know no beam theory.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from beam_chain import BeamChain
from designed_campaign import DesignedCampaign
from shared import Answer, Document, Flag, paragraphs, run_script

import lab
from lab.calibration.identification import Identification
from lab.compensation.compensator import Compensator
from lab.core import se3
from lab.core.measurements import Measurements
from lab.core.random import rng_for
from lab.core.se3 import Array
from lab.extensions.robotics.trajectory.cartesian import Feed, PathMove, arc, path_move
from lab.extensions.robotics.trajectory.path_errors import TrackedArm, tracking_along
from lab.kinematics.effects.arm_with_effects import Arm, ArmWithEffects
from lab.kinematics.effects.bending import ElasticLinks
from lab.kinematics.inverse.branches import NominalInverse
from lab.kinematics.inverse.newton_inverse import PoseTarget
from lab.kinematics.serial.serial_arm import SerialArm
from lab.library.hand_load import HandLoad
from lab.library.virtual_arm import perturbed_arm
from lab.options.option_groups import Effects
from lab.options.virtual_campaign import VirtualCampaign
from lab.pose_selection.tour import rated
from lab.robots.load_robot import load_virtual
from lab.robots.robot import Robot
from lab.simulation.collisions import random_poses
from lab.simulation.elastic_links import AT_REST, JointMotion
from lab.simulation.true_robot import TrueSerialRobot

EI, GJ = 48_400.0, 36_000.0  # N m²: aluminium, a tube of 80 x 4 mm
TARGETS = ("p1", "p2", "p3")
PIECES = 16  # of a link: 0.1 % of its deflection
LOADS_KG = {"irb120": 3.0, "tx40": 2.0}
RADIUS_M = 0.08
FAST = Feed(10.0, 200.0, 50.0, 500.0)  # no limit beside the joints'
KNOWN = ("geometry", "auto", "tubes")
MIDDLES_DEG = {"irb120": (0.0, 30.0, -5.0, 15.0, 45.0, 0.0), "tx40": (0.0, 35.0, 75.0, 15.0, 50.0, 0.0)}


@dataclass(frozen=True)
class Options:
    """How much to simulate."""

    robots: tuple[str, ...] = ("irb120", "tx40")
    """Which arms."""
    arms: int = 5
    """Copies of each."""
    targets: int = 30
    """Targets at rest."""
    times: int = 20
    """Times along the circle."""
    json: Flag = False
    """Print one JSON object."""


def answer(options: Options) -> Answer:
    """All arms."""
    rows = [
        {"robot": robot, "arm": seed, **closed(robot, seed, options.targets, options.times)}
        for robot in options.robots
        for seed in range(options.arms)
    ]
    said = Document("Elastic arms, corrected, on chains of pieces", paragraphs(words(rows)))
    return Answer({"rows": rows}, said)


@dataclass(frozen=True)
class Pieces:
    """The real arm with its elastic links as chains, its true payload, and its tracker."""

    real: TrueSerialRobot
    chain: BeamChain
    payload_kg: float

    def points(self, joints: Array, motion: JointMotion = AT_REST) -> Array:
        """Where the first target is ``(n, 3)`` m in the tracker's frame at commanded joints ``(n, joints)``."""
        load = np.full(len(joints), self.payload_kg)
        world = self.chain.positions(joints + self.real.joint_offset, TARGETS[:1], load, motion)[:, 0]
        return se3.transform(se3.inverse(self.real.T_world_tracker), world)


def closed(name: str, seed: int, targets: int, times: int) -> dict[str, Any]:
    """One arm from the balance to the verification: errors in mm."""
    weighed = lab.payload(robot=name, simulate=True, method="wrench", payload_kg=LOADS_KG[name], seed=seed)
    assert weighed.truth is not None
    load = weighed.estimate.hand_load
    true_kg, true_centre = float(weighed.truth[0]), weighed.truth[1:4] / weighed.truth[0]
    day = DesignedCampaign(name, TARGETS, ("compliance", "bending"), payloads_kg=(0.0, true_kg), load=load)
    real, data = measured(day, HandLoad(true_kg, true_centre, load.covariance), seed)
    known = with_payload(data, load.mass_kg)
    found = day.selected(known)
    tubes = tuple("tubes" if name == "bending" else name for name in found.chosen)
    known_as = {
        "geometry": day.identified(known, ()),
        "auto": found.identification,
        "tubes": day.identified(known, tubes),
    }
    sections = real.effects.part(ElasticLinks).compliances
    joints = random_poses(real.robot, targets, rng_for(seed, "targets"))
    pieces = Pieces(real, BeamChain(real.model, real.robot, sections, PIECES, true_centre), true_kg)
    return {
        "groups": sorted(found.chosen),
        "mass_off_g": 1e3 * (load.mass_kg - true_kg),
        "centre_off_mm": 1e3 * float(np.linalg.norm(load.centre_m - true_centre)),
        "at_rest_mm": at_rest(pieces, known_as, load.mass_kg, joints),
        "circle_mm": circled(day, pieces, known_as, load.mass_kg, times),
    }


def measured(day: DesignedCampaign, true_load: HandLoad, seed: int) -> tuple[TrueSerialRobot, Measurements]:
    """The real arm, which carries its true payload, and its measurement session."""
    tube = (0.0, EI, 0.0, EI, 0.0, 0.0), (0.0, GJ, 0.0, GJ, 0.0, 0.0)
    effects = Effects(link_ei=tube[0], link_gj=tube[1])
    nominal = true_load.carried_by(load_virtual(day.robot_name))
    real = perturbed_arm(nominal, VirtualCampaign(seed=seed, effects=effects))
    assert isinstance(real, TrueSerialRobot)
    return real, day.measured(real, seed)


def with_payload(data: Measurements, payload_kg: float) -> Measurements:
    """The measurements, with the payload as it was weighed where there is one."""
    carried = np.where(data.conditions["payload_kg"] > 0, payload_kg, 0.0)
    return replace(data, conditions={**data.conditions, "payload_kg": carried})


Found = Mapping[str, Identification]
"""What is known of the arm: its geometry, with what ``--model auto`` takes, and with links as round tubes."""


def arm_of(found: Identification) -> Arm:
    """The arm that was identified."""
    assert isinstance(found.model, SerialArm | ArmWithEffects)
    return found.model


def nominal_of(found: Found) -> NominalInverse:
    """What the controller computes with."""
    arm = arm_of(found["auto"]).rigid
    return NominalInverse(arm, found["auto"].nominal_aligned[: len(arm.names)])


def at_rest(pieces: Pieces, found: Found, payload_kg: float, joints: Array) -> dict[str, Any]:
    """Errors at targets where the nominal model has the tool at joint positions ``(n, joints)``."""
    nominal = nominal_of(found)
    Ts = nominal.tool(joints)[0]
    wanted, errors = PoseTarget(Ts[:, :3, 3], Ts[:, :3, :3]), {"nominal": spread(pieces.points(joints) - Ts[:, :3, 3])}
    for name, each in found.items():
        setting = [payload_kg if condition == "payload_kg" else 0.0 for condition in each.model.conditions]
        done = Compensator(nominal, arm_of(each), each.values)(wanted, np.tile(setting, (len(joints), 1)), joints)
        off = pieces.points(done.joints[done.converged]) - wanted.positions[done.converged]
        errors[name] = spread(off)
    return errors | {"targets": int(done.converged.sum())}


def circled(day: DesignedCampaign, pieces: Pieces, found: Found, payload_kg: float, times: int) -> dict[str, Any]:
    """Errors along most of a circle, upright across the arm, as fast as the joints' speeds and accelerations let it."""
    move = circle_of(day.robot)
    when = np.linspace(0.02, 0.98, times) * move.seconds
    joints, speeds, accelerations = move.at(when)
    motion, nominal = JointMotion(speeds, accelerations), nominal_of(found)
    wanted = nominal.tool(joints)[0][:, :3, 3]
    errors = {"nominal": spread(pieces.points(joints, motion) - wanted)}
    for name, each in found.items():
        arm = day.robot.arm_with(TARGETS, arm_of(each).groups, moving=True)
        tracked = TrackedArm(arm, each.values, nominal.values, payload_kg, ())
        corrected = tracking_along(tracked, joints, speeds, accelerations, when).corrected.joints
        errors[name] = spread(pieces.points(corrected, motion) - wanted)
    fastest = float(np.abs(accelerations).max())
    return errors | {"seconds": move.seconds, "largest_acceleration_rad_s2": fastest}


def circle_of(robot: Robot) -> PathMove:
    """350° of a circle of the tool, its orientation kept."""
    arm, start = robot.serial_arm(TARGETS), np.deg2rad(MIDDLES_DEG[robot.name])
    values = arm.nominal(robot.tool)
    T = arm.tool(start[None], values)[0][0]

    def at(angle_deg: float) -> Array:
        angle = np.deg2rad(angle_deg)
        return np.asarray(T[:3, 3] + RADIUS_M * np.array([0.0, np.sin(angle), np.cos(angle) - 1.0]))

    path = arc(T, at(170.0), se3.pose(T[:3, :3], at(350.0)))
    return path_move(arm, values, rated(robot.chain)[0], path, start, FAST)


def spread(off: Array) -> dict[str, float]:
    """Mean and largest length (mm) of errors ``(n, 3)`` m."""
    lengths = 1e3 * np.linalg.norm(off, axis=1)
    return {"mean": float(lengths.mean()), "max": float(lengths.max())}


def words(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Some lines an arm, then the mean over the arms of each robot."""
    lines = []
    for row in rows:
        lines.append(
            f"{row['robot']} {row['arm']}: auto takes {'+'.join(row['groups'])}; the payload is weighed "
            f"{row['mass_off_g']:.2g} g and {row['centre_off_mm']:.2g} mm off"
        )
        for what, label in (("at_rest_mm", "at rest"), ("circle_mm", f"circle in {row['circle_mm']['seconds']:.2f} s")):
            each = row[what]
            parts = (f"{name} {each[name]['mean']:.4f} (max {each[name]['max']:.4f})" for name in ("nominal", *KNOWN))
            lines.append(f"  {label}: {', '.join(parts)} mm")
    for robot in dict.fromkeys(row["robot"] for row in rows):
        for what in ("at_rest_mm", "circle_mm"):
            own = [row[what] for row in rows if row["robot"] == robot]
            means = ", ".join(f"{name} {np.mean([each[name]['mean'] for each in own]):.4f}" for name in KNOWN)
            lines.append(f"{robot}, {what.removesuffix('_mm')}, mean over {len(own)} arms: {means} mm")
    return lines


if __name__ == "__main__":
    run_script("elastic_loop")
