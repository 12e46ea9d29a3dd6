"""Which signals ask a command to end, and who answers them."""

import signal
from collections.abc import Callable
from types import FrameType

#: Ctrl-C, a request to end, and a terminal that is closed, which not every system has.
SIGNALS = (
    signal.SIGINT,
    signal.SIGTERM,
    *((signal.SIGHUP,) if hasattr(signal, "SIGHUP") else ()),
)


def answer(handler: Callable[[int, FrameType | None], None]) -> None:
    """Let a function answer every request to end but those that are ignored, as under ``nohup``."""
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)


def ignore() -> None:
    """Answer no request to end any more."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
