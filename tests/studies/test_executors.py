"""The processes that do the work of a study."""

import signal

import pytest

from lab.studies.executors import local_executor


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
