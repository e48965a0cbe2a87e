"""Register the command ``lab reproduce``."""

from lab.commands.registry import Command

__all__ = ["REPRODUCE"]

REPRODUCE = Command(
    "reproduce",
    "Compute the tables, figures and examples of a source again, each exercise with its solution.",
    "lab.extensions.reproduction.options:ReproduceOptions",
    "lab.extensions.reproduction.result:reproduce",
    "reproduce-{source}",
    examples=("thesis --item III", "course --item 8.6"),
    group="learn",
)
