"""What an arm's links bear: gravity, a payload, and in motion the inertia of all that they carry.

Each link is a beam (``dynamics.beam``) from the axis of the joint that moves it to the next joint's axis, the last one
to the last frame: the straight line between the feet of the two common normals, which the nominal table gives, unless
it has a path of its own. A slide's link begins where the slide stands.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lab.core import se3
from lab.core.errors import LabError
from lab.core.se3 import Array
from lab.kinematics.dynamics.beam import Beam, loads_on
from lab.kinematics.dynamics.gravity import LinkFrames, Loads
from lab.kinematics.dynamics.sections import LinkSections
from lab.kinematics.serial.chain import Chain

__all__ = ["SHORTEST_M", "LinkLoads", "link_ends", "link_loads", "refuse_without_length"]

SHORTEST_M = 0.01  # a link that is shorter does not bend


@dataclass(frozen=True)
class LinkLoads:
    """The links of an arm as beams, with the loads on them.

    Attributes:
        loads: the masses.
        beams: by link, from 0; a link that is too short to bend has none.
        ends: ``(n, 3)`` m, each link's far end in its own axes.
    """

    loads: Loads
    beams: Mapping[int, Beam]
    ends: Array

    def at_rest(self, joints: Array, payload_kg: Array) -> Array:
        """Loads ``(n, joints, 18)`` (``beam.loads_on``) of gravity at joint positions ``(n, joints)``.

        Args:
            payload_kg: ``(n,)`` at the payload's place.
        """
        placed = self.loads.frames(joints)
        gravity = np.broadcast_to(self.loads.gravity, (len(joints), self.loads.chain.size, 3))
        weights = self.loads.mass_kg[:, None] * gravity
        payload = payload_kg[:, None] * self.loads.gravity
        return self._told(placed, weights, np.zeros_like(weights), payload, gravity, None)

    def moving(self, joints: Array, speeds: Array, accelerations: Array, payload_kg: Array) -> Array:
        """Loads ``(n, joints, 18)`` of gravity and of motion, by the recursion of Newton and Euler (Luh et al. 1980).

        The inertia of a link is that of its mass spread along its line; one without a beam, and a payload, is a mass
        in a point.

        Args:
            joints, speeds, accelerations: ``(n, joints)``.
            payload_kg: ``(n,)``.
        """
        placed, slides = self.loads.frames(joints), self.loads.chain.prismatic
        size, gravity = self.loads.chain.size, self.loads.gravity
        omega, alpha = np.zeros((len(joints), 3)), np.zeros((len(joints), 3))
        point, pull = placed.anchors[:, 0], np.broadcast_to(gravity, (len(joints), 3))
        pulls, changes, weights, torques = [], [], [], []
        change = np.zeros((len(joints), 3, 3))
        for j in range(size):
            axis, v, a = placed.axes[:, j], speeds[:, j, None], accelerations[:, j, None]
            near = self._far(placed, j) - _turned(placed.rotations[:, j], self.ends[j])
            pull, point = pull + _turned(change, near - point), near
            if slides[j]:
                pull = pull - axis * a - 2 * np.cross(omega, axis * v)
            else:
                alpha = alpha + axis * a + np.cross(omega, axis * v)
                omega = omega + axis * v
            change = -(se3.skew(alpha) + se3.skew(omega) @ se3.skew(omega))
            pulls.append(pull)
            changes.append(change)
            mass = self.loads.mass_kg[j]
            weights.append(mass * (pull + _turned(change, placed.centres[:, j] - near)))
            torques.append(self._spin(j, placed.rotations[:, j], change))
        payload = payload_kg[:, None] * (pull + _turned(change, placed.payload - point))
        weight, torque, pulled, changed = (np.stack(each, axis=1) for each in (weights, torques, pulls, changes))
        return self._told(placed, weight, torque, payload, pulled, changed)

    def inertia(self, joints: Array, speeds: Array, accelerations: Array, payload_kg: Array) -> Array:
        """Generalized forces ``(n, joints)`` Nm (N of a slide) of inertia alone, as ``Loads.forces`` has gravity's.

        Of each joint they are what its link bears at its far end, more than at rest, and what the link adds itself.
        """
        placed, slides = self.loads.frames(joints), self.loads.chain.prismatic
        still = np.zeros_like(joints)
        found = np.zeros(joints.shape, dtype=np.result_type(joints, speeds, accelerations))
        for rates, sign in (((speeds, accelerations), 1.0), ((still, still), -1.0)):
            loads = self.moving(joints, *rates, payload_kg)
            for j in range(self.loads.chain.size):
                force, moment = self._at_joint(placed, loads[:, j], j)
                found[:, j] += sign * (placed.axes[:, j] * (force if slides[j] else moment)).sum(axis=1)
        return found

    def _at_joint(self, placed: LinkFrames, loads: Array, link: int) -> tuple[Array, Array]:
        """Force and moment ``(n, 3)`` about a joint's anchor, in frame 0, of loads ``(n, 18)`` on its link and of that.

        The link's own mass is a point with the second moment of its line.
        """
        turn = placed.rotations[:, link]
        force, moment, pull = (_turned(turn, loads[:, 3 * i : 3 * i + 3]) for i in range(3))
        change = turn @ loads[:, 9:].reshape(-1, 3, 3) @ turn.swapaxes(1, 2)
        far, anchor, centre = self._far(placed, link), placed.anchors[:, link], placed.centres[:, link]
        near = far - _turned(turn, self.ends[link])
        weight = self.loads.mass_kg[link] * (pull + _turned(change, centre - near))
        moment = moment + np.cross(far - anchor, force) + np.cross(centre - anchor, weight)
        return force + weight, moment + self._spin(link, turn, change)

    def _spin(self, link: int, rotation: Array, change: Array) -> Array:
        """The moment ``(n, 3)`` of a link's inertia about its centre of mass: the sum of r x (change r) dm."""
        if link not in self.beams:
            return np.zeros((len(rotation), 3))
        spread = change @ rotation @ self.beams[link].second_moment @ rotation.swapaxes(1, 2)
        return np.stack([spread[:, k, j] - spread[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))], axis=1)

    def _far(self, placed: LinkFrames, link: int) -> Array:
        return placed.end if link == self.loads.chain.size - 1 else placed.anchors[:, link + 1]

    def _told(
        self, placed: LinkFrames, weights: Array, torques: Array, payload: Array, pulls: Array, changes: Array | None
    ) -> Array:
        """Loads ``(n, joints, 18)`` in the links' axes, summed from the hand inward; all arguments in frame 0."""
        force, at = payload, placed.payload
        moment = np.zeros_like(payload)
        found = []
        for j in reversed(range(self.loads.chain.size)):
            far = self._far(placed, j)
            moment, at = moment + np.cross(at - far, force), far
            back = placed.rotations[:, j].swapaxes(1, 2)
            change = None if changes is None else back @ changes[:, j] @ placed.rotations[:, j]
            found.append(loads_on(_turned(back, force), _turned(back, moment), _turned(back, pulls[:, j]), change))
            moment = moment + torques[:, j] + np.cross(placed.centres[:, j] - at, weights[:, j])
            force = force + weights[:, j]
        return np.stack(found[::-1], axis=1)


