"""Arguments and options of the commands: type, help and bounds.

Nothing is imported here that takes long: see `bayesdeg.commands.interface`.
"""

import os
from pathlib import Path
from typing import Annotated

import typer

from bayesdeg.actuator.status import Backend
from bayesdeg.quantities import LARGEST_SEED, MOUNTS, SIDES, Effort

CORES = min(4, os.cpu_count() or 1)
STORE = Path(".cache/campaign")
SCORE, MATRIX, PICTURE = "score.json", "isolability.csv", "isolability.svg"

StudyFolder = Annotated[
    Path, typer.Argument(help="A study folder: study.toml and CSV files.", metavar="STUDY")
]
Seed = Annotated[
    int | None,
    typer.Option(help="Instead of the study's own seed.", min=0, max=LARGEST_SEED),
]
Workers = Annotated[
    int,
    typer.Option(
        help="Processes on this machine, at most one for each core; the results do not depend on "
        "it.",
        min=1,
    ),
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

# ---- of run

EffortOfRun = Annotated[Effort | None, typer.Option(help="Instead of the study's own effort.")]
OtherEmulator = Annotated[
    Path | None,
    typer.Option(
        help="An emulator made by 'emulate', instead of those found by themselves.", metavar="FILE"
    ),
]
Refine = Annotated[
    bool,
    typer.Option(
        "--refine", help="Correct the emulator by fine curves where the posterior lies, first."
    ),
]
Fresh = Annotated[
    bool, typer.Option("--fresh", help="Calibrate again, resume nothing; emulators are kept.")
]
RunTarget = Annotated[
    Path | None,
    typer.Option(help="Run folder; by default reports/NAME, with the name of the study."),
]
VerdictAsJson = Annotated[bool, typer.Option("--json", help="Print verdict.json last.")]

# ---- of simulate

Hidden = Annotated[
    list[str] | None,
    typer.Option(help="An effect to hide, NAME=VALUE or NAME.PARAMETER=VALUE; may be repeated."),
]
Drawn = Annotated[bool, typer.Option("--draw-material", help="Draw the material at random.")]
Assembled = Annotated[
    Backend,
    typer.Option(
        help="What assembles the finite elements: compiled kernels, or scikit-fem's forms, which "
        "say the same equations in plain sight, to check the kernels by. The readings are the "
        "same, and assembly takes forty times as long: for checks, not for whole studies."
    ),
]
Trained = Annotated[
    Backend,
    typer.Option(
        help="What assembles the finite elements that an emulator is trained on. With scikit-fem "
        "one is trained even where one ships, to check the kernels by: assembly takes forty times "
        "as long; derivatives by the inputs remain those of the kernels."
    ),
]
VirtualTarget = Annotated[Path, typer.Option(help="Folder for the virtual study.")]

# ---- of emulate

GeometryFile = Annotated[
    Path | None,
    typer.Argument(
        help="A study folder, or a TOML file with an [actuator] table (lengths in mm); by default "
        "the geometry of the paper.",
        metavar="GEOMETRY",
    ),
]
EmulatorTarget = Annotated[
    Path | None,
    typer.Option(
        help="File for the trained emulator; by default one in .cache/emulators, where "
        "'bayesdeg run' finds it. Another file is given to 'bayesdeg run' with --emulator.",
        metavar="FILE",
    ),
]
Store = Annotated[
    Path,
    typer.Option(
        help="Folder of finite element solutions, to go on from; several campaigns may share it.",
        metavar="FOLDER",
    ),
]
Timeout = Annotated[
    float,
    typer.Option(
        help="Time after which a finite element run is given up, counted from its start; it is "
        "then listed as failed, and tried again only if more time is allowed.",
        metavar="SECONDS",
        show_default="none",
    ),
]

# ---- of all that ask a finished run

RunFolderPath = Annotated[
    Path, typer.Argument(help="A run folder that 'bayesdeg run' has written.", metavar="REPORT")
]
MaybeRates = Annotated[
    list[str] | None,
    typer.Option(
        "--degradation",
        help="Degradation rates in percent, known but for --degradation-sd: 10, or 0,10,25, or a "
        "range 0:25:5 (its end included); may be repeated. Not needed where nothing degrades.",
        metavar="PERCENT",
    ),
]
Hours = Annotated[
    list[str] | None,
    typer.Option(
        "--hours",
        help="Instead of --degradation: hours in the soil, from which the degradation rate follows "
        "by the films' moisture, with its uncertainty; lists and ranges as for --degradation.",
        metavar="H",
    ),
]
Hold = Annotated[
    float,
    typer.Option(
        "--hold-s",
        help="How long the pressure has been held, and the actuator in the room, when it is read, "
        "in seconds.",
        metavar="S",
    ),
]
Cycle = Annotated[
    int,
    typer.Option(
        help="Loading cycle, from 1; earlier ones went to the largest pressure that was tested.",
        metavar="N",
    ),
]
Branch = Annotated[
    str,
    typer.Option(
        help="loading, or unloading: down from the largest pressure that was tested.",
        metavar="BRANCH",
    ),
]
Humidity = Annotated[
    float | None,
    typer.Option(
        help="Relative humidity of the room in percent: of curvature it acts over the time of "
        "--hold-s, of rupture at once.",
        metavar="PERCENT",
    ),
]
Temperature = Annotated[
    float | None,
    typer.Option(
        help="Of the room in degrees Celsius; by default that of tests without one.",
        metavar="CELSIUS",
    ),
]
Mount = Annotated[
    str,
    typer.Option(help="How the actuator is held: " + ", ".join(MOUNTS) + ".", metavar="MOUNT"),
]
DegradationSd = Annotated[
    float,
    typer.Option(
        "--degradation-sd",
        help="Standard error of the degradation rate of the actuator, in points of percent.",
        metavar="POINTS",
    ),
]
Risk = Annotated[
    float,
    typer.Option(help="Largest probability of rupture that is accepted.", metavar="PROBABILITY"),
]
Beyond = Annotated[
    bool,
    typer.Option(
        "--beyond",
        help="Allow pressures above the largest that was tested, and above those at which "
        "actuators burst.",
    ),
]
BaseModel = Annotated[
    bool, typer.Option("--base", help="Use the base model, without the causes that were named.")
]
OneCause = Annotated[
    str | None,
    typer.Option(
        "--cause",
        help="Of causes that the run could not tell apart, the one to predict with; by default "
        "predictions are averaged over them by their probabilities.",
        metavar="NAME",
    ),
]
SameEmulator = Annotated[
    Path | None,
    typer.Option(
        help="The emulator that 'bayesdeg run' was given; not needed for the package's own, nor "
        "for those trained in this folder.",
        metavar="FILE",
    ),
]
SeedOfAnswer = Annotated[
    int | None,
    typer.Option(help="Instead of the seed of the run.", min=0, max=LARGEST_SEED),
]
OutFile = Annotated[Path | None, typer.Option(help="Also write a CSV file.", metavar="FILE")]
Inputs = Annotated[
    list[str] | None,
    typer.Option(
        "--x",
        help="Of a forward map of one's own: an input, NAME=VALUES, with numbers, lists and ranges "
        "as for --degradation; may be repeated for other inputs.",
        metavar="NAME=VALUES",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON, nothing else.")]

# ---- of predict, control, lifetime and update

Pressures = Annotated[
    list[str] | None,
    typer.Option(
        "--pressure",
        help="Gauge pressures in kPa, as read by the sensor: 100, or 50,100, or a range 0:240:20 "
        "(its end included); may be repeated.",
        metavar="KPA",
    ),
]
Curvatures = Annotated[
    list[str] | None,
    typer.Option(
        "--curvature",
        help="Wanted curvature in 1/m, less that at zero pressure, positive towards the paper; "
        "lists and ranges as for --degradation.",
        metavar="PER_M",
    ),
]
Readings = Annotated[
    list[str] | None,
    typer.Option(
        "--reading",
        help="Of a forward map of one's own: wanted readings in their unit, as for --degradation.",
        metavar="VALUES",
    ),
]
DutyPressure = Annotated[
    float, typer.Option(help="Gauge pressure of the duty in kPa.", metavar="KPA")
]
DutyCurvature = Annotated[
    float,
    typer.Option(help="Curvature in 1/m that the duty asks for, above 0.", metavar="PER_M"),
]
NewRows = Annotated[
    Path,
    typer.Argument(
        help="Rows with the columns of actuator.csv: pressure in kPa, curvature in 1/m, bend angle "
        "in degrees, degradation rate in percent.",
        metavar="NEW.csv",
    ),
]
UpdateTarget = Annotated[
    Path | None,
    typer.Option(help="The new run folder; by default beside REPORT, its name with _updated."),
]

# ---- of score

Answers = Annotated[
    Path,
    typer.Argument(
        help="What a method says: a CSV file with study, outcome, causes (a|b;c is a or b, and c) "
        "and, if it gives them, p_value, sizes and probabilities; the same as JSON lines; or a "
        "folder of run folders, named as the studies.",
        metavar="ANSWERS",
    ),
]
Truths = Annotated[Path, typer.Argument(help="What is hidden, as JSON lines.", metavar="TRUTHS")]
ScoreTarget = Annotated[
    Path | None,
    typer.Option(
        help=f"Write {SCORE}, {MATRIX} (with 95 % intervals) and {PICTURE} there.",
        metavar="FOLDER",
    ),
]

# ---- of trace

Photos = Annotated[list[Path] | None, typer.Argument(help="Photographs.", metavar="PHOTO…")]
TraceTarget = Annotated[Path | None, typer.Option(help="Where markers.csv goes.", metavar="FOLDER")]
PageOf = Annotated[
    Path | None,
    typer.Option(
        help="Instead of tracing, show what was traced into a folder on a page of this machine, "
        "where points can be moved and saved.",
        metavar="FOLDER",
    ),
]
Port = Annotated[
    int | None, typer.Option(help="Of the page; by default a free one.", min=1024, max=65535)
]
Grid = Annotated[str | None, typer.Option(help="Side of a square of a checkerboard.", metavar="MM")]
Ruler = Annotated[str | None, typer.Option(help="From tick to tick of a ruler.", metavar="MM")]
Length = Annotated[
    str | None,
    typer.Option(help="Length of the bottom line; with another scale, a check.", metavar="MM"),
]
PixelSize = Annotated[
    float | None, typer.Option(help="Size of a pixel, seen square on [mm].", metavar="MM/PX")
]
Hint = Annotated[
    Path | None,
    typer.Option(
        help="Points near the line from end to end, a CSV file with x_px and y_px, and a "
        "column file where there are several photographs; ROIs of ImageJ will do, see --line.",
        metavar="FILE",
    ),
]
Line = Annotated[
    Path | None,
    typer.Option(
        help="The line itself, from the clamp to the tip, where tracing fails or is to be "
        "corrected: an edited points.csv, a ROI of ImageJ (.roi), or a RoiSet.zip whose ROIs are "
        "named as the photographs.",
        metavar="FILE",
    ),
]
About = Annotated[
    Path | None,
    typer.Option(
        help="photos.csv: file, specimen_id, pressure_kPa, degradation_pct.", metavar="CSV"
    ),
]
ClampSide = Annotated[str | None, typer.Option(help=f"Where the clamp is: {', '.join(SIDES)}.")]
SeedOfTrace = Annotated[
    int, typer.Option(min=0, max=LARGEST_SEED, help="Of the draws that errors are taken from.")
]

# ---- of init and report

NewFolder = Annotated[
    Path, typer.Argument(help="A folder that is not there yet, or empty.", metavar="FOLDER")
]
RunFolderOnly = Annotated[Path, typer.Argument(help="A run folder.", metavar="REPORT")]
