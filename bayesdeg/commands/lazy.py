"""The commands by name: the module of each is imported when it is called, and no sooner.

A command needs numba, scipy and more, which take seconds to import; the list of commands does not.
"""

import importlib
from dataclasses import dataclass
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command


@dataclass(frozen=True)
class Command:
    """Where a command is, and what the list of commands says of it.

    Parameters
    ----------
    name : str
        On the command line.
    module : str
        In ``bayesdeg.commands``.
    function : str
        In the module; its docstring is the help of the command.
    summary : str
        First sentence of that docstring.
    examples : tuple of str
        Command lines that its own help ends with.
    output : tuple of str
        Lines that the last of them prints.
    """

    name: str
    module: str
    function: str
    summary: str
    examples: tuple[str, ...]
    output: tuple[str, ...] = ()

    @property
    def epilog(self) -> str:
        """What the help of the command ends with; rich keeps lines apart by an empty one."""
        prints = ["which prints:", *(f"`{line}`" for line in self.output)] if self.output else []
        return "\n\n".join(["For example:", *(f"`{line}`" for line in self.examples), *prints])


COMMANDS = (
    Command(
        "init",
        "init",
        "init",
        "Write a commented study with example data, ready to be run and to be filled with your "
        "own.",
        ("bayesdeg init studies/mine",),
    ),
    Command(
        "run",
        "run",
        "run",
        "Calibrate, criticise, name the cause, measure the gain, predict, and write the report.",
        (
            "bayesdeg run studies/gelatin_actuator --effort quick",
            "bayesdeg run studies/mine --out reports/try --seed 7",
        ),
    ),
    Command(
        "check",
        "check",
        "check",
        "Read and check the data only; exit code 2 and the list of faults if there are any.",
        ("bayesdeg check studies/gelatin_actuator",),
    ),
    Command(
        "causes",
        "causes",
        "causes",
        "List the catalogue: mechanism, parameters with units and priors, what reveals each cause.",
        ("bayesdeg causes",),
    ),
    Command(
        "report",
        "report",
        "report",
        "Rebuild the HTML report from a run folder without computing anything.",
        ("bayesdeg report reports/gelatin_actuator",),
    ),
    Command(
        "simulate",
        "simulate",
        "simulate",
        "Make a virtual experiment with the study's design, from a fine finite element model.",
        (
            "bayesdeg simulate studies/gelatin_actuator --cause pressure_offset=14 "
            "--out studies/planted",
        ),
    ),
    Command(
        "emulate",
        "emulate",
        "emulate",
        "Train an emulator on finite element curves of a geometry.",
        ("bayesdeg emulate studies/mine --workers 4",),
    ),
    Command(
        "predict",
        "predict",
        "predict",
        "Predict curvature and rupture of a new specimen from the posterior of a finished run.",
        (
            "bayesdeg predict reports/gelatin_actuator --pressure 0:240:20 "
            "--degradation 0 --degradation 25",
            "bayesdeg predict reports/gelatin_actuator --pressure 120 --degradation 10 "
            "--hold-s 60 --mount hanging",
            "bayesdeg predict reports/gelatin_actuator --pressure 120 --hours 8",
        ),
        (
            "soil   D_R    pressure  κ q05  κ q25  κ q50  κ q75  κ q95  …",
            "8 h    12.66  120 kPa   3.88   4.14   4.32   4.50   4.76   …",
        ),
    ),
    Command(
        "control",
        "control",
        "control",
        "Find the pressure that reaches a wanted curvature at a bounded risk of rupture.",
        (
            "bayesdeg control reports/gelatin_actuator --curvature 15 --degradation 10 --risk 0.05",
            "bayesdeg control reports/gelatin_actuator --curvature 4 --hours 0:24:6",
            "bayesdeg control reports/gelatin_actuator --curvature 10 --degradation 25",
        ),
        (
            "10 1/m at 25 % is out of reach: half of the specimens need more than 477 kPa, and "
            "240 kPa is the largest pressure that was tested, or survived where others burst; "
            "--beyond allows more; half of the specimens bend by more than 4.61 1/m there",
        ),
    ),
    Command(
        "lifetime",
        "lifetime",
        "lifetime",
        "Say how long an actuator in the soil does its duty, and which pressure keeps its "
        "curvature.",
        ("bayesdeg lifetime reports/gelatin_actuator --pressure 120 --curvature 5 --risk 0.05",),
        (
            "An actuator fails its duty of 5 1/m at 120 kPa when it bursts or bends less: half of "
            "new actuators do so by 6.37 h (5 % by 5.07 h, 95 % by 7.87 h).",
        ),
    ),
    Command(
        "next",
        "next",
        "next_experiment",
        "Rank further experiments by how well they would tell the causes still in question apart.",
        ("bayesdeg next reports/gelatin_actuator",),
    ),
    Command(
        "update",
        "update",
        "update",
        "Let further readings of actuators enter a finished run, in seconds.",
        ("bayesdeg update reports/gelatin_actuator new.csv",),
        (
            "parameter               unit  before           after            shift [sd]",
            "curvature_noise_length  kPa   11.1 ± 3.4       10.1 ± 3.3       −0.29",
            "bend_angle_noise        –     0.0237 ± 0.0022  0.0232 ± 0.0021  −0.22",
            "curvature_noise_floor   1/m   0.107 ± 0.0096   0.105 ± 0.0090   −0.21",
            "updated run: reports/gelatin_actuator_updated",
        ),
    ),
    Command(
        "score",
        "score",
        "score_answers",
        "Score what a method says of hidden effects against the truths, with 95 % intervals.",
        (
            "bayesdeg score answers.csv truths.jsonl --out scored",
            "bayesdeg score reports truths.jsonl --json",
        ),
    ),
    Command(
        "trace",
        "trace",
        "trace_photographs",
        "Trace the bottom line of actuators in photographs, and write points with their errors.",
        (
            "bayesdeg trace photos/*.jpg --grid 5 --out traced",
            "bayesdeg trace --page traced",
            "bayesdeg trace photo.jpg --length 42.6 --hint traced/points.csv --out corrected",
        ),
    ),
)


def placeholder() -> None:
    """Stand in the list of commands for one that is not imported yet."""


class LazyGroup(TyperGroup):
    """A group whose commands are imported when they are called."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return name, command and remaining arguments, the command imported."""
        name, command, rest = super().resolve_command(ctx, args)
        found = [known for known in COMMANDS if known.name == name]
        return name, (loaded(found[0]) if found else command), rest


def loaded(command: Command) -> Any:
    """Import the module of a command and return what the command line calls."""
    module = importlib.import_module(f"bayesdeg.commands.{command.module}")
    app = typer.Typer(rich_markup_mode="markdown", add_completion=False)
    app.command(command.name, epilog=command.epilog)(getattr(module, command.function))
    return get_command(app)
