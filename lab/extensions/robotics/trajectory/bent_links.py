"""The links of an arm as lines that bend, their deflection magnified: what a recording shows segment by segment."""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from lab.core import se3
from lab.core.se3 import Array
from lab.kinematics.dynamics.link_loads import LinkLoads
from lab.kinematics.serial.walk import Torsors

__all__ = ["bent_links"]

_POINTS = 12  # of each straight part of a link


def bent_links(links: LinkLoads, joints: Array, sag: Array, torsors: Torsors, factor: float) -> Mapping[int, Array]:
    """Lines of the links ``(k, m, 3)`` m in frame 0, by link, from 0; links without a length have none.

    The deformations of all links and joints are magnified, and each carries the links beyond it. Between its ends a
    link is drawn as a beam that is loaded at its end: by the cubic through displacements and slopes there.

    Args:
        joints: ``(k, n)`` as commanded.
        sag: ``(k, n)`` how far the joints give way, rad or m.
        torsors: how far the links' ends are displaced.
        factor: of the magnification.
    """
    placed, chain = links.loads.frames(joints), links.loads.chain
    carried = np.tile(np.eye(4), (len(joints), 1, 1))  # how the magnified deformations inward of a link have moved it
    found = {}
    for j in range(chain.size):
        far = placed.end if j == chain.size - 1 else placed.anchors[:, j + 1]
        rotation, end = placed.rotations[:, j], links.ends[j]
        carried = carried @ _given_way(placed.axes[:, j], placed.anchors[:, j], factor * sag[:, j], chain.prismatic[j])
        torsor = factor * torsors.get(j, np.zeros((len(joints), 6)))
        turn = se3.exp(torsor[:, 3:])
        shift = (turn @ torsor[:, :3, None])[..., 0]  # T_flex = Rot Trans
        if end.any():
            line = _along(links.beams[j].path if j in links.beams else np.stack([np.zeros(3), end]))
            Ts = carried @ se3.pose(rotation, far - rotation @ end)
            drawn = line + _deflection(line, end, shift, torsor[:, 3:])
            found[j] = drawn @ Ts[:, :3, :3].swapaxes(1, 2) + Ts[:, None, :3, 3]
        T_frame0_far = se3.pose(rotation, far)
        carried = carried @ T_frame0_far @ se3.pose(turn, shift) @ se3.inverse(T_frame0_far)
    return found


def _along(path: Array) -> Array:
    """Points ``(m, 3)`` along a line with corners ``(k, 3)``."""
    shares = np.linspace(0.0, 1.0, _POINTS)[1:, None]
    return np.concatenate([path[:1], *(a + shares * (b - a) for a, b in pairwise(path))])


def _deflection(line: Array, end: Array, shift: Array, turn: Array) -> Array:
    """How far points ``(m, 3)`` of a link go ``(k, m, 3)`` whose end ``(3,)`` is shifted and turned by ``(k, 3)``."""
    lengths = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1)))
    s = (lengths / lengths[-1])[:, None]
    shape: Array = (3 * s**2 - 2 * s**3) * shift[:, None] + (s**3 - s**2) * np.cross(turn, end)[:, None]
    return shape


def _given_way(axes: Array, anchors: Array, by: Array, slides: bool) -> Array:
    """Motions ``(k, 4, 4)`` of joints that give way."""
    if slides:
        return se3.pose(np.tile(np.eye(3), (len(by), 1, 1)), axes * by[:, None])
    turn = se3.exp(axes * by[:, None])
    return se3.pose(turn, anchors - (turn @ anchors[..., None])[..., 0])
