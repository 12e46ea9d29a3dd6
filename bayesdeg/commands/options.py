"""Arguments and options of the commands: type, help and bounds.

Options that several commands share are groups: a command takes the group as one argument. Only fast
imports here: see `bayesdeg.commands.interface`.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from bayesdeg.actuator.status import Backend
from bayesdeg.prediction.conditions import PROMPT, ServiceConditions
from bayesdeg.quantities import LARGEST_SEED, MOUNTS, SIDES, Effort

CORES = min(4, os.cpu_count() or 1)
STORE = Path(".cache/campaign")
SCORE, MATRIX, PICTURE = "score.json", "isolability.csv", "isolability.svg"

StudyFolder = Annotated[
    Path, typer.Argument(help="A study folder: study.toml and CSV files.", metavar="STUDY")
]
Seed = Annotated[
    int | None,
    typer.Option(help="Seed, instead of the study's own.", min=0, max=LARGEST_SEED),
]
Workers = Annotated[
    int,
    typer.Option(
        help="Processes on this machine, at most one per core; results do not depend on it.",
        min=1,
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        help="Dask scheduler whose workers are used instead, such as tcp://127.0.0.1:8786; "
        "needs bayesdeg[cluster].",
        metavar="ADDRESS",
    ),
]
Yes = Annotated[
    bool,
    typer.Option("--yes", "-y", help="Train an emulator without asking, however long it takes."),
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print nothing but the result.")]

# ---- of run

EffortOfRun = Annotated[
    Effort | None, typer.Option(help="Sampling effort, instead of the study's own.")
]
OtherEmulator = Annotated[
    Path | None,
    typer.Option(
        help="Emulator made by 'emulate', instead of the one found automatically.", metavar="FILE"
    ),
]
Refine = Annotated[
    bool,
    typer.Option(
        "--refine", help="First correct the emulator by fine-mesh curves in the posterior region."
    ),
]
Fresh = Annotated[
    bool, typer.Option("--fresh", help="Start again instead of resuming; emulators are kept.")
]
RunTarget = Annotated[
    Path | None,
    typer.Option(help="Run folder; by default reports/NAME, NAME being that of the study."),
]
VerdictAsJson = Annotated[bool, typer.Option("--json", help="Print verdict.json last.")]

# ---- of simulate

Hidden = Annotated[
    list[str] | None,
    typer.Option(help="An effect to hide, NAME=VALUE or NAME.PARAMETER=VALUE; may be repeated."),
]
Drawn = Annotated[
    bool, typer.Option("--draw-material", help="Draw the material parameters at random.")
]
Assembled = Annotated[
    Backend,
    typer.Option(
        help="Finite element assembly: compiled kernels, or scikit-fem forms that state the same "
        "equations readably, to check the kernels. The readings are the same, but assembly is "
        "forty times slower: for checks, not for whole studies."
    ),
]
Trained = Annotated[
    Backend,
    typer.Option(
        help="Finite element assembly for training an emulator. With scikit-fem one is trained "
        "even if one ships, to check the kernels: assembly is forty times slower; derivatives with "
        "respect to the inputs still come from the kernels."
    ),
]
VirtualTarget = Annotated[Path, typer.Option(help="Folder for the virtual study.")]

# ---- of emulate

GeometryFile = Annotated[
    Path | None,
    typer.Argument(
        help="Study folder, or TOML file with an [actuator] table (lengths in mm); by default "
        "the geometry of the paper.",
        metavar="GEOMETRY",
    ),
]
EmulatorTarget = Annotated[
    Path | None,
    typer.Option(
        help="File for the trained emulator; by default one in .cache/emulators, where "
        "'bayesdeg run' finds it. Elsewhere, give it to 'bayesdeg run' with --emulator.",
        metavar="FILE",
    ),
]
Store = Annotated[
    Path,
    typer.Option(
        help="Folder of finite element solutions to resume from; several campaigns may share it.",
        metavar="FOLDER",
    ),
]
Timeout = Annotated[
    float,
    typer.Option(
        help="Time limit of each finite element run; one that exceeds it is listed as failed and "
        "tried again only with a longer limit.",
        metavar="SECONDS",
        show_default="none",
    ),
]

# ---- of all that ask a finished run

RunFolderPath = Annotated[
    Path, typer.Argument(help="Run folder written by 'bayesdeg run'.", metavar="REPORT")
]
MaybeRates = Annotated[
    list[str] | None,
    typer.Option(
        "--degradation",
        help="Degradation rates in percent, with standard error --degradation-sd: 10, or 0,10,25, "
        "or a range 0:25:5 (end included); may be repeated. Not needed if nothing degrades.",
        metavar="PERCENT",
    ),
]
Hours = Annotated[
    list[str] | None,
    typer.Option(
        "--hours",
        help="Instead of --degradation: hours in the soil, converted to a degradation rate with "
        "the films' moisture and its uncertainty; lists and ranges as for --degradation.",
        metavar="H",
    ),
]
Hold = Annotated[
    float,
    typer.Option(
        "--hold-s",
        help="Time for which the pressure has been held, and the actuator has been in the room, "
        "before the reading, in seconds.",
        metavar="S",
    ),
]
Cycle = Annotated[
    int,
    typer.Option(
        help="Loading cycle, from 1; earlier cycles reached the largest pressure that was tested.",
        metavar="N",
    ),
]
Branch = Annotated[
    str,
    typer.Option(
        help="loading, or unloading from the largest pressure that was tested.",
        metavar="BRANCH",
    ),
]
Humidity = Annotated[
    float | None,
    typer.Option(
        help="Relative humidity of the room in percent; it acts on curvature over the time of "
        "--hold-s, on rupture at once.",
        metavar="PERCENT",
    ),
]
Temperature = Annotated[
    float | None,
    typer.Option(
        help="Room temperature in degrees Celsius; by default that of tests without one.",
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
        help="Standard error of the degradation rate of the actuator, in percentage points.",
        metavar="POINTS",
    ),
]
Risk = Annotated[
    float,
    typer.Option(help="Largest acceptable probability of rupture.", metavar="PROBABILITY"),
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
        help="Cause to predict with, of those that the run could not tell apart; by default "
        "predictions are averaged over them, weighted by probability.",
        metavar="NAME",
    ),
]
SameEmulator = Annotated[
    Path | None,
    typer.Option(
        help="Emulator that 'bayesdeg run' was given; not needed for one that ships with the "
        "package or was trained in this folder.",
        metavar="FILE",
    ),
]
SeedOfAnswer = Annotated[
    int | None,
    typer.Option(help="Seed, instead of that of the run.", min=0, max=LARGEST_SEED),
]
OutFile = Annotated[Path | None, typer.Option(help="Also write a CSV file.", metavar="FILE")]
Inputs = Annotated[
    list[str] | None,
    typer.Option(
        "--x",
        help="Input of your own forward map, NAME=VALUES, with numbers, lists and ranges as for "
        "--degradation; may be repeated for other inputs.",
        metavar="NAME=VALUES",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print only the result, as JSON.")]


@dataclass(frozen=True)
class Service:
    """Options of predict, control and lifetime: the conditions of use of an actuator."""

    hold_s: Hold = PROMPT.hold_s
    cycle: Cycle = PROMPT.cycle
    branch: Branch = PROMPT.branch
    humidity: Humidity = PROMPT.humidity_pct
    temperature: Temperature = PROMPT.temperature_c
    mount: Mount = PROMPT.mount

    def conditions(self, degradation_sd: float = PROMPT.degradation_sd) -> ServiceConditions:
        """Return the conditions; refuse impossible ones."""
        return ServiceConditions(
            self.hold_s,
            self.cycle,
            self.branch,
            self.humidity,
            self.mount,
            degradation_sd,
            self.temperature,
        )


@dataclass(frozen=True)
class Asking:
    """Options of predict, control and lifetime: which posterior is asked, and where answers go."""

    cause: OneCause = None
    base: BaseModel = False
    emulator: SameEmulator = None
    seed: SeedOfAnswer = None
    out: OutFile = None
    as_json: AsJson = False
    quiet: Quiet = False


AS_TESTED, AS_RUN = Service(), Asking()

# ---- of predict, control, lifetime and update

Pressures = Annotated[
    list[str] | None,
    typer.Option(
        "--pressure",
        help="Gauge pressures in kPa, as read by the sensor: 100, or 50,100, or a range 0:240:20 "
        "(end included); may be repeated.",
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
        help="Wanted readings of your own forward map, in their unit; as for --degradation.",
        metavar="VALUES",
    ),
]
DutyPressure = Annotated[
    float, typer.Option(help="Gauge pressure in service, in kPa.", metavar="KPA")
]
DutyCurvature = Annotated[
    float,
    typer.Option(help="Curvature required in service, in 1/m, above 0.", metavar="PER_M"),
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
    typer.Option(help="New run folder; by default REPORT with _updated appended to its name."),
]

# ---- of score

Answers = Annotated[
    Path,
    typer.Argument(
        help="Answers of a method: a CSV file with study, outcome, causes (a|b;c is a or b, and c) "
        "and optionally p_value, sizes and probabilities; the same as JSON lines; or a "
        "folder of run folders named like the studies.",
        metavar="ANSWERS",
    ),
]
Truths = Annotated[Path, typer.Argument(help="Hidden effects, as JSON lines.", metavar="TRUTHS")]
ScoreTarget = Annotated[
    Path | None,
    typer.Option(
        help=f"Write {SCORE}, {MATRIX} (with 95 % intervals) and {PICTURE} there.",
        metavar="FOLDER",
    ),
]

# ---- of trace

Photos = Annotated[list[Path] | None, typer.Argument(help="Photographs.", metavar="PHOTO…")]
TraceTarget = Annotated[
    Path | None, typer.Option(help="Folder for markers.csv and the other files.", metavar="FOLDER")
]
PageOf = Annotated[
    Path | None,
    typer.Option(
        help="Instead of tracing, show the traces of a folder on a local web page, where points "
        "can be moved and saved.",
        metavar="FOLDER",
    ),
]
Port = Annotated[
    int | None, typer.Option(help="Port of the page; by default a free one.", min=1024, max=65535)
]
Grid = Annotated[
    str | None, typer.Option(help="Side length of a checkerboard square.", metavar="MM")
]
Ruler = Annotated[str | None, typer.Option(help="Distance between ticks of a ruler.", metavar="MM")]
Length = Annotated[
    str | None,
    typer.Option(
        help="Length of the bottom line; a check if another scale is given.", metavar="MM"
    ),
]
PixelSize = Annotated[
    float | None,
    typer.Option(help="Size of a pixel [mm], for a camera facing the actuator.", metavar="MM/PX"),
]
Hint = Annotated[
    Path | None,
    typer.Option(
        help="Points near the line from end to end: a CSV file with x_px and y_px, and a column "
        "file for several photographs; or ImageJ ROIs, see --line.",
        metavar="FILE",
    ),
]
Line = Annotated[
    Path | None,
    typer.Option(
        help="The line itself, from the clamp to the tip, if tracing fails or needs correction: "
        "an edited points.csv, an ImageJ ROI (.roi), or a RoiSet.zip whose ROIs are named "
        "like the photographs.",
        metavar="FILE",
    ),
]
About = Annotated[
    Path | None,
    typer.Option(
        help="photos.csv: file, specimen_id, pressure_kPa, degradation_pct.", metavar="CSV"
    ),
]
ClampSide = Annotated[str | None, typer.Option(help=f"Side of the clamp: {', '.join(SIDES)}.")]
SeedOfTrace = Annotated[
    int, typer.Option(min=0, max=LARGEST_SEED, help="Seed of the draws that estimate errors.")
]

# ---- of init and report

NewFolder = Annotated[Path, typer.Argument(help="A new or empty folder.", metavar="FOLDER")]
RunFolderOnly = Annotated[Path, typer.Argument(help="A run folder.", metavar="REPORT")]