def link_loads(loads: Loads) -> LinkLoads:
    """The links of an arm as beams.

    Args:
        loads: the arm's masses, with the lines of links that are not straight.

    Raises:
        LabError: a path is of no link, or does not begin and end where the link does.
    """
    ends, chain, paths = link_ends(loads.chain), loads.chain, loads.link_paths
    for link, path in paths.items():
        if not 0 <= link < chain.size or np.abs(path[-1] - ends[link]).max() > 1e-6 or np.abs(path[0]).max() > 1e-9:
            mm = np.round(1e3 * ends[link], 6) + 0.0 if 0 <= link < chain.size else ()
            at = f"it runs from 0, 0, 0 to {', '.join(f'{each:g}' for each in mm)} mm" if len(mm) else "no such link"
            raise LabError(
                f"robot {chain.name}: the path of link {link + 1}: {at} in the link's axes; let the path too"
            )
    beams = {}
    for link, end in enumerate(ends):
        line = paths.get(link, np.stack([np.zeros(3), end]))
        if link in paths or np.linalg.norm(end) > SHORTEST_M:
            beams[link] = Beam(line, float(loads.mass_kg[link]), _centre(loads, link, end))
    return LinkLoads(loads, beams, ends)


def refuse_without_length(loads: Loads, sections: LinkSections) -> None:
    """A LabError for a description of links that no beams can have: an elastic one without a length, a wrong path."""
    beams = link_loads(loads).beams
    if short := [link for link in np.flatnonzero(sections.compliances.any(axis=1)).tolist() if link not in beams]:
        raise LabError(
            f"link {short[0] + 1} of robot {loads.chain.name} has no length, so it does not bend; leave it out"
        )


def link_ends(chain: Chain) -> Array:
    """``(n, 3)`` m: where each link ends, in its own axes: at the next joint's axis, or the last frame's origin."""
    d = np.where(chain.prismatic, 0.0, chain.table[:, 1])
    a = chain.table[:, 2] if chain.convention == "distal" else np.append(chain.table[1:, 2], 0.0)
    return np.stack([a, np.zeros(chain.size), d], axis=1)


def _centre(loads: Loads, link: int, end: Array) -> Array:
    """A link's centre of mass ``(3,)`` m in its own axes, from the frame of the table that turns with it."""
    if loads.chain.convention == "craig":
        craig: Array = loads.centre_m[link] + [0.0, 0.0, end[2]]
        return craig
    _, _, _, alpha, beta = loads.chain.table[link]
    twist = se3.exp(np.array([alpha, 0.0, 0.0])) @ se3.exp(np.array([0.0, beta, 0.0]))
    placed: Array = end + twist @ loads.centre_m[link]
    return placed


def _turned(rotations: Array, vectors: Array) -> Array:
    """Vectors ``(n, 3)`` or ``(3,)`` by matrices ``(n, 3, 3)``."""
    found: Array = (rotations @ vectors[..., None])[..., 0]
    return found
