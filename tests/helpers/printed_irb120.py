"""The IRB 120 of Mahdadi and Bouafia 2020 by its printed table and matrix of a link: none of the lab's models."""

import numpy as np

__all__ = ["IRB120", "TABLE", "frames", "table_of"]

IRB120 = (  # theta - q, d, a, alpha; m and degrees, table III.2
    (0, 0.29, 0, -90),
    (-90, 0, 0.27, 0),
    (0, 0, 0.07, -90),
    (0, 0.302, 0, 90),
    (0, 0, 0, -90),
    (180, 0.072, 0, 0),
)


def table_of(rows: tuple) -> np.ndarray:
    """Return a table with its angles in rad."""
    table = np.array(rows, dtype=float)
    table[:, [0, 3]] = np.deg2rad(table[:, [0, 3]])
    return table


TABLE = table_of(IRB120)


def frames(table: np.ndarray, q: np.ndarray) -> list[np.ndarray]:
    """Return the poses ``(n, 4, 4)`` of all frames at joints ``(n, joints)``, by equation III.2."""
    T, out = np.tile(np.eye(4), (len(q), 1, 1)), []
    for (theta, d, a, alpha), angle in zip(table, q.T, strict=True):
        c, s, ca, sa = np.cos(theta + angle), np.sin(theta + angle), np.cos(alpha), np.sin(alpha)
        zero, one = np.zeros_like(c), np.ones_like(c)
        link = np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [zero, sa * one, ca * one, d * one],
                         [zero, zero, zero, one]])  # fmt: skip
        T = T @ link.transpose(2, 0, 1)
        out.append(T)
    return out
