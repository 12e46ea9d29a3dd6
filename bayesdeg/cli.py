"""The command line: ``bayesdeg run STUDY`` and what stands around it, with its exit codes."""

import os
import signal
import sys
import traceback
from types import FrameType

import typer

import bayesdeg
from bayesdeg.commands import look
from bayesdeg.commands.control import control
from bayesdeg.commands.emulate import emulate
from bayesdeg.commands.next import next_experiment
from bayesdeg.commands.options import Stopped
from bayesdeg.commands.predict import predict
from bayesdeg.commands.run import run
from bayesdeg.commands.simulate import simulate
from bayesdeg.console import errors
from bayesdeg.errors import BayesdegError, ResumableError, StudyError

app = typer.Typer(
    name="bayesdeg",
    help="Bayesian calibration of degrading soft actuators: names what the simulation gets wrong.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    add_completion=False,
)
for command in (run, look.check, look.causes, look.report, simulate, emulate, predict, control):
    app.command()(command)
app.command("next")(next_experiment)

DONE, OUR_FAULT, INPUT_FAULT, STOPPED = 0, 1, 2, 3


def main() -> None:
    """Run the command line with the exit codes of the contract."""
    signal.signal(signal.SIGTERM, _stop)
    code = exit_code()
    if code != DONE:
        # at once: worker processes end with this one, whatever they are at
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _stop(_signal: int, _frame: FrameType | None) -> None:
    """Take a request to end as if the user had pressed Ctrl-C."""
    raise KeyboardInterrupt


def exit_code() -> int:
    """Run the command that stands in ``sys.argv``; return its exit code."""
    try:
        app(standalone_mode=False)
    except StudyError as fault:
        return _say(*(str(line) for line in fault.faults))
    except ResumableError as fault:
        _say(str(fault))
        return STOPPED
    except BayesdegError as fault:
        return _say(str(fault))
    except typer.Exit as done:
        return done.exit_code
    except Stopped as stopped:
        errors.print(str(stopped), markup=False, highlight=False, soft_wrap=True)
        return STOPPED
    except (KeyboardInterrupt, typer.Abort):
        errors.print("stopped; the same command goes on where this run stopped")
        return STOPPED
    except Exception as fault:
        if hasattr(fault, "format_message") and hasattr(fault, "exit_code"):  # click's usage errors
            return _say(fault.format_message())
        traceback.print_exc()
        errors.print(
            f"This is a fault of bayesdeg {bayesdeg.__version__}: please send us the above."
        )
        return OUR_FAULT
    return DONE


def _say(*faults: str) -> int:
    for fault in faults:
        errors.print(fault, style="red", markup=False, highlight=False, soft_wrap=True)
    return INPUT_FAULT


if __name__ == "__main__":
    main()
