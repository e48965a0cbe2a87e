"""What simulates a kind of observation is called as the protocol says."""

import inspect

from lab.simulation.observations import protocol
from lab.simulation.observations.points import measure_with_outlier_mask


def test_points_are_simulated_as_the_protocol_says() -> None:
    asked = list(inspect.signature(protocol.Simulate.__call__).parameters)[1:]
    assert list(inspect.signature(measure_with_outlier_mask).parameters)[: len(asked)] == asked
