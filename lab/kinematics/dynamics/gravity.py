"""Loads of gravity, payload and inertia on joints and links.

Each link is a beam (``dynamics.beam``) from its joint's axis to the next joint's axis, the last one to the last frame:
the straight line between the ends of the two common normals of the nominal table, or its own path. A slide's link
begins at the slide.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.core import se3
from lab.core.errors import LabError
from lab.core.recent import recent
from lab.core.se3 import Array
from lab.core.units import MM
from lab.kinematics.dynamics.beam import Beam, LinkSections, loads_on
from lab.kinematics.serial.chain import Chain

__all__ = [
    "LinkFrames",
    "LinkLoads",
    "Loads",
    "chain_frames",
    "link_ends",
    "link_loads",
    "refuse_without_length",
    "solved_by",
]

_BEARS = 0.1  # share of the largest root mean square torque (force of slides) of joints that bear weight
_LEAST_FORCE = 1e-9  # Nm or N: rounding
_POSES = 200
_KEPT = 6  # results at the last joint positions, which several effects of an arm ask for


@dataclass(frozen=True)
class LinkFrames:
    """Poses of an arm's links at n poses, in frame 0.

    Attributes:
        axes, anchors: ``(n, joints, 3)``, of each joint; a hinge's anchor is the beginning of its link.
        rotations: ``(n, joints, 3, 3)`` of each link, as in ``dynamics.beam``: z is the joint's axis of the table, x
            the common normal on the link.
        centres: ``(n, joints, 3)`` m, of each link's mass.
        payload: ``(n, 3)`` m, of a payload's mass.
        end: ``(n, 3)`` m, the last frame's origin.
    """

    axes: Array
    anchors: Array
    rotations: Array
    centres: Array
    payload: Array
    end: Array


@dataclass(frozen=True)
class _Equilibrium:
    """Equilibrium of compliant joints.

    Attributes:
        offset: ``(n, joints)`` deflections, rad or m.
        force: ``(n, joints)`` Nm (N of a slide) of all loads, before the last step.
        equations: ``(n, joints, joints)`` 1 - C dg/dq there.
    """

    offset: Array
    force: Array
    equations: Array


@dataclass(frozen=True)
class Loads:
    """Masses on the links of a nominal arm, and gravity.

    Attributes:
        mass_kg: ``(n,)``, of the body moved by each joint.
        centre_m: ``(n, 3)``, their centres in the frames of the table that turn with them.
        gravity: ``(3,)`` m/s^2 in frame 0.
        payload_at_m: ``(3,)``, a payload's centre of mass in the last frame.
        link_paths: by link (from 0), its line as a beam (``beam.LinkSections``); others are straight.
    """

    chain: Chain
    mass_kg: Array
    centre_m: Array
    gravity: Array
    payload_at_m: Array = field(default_factory=lambda: np.zeros(3))
    link_paths: Mapping[int, Array] = field(default_factory=dict)

    def forces(self, joints: Array, payload_kg: Array) -> tuple[Array, Array]:
        """Return gravity's generalized forces and their derivatives by the joints.

        With z_j and o_j the axis of joint j, M_j the mass beyond it and S_j the first moment of that about o_j, the
        torque is g . F_j with F_j = z_j x S_j (M_j z_j of a slide), and turning joint i <= j by dq turns F_j: d(g .
        F_j) / dq_i = g . (z_i x F_j).

        Args:
            joints: ``(n, joints)``.
            payload_kg: ``(n,)`` at ``payload_at_m``.

        Returns:
            ``(n, joints)`` Nm (N of a slide), positive if gravity increases the joint position; and the symmetric ``(n,
            joints, joints)``.
        """
        return _forces(self, joints, payload_kg)

    def equilibrium(
        self, joints: Array, compliance: Array, payload_kg: Array, steps: int, beside: Array | None = None
    ) -> _Equilibrium:
        """Solve offset = C (g(q + offset) + h) by a fixed number of Newton steps.

        Complex compliances pass, for derivatives by complex steps.

        Args:
            joints: q ``(n, joints)``.
            compliance: C ``(joints,)`` rad/Nm (m/N of a slide), zero for stiff joints; ``(b, 1, joints)`` of b arms,
                whose results have that first axis, too.
            payload_kg: ``(n,)`` at ``payload_at_m``.
            steps: one at least.
            beside: h ``(n, joints)`` Nm (N of a slide), further forces.
        """
        offset: Array = np.zeros_like(joints, dtype=np.result_type(joints, compliance))
        for _ in range(steps if np.any(compliance) else 1):
            force, rate = self._forces_of_all(joints + offset, payload_kg)
            force = force if beside is None else force + beside
            equations: Array = np.eye(compliance.shape[-1]) - compliance[..., None] * rate
            off = (compliance * force - offset)[..., None]
            soft = slice(None) if compliance.ndim == 1 else np.flatnonzero(compliance.any(axis=(0, 1)))
            offset = offset + np.asarray(solved_by(equations, off, soft), dtype=offset.dtype)[..., 0]
        return _Equilibrium(offset, force, equations)

    def _forces_of_all(self, joints: Array, payload_kg: Array) -> tuple[Array, Array]:
        """Return ``forces`` at joint positions ``(n, joints)``, or ``(b, n, joints)`` of b arms."""
        if joints.ndim == 2:
            return self.forces(joints, payload_kg)
        force, rate = self.forces(joints.reshape(-1, joints.shape[2]), np.tile(payload_kg, len(joints)))
        return force.reshape(joints.shape), rate.reshape(*joints.shape, joints.shape[2])

    def bearing(self, rng: np.random.Generator) -> tuple[int, ...]:
        """Return the joints (from 0) that bear the arm's weight anywhere within its limits."""
        force, _ = self.forces(self.chain.random_joints(_POSES, rng), np.zeros(_POSES))
        size = np.sqrt((force**2).mean(axis=0))
        slides = np.array(self.chain.prismatic)
        largest = np.where(slides, size.max(where=slides, initial=0.0), size.max(where=~slides, initial=0.0))
        return tuple(int(j) for j in np.flatnonzero(size > np.maximum(_BEARS * largest, _LEAST_FORCE)))

    def frames(self, joints: Array) -> LinkFrames:
        """Return the link frames at joint positions ``(n, joints)``."""
        placed = chain_frames(self.chain, joints)
        ends = zip(placed.ends, placed.turned, self.centre_m, strict=True)
        centres = [end + _along(turned, centre) for end, turned, centre in ends]
        payload = placed.ends[-1] + _along(placed.turned[-1], self.payload_at_m)
        return LinkFrames(placed.axes, placed.anchors, placed.rotations, np.stack(centres, 1), payload, placed.ends[-1])


