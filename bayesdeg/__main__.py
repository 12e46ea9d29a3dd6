"""Entry point of the command; a signal during imports ends it cleanly."""

import importlib
import os
from contextlib import suppress
from types import FrameType

from bayesdeg import signals

STOPPED = 3
MESSAGE = "stopped before any work began; run the same command again\n"


def main() -> None:
    """Run the command line; a signal may stop even the import."""
    signals.answer(_end)
    importlib.import_module("bayesdeg.cli").main()


def _end(_signal: int, _frame: FrameType | None) -> None:
    with suppress(OSError):  # the terminal may be gone
        os.write(2, MESSAGE.encode())
    os._exit(STOPPED)


if __name__ == "__main__":
    main()
