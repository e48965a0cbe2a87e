"""Programs that tests start."""

import signal

__all__ = ["interruptible"]


def interruptible() -> None:
    """Let a program be interrupted however the tests were started: a shell's background jobs ignore that signal."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