_Axes = tuple[Array, ...]  # a frame's x, y and z, ``(n, 3)`` each


@dataclass(frozen=True)
class ChainFrames:
    """Frames along a chain at n poses, in frame 0.

    Attributes:
        axes, anchors, rotations: as of ``LinkFrames``.
        ends: ``(n, 3)`` m of each link, its frame's origin.
        turned: of each link, the axes of that frame.
    """

    axes: Array
    anchors: Array
    rotations: Array
    ends: tuple[Array, ...]
    turned: tuple[_Axes, ...]


@recent(_KEPT)
def chain_frames(chain: Chain, joints: Array) -> ChainFrames:
    """Return the frames along a chain at joint positions ``(n, joints)``."""
    count, kind = len(joints), np.result_type(joints, float)
    turned = tuple(np.broadcast_to(row, (count, 3)).astype(kind) for row in np.eye(3))  # the axes of the frame
    position = np.zeros((count, 3), dtype=kind)
    axes, anchors, rotations, ends, after = [], [], [], [], []
    distal, sign = chain.convention == "distal", chain.sign
    for i, (theta, d, a, alpha, beta) in enumerate(chain.table):
        reading = sign[i] * joints[:, i]
        angle, slide = (theta, d + reading) if chain.prismatic[i] else (theta + reading, d)
        if not distal:
            turned = _about(0, alpha, turned)
            position, turned = position + a * turned[0], _about(1, beta, turned)
        axes.append(sign[i] * turned[2])
        anchors.append(position)
        position = position + np.reshape(slide, (-1, 1)) * turned[2]
        turned = _about(2, angle, turned)
        rotations.append(np.stack(turned, axis=2))
        if distal:
            position = position + a * turned[0]
            turned = _about(1, beta, _about(0, alpha, turned))
        ends.append(position)
        after.append(turned)
    return ChainFrames(np.stack(axes, 1), np.stack(anchors, 1), np.stack(rotations, 1), tuple(ends), tuple(after))


