"""Register the command ``lab reproduce``."""

from lab.options.command import Command

__all__ = ["REPRODUCE"]

REPRODUCE = Command(
    "reproduce",
    "Compute the tables, figures and examples of a source again, each exercise with its solution.",
    "lab.extensions.reproduction.reproduction_options:ReproduceOptions",
    "lab.extensions.reproduction.reproduction_result:reproduce",
    "reproduce-{source}",
    examples=("thesis --item III", "course --item 8.6"),
    group="learn",
)
