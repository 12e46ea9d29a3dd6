"""Signals that ask a command to end, and their handlers."""

import signal
from collections.abc import Callable
from types import FrameType

#: Ctrl-C, a termination request, and a closed terminal, which not every system signals.
SIGNALS = (
    signal.SIGINT,
    signal.SIGTERM,
    *((signal.SIGHUP,) if hasattr(signal, "SIGHUP") else ()),
)


def answer(handler: Callable[[int, FrameType | None], None]) -> None:
    """Install a handler for every request to end, except ignored ones, as under ``nohup``."""
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)


def ignore() -> None:
    """Ignore further requests to end."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
