"""Define a sampler of arms: the distribution of the geometric errors of virtual arms."""

from abc import ABC, abstractmethod

import numpy as np

from lab.core.se3 import Array
from lab.extension_points import Part, PartKind, numbers

__all__ = ["NORMAL", "Sampler", "sampler_named"]

_SAMPLERS = PartKind(
    "lab.samplers",
    "sampler",
    "sampler",
    ("normal",),
    {"draw": lambda where, errors, rng, shape: numbers(where, errors, shape)},
    "draw",
)


class Sampler(Part, ABC, kind=_SAMPLERS):
    """A sampler of virtual arms: the distribution of their geometric errors.

    Your own is a subclass with a ``name`` and a ``draw``, or a function like ``draw``. Every call with an option
    ``sampler`` takes an object of it; if a package registers it as an entry point of ``lab.samplers``, ``--sampler``
    takes it by name.

    Attributes:
        name: in options.

    Example:
        >>> import numpy as np
        >>> import lab
        >>> class Uniform(lab.Sampler):
        ...     name = "uniform"
        ...
        ...     def draw(self, rng, shape):
        ...         return rng.uniform(-np.sqrt(3), np.sqrt(3), shape)
        >>> day = lab.simulate("irb120", poses=10, seed=7, sampler=Uniform())
        >>> day.options.sampler
        'uniform'
    """

    name: str

    @abstractmethod
    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        """Draw errors in standard deviations, of mean zero and variance one.

        Args:
            rng: the only source of chance.
            shape: ``(bodies, 6)`` of a serial arm: position along x, y, z, and rotation about them, of the base, each
                link and the flange; ``(joints,)`` of its joints' zeros; ``(links, 5)`` of its Denavit-Hartenberg
                table; ``(parameters,)`` of a mechanism.
        """


class _Normal(Sampler):
    name = "normal"

    def draw(self, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
        return rng.standard_normal(shape)


NORMAL = _Normal()


def sampler_named(name: str) -> Sampler:
    """Return the sampler of this name.

    Raises:
        LabError: there is none, or its package cannot be imported.
    """
    sampler: Sampler = NORMAL if name == NORMAL.name else _SAMPLERS.named(name)
    return sampler
