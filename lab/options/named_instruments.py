"""Find instruments by the name of a preset, or by a file."""

from pathlib import Path

from lab.calibration.sensor import ArmSensor
from lab.calibration.weights import Noise
from lab.core.units import MM
from lab.formats.instrument_toml import read_instrument
from lab.noise import instruments
from lab.noise.instruments import Instrument, is_named, observing
from lab.options.measured_campaign import MeasuredCampaign

__all__ = ["instrument", "name_of", "named_instrument", "noise_of"]


def instrument(name: str | Path | Instrument) -> Instrument:
    """Return an instrument, its noise model and field of view, by a name or a file.

    Args:
        name: of a preset; or the path of a TOML file that describes a tracker; an instrument stays as it is.

    Returns:
        The instrument.

    Raises:
        LabError: there is no such preset (the message lists those there are), or the file describes no tracker.

    Example:
        >>> import lab
        >>> lab.instrument("leica-at960").kind
        'spherical'
    """
    return name if isinstance(name, Instrument) else named_instrument(str(name))


def named_instrument(name: str) -> Instrument:
    """Return an instrument by the name of its preset, or by the path of its TOML file.

    Raises:
        LabError: there is neither, or the file does not describe an instrument.
    """
    if is_named(name) or not name.endswith(".toml"):
        return instruments.instrument(name)
    return read_instrument(Path(name))


def name_of(device: str | Path | Instrument) -> str | Instrument:
    """Return the name or path by which a run reads an instrument again; one that has neither as it is."""
    if not isinstance(device, Instrument):
        return str(device)
    for name in (device.name, device.source):
        if name and (is_named(name) or name == device.source) and named_instrument(name) == device:
            return name
    return device


def noise_of(options: MeasuredCampaign, sensor: ArmSensor) -> Noise:
    """Return the noise by which options weigh measurements of a sensor; unknown where none is given."""
    device = None
    if options.instrument is not None:
        device = observing(named_instrument(options.instrument), sensor.read_by or sensor.name)
    return Noise(device, None if options.noise_mm is None else MM.to_si(options.noise_mm))
