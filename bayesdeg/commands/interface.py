"""Signatures and help texts of the commands; their work is imported only when it is called.

Running a command needs numba, scipy and more, which take seconds to import. Help, completion and
the refusal of a wrong option need none of them.
"""

import functools
import importlib
import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from math import inf
from typing import Any

from bayesdeg.actuator.status import Backend
from bayesdeg.commands import options
from bayesdeg.prediction.conditions import PROMPT


@dataclass(frozen=True)
class Command:
    """A command: its signature and the examples of its help.

    Parameters
    ----------
    name : str
        Its name on the command line, and of the module in ``bayesdeg.commands`` that does the work.
    signature : callable
        Its parameters are the arguments, options and groups of options, its docstring the help; the
        list of commands shows the first paragraph. A function of that name in the module does the
        work.
    examples : tuple of str
        Command lines at the end of the help.
    output : tuple of str
        Output of the last example.
    """

    name: str
    signature: Callable[..., None]
    examples: tuple[str, ...]
    output: tuple[str, ...] = ()

    @property
    def epilog(self) -> str:
        """The end of the help; rich needs an empty line between lines."""
        prints = ["which prints:", *(f"`{line}`" for line in self.output)] if self.output else []
        return "\n\n".join(["For example:", *(f"`{line}`" for line in self.examples), *prints])

    @property
    def work(self) -> Callable[..., None]:
        """The function that does the work, imported with its dependencies."""
        module = importlib.import_module(f"bayesdeg.commands.{self.name}")
        found: Callable[..., None] = getattr(module, self.signature.__name__)
        return found

    @property
    def call(self) -> Callable[..., None]:
        """The callable for the command line: the signature with each option, and the work."""
        stated = inspect.signature(self.signature).parameters
        groups: dict[str, Any] = {
            name: p.annotation for name, p in stated.items() if is_dataclass(p.annotation)
        }
        each: list[inspect.Parameter] = []
        for name, parameter in stated.items():
            grouped = fields(groups[name]) if name in groups else ()
            each += [
                parameter.replace(name=option.name, annotation=option.type, default=option.default)
                for option in grouped
            ] or [parameter]

        @functools.wraps(self.signature)
        def call(**given: Any) -> None:
            for name, group in groups.items():
                own = {option.name: given.pop(option.name) for option in fields(group)}
                given[name] = group(**own)
            self.work(**given)

        vars(call)["__signature__"] = inspect.Signature(each)
        call.__annotations__ = {p.name: p.annotation for p in each}
        return call


def init(folder: options.NewFolder) -> None:
    """Write a commented study with example data, ready to run and to replace with your own.

    Every key of study.toml is explained. The data come from a virtual experiment, as the study
    states.
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

    An interrupted run continues where it stopped. If there is no emulator for the geometry, one is
    trained first; on a terminal, without --yes, the command says how long that takes and asks
    before it starts. Finite element solutions are kept in .cache/campaign, emulators in
    .cache/emulators. With --refine the emulator is corrected by 16 to 32 fine-mesh curves in the
    study's posterior region, until its error, estimated from held-out curves, shifts no posterior
    mean by more than 0.1 standard deviations; run.json and the report say how far this was
    achieved.
    """