def _about(axis: int, angle: Array, turned: _Axes) -> _Axes:
    j, k = (axis + 1) % 3, (axis + 2) % 3
    c, s = (np.reshape(function(angle), (-1, 1)) for function in (np.cos, np.sin))
    after = list(turned)
    after[j], after[k] = c * turned[j] + s * turned[k], c * turned[k] - s * turned[j]
    return tuple(after)


def _along(turned: _Axes, vector: Array) -> Array:
    return np.asarray(vector[0] * turned[0] + vector[1] * turned[1] + vector[2] * turned[2])


def solved_by(equations: Array, right: Array, soft: NDArray[np.int_] | slice) -> Array:
    """Solve equations ``(..., n, n)`` of compliant joints for right sides ``(..., n, m)``.

    Args:
        soft: joints that may move; the right sides of all others are zero, and their equations those of the identity.
    """
    if isinstance(soft, slice):
        return np.asarray(np.linalg.solve(equations, right))
    found = np.zeros((*equations.shape[:-2], *right.shape[-2:]), dtype=np.result_type(equations, right))
    found[..., soft, :] = np.linalg.solve(equations[..., soft[:, None], soft], right[..., soft, :])
    return found


_SHORTEST_M = 0.01  # shorter links do not bend


@dataclass(frozen=True)
class LinkLoads:
    """Links of an arm as beams, with their loads.

    Attributes:
        loads: the masses.
        beams: by link, from 0; not for links that are too short.
        ends: ``(n, 3)`` m, each link's far end in its own axes.
    """

    loads: Loads
    beams: Mapping[int, Beam]
    ends: Array

    def at_rest(self, joints: Array, payload_kg: Array) -> Array:
        """Return loads ``(n, joints, 18)`` (``beam.loads_on``) of gravity and payloads ``(n,)`` at joint positions."""
        return _at_rest(self, joints, payload_kg)

    def moving(self, joints: Array, speeds: Array, accelerations: Array, payload_kg: Array) -> Array:
        """Return loads ``(n, joints, 18)`` of gravity and motion, by the recursion of Newton and Euler (Luh et al.
        1980).

        A link's mass is spread along its line; without a beam, and for a payload, it is a point.

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
        return self._summed(placed, weight, torque, payload, pulled, changed)

    def inertia(self, joints: Array, speeds: Array, accelerations: Array, payload_kg: Array) -> Array:
        """Return generalized forces ``(n, joints)`` of inertia alone, as ``Loads.forces`` of gravity."""
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
        """Return force and moment ``(n, 3)`` about a joint's anchor, in frame 0, of loads ``(n, 18)`` on its link and
        of the link.

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
        """Return the moment ``(n, 3)`` of a link's inertia about its centre of mass, the sum of r x (change r) dm."""
        if link not in self.beams:
            return np.zeros((len(rotation), 3))
        spread = change @ rotation @ self.beams[link].second_moment @ rotation.swapaxes(1, 2)
        return np.stack([spread[:, k, j] - spread[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))], axis=1)

    def _far(self, placed: LinkFrames, link: int) -> Array:
        return placed.end if link == self.loads.chain.size - 1 else placed.anchors[:, link + 1]

    def _summed(
        self, placed: LinkFrames, weights: Array, torques: Array, payload: Array, pulls: Array, changes: Array | None
    ) -> Array:
        """Return loads ``(n, joints, 18)`` in the links' axes, summed from the hand; arguments in frame 0."""
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


