"""Run a study's tasks on executors: local processes or a cluster."""

import asyncio
import logging
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from contextlib import contextmanager
from importlib.util import find_spec
from itertools import islice
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from lab.core.errors import LabError, option_name
from lab.core.extras import optional
from lab.core.limits import WORKERS, whole

if TYPE_CHECKING:
    from distributed import Client  # of an extra

__all__ = ["CONNECTING_S", "TIMEOUT_S", "StoppedError", "cluster_executor", "local_executor", "run_jobs"]

_IN_FLIGHT = 256  # tasks submitted at a time: enough for a hundred workers, within memory
CONNECTING_S, TIMEOUT_S = 10.0, 600.0
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

_Key = TypeVar("_Key")
_Result = TypeVar("_Result")


class StoppedError(LabError):
    """A study stopped before its end; finished files stay, and it can be resumed."""


def local_executor(workers: int | None = None) -> ProcessPoolExecutor:
    """Return processes of this machine, by default one for each core that this process may use.

    A process imports the modules whose functions it calls, but not the script or the session that started it: a script
    needs no ``if __name__ == "__main__"``, and its own functions cannot be called.

    Raises:
        LabError: ``workers`` is below one, or too many.
    """
    if workers is None:
        workers = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    whole(option_name("workers"), workers, 1, WORKERS)
    return _Workers(workers)


class _Workers(ProcessPoolExecutor):
    """Processes that are ended where a study stops, as one that never answers would be waited for."""

    def __init__(self, workers: int) -> None:
        self._context = _Processes()
        super().__init__(workers, self._context, _prepare)

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: Any) -> Literal[False]:
        if isinstance(error, StoppedError):
            for process in self._context.started:
                process.terminate()
        super().__exit__(kind, error, trace)
        return False


class _Process(SpawnProcess):
    """A process that does not run the script again, and ignores interruptions: the parent ends the work."""

    def start(self) -> None:
        """Start it with the signal blocked, which a new process inherits; the parent gets pending signals."""
        if not hasattr(signal, "pthread_sigmask"):  # Windows
            self._start_without_script()
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            self._start_without_script()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def _start_without_script(self) -> None:
        """Start it with an empty module in the script's place, which the new process imports.

        A script that calls ``lab.study`` outside ``if __name__ == "__main__"`` would start a study in every process,
        and one that is read from standard input cannot be imported at all.
        """
        script = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            super().start()
        finally:
            sys.modules["__main__"] = script


class _Processes(SpawnContext):
    """Context that starts new interpreters, without copies of this one, and knows them."""

    def __init__(self) -> None:
        super().__init__()
        self.started: list[SpawnProcess] = []

    def Process(self, *args: Any, **kwargs: Any) -> SpawnProcess:  # type: ignore[override]
        """Return a process that is not started yet."""
        process = _Process(*args, **kwargs)
        self.started.append(process)
        return process


def _prepare() -> None:
    """Prepare a process: one BLAS thread, ended and interrupted only with the parent."""
    os.environ.update(dict.fromkeys(_THREADS, "1"))  # before numpy is imported
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # where the signal could not be blocked before
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End with the parent: workers of a killed parent would wait for work for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def cluster_executor(address: str) -> Iterator[Executor]:
    """Yield the workers of a dask.distributed scheduler; certificates for ``tls://`` come from dask's configuration.

    Raises:
        LabError: the extra is not installed, or the scheduler does not answer or has no workers with the lab.
        StoppedError: a piece of work was lost with several workers, one after another.
    """
    distributed = optional("distributed", option_name("scheduler"))
    with _client(address) as client:
        try:
            client.wait_for_workers(1, timeout=CONNECTING_S)
        except TimeoutError as error:
            raise LabError(
                f"{option_name('scheduler')} {address}: has no workers; start dask worker {address}"
            ) from error
        found = {"the scheduler": client.run_on_scheduler(find_spec, "lab"), **client.run(find_spec, "lab")}
        if lacking := [place for place, lab in found.items() if lab is None]:
            raise LabError(
                f"{option_name('scheduler')} {address}: no lab at {lacking[0]}; install the same one on every machine"
            )
        try:
            yield client.get_executor(pure=False)
        except distributed.KilledWorker as error:
            raise StoppedError(
                "workers of the cluster ended one after another (killed, or out of memory); "
                f"look at their logs, then {option_name('resume')} goes on"
            ) from error


def _client(address: str) -> "Client":
    from distributed import Client
    from distributed.comm.core import connect
    from distributed.security import Security

    async def answer() -> None:  # a client without a scheduler would not end quietly
        async with asyncio.timeout(CONNECTING_S):  # its own is not of one that accepts, and never answers
            comm = await connect(address, timeout=CONNECTING_S, **Security().get_connection_args("client"))
        await comm.close()

    try:
        asyncio.run(answer())
        client = Client(address, timeout=CONNECTING_S, set_as_default=False)
    except (OSError, ValueError, TypeError, RuntimeError) as error:  # dask's errors of addresses and certificates
        why = " ".join(str(error).split()) or f"nothing came within {CONNECTING_S:g} s"
        raise LabError(
            f"{option_name('scheduler')} {address}: does not answer ({why}); start dask scheduler there, "
            "mend the address, or give dask its certificates"
        ) from error
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # a loss is reported here
    return client


def run_jobs(
    executor: Executor, jobs: Iterable[tuple[_Key, Callable[[], _Result]]], timeout_s: float = TIMEOUT_S
) -> Generator[tuple[_Key, _Result], None, None]:
    """Yield each job's key and result as jobs finish, with some hundreds submitted at a time.

    Args:
        timeout_s: for so long no job may finish.

    Raises:
        StoppedError: the workers were lost, or do not answer.
    """
    left = iter(jobs)
    waiting: dict[Future[_Result], _Key] = {}
    try:
        while True:
            for key, call in islice(left, _IN_FLIGHT - len(waiting)):
                waiting[executor.submit(call)] = key
            if not waiting:
                return
            done = wait(waiting, timeout_s, FIRST_COMPLETED).done
            if not done:
                raise StoppedError(
                    f"the workers finished nothing within {timeout_s:g} s; look at them, then {option_name('resume')} "
                    f"goes on; where a piece of work takes longer, give {option_name('timeout_s')}"
                )
            for future in [future for future in waiting if future in done]:  # in the order of submission
                yield waiting.pop(future), future.result()
    except BrokenExecutor as error:
        raise StoppedError(
            f"a worker process ended (killed, or out of memory); {option_name('resume')} goes on"
        ) from error
    except CancelledError as error:
        raise StoppedError(
            f"the cluster's scheduler was lost; start it again, then {option_name('resume')} goes on"
        ) from error
    finally:
        for future in waiting:
            future.cancel()
