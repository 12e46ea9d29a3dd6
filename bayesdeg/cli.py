"""The command line ``bayesdeg``: commands and exit codes."""

import errno
import io
import os
import sys
import traceback
from concurrent.futures import BrokenExecutor
from contextlib import suppress
from types import FrameType
from typing import Annotated

import typer

import bayesdeg
from bayesdeg import signals
from bayesdeg.commands.interface import COMMANDS
from bayesdeg.console import errors
from bayesdeg.errors import BayesdegError, ResumableError, Stopped, StudyError
from bayesdeg.files import no_room, reason

app = typer.Typer(
    name="bayesdeg",
    help="Bayesian calibration of degrading soft actuators: names what the simulation gets wrong.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
for command in COMMANDS:
    app.command(command.name, epilog=command.epilog)(command.call)

DONE, OUR_FAULT, INPUT_FAULT, STOPPED = 0, 1, 2, 3
INTERRUPTED = 130  # typer's return value after Ctrl-C
_requests: list[int] = []  # received signals to end this process


def _print_version(wanted: bool) -> None:
    if wanted:
        sys.stdout.write(f"bayesdeg {bayesdeg.__version__}\n")
        raise typer.Exit


@app.callback()
def group(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Show the version and exit.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Options common to all commands; this docstring is not shown as help."""


def main() -> None:
    """Run the command line with the exit codes of the contract."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        signals.answer(_stop)
        code = exit_code()
    except KeyboardInterrupt:  # a second signal while the first was handled
        code = STOPPED
    except OSError:  # the terminal is gone, so nothing can be printed
        code = STOPPED
    signals.ignore()  # ignore further signals
    if code != DONE:
        # at once: worker processes end with this one, whatever they are doing
        with suppress(OSError):
            sys.stdout.flush()
            sys.stderr.flush()
        _give_back_semaphores()
        os._exit(code)


def _give_back_semaphores() -> None:
    """Release semaphores of workers, or Python prints warnings about leaks on the terminal."""
    util = sys.modules.get("multiprocessing.util")
    if util is not None:
        with suppress(Exception):  # nothing may prevent the command from ending
            util._run_finalizers(0)


def _stop(number: int, _frame: FrameType | None) -> None:
    """Treat any signal to end as Ctrl-C."""
    _requests.append(number)
    raise KeyboardInterrupt


def _ended() -> object:
    """Run the command; an exception after a signal to end counts as that signal.

    A library that is interrupted half-way (an extension being imported, a pool whose workers
    received the signal too) may raise anything.
    """
    try:
        ended = app(standalone_mode=False)
    except (Stopped, ResumableError):  # they carry a better message
        raise
    except Exception:
        if _requests:
            raise KeyboardInterrupt from None
        raise
    if ended == INTERRUPTED:
        raise KeyboardInterrupt
    return ended


def exit_code() -> int:
    """Run the command in ``sys.argv``; return its exit code."""
    try:
        ended = _ended()
    except StudyError as fault:
        return _say(*(str(line) for line in fault.faults))
    except ResumableError as fault:
        _say(str(fault))
        return STOPPED
    except BayesdegError as fault:
        return _say(str(fault))
    except Stopped as stopped:
        errors.print(str(stopped), soft_wrap=True)
        return STOPPED
    except (KeyboardInterrupt, typer.Abort):
        errors.print("stopped; the same command continues where it stopped")
        return STOPPED
    except MemoryError:
        _say("not enough memory; close other programs, or make the study smaller")
        return STOPPED
    except BrokenExecutor:
        _say(
            "a worker process was killed from outside, possibly for lack of memory; repeat the "
            "command, with --workers 1 to use less"
        )
        return STOPPED
    except (BrokenPipeError, SystemExit):  # rich's: the reader of the output has closed it
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        return DONE
    except OSError as fault:
        if fault.errno == errno.ENAMETOOLONG:
            return _say(f"{str(fault.filename)[:60]}… is too long for a name; give a shorter one")
        if not no_room(fault):
            return _report_bug()
        place = f" for {fault.filename}" if fault.filename else ""
        _say(f"no space left{place} ({reason(fault)}); free some space and repeat the command")
        return STOPPED
    except Exception as fault:
        if hasattr(fault, "format_message") and hasattr(fault, "exit_code"):  # click's usage errors
            return _say(fault.format_message())
        return _report_bug()
    return ended if isinstance(ended, int) else DONE  # the code of a `typer.Exit`


def _report_bug() -> int:
    """Print the current exception for the user to send to us."""
    traceback.print_exc()
    errors.print(f"This is a fault in bayesdeg {bayesdeg.__version__}: please send us the above.")
    return OUR_FAULT


def _say(*faults: str) -> int:
    for fault in faults:
        errors.print(fault, style="red", soft_wrap=True)
    return INPUT_FAULT


if __name__ == "__main__":
    main()
