"""What every command takes and says; what it does is imported when it is called, and no sooner.

The work of a command needs numba, scipy and more, which take seconds to import. Its help, the
completion of its options and the refusal of a wrong one need none of it.
"""

import functools
import importlib
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Any

from bayesdeg.actuator.status import Backend
from bayesdeg.commands import options
from bayesdeg.prediction.conditions import PROMPT


@dataclass(frozen=True)
class Command:
    """A command: what it takes, and what its help ends with.

    Parameters
    ----------
    name : str
        On the command line, and of the module in ``bayesdeg.commands`` that does the work.
    signature : callable
        Its parameters are the arguments and options, its docstring the help, whose first paragraph
        the list of commands shows. A function of that name in the module does the work.
    examples : tuple of str
        Command lines that the help ends with.
    output : tuple of str
        Lines that the last of them prints.
    """

    name: str
    signature: Callable[..., None]
    examples: tuple[str, ...]
    output: tuple[str, ...] = ()

    @property
    def epilog(self) -> str:
        """What the help of the command ends with; rich keeps lines apart by an empty one."""
        prints = ["which prints:", *(f"`{line}`" for line in self.output)] if self.output else []
        return "\n\n".join(["For example:", *(f"`{line}`" for line in self.examples), *prints])

    @property
    def work(self) -> Callable[..., None]:
        """What does the work, imported with all that it needs."""
        module = importlib.import_module(f"bayesdeg.commands.{self.name}")
        found: Callable[..., None] = getattr(module, self.signature.__name__)
        return found

    @property
    def call(self) -> Callable[..., None]:
        """What the command line calls: it looks like the signature, and does the work."""

        @functools.wraps(self.signature)
        def call(**given: Any) -> None:
            self.work(**given)

        return call


def init(folder: options.NewFolder) -> None:
    """Write a commented study with example data, ready to be run and to be filled with your own.

    Every key of study.toml is explained. The data are those of a virtual experiment, and the study
    says so.
    """


def run(
    study: options.StudyFolder,
    effort: options.EffortOfRun = None,
    out: options.RunTarget = None,
    seed: options.Seed = None,
    workers: options.Workers = options.CORES,
    scheduler: options.Scheduler = None,
    emulator: options.OtherEmulator = None,
    refine: options.Refine = False,
    backend: options.Trained = Backend.KERNELS,
    fresh: options.Fresh = False,
    yes: options.Yes = False,
    as_json: options.VerdictAsJson = False,
    quiet: options.Quiet = False,
) -> None:
    """Calibrate, criticise, name the cause, measure the gain, predict, and write the report.

    An interrupted run goes on where it stopped. If there is no emulator of the geometry, one is
    trained first; in a terminal, and without --yes, the command says how long that takes and asks
    before it starts. Finite element solutions are kept in .cache/campaign, emulators in
    .cache/emulators. With --refine it is corrected by 16 to 32 fine curves where the study's
    posterior lies, until its own error, as curves left out tell it, moves no posterior mean
    by more than 0.1 standard deviations; how far that is reached stands in run.json and in the
    report.
    """


def check(study: options.StudyFolder) -> None:
    """Read and check the data only; exit code 2 and the list of faults if there are any.

    Columns are compared with each other, with the priors and with what is possible. What is
    impossible is a fault; what is unlikely, such as one specimen in another unit, is reported as
    in doubt.
    """


def causes() -> None:
    """List the catalogue: mechanism, parameters with units and priors, what reveals each cause."""


def report(folder: options.RunFolderOnly) -> None:
    """Rebuild the HTML report from a run folder without computing anything."""


def simulate(
    study: options.StudyFolder,
    out: options.VirtualTarget,
    cause: options.Hidden = None,
    seed: options.Seed = None,
    draw_material: options.Drawn = False,
    backend: options.Assembled = Backend.KERNELS,
    workers: options.Workers = options.CORES,
    quiet: options.Quiet = False,
) -> None:
    """Make a virtual experiment with the study's design, from a fine finite element model.

    It has the files of data that the study has; of published statistics alone, all of them. The
    curves take about half a minute each. Volumes of the cavity and blocked tip forces
    (force.csv) are read where the study has them; a force takes a curve more. What was hidden is
    written to truth.json, which no other command opens.
    """


def emulate(
    geometry: options.GeometryFile = None,
    out: options.EmulatorTarget = None,
    store: options.Store = options.STORE,
    workers: options.Workers = options.CORES,
    scheduler: options.Scheduler = None,
    timeout: options.Timeout = inf,
    backend: options.Trained = Backend.KERNELS,
    yes: options.Yes = False,
    quiet: options.Quiet = False,
) -> None:
    """Train an emulator on finite element curves of a geometry.

    A factorization on each mesh is timed first, to say how long all curves take; in a terminal,
    and without --yes, the command then asks whether to go on. Every solution is kept: stopped at
    any moment, the same command goes on where it was. At the end tables say how the curves ended
    and how accurate the emulator is; the parameters of failed curves are written to a file.
    """


