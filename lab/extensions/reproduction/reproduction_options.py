"""Options of ``lab reproduce``."""

from dataclasses import dataclass

import tyro

from lab.extensions.reproduction.item import SourceName

__all__ = ["ReproduceOptions"]


@dataclass(frozen=True)
class ReproduceOptions:
    """Options: the source, and the items of it."""

    source: tyro.conf.Positional[SourceName]
    """thesis: Mahdadi and Bouafia 2020; elastic: Benmisra 2007; course: Mallem 2011; staubli: the RX 130 and TX 40."""
    item: str | None = None
    """Only the items of this number (8.6, III.24, "Table IV.2") or chapter (8, III)."""
