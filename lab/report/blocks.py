"""Parts that many documents share: verdicts, tables of errors, and the joint positions of a robot."""

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from lab.core.number_text import fixed, short
from lab.core.se3 import Array
from lab.kinematics.joints import JointSpec
from lab.library.result import joint_values
from lab.report.document import Badge, Row, Table

__all__ = ["error_table", "joint_cells", "joint_headings", "verdict_badge"]

_KINDS: Mapping[str, Literal["good", "doubtful", "bad", "open"]] = {
    "good": "good",
    "due": "doubtful",
    "doubtful": "doubtful",
    "bad": "bad",
}
_STATISTICS = ("mean", "rms", "p95", "max")


def verdict_badge(word: str, text: str = "") -> Badge:
    """Return the badge of a verdict or a state of an arm: good, due, doubtful, bad, or any other word in grey.

    Args:
        text: of the badge, where it is not the word.
    """
    return Badge(text or word, _KINDS.get(word, "open"))


def error_table(
    rows: Sequence[tuple[str, Mapping[str, float]]], caption: str, kinds: tuple[str, ...] = (), counted: str = "points"
) -> Table:
    """Tabulate errors: mean, root mean square, 95th percentile, largest and count, mm; what is missing is empty.

    Args:
        rows: name of each kind of errors, and the statistics ``mean``, ``rms``, ``p95``, ``max`` and ``count``.
        counted: heading of the count.
    """
    cells: list[Row] = [
        (
            name,
            *(short(values[key]) if key in values else "" for key in _STATISTICS),
            f"{values['count']:,.0f}" if "count" in values else "",
        )
        for name, values in rows
    ]
    return Table(("", "mean", "rms", "95 %", "max", counted), tuple(cells), caption, kinds)


def joint_headings(chain: JointSpec, per: str = "") -> tuple[str, ...]:
    """Return name and unit of each joint; ``per`` follows the unit, as "/s"."""
    return tuple(f"{name}, {chain.unit(i).name}{per}" for i, name in enumerate(chain.joint_names))


def joint_cells(chain: JointSpec, joints: Array, digits: int = 3) -> tuple[str, ...]:
    """Return joint positions or rates ``(n,)`` as people read them: degrees, mm of a slide."""
    values: list[Any] = joint_values(chain.prismatic, joints).tolist()
    return tuple(fixed(value, digits) for value in values)