def predict(
    report: options.RunFolderPath,
    pressure: options.Pressures = None,
    degradation: options.MaybeRates = None,
    hours: options.Hours = None,
    hold_s: options.Hold = PROMPT.hold_s,
    cycle: options.Cycle = PROMPT.cycle,
    branch: options.Branch = PROMPT.branch,
    humidity: options.Humidity = PROMPT.humidity_pct,
    temperature: options.Temperature = PROMPT.temperature_c,
    mount: options.Mount = PROMPT.mount,
    degradation_sd: options.DegradationSd = PROMPT.degradation_sd,
    x: options.Inputs = None,
    cause: options.OneCause = None,
    base: options.BaseModel = False,
    emulator: options.SameEmulator = None,
    seed: options.SeedOfAnswer = None,
    out: options.OutFile = None,
    as_json: options.AsJson = False,
    quiet: options.Quiet = False,
) -> None:
    """Predict curvature and rupture of a new specimen from the posterior of a finished run.

    Curvatures are 5, 25, 50, 75 and 95 % quantiles over new specimens, without reading noise; by
    default on a prompt first loading in a horizontal mount. --hold-s, --cycle, --branch,
    --humidity, --temperature and --mount move predictions by the causes that the run named; what no
    cause answers to is said. The probability of rupture up to a pressure has its 90 % interval;
    what is less than one in the films broken and actuators loaded is no number. Cells are empty
    where most specimens are beyond the range of the emulator. Of a forward map of one's own give
    --x NAME=VALUES for each of its inputs.
    """


def control(
    report: options.RunFolderPath,
    curvature: options.Curvatures = None,
    degradation: options.MaybeRates = None,
    hours: options.Hours = None,
    risk: options.Risk = 0.05,
    beyond: options.Beyond = False,
    reading: options.Readings = None,
    hold_s: options.Hold = PROMPT.hold_s,
    cycle: options.Cycle = PROMPT.cycle,
    branch: options.Branch = PROMPT.branch,
    humidity: options.Humidity = PROMPT.humidity_pct,
    temperature: options.Temperature = PROMPT.temperature_c,
    mount: options.Mount = PROMPT.mount,
    degradation_sd: options.DegradationSd = PROMPT.degradation_sd,
    x: options.Inputs = None,
    cause: options.OneCause = None,
    base: options.BaseModel = False,
    emulator: options.SameEmulator = None,
    seed: options.SeedOfAnswer = None,
    out: options.OutFile = None,
    as_json: options.AsJson = False,
    quiet: options.Quiet = False,
) -> None:
    """Find the pressure that reaches a wanted curvature at a bounded risk of rupture.

    The pressure is that at which half of new specimens bend as far or further. The table also gives
    the pressures that 90 % of the specimens need, the curvature at the pressure, and the
    probability of rupture. A specimen for which the emulator has no answer counts as burst: it
    balloons, or nothing is known of it. If the wanted curvature cannot be reached at this risk, the
    largest allowed pressure is given, with the curvature there; the exit code is 0 too. By default
    it is for a prompt first loading in a horizontal mount; --hold-s, --cycle, --branch, --humidity,
    --temperature and --mount act by the causes that the run named. Whatever the risk, no pressure
    is allowed above the largest that was tested, nor above what actuators survived that burst at or
    near the degradation rate, unless --beyond is given.

    For a forward map of your own, give --reading, and with --x the inputs to try: for the first
    input, the range in which to look. Nothing is known of rupture there, so no risk is bounded.
    """


def lifetime(
    report: options.RunFolderPath,
    pressure: options.DutyPressure,
    curvature: options.DutyCurvature,
    risk: options.Risk = 0.05,
    hours: options.Hours = None,
    beyond: options.Beyond = False,
    hold_s: options.Hold = PROMPT.hold_s,
    cycle: options.Cycle = PROMPT.cycle,
    branch: options.Branch = PROMPT.branch,
    humidity: options.Humidity = PROMPT.humidity_pct,
    temperature: options.Temperature = PROMPT.temperature_c,
    mount: options.Mount = PROMPT.mount,
    cause: options.OneCause = None,
    base: options.BaseModel = False,
    emulator: options.SameEmulator = None,
    seed: options.SeedOfAnswer = None,
    out: options.OutFile = None,
    as_json: options.AsJson = False,
    quiet: options.Quiet = False,
) -> None:
    """Say how long an actuator in the soil does its duty, and which pressure keeps its curvature.

    An actuator fails when it bursts at the pressure of the duty or bends less than asked. The table
    gives, by hours in the soil, degradation rate, curvature at that pressure, the probability of
    having burst and of having failed by then with its 90 % interval, the pressures that keep the
    curvature of 90 % of new actuators, the largest pressure that --risk and the tests allow, and
    the share of actuators that reach the curvature with it. A probability of less than one in the
    films broken and actuators loaded is no number. Times are those up to the last film that was
    taken out of the soil; give others with --hours.
    """


