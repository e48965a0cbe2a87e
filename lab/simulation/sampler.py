"""Define a sampler of arms: the distribution of the geometric errors of virtual arms."""

from abc import ABC, abstractmethod

import numpy as np

from lab.core.errors import LabError, option_name
from lab.core.se3 import Array
from lab.extension_points import added, load_part, own_errors, own_part

__all__ = ["NORMAL", "Sampler", "drawn", "own_sampler", "sampler_named"]

_GROUP = "lab.samplers"


class Sampler(ABC):
    """A sampler of virtual arms: the distribution of their geometric errors.

    Your own is a subclass with a ``name`` and a ``draw``. ``lab.calibrate(..., sampler=...)`` and ``lab.simulate`` take
    an object of it; if a package registers it as an entry point of ``lab.samplers``, ``--sampler`` takes it by name.

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
_NAMES = (NORMAL.name,)


def drawn(sampler: Sampler, rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Return the errors that a sampler draws.

    Raises:
        LabError: it raises an error, or draws something else than finite numbers of this shape.
    """
    with own_errors("sampler", sampler.name):
        errors = np.asarray(sampler.draw(rng, shape), dtype=np.float64)
    if errors.shape != shape or not np.isfinite(errors).all():
        raise LabError(f"sampler '{sampler.name}' draws shape {errors.shape}; draw finite numbers of shape {shape}")
    return errors


def own_sampler(given: object) -> Sampler:
    """Return the sampler given by a user: an object, or a class of such objects.

    Raises:
        LabError: it is no ``Sampler``, or has no name of its own.
    """
    return own_part(given, Sampler, "sampler", _NAMES)  # type: ignore[type-abstract]


def sampler_named(name: str) -> Sampler:
    """Return the sampler of this name.

    Raises:
        LabError: there is none, or its package cannot be imported.
    """
    if name == NORMAL.name:
        return NORMAL
    names = added(_GROUP, _NAMES)
    if name not in names:
        raise LabError(f"{option_name('sampler')} {name}: unknown; give one of {', '.join((*_NAMES, *names))}")
    return load_part(_GROUP, name, Sampler, "sampler")  # type: ignore[type-abstract]
