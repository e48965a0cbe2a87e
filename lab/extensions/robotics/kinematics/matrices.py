"""The matrices of a serial arm as the sources print them: in numbers at some joint positions, and in letters."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from lab.commands.values import tidy
from lab.core.se3 import Array
from lab.extensions.robotics.kinematics.symbolic import SymbolicChain, textbook

__all__ = ["Matrices"]


@dataclass(frozen=True)
class Matrices:
    """Link matrices and their products.

    Attributes:
        links: ``(n, 4, 4)`` T_i-1,i (m) at the first placement; none of a robot with loops.
        letters: the chain in letters, where asked for.
        between: the two frames whose product is asked for.
    """

    links: Array
    letters: SymbolicChain | None
    between: tuple[int, int] | None

    def product(self, first: int, last: int) -> Array:
        """The pose ``(4, 4)`` (m) of frame ``last`` in frame ``first``."""
        found = np.eye(4)
        for link in self.links[first:last]:
            found = found @ link
        return found

    def texts(self) -> dict[str, list[list[str]]]:
        """The matrices in letters, T_i-1,i and T_0,n and the product that is asked for; none without letters."""
        if self.letters is None:
            return {}
        size = len(self.letters.rows)
        pairs = [*((i, i + 1) for i in range(size)), (0, size)]
        if self.between is not None and self.between not in pairs:
            pairs.append(self.between)
        made = {f"T{first},{last}": self.letters.between(first, last) for first, last in pairs}
        return {name: [[textbook(matrix[i, j]) for j in range(4)] for i in range(4)] for name, matrix in made.items()}

    def letter_values(self) -> dict[str, float]:
        """What the letters stand for: lengths ``<letter>_mm``, angles ``<letter>_deg``."""
        letters: dict[str, Any] = {} if self.letters is None else dict(self.letters.letters)
        lengths = {name for name in letters if name.rstrip("0123456789") in ("d", "a")}
        return {
            f"{name}_mm" if name in lengths else f"{name}_deg": tidy(value * (1e3 if name in lengths else 180 / np.pi))
            for name, value in letters.items()
        }
