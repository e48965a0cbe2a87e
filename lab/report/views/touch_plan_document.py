"""Document of the configurations that a daily check proposes."""

from lab.core.errors import counted
from lab.core.limits import called
from lab.library.touch_plan import TouchPlan
from lab.report import document as doc
from lab.report.blocks import joint_cells, joint_headings

__all__ = ["plan_document"]


def plan_document(plan: TouchPlan) -> doc.Document:
    """Build the document of the proposed configurations."""
    chain = plan.calibrated.robot.chain
    rows = [
        (socket or "–", *joint_cells(chain, joints, 2))
        for socket, joints in zip(plan.sockets, plan.joints, strict=True)
    ]
    note = (
        f"Every cause keeps {100 * plan.own_share:.0f} % of its pattern or more that no other single cause explains, "
        "but for causes that no configuration here tells apart. Touch near these positions; joint positions within "
        "10° of them count as the same configuration."
    )
    blocks = (
        doc.Paragraph(f"plan.csv holds {counted(len(plan.joints), 'configuration')}. Touch each every day, and add the "
                      "joint positions to the file of all checks, with the day in session."),
        doc.Table(("socket", *joint_headings(chain)), tuple(rows)),
        doc.Paragraph(note, "note"),
        doc.Warnings(plan.warnings),
    )  # fmt: skip
    name = called(plan.calibrated.robot.name, plan.calibrated.serial or plan.options.serial)
    return doc.Document(f"{name}: configurations of a daily check", blocks)
