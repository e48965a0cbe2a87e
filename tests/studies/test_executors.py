"""The processes that do the work of a study."""

import signal
import socket
import subprocess
import sys
import textwrap
from concurrent.futures import Executor, Future
from functools import partial
from multiprocessing import active_children
from pathlib import Path
from threading import Lock
from time import sleep
from types import SimpleNamespace

import pytest

import lab
from lab import extension_points
from lab.core.errors import LabError
from lab.studies import executors
from lab.studies.executors import StoppedError, local_executor, run_jobs

SCRIPT = """\
    import os
    from lab.studies.executors import local_executor
    with local_executor(1) as pool:
        assert pool.submit(os.getpid).result() != os.getpid()
    print("done")
"""


@pytest.mark.parametrize("started", ["unguarded", pytest.param("standard input", marks=pytest.mark.thorough)])
def test_a_script_needs_no_guard(started: str, tmp_path: Path) -> None:
    """Its processes do not run it again, so that it ends as it does with one; nothing but its own line is printed."""
    script = tmp_path / "script.py"
    script.write_text(textwrap.dedent(SCRIPT))
    command = [sys.executable, *([] if started == "standard input" else [str(script)])]
    with script.open() as text:
        done = subprocess.run(command, stdin=text, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "done\n", "")


def blocked() -> bool:
    """Whether an interruption is kept from this process."""
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])


@pytest.mark.thorough
@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="of POSIX")
def test_workers_start_with_interruptions_blocked() -> None:
    """Else one that comes while they import is a traceback among the parent's own lines."""
    with local_executor(1) as pool:
        assert pool.submit(blocked).result()
    assert not blocked()


def names_there(content: bytes) -> dict[str, str]:
    """The parts that a process knows after it has received some: the names of their classes."""
    extension_points.receive_parts(content)
    known = extension_points._given.get("lab.samplers", {})
    return {name: type(part).__name__ for name, part in known.items()}


def test_parts_of_this_program_reach_its_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a script, too, which its processes do not import; a module that they cannot import is named."""
    monkeypatch.setattr(extension_points, "_given", {})
    flat = type("Flat", (lab.Sampler,), {"__module__": "__main__", "name": "flat", "draw": lambda self, rng, shape: 0})
    for part in (flat(), lambda rng, shape: rng.standard_normal(shape)):
        extension_points.named_parts("sampler", part)
    content = extension_points.sent_parts()
    with local_executor(1) as pool:
        assert pool.submit(names_there, content).result() == {"flat": "Flat", "lambda": "lambda"}
        with pytest.raises(LabError, match=r"a worker cannot load a part .*; install its package there"):
            pool.submit(names_there, b"cnowhere\nthing\n.").result()
    locked = flat()
    locked.lock = Lock()
    extension_points.add(locked)
    with pytest.raises(LabError, match="sampler 'flat' cannot be sent to other processes"):
        extension_points.sent_parts()


class Silent(Executor):
    """Accepts work, and never answers."""

    def submit(self, fn: object, /, *args: object, **kwargs: object) -> Future:
        return Future()


def test_workers_that_never_answer_are_given_up() -> None:
    with pytest.raises(StoppedError, match=r"finished nothing within 0.01 s; look at them, then (--)?resume goes on"):
        list(run_jobs(Silent(), [("one", str), ("two", str)], timeout_s=0.01))


def test_each_finished_job_renews_the_wait(monkeypatch: pytest.MonkeyPatch) -> None:
    """However long all of them take: each wait is for the whole time again, and only the last one is in vain."""
    waited, submitted = list[float](), list[Future]()

    class OneByOne(Silent):
        def submit(self, fn: object, /, *args: object, **kwargs: object) -> Future:
            submitted.append(Future())
            return submitted[-1]

    def wait(waiting: dict, timeout: float, when: str) -> SimpleNamespace:
        waited.append(timeout)
        if len(waited) == 4:
            return SimpleNamespace(done=set())
        future = submitted[len(waited) - 1]
        future.set_result("done")
        return SimpleNamespace(done={future})

    monkeypatch.setattr(executors, "wait", wait)
    results = run_jobs(OneByOne(), [(number, str) for number in range(5)], timeout_s=7.0)
    assert [next(results) for _ in range(3)] == [(0, "done"), (1, "done"), (2, "done")]
    with pytest.raises(StoppedError, match="nothing within 7 s"):
        next(results)
    assert waited == [7.0] * 4


@pytest.mark.thorough
def test_processes_that_never_answer_are_ended() -> None:
    """Else the end of the program would wait for them."""
    stuck = [("stuck", partial(sleep, 3600.0))] * 2
    with pytest.raises(StoppedError, match="the workers finished nothing"), local_executor(2) as pool:
        list(run_jobs(pool, stuck, timeout_s=3.0))
    assert not active_children()


@pytest.mark.thorough
def test_a_scheduler_that_accepts_and_never_answers_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(executors, "CONNECTING_S", 0.5)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen(5)
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with (
            pytest.raises(LabError, match=r"does not answer \(nothing came within 0.5 s\); start dask scheduler there"),
            executors.cluster_executor(address),
        ):
            pass
