"""Draw the layout graph of a mechanism: a box a joint, base to the left, platform to the right, a row a leg."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence

from lab.kinematics.closed.layout import Layout, layout_of
from lab.kinematics.closed.mechanism import Mechanism
from lab.report.charts.chart import axes_picture
from lab.report.charts.marks import Axes
from lab.report.document import Block, Figure, Paragraph, Picture, guarded
from lab.report.style import ARM, GRID, INK, PREDICTED

__all__ = ["layout_blocks", "layout_picture"]

_KINDS = {"R": "R a hinge", "P": "P a slide", "S": "S a ball"}
_ROW, _COLUMN, _EDGE = 0.42, 1.0, 0.5  # inches: a row's height, a column's width, and around


@guarded
def layout_blocks(mechanism: Mechanism) -> tuple[Block, ...]:
    """Name the legs, and draw them; nothing where the platform is not reached by joints."""
    layout = layout_of(mechanism.tree)
    legs = Counter("-".join(layout.joints[i].text for i in leg) for leg in layout.legs)
    if not legs:
        return ()
    named = ", ".join(f"{count} × {text}" if count > 1 else text for text, count in legs.items())
    kinds = {joint.kind for joint in layout.joints}
    used = [text for kind, text in _KINDS.items() if kind in kinds]
    guide = " Joints of a leg that has no actuated one stand for the platform's guide." if _is_guided(layout) else ""
    return (
        Paragraph(f"Legs from the base to the platform: {named} ({', '.join(used)}; underlined: actuated).{guide}"),
        Figure("layout", (layout_picture(layout),), "Layout graph: a box a joint, filled where it is actuated."),
    )


def _is_guided(layout: Layout) -> bool:
    """Check whether a leg has no actuated joint."""
    return any(not any(layout.joints[i].actuated for i in leg) for leg in layout.legs)


def layout_picture(layout: Layout) -> Picture:
    """Draw the legs as rows of boxes; a joint that several legs share stands amid their rows."""
    legs = layout.legs
    longest = max(len(leg) for leg in legs)
    places, end = _places(legs, longest), longest + 1
    size = (_COLUMN * (longest + 1) + 2 * _EDGE, _ROW * (len(legs) + 1) + _EDGE)

    def draw(axes: Axes) -> None:
        for leg in legs:
            stops = [(0.0, places[leg[0]][1]), *(places[i] for i in leg), (float(end), places[leg[-1]][1])]
            axes.plot([x for x, _ in stops], [y for _, y in stops], color=ARM, linewidth=1.2)
        for i, (x, y) in places.items():
            joint = layout.joints[i]
            fill = PREDICTED if joint.actuated else GRID
            axes.plot([x], [y], "s", color=fill, markersize=17)
            axes.annotate(joint.kind, (x, y), ha="center", va="center", fontsize=9,
                          color="white" if joint.actuated else INK)  # fmt: skip
        for x, name in ((0.0, "base"), (float(end), "platform")):
            axes.plot([x, x], [-0.5, len(legs) - 0.5], color=INK, linewidth=3)
            axes.annotate(name, (x, len(legs) - 0.3), ha="center", va="bottom", fontsize=8, color=INK)
        axes.set(xlim=(-0.6, end + 0.6), ylim=(-0.8, len(legs) + 0.2))
        axes.set_xticks([])
        axes.set_yticks([])

    return axes_picture("layout-graph", "Layout graph of the mechanism", size, draw, (0.05, 0.05, 0.05, 0.05))


def _places(legs: Sequence[Sequence[int]], longest: int) -> Mapping[int, tuple[float, float]]:
    """Return column and row of each joint; the first leg is at the top, and short legs are spread."""
    rows, columns = defaultdict[int, list[float]](list), defaultdict[int, list[float]](list)
    for row, leg in enumerate(legs):
        for column, joint in enumerate(leg):
            rows[joint].append(len(legs) - 1.0 - row)
            columns[joint].append((column + 1) * (longest + 1) / (len(leg) + 1))
    return {
        joint: (sum(columns[joint]) / len(columns[joint]), sum(every) / len(every)) for joint, every in rows.items()
    }