def check(study: options.StudyFolder) -> None:
    """Read and check the data only; exit code 2 and the list of faults if there are any.

    Columns are checked against each other, the priors and physical limits. Impossible values are
    faults; unlikely ones, such as one specimen in a different unit, are reported as in doubt.
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
    """Simulate a virtual experiment with the study's design on a fine finite element model.

    It has the data files of the study, or all of them if the study has only published statistics.
    Each curve takes about half a minute. Cavity volumes and blocked tip forces (force.csv) are
    simulated if the study has them; a force takes one more curve. The hidden effects are written
    to truth.json, which no other command opens.
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

    One factorization on each mesh is timed first to estimate the total time; on a terminal,
    without --yes, the command then asks whether to continue. Every solution is kept: after an
    interruption the same command continues where it stopped. Tables at the end show how the
    curves ended and how accurate the emulator is; the parameters of failed curves are written to
    a file.
    """


def predict(
    report: options.RunFolderPath,
    pressure: options.Pressures = None,
    degradation: options.MaybeRates = None,
    hours: options.Hours = None,
    service: options.Service = options.AS_TESTED,
    degradation_sd: options.DegradationSd = PROMPT.degradation_sd,
    x: options.Inputs = None,
    asking: options.Asking = options.AS_RUN,
) -> None:
    """Predict curvature and rupture of a new specimen from the posterior of a finished run.

    Curvatures are 5, 25, 50, 75 and 95 % quantiles over new specimens, without reading noise, by
    default for a prompt first loading in a horizontal mount. --hold-s, --cycle, --branch,
    --humidity, --temperature and --mount act through the causes that the run named; an option
    without effect is reported. The probability of rupture up to a pressure has a 90 % interval;
    one below 1 in the number of films broken and actuators loaded is shown as that bound. Cells
    are empty where most specimens are outside the emulator's range. For your own forward map,
    give --x NAME=VALUES for each input.
    """


def control(
    report: options.RunFolderPath,
    curvature: options.Curvatures = None,
    degradation: options.MaybeRates = None,
    hours: options.Hours = None,
    risk: options.Risk = 0.05,
    beyond: options.Beyond = False,
    reading: options.Readings = None,
    service: options.Service = options.AS_TESTED,
    degradation_sd: options.DegradationSd = PROMPT.degradation_sd,
    x: options.Inputs = None,
    asking: options.Asking = options.AS_RUN,
) -> None:
    """Find the pressure that reaches a wanted curvature at a bounded risk of rupture.

    At the pressure found, half of new specimens bend as far or further. The table also gives the
    pressures that 90 % of the specimens need, the curvature at the pressure, and the probability
    of rupture. A specimen outside the emulator's range counts as burst: it balloons, or nothing
    is known about it. If the wanted curvature cannot be reached at this risk, the largest allowed
    pressure is given with the curvature there, also with exit code 0. The default is a prompt
    first loading in a horizontal mount; --hold-s, --cycle, --branch, --humidity, --temperature and
    --mount act through the causes that the run named. Whatever the risk, no pressure is allowed
    above the largest that was tested, nor above what actuators survived that burst at or near
    the degradation rate, unless --beyond is given.

    For your own forward map, give --reading, and with --x the inputs to try: a search range for
    the first input. Rupture is unknown there, so no risk is bounded.
    """


def lifetime(
    report: options.RunFolderPath,
    pressure: options.DutyPressure,
    curvature: options.DutyCurvature,
    risk: options.Risk = 0.05,
    hours: options.Hours = None,
    beyond: options.Beyond = False,
    service: options.Service = options.AS_TESTED,
    asking: options.Asking = options.AS_RUN,
) -> None:
    """Predict the service life of an actuator in the soil, and the pressure for its curvature.

    An actuator fails when it bursts at the given pressure or bends less than asked. For each time
    in the soil, the table gives the degradation rate, the curvature at that pressure, the
    probability of having burst and of having failed by then with its 90 % interval, the pressures
    that keep the curvature of 90 % of new actuators, the largest pressure that --risk and the
    tests allow, and the share of actuators that reach the curvature with it. A probability below
    1 in the number of films broken and actuators loaded is shown as that bound. Times extend to
    the last film taken out of the soil; give others with --hours.
    """


def next_experiment(
    report: options.RunFolderPath, as_json: options.AsJson = False, quiet: options.Quiet = False
) -> None:
    """Rank further experiments by how well they would tell the causes still in question apart.

    The expected log Bayes factor is the average evidence that an experiment adds for the true
    cause, whichever of the two it is: 3 means odds of 20 to 1. The ranking was computed by the
    run. The exit code is also 0 if there is nothing to tell apart.
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
    """Add further actuator readings to a finished run, in seconds.

    The rows are of new specimens, or further readings of earlier ones. They reweight the draws of
    the run's posterior; if too few draws carry the weight, a distribution is fitted to these and
    sampled with all readings. Posteriors, curvature bands, ruptures, decisions, the life in the
    soil and shares from all readings go to a new run folder; the run is not changed. The verdict
    is not updated: for that, add the rows to the study and run it. The study must still be where
    it was for the run.
    """


def score_answers(
    answers: options.Answers,
    truths: options.Truths,
    out: options.ScoreTarget = None,
    as_json: options.AsJson = False,
) -> None:
    """Score the answers of a method on hidden effects against the truths, with 95 % intervals.

    Methods are ranked by credit: 1 for the correct answer, and 1/n for a set of n causes that
    contains it, so naming everything gains nothing. The correct answer is adequate if nothing is
    hidden, and unexplained if the effect is not in the catalogue. Every study must be answered.
    The matrix has a row for each hidden effect and a column for each answer.
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
    """Trace the bottom line of actuators in photographs and write its points with their errors.

    Writes markers.csv, traces.csv (angle and curvature), points.csv (the points in pixels, for
    corrections) and a picture with the line for every photograph. A checkerboard or ruler must lie
    in the plane of the traced side. Photographs that cannot be read are reported and left out.
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
