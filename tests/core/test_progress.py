"""Events of calls: who listens gets them in order, and nobody else."""

import math
from collections.abc import Callable
from typing import Any

import pytest

import lab
from lab.core.errors import LabError
from lab.core.progress import Event, listening, stages


def _work() -> None:
    with stages("outer") as stage:
        stage("first")
        with stages("inner") as part:
            part("counted", 1, 4)
        stage("second", 2, 2)


def test_events_come_in_order_with_the_end_of_each_work() -> None:
    events = list[Event]()
    with listening(events.append):
        _work()
    assert [(event.work, event.stage) for event in events] == [
        ("outer", ""), ("outer", "first"), ("inner", ""), ("inner", "counted"), ("inner", ""), ("outer", "second"),
        ("outer", ""),
    ]  # fmt: skip
    assert [event.ended for event in events] == [False, False, False, False, True, False, True]
    assert events[3].fraction == 0.25 and events[-1].fraction == 1.0 and math.isnan(events[1].fraction)


def test_the_nearest_listener_hears_and_the_others_do_not() -> None:
    outer, inner = list[Event](), list[Event]()
    with listening(outer.append):
        with listening(inner.append):
            _work()
        assert len(inner) == 7 and not outer
        with listening(None):
            _work()
    _work()
    assert len(outer) == 7 and len(inner) == 7


def _simulated(**more: Any) -> lab.MeasurementSession:
    return lab.simulate("irb120", poses=30, seed=7, **more)


def test_a_call_reports_to_its_own_listener_and_prints_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    events, day = list[lab.Event](), _simulated()
    result = lab.identify(day.measurements, instrument="uniform-8um", progress=events.append)
    assert events[0].work == "identifying" and events[-1].ended and any(0 < each.fraction < 1 for each in events)
    assert capfd.readouterr() == ("", "")
    silent = lab.identify(day.measurements, instrument="uniform-8um")
    assert silent.to_dict() | {"seconds": 0} == result.to_dict() | {"seconds": 0}


def test_what_a_listener_raises_ends_the_call() -> None:
    class StoppedError(Exception):
        pass

    def stop(event: Event) -> None:
        raise StoppedError

    data = _simulated().measurements
    with pytest.raises(StoppedError):
        lab.identify(data, instrument="uniform-8um", progress=stop)


@pytest.mark.parametrize("call", [lab.simulate, lab.calibrate, lab.inspect, lab.study])
def test_what_is_no_listener_is_refused(call: Callable[..., Any]) -> None:
    with pytest.raises(LabError, match=rf"lab.{call.__name__}: progress is 3; give a function"):
        call("irb120", progress=3)