@recent(_KEPT)
def _forces(loads: Loads, joints: Array, payload_kg: Array) -> tuple[Array, Array]:
    # masses and first moments of each link, the last one's with the payload
    placed = loads.frames(joints)
    axes, slides = placed.axes, np.array(loads.chain.prismatic)
    masses = np.tile(loads.mass_kg, (len(joints), 1)).astype(np.result_type(payload_kg, float))
    moments = masses[:, :, None] * placed.centres
    moments[:, -1] += payload_kg[:, None] * placed.payload
    masses[:, -1] += payload_kg
    # summed from the hand in: of all that a joint carries
    weight, moment = (np.cumsum(each[:, ::-1], axis=1)[:, ::-1] for each in (masses, moments))  # beyond each joint
    weight = weight[:, :, None]
    first_moments = np.where(slides[:, None], weight * axes, np.cross(axes, moment - weight * placed.anchors))
    # torque z . (p x m g) = g . (z x m p), and its derivatives by the joints further in or out
    force = first_moments @ loads.gravity
    across = np.where(slides[:, None], 0.0, np.cross(loads.gravity, axes))  # g . (z x F) = (g x z) . F
    below = np.triu(across @ first_moments.swapaxes(1, 2))
    rate = below + np.triu(below, 1).swapaxes(1, 2)
    return force, rate


@recent(_KEPT)
def _at_rest(links: LinkLoads, joints: Array, payload_kg: Array) -> Array:
    loads = links.loads
    placed = loads.frames(joints)
    gravity = np.broadcast_to(loads.gravity, (len(joints), loads.chain.size, 3))
    weights = loads.mass_kg[:, None] * gravity
    payload = payload_kg[:, None] * loads.gravity
    return links._summed(placed, weights, np.zeros_like(weights), payload, gravity, None)


@recent(_KEPT)
def link_loads(loads: Loads) -> LinkLoads:
    """Return the links of an arm as beams."""
    ends, paths = link_ends(loads.chain), loads.link_paths
    for link, path in paths.items():
        _refuse_wrong_path(loads.chain, link, path, ends)
    beams = {}
    for link, end in enumerate(ends):
        line = paths.get(link, np.stack([np.zeros(3), end]))
        if link in paths or np.linalg.norm(end) > _SHORTEST_M:
            beams[link] = Beam(line, float(loads.mass_kg[link]), _centre(loads, link, end))
    return LinkLoads(loads, beams, ends)


def _refuse_wrong_path(chain: Chain, link: int, path: Array, ends: Array) -> None:
    """Refuse the path ``(c, 3)`` of a link that there is not, or that does not run from its origin to its end."""
    start, remedy = f"robot {chain.name}: the path of link {link + 1}", "in the link's axes; let the path too"
    if not 0 <= link < chain.size:
        raise LabError(f"{start}: no such link {remedy}")
    if np.abs(path[-1] - ends[link]).max() > 1e-6 or np.abs(path[0]).max() > 1e-9:
        mm = np.round(MM.of(ends[link]), 6) + 0.0
        raise LabError(f"{start}: it runs from 0, 0, 0 to {', '.join(f'{each:g}' for each in mm)} mm {remedy}")


def refuse_without_length(loads: Loads, sections: LinkSections) -> None:
    """Raise a LabError for an elastic link without a length, or a wrong path."""
    beams = link_loads(loads).beams
    if short := [link for link in np.flatnonzero(sections.compliances.any(axis=1)).tolist() if link not in beams]:
        raise LabError(
            f"link {short[0] + 1} of robot {loads.chain.name} has no length, so it does not bend; leave it out"
        )


def link_ends(chain: Chain) -> Array:
    """Return each link's end ``(n, 3)`` m in its own axes: on the next joint's axis, or the last frame's origin."""
    d = np.where(chain.prismatic, 0.0, chain.table[:, 1])
    a = chain.table[:, 2] if chain.convention == "distal" else np.append(chain.table[1:, 2], 0.0)
    return np.stack([a, np.zeros(chain.size), d], axis=1)


def _centre(loads: Loads, link: int, end: Array) -> Array:
    """Return a link's centre of mass ``(3,)`` m in its own axes."""
    if loads.chain.convention == "craig":
        return np.asarray(loads.centre_m[link] + [0.0, 0.0, end[2]])
    _, _, _, alpha, beta = loads.chain.table[link]
    twist = se3.exp(np.array([alpha, 0.0, 0.0])) @ se3.exp(np.array([0.0, beta, 0.0]))
    return np.asarray(end + twist @ loads.centre_m[link])


def _turned(rotations: Array, vectors: Array) -> Array:
    return np.asarray((rotations @ vectors[..., None])[..., 0])
