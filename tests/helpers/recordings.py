"""Recordings, read back from their files and shown by the viewer."""

import socket
import subprocess
import sys
import time
from pathlib import Path

import pyarrow as pa
import pytest
import rerun_cli
from rerun.chunk import RrdReader
from rerun.experimental import ViewerClient

from lab.core import se3

DRIVERS = [Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d")]


FLOAT32 = 2.0**-23  # relative spacing of float32


needs_vulkan = pytest.mark.skipif(
    sys.platform != "linux" or not any(folder.glob("*.json") for folder in DRIVERS if folder.is_dir()),
    reason="no Vulkan driver: the viewer cannot draw here",
)


def program():
    """Rerun's program itself: as a Python module it loses the exit code, and leaves a viewer running when ended."""
    return str(Path(rerun_cli.__file__).parent / "rerun")


def rrd(home, *arguments):
    command = [program(), "rrd", *map(str, arguments)]
    return subprocess.run(command, env=home, capture_output=True, text=True, timeout=60)


def column(path, entity, name, timeline="pose"):
    """Indices and values of a component over a timeline, one list of values a row."""
    reader = RrdReader(path)
    rows = {}
    for chunk in reader.stream(store=reader.recordings()[0]).filter(content=entity):
        batch = chunk.to_record_batch()
        if timeline in batch.schema.names and name in batch.schema.names:
            at = batch.column(timeline)
            at = at.cast("int64") if pa.types.is_duration(at.type) else at  # ns
            rows.update(zip(at.to_pylist(), batch.column(name).to_pylist(), strict=True))
    index = sorted(rows)
    return index, [rows[i] for i in index]


def statics(path, entity, name):
    reader = RrdReader(path)
    for chunk in reader.stream(store=reader.recordings()[0]).filter(content=entity):
        batch = chunk.to_record_batch()
        if "pose" not in batch.schema.names and name in batch.schema.names:
            return batch.column(name).to_pylist()[0]
    raise AssertionError(f"{entity} has no static {name}")


def in_world(outcome, points):
    """Points (n, 3) of the tracker's frame in the world, by the identified base."""
    base = outcome.identification.values[:6]
    T_tracker_frame0 = se3.pose(se3.exp(base[3:]), base[:3])
    return se3.transform(outcome.robot.model.T_world_frame0 @ se3.inverse(T_tracker_frame0), points)


def views_of(recording, home, timeline="pose"):
    """The views of a recording that is open in a viewer of its own, which no other machine reaches."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = ["--headless", "--bind", "127.0.0.1", "--port", str(port), "--hide-welcome-screen"]
    viewer = subprocess.Popen([program(), *server], env=home, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        return opened(port, recording, timeline).views
    finally:
        viewer.terminate()
        viewer.wait(10)


def settled(client, deadline):
    """What a viewer shows once all is read: a busy machine takes its time, and what is wrong stays wrong."""
    time.sleep(1)
    while True:
        state = client.get_state()
        if time.monotonic() > deadline or (state.views and not any(view.reports for view in state.views)):
            return state
        time.sleep(0.5)


def opened(port, path, timeline):
    deadline = time.monotonic() + 20
    while True:
        try:
            with ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy") as client:
                client.open(str(path))
                client.set_time(timeline, sequence=3)
                return settled(client, time.monotonic() + 10)
        except Exception:
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)
