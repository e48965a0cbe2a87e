"""The masses of a MuJoCo model, as the equations of gravity need them."""

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.dynamics.arm_dynamics import khalil_chain, load_in_frame
from lab.kinematics.dynamics.gravity import Loads
from lab.kinematics.dynamics.rigid_body import load_of
from lab.kinematics.serial.arm import SerialArm
from lab.simulation.model import at_zero
from lab.simulation.serial_model import SerialModel

__all__ = ["bodies_of_links", "link_inertias", "loads_of"]


def loads_of(robot: SerialModel) -> Loads:
    """What turns with each joint of the nominal model: its body and all that is welded to it, later joints' aside."""
    model, chain = robot.model, robot.chain
    data = at_zero(model)
    mass, moment = np.zeros(chain.size), np.zeros((chain.size, 3))
    for link, bodies in enumerate(bodies_of_links(robot)):
        for body in bodies:
            mass[link] += model.body_mass[body]
            moment[link] += model.body_mass[body] * data.xipos[body]
    centre = moment / np.maximum(mass, 1e-300)[:, None]
    arm, zero = SerialArm(chain), np.zeros((1, chain.size))
    links = [arm.frame(zero, arm.nominal(), size)[0] for size in range(1, chain.size + 1)]
    placed = [
        se3.transform(se3.inverse(robot.T_world_frame0 @ T_frame0_link), centre[i : i + 1])[0]
        if mass[i]
        else np.zeros(3)
        for i, T_frame0_link in enumerate(links)
    ]
    gravity = robot.T_world_frame0[:3, :3].T @ model.opt.gravity
    paths = {} if robot.links is None else robot.links.paths
    return Loads(chain, mass, np.array(placed), gravity, link_paths=paths)


def link_inertias(robot: SerialModel) -> Array:
    """Phi ``(J, 10)`` of what turns with each joint (as ``rigid_body.LOAD``), in Khalil's frames (``khalil_chain``)."""
    model, chain = robot.model, khalil_chain(robot.chain)
    data, arm, zero = at_zero(model), SerialArm(chain), np.zeros((1, chain.size))
    found = np.zeros((chain.size, 10))
    for link, bodies in enumerate(bodies_of_links(robot)):
        T_world_link = robot.T_world_frame0 @ arm.frame(zero, arm.nominal(), link + 1)[0]
        for body in bodies:
            T_world_centre = se3.pose(data.ximat[body].reshape(3, 3), data.xipos[body])
            about_centre = load_of(float(model.body_mass[body]), np.zeros(3), np.diag(model.body_inertia[body]))
            found[link] += load_in_frame(se3.inverse(T_world_link) @ T_world_centre) @ about_centre
    return found


def bodies_of_links(robot: SerialModel) -> list[list[int]]:
    """Of each joint the bodies that turn with it and with no later one: its own first, then what is welded to that."""
    model = robot.model
    jointed = [int(model.body(name).id) for name in robot.bodies]
    found: list[list[int]] = [[] for _ in jointed]
    for body in range(1, model.nbody):
        carrier = body
        while carrier and carrier not in jointed:
            carrier = int(model.body_parentid[carrier])
        if carrier:
            found[jointed.index(carrier)].append(body)
    return found
