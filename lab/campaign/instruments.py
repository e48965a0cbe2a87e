"""Instruments as they are named: a preset, or a file that describes one."""

from pathlib import Path

from lab.core.instruments import INSTRUMENTS, Instrument, instrument
from lab.formats.instrument_toml import read_instrument

__all__ = ["named_instrument"]


def named_instrument(name: str) -> Instrument:
    """An instrument by the name of its preset, or by the path of a TOML file that describes it.

    Raises:
        LabError: there is neither, or the file describes none.
    """
    if name in INSTRUMENTS or not name.endswith(".toml"):
        return instrument(name)
    return read_instrument(Path(name))
