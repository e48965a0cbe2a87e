"""Mistakes of a measurement session: what moves, drifts or is read in another way while poses are measured."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

import lab
from lab.core import se3
from lab.core.measurements import Measurements
from lab.core.se3 import Array
from lab.robots.load_robot import load_robot

__all__ = ["MISTAKES", "Mistake", "session_with_noise", "stopped_elsewhere"]

ARM = load_robot("irb120").serial_arm(("p1",))
LEVER_M = 0.5  # at which the size of a joint's mistake is meant
Mistake = Callable[[Measurements, np.random.Generator, float], Measurements]


def session_with_noise(
    seed: int, poses: int = 60, noise_m: float = 9e-6, **options: object
) -> tuple[Measurements, np.random.Generator]:
    """Measurements of a virtual IRB 120 with Gaussian noise, and a generator for what goes wrong."""
    exact = lab.simulate("irb120", poses=poses, seed=seed, instrument="exact", **options).measurements
    rng = np.random.default_rng(10_000 + seed)
    return replace(exact, points=exact.points + noise_m * rng.normal(size=exact.points.shape)), rng


def _direction(rng: np.random.Generator) -> Array:
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def _after(data: Measurements, row: int) -> Array:
    return np.asarray((np.arange(len(data)) >= row)[:, None, None] * 1.0)


def _moved(data: Measurements, rng: np.random.Generator, size_m: float) -> Measurements:
    """The tracker moves half way."""
    return replace(data, points=data.points + size_m * _after(data, len(data) // 2) * _direction(rng))


def _moved_anywhere(data: Measurements, rng: np.random.Generator, size_m: float) -> Measurements:
    row = int(rng.integers(8, len(data) - 8))
    return replace(data, points=data.points + size_m * _after(data, row) * _direction(rng))


def _three_blocks(data: Measurements, rng: np.random.Generator, size_m: float) -> Measurements:
    shifts = np.repeat([size_m * _direction(rng) for _ in range(3)], -(-len(data) // 3), axis=0)[: len(data)]
    return replace(data, points=data.points + shifts[:, None, :])


def _turned(data: Measurements, rng: np.random.Generator, size_m: float) -> Measurements:
    """The tracker turns half way: by so much at a metre, about the middle of the points."""
    middle = data.points.mean(axis=(0, 1))
    turned = (data.points - middle) @ se3.exp(size_m * _direction(rng)).T + middle
    return replace(data, points=np.where(_after(data, len(data) // 2) > 0, turned, data.points))


def _drifted(data: Measurements, rng: np.random.Generator, size_m: float) -> Measurements:
    along = np.linspace(0.0, 1.0, len(data))[:, None, None]
    return replace(data, points=data.points + size_m * along * _direction(rng))


def _wandered(data: Measurements, rng: np.random.Generator, size_m: float) -> Measurements:
    """An AR(1) shift of the base, 0.9 from one pose to the next."""
    errors = rng.normal(size=(len(data), 3))
    for row in range(1, len(data)):
        errors[row] = 0.9 * errors[row - 1] + np.sqrt(1 - 0.9**2) * errors[row]
    return replace(data, points=data.points + size_m / np.sqrt(3) * errors[:, None, :])


def _zero_shifted(data: Measurements, rng: np.random.Generator, size_m: float) -> Measurements:
    """A joint's zero shifts half way."""
    joints = data.joints.copy()
    joints[len(data) // 2 :, int(rng.integers(0, 5))] += size_m / LEVER_M * rng.choice([-1, 1])
    return replace(data, joints=joints)


def _to_instrument(data: Measurements) -> Array:
    """The rotation ``(3, 3)`` from the base to the instrument, from the nominal arm's points."""
    start = ARM.points(data.joints, ARM.nominal())[:, 0]
    a, b = start - start.mean(axis=0), data.points[:, 0] - data.points[:, 0].mean(axis=0)
    left, _, right = np.linalg.svd(b.T @ a)
    return np.asarray(left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right)


def stopped_elsewhere(data: Measurements, off: Array) -> Measurements:
    """The arm stands ``off`` ``(n, joints)`` (rad) beside the joint positions that are recorded."""
    moved = ARM.points(data.joints + off, ARM.nominal()) - ARM.points(data.joints, ARM.nominal())
    return replace(data, points=data.points + moved @ _to_instrument(data).T)


def _reseated(data: Measurements, rng: np.random.Generator, size_m: float) -> Measurements:
    """The reflector is reseated half way: the tool point moves in the flange."""
    tool = [ARM.names.index(f"tool.p1.{axis}") for axis in "xyz"]
    slopes = ARM.observe(data.joints, ARM.nominal())[1][:, 0][..., tool]  # the flange's axes in the base
    moved = (_to_instrument(data) @ slopes @ _direction(rng))[:, None, :]
    return replace(data, points=data.points + size_m * _after(data, len(data) // 2) * moved)


def _half_read_back(data: Measurements, rng: np.random.Generator, size_m: float) -> Measurements:
    """The first half of the joint positions as commanded, the others as read back."""
    joints, half = data.joints.copy(), len(data) // 2
    joints[half:] += size_m / LEVER_M / 2 * rng.normal(size=joints[half:].shape)
    return replace(data, joints=joints)


MISTAKES: Mapping[str, Mistake] = {
    "the tracker moved half way": _moved,
    "the tracker moved at any pose": _moved_anywhere,
    "three blocks": _three_blocks,
    "the tracker turned": _turned,
    "drift": _drifted,
    "correlated in time": _wandered,
    "a zero shifted": _zero_shifted,
    "the reflector was reseated": _reseated,
    "half commanded, half read back": _half_read_back,
}
