"""The registry of kinds: each answers by its name, takes its own options, and is simulated."""

import inspect
from dataclasses import fields
from pkgutil import resolve_name

import pytest

from lab.calibration.observations.kind import ObservationKind
from lab.calibration.observations.options import FitInputs, ObservationOptions
from lab.campaign.observation_kinds import KINDS, configured_kind, kind_named, simulation_of
from lab.campaign.options import MeasuringSetup
from lab.core.errors import LabError
from lab.simulation.observations.protocol import Simulate


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_is_registered_by_its_name(name: str) -> None:
    kind = kind_named(name)
    assert kind.name == name and ObservationKind in kind.__mro__
    assert not inspect.isabstract(kind)
    assert configured_kind(name, ObservationOptions(), FitInputs()) == kind()
    for declared in inspect.get_annotations(ObservationKind):  # what has no default is said by every kind
        assert hasattr(kind, declared), declared
    words = kind.words
    assert all(getattr(words, field.name) for field in fields(words) if field.name != "names_targets")


def test_the_flags_of_each_kind_are_options_of_all() -> None:
    known = {field.name for field in fields(ObservationOptions)}
    own = [field.name for name in KINDS if kind_named(name).flags for field in fields(kind_named(name).flags)]
    assert known == set(own) and len(own) == len(set(own))


@pytest.mark.parametrize("name", KINDS)
def test_a_simulation_measures_a_virtual_arm(name: str) -> None:
    simulate = simulation_of(name)
    assert simulate is resolve_name(KINDS[name].simulation)
    assert list(inspect.signature(simulate).parameters) == list(inspect.signature(Simulate.__call__).parameters)[1:]
    assert set(KINDS[name].setup) <= {field.name for field in fields(MeasuringSetup)}


REFUSED = {
    "unknown": ("camera", {}, {}, "--observe camera: unknown; give one of points, pose, cable"),
    "another kind's flag": ("points", {"orientation": "fixed-xyz"}, {}, "--orientation is of --observe pose; give"),
    "another kind's value": ("cable", {"method": "sequential"}, {}, "--method sequential is of --observe pose; give"),
    "another kind's distance": (
        "pose",
        {"socket_distance_mm": 50.0},
        {},
        "--socket-distance-mm is of --observe socket",
    ),
    "a distance of nothing": ("socket", {"socket_distance_mm": 0.0}, {}, "--socket-distance-mm 0: give a number above"),
    "a noise alone": ("pose", {"noise_mrad": 0.1}, {}, "--noise-mrad says what orientations weigh .* --noise-mm too"),
    "a noise of nothing": ("pose", {"noise_mrad": 0.0}, {"noise_mm": 0.1}, "--noise-mrad 0: give a number above zero"),
    "sequential with a prior": ("pose", {"method": "sequential"}, {"prior": True}, "--prior is of --method global"),
    "an instrument": ("cable", {}, {"instrument": True}, "--observe cable: --validate and --instrument are of points"),
    "a validation file": ("pose", {}, {"validation_file": True}, "--observe pose: --validate is of points"),
}


@pytest.mark.parametrize(("name", "options", "fit", "what"), REFUSED.values(), ids=REFUSED)
def test_options_that_do_not_go_together_are_refused(name, options, fit, what) -> None:
    with pytest.raises(LabError, match=what):
        configured_kind(name, ObservationOptions(**options), FitInputs(**fit))


def test_options_reach_their_kind() -> None:
    pose = configured_kind("pose", ObservationOptions(noise_mrad=0.3, orientation="fixed-xyz"), FitInputs(noise_mm=0.1))
    assert pose.ratio == pytest.approx(3.0) and pose.orientation == "fixed-xyz" and pose.solve is None
    assert configured_kind("pose", ObservationOptions(method="sequential"), FitInputs()).solve is not None
    socket = configured_kind("socket", ObservationOptions(socket_distance_mm=50.0), FitInputs())
    assert socket.distance_m == pytest.approx(0.05)