def next_experiment(
    report: options.RunFolderPath, as_json: options.AsJson = False, quiet: options.Quiet = False
) -> None:
    """Rank further experiments by how well they would tell the causes still in question apart.

    The expected log Bayes factor is what an experiment adds on average to the evidence for the
    true cause, whichever of the two it is: 3 are odds of 20 to 1. The ranking is that of the run;
    nothing is computed. The exit code is 0 too where there is nothing to tell apart.
    """


def update(
    report: options.RunFolderPath,
    new: options.NewRows,
    out: options.UpdateTarget = None,
    emulator: options.SameEmulator = None,
    seed: options.SeedOfAnswer = None,
    as_json: options.AsJson = False,
    quiet: options.Quiet = False,
) -> None:
    """Let further readings of actuators enter a finished run, in seconds.

    The rows are of new specimens, or further readings of earlier ones. Draws of the run's posterior
    are weighed by what they say; where too few draws carry the weight, a law is fitted to these and
    drawn from with all readings. Posteriors, curvature bands, ruptures, decisions, the life in the
    soil and shares of all readings go to a new run folder, the run stays as it is. The verdict is
    not judged again: for that, add the rows to the study and run it. The study must be where it was
    for the run.
    """


def score_answers(
    answers: options.Answers,
    truths: options.Truths,
    out: options.ScoreTarget = None,
    as_json: options.AsJson = False,
) -> None:
    """Score what a method says of hidden effects against the truths, with 95 % intervals.

    Methods are ranked by the credit: 1 where what is said is what is hidden, and where a set of
    causes is said, 1 over its members, so that naming everything wins nothing. Nothing hidden asks
    for adequate, an effect that no cause of the catalogue is for unexplained. Every study must be
    answered. The matrix has a row for each thing hidden and a column for each thing said.
    """


def trace_photographs(
    photos: options.Photos = None,
    out: options.TraceTarget = None,
    grid: options.Grid = None,
    ruler: options.Ruler = None,
    length: options.Length = None,
    scale: options.PixelSize = None,
    hint: options.Hint = None,
    line: options.Line = None,
    about: options.About = None,
    base: options.ClampSide = None,
    seed: options.SeedOfTrace = 1,
    page: options.PageOf = None,
    port: options.Port = None,
) -> None:
    """Trace the bottom line of actuators in photographs, and write points with their errors.

    Writes markers.csv, traces.csv (angle and curvature), points.csv (the points in pixels, to be
    corrected) and a picture with the line of every photograph. A checkerboard or ruler must lie in
    the plane of the side that is traced. What cannot be read is said, and left out.
    """


COMMANDS = (
    Command("init", init, ("bayesdeg init studies/mine",)),
    Command(
        "run",
        run,
        (
            "bayesdeg run studies/gelatin_actuator --effort quick",
            "bayesdeg run studies/mine --out reports/try --seed 7",
        ),
    ),
    Command("check", check, ("bayesdeg check studies/gelatin_actuator",)),
    Command("causes", causes, ("bayesdeg causes",)),
    Command("report", report, ("bayesdeg report reports/gelatin_actuator",)),
    Command(
        "simulate",
        simulate,
        (
            "bayesdeg simulate studies/gelatin_actuator --cause pressure_offset=14 "
            "--out studies/planted",
        ),
    ),
    Command("emulate", emulate, ("bayesdeg emulate studies/mine --workers 4",)),
    Command(
        "predict",
        predict,
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
        control,
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
        lifetime,
        ("bayesdeg lifetime reports/gelatin_actuator --pressure 120 --curvature 5 --risk 0.05",),
        (
            "An actuator fails its duty of 5 1/m at 120 kPa when it bursts or bends less: half of "
            "new actuators do so by 6.37 h (5 % by 5.07 h, 95 % by 7.87 h).",
        ),
    ),
    Command("next", next_experiment, ("bayesdeg next reports/gelatin_actuator",)),
    Command(
        "update",
        update,
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
        score_answers,
        (
            "bayesdeg score answers.csv truths.jsonl --out scored",
            "bayesdeg score reports truths.jsonl --json",
        ),
    ),
    Command(
        "trace",
        trace_photographs,
        (
            "bayesdeg trace photos/*.jpg --grid 5 --out traced",
            "bayesdeg trace --page traced",
            "bayesdeg trace photo.jpg --length 42.6 --hint traced/points.csv --out corrected",
        ),
    ),
)
