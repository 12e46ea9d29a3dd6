"""Options that several commands share."""

import os
from pathlib import Path
from typing import Annotated

import typer

from bayesdeg.quantities import LARGEST_SEED

CORES = min(4, os.cpu_count() or 1)

StudyFolder = Annotated[
    Path, typer.Argument(help="A study folder: study.toml and CSV files.", metavar="STUDY")
]
Seed = Annotated[
    int | None,
    typer.Option(help="Instead of the study's own seed.", min=0, max=LARGEST_SEED),
]
Workers = Annotated[
    int,
    typer.Option(help="Processes on this machine; the results do not depend on it.", min=1),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        help="Dask scheduler whose workers are taken instead, such as tcp://127.0.0.1:8786; "
        "needs bayesdeg[cluster].",
        metavar="ADDRESS",
    ),
]
Yes = Annotated[
    bool, typer.Option("--yes", "-y", help="Train an emulator without asking, however long.")
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but the result.")]


class Stopped(Exception):  # noqa: N818 - it is not an error
    """The user stopped a command, which can be resumed; the message says what stays and how."""
