"""Where the command starts; stopped while it is still being imported, it ends in good order."""

import importlib
import os
import signal
from contextlib import suppress
from types import FrameType

STOPPED = 3
#: Ctrl-C, a request to end, and a terminal that is closed, which not every system has.
SIGNALS = (
    signal.SIGINT,
    signal.SIGTERM,
    *((signal.SIGHUP,) if hasattr(signal, "SIGHUP") else ()),
)
MESSAGE = "stopped before anything was begun; the same command starts again\n"


def main() -> None:
    """Run the command line, of which a signal may stop even the import."""
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)
    importlib.import_module("bayesdeg.cli").main()


def _end(_signal: int, _frame: FrameType | None) -> None:
    with suppress(OSError):  # the terminal may be gone
        os.write(2, MESSAGE.encode())
    os._exit(STOPPED)


if __name__ == "__main__":
    main()
