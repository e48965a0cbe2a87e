"""The lab's version, and where its package is."""

from pathlib import Path
from typing import Final

__all__ = ["PACKAGE", "__version__"]

__version__ = "0.1.0"
PACKAGE: Final = Path(__file__).resolve().parents[1]
