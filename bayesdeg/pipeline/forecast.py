"""Rebuild a predictive model from the folder of a finished run."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.actuator.reading import ReadByOperator, as_read
from bayesdeg.causes.catalogue import find, in_order
from bayesdeg.causes.cause import Cause
from bayesdeg.data.settings import (
    POINTS_OF,
    RUPTURE_CRITERIA,
    Dimensions,
    RuptureCriterion,
)
from bayesdeg.data.study import Study
from bayesdeg.data.uncertain import dimensions_among, is_dimension
from bayesdeg.emulator.kept import CACHE, Recipe, cached_path, read_content, record_of
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.emulator.trained import default_surrogate, read_trained
from bayesdeg.errors import BayesdegError
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import Chain
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.means import Means
from bayesdeg.observations.specimens import (
    COURSE,
    OF_ACTUATORS,
    PAPER_STIFFNESS,
    FilmsAndActuators,
    control_name,
    has_elongation,
    node_name,
)
from bayesdeg.observations.tensile import Tensile
from bayesdeg.pipeline.experience import Experience, bursts_of
from bayesdeg.pipeline.posterior import Posterior, Range
from bayesdeg.pipeline.progress import Progress
from bayesdeg.prediction.conditions import PROMPT, ServiceConditions
from bayesdeg.prediction.control import Setting, control, largest_allowed
from bayesdeg.prediction.predictive import (
    QUANTILES,
    Specimens,
    curvature_bands,
    draw_specimens,
    moving_nothing,
    not_below,
    respond,
    rupture_table,
    specimens_tested,
)
from bayesdeg.prediction.soil import Level, Soil, known_levels
from bayesdeg.priors import Flat, Parameter
from bayesdeg.records import LARGEST, RecordError
from bayesdeg.report.folder import (
    EMULATOR,
    POSTERIOR,
    POSTERIOR_AVERAGED,
    POSTERIOR_BASE,
    POSTERIOR_COURSE,
    RunFolder,
)
from bayesdeg.report.record import MemberEntry, ModelEntry, RunRecord
from bayesdeg.report.wording import SPACE, sentences

Floats = NDArray[np.float64]

# prefixes of the names of positive parameters
_CONSTANTS = ("c1", "c2_ratio", "c3")
_CONTROLS = tuple(f"{name}_{kind}_" for name in _CONSTANTS for kind in ("at", "control"))
_ELONGATION = "elongation"
_POSITIVE = (PAPER_STIFFNESS, "volume_ratio", "c1_", "c3_", f"{_ELONGATION}_at_")


def model_document(model: JointModel, study: Study | None = None) -> ModelEntry:
    """Return ``model`` of ``run.json``, which `read_stored` needs besides the posterior.

    Parameters
    ----------
    model : JointModel
        The base model of a run.
    study : Study, optional
        For the ruptures that it cites.
    """
    measured: dict[str, Iterable[float]] = {}
    for tests in model.of_kind(Curvature):
        measured["pressure_kPa"] = tests.tests.pressure[tests.tests.mask]
        measured["degradation_pct"] = tests.tests.degradation.ravel()
    films = [float(level) for one in model.of_kind(Tensile) for level in one.levels]
    films += [
        s.degradation for s in model.data_of(Means).statistics if s.quantity == "young_modulus"
    ]
    measured |= {"film_degradation_pct": films} if films else {}
    buried = None if study is None else study.moisture
    measured |= {} if buried is None else {TIME: buried["time_h"].to_numpy(np.float64)}
    forward = model.world.forward
    reads = forward if isinstance(forward, ReadByOperator) else None
    return ModelEntry(
        parameters=tuple(model.table.names),
        nodes_pct=model.world.nodes,
        elongation_nodes_pct=model.world.elongation_nodes,
        paper_thickness_mm=model.world.paper_thickness,
        largest_pressure_kPa=model.world.largest_pressure,
        measured={name: (float(min(v)), float(max(v))) for name, v in measured.items()},
        rupture_criterion=model.world.criterion,
        rupture_size_ratio=model.world.size_ratio,
        reading_operator=reads.operator if reads else "",
        reading_points=reads.points if reads else None,
        reading_of_line=reads is not None and reads.with_angle,
        material_law="" if model.world.law == "yeoh" else "neo_hookean",
        stiffening=model.world.stiffening or None,
        rupture_checks=specimens_tested(model) or None,
        bursts=bursts_of(model, study),
    )


def read_stored(
    path: Path, *, base: bool = False, emulator: Path | None = None, cache: Path = CACHE
) -> Posterior:
    """Read a finished run's posterior and rebuild its model.

    Parameters
    ----------
    path : Path
        The run folder.
    base : bool
        The base model instead of the final one.
    emulator : Path, optional
        File of the emulator that the run used; by default it is looked for in the package and
        among those trained here.
    cache : Path
        Folder of emulators of other geometries.

    Raises
    ------
    BayesdegError
        If it is no folder of a finished run, is damaged or from an older version, if nothing was
        calibrated that says how actuators bend, or if its emulator is not to be had.
    """
    if not path.is_dir():
        raise BayesdegError(
            f"{path}: no such folder; name a run folder, such as reports/NAME, that "
            "`bayesdeg run` has written"
        )
    folder = RunFolder(path)
    run, verdict = folder.read_run(), folder.read_verdict()
    members = () if base or run.model is None else run.model.averaged
    tree = folder.read_posterior(
        POSTERIOR_BASE if base else POSTERIOR_AVERAGED if members else POSTERIOR
    )
    draws = {str(n): v.to_numpy() for n, v in _posterior(tree, path).items()}
    refuse_impossible_draws(draws, path)
    if not bends_actuators(draws):
        raise BayesdegError(
            f"{path}: the study has no actuator readings, so its posterior cannot predict "
            "actuators; add actuator.csv to the study and run it again"
        )
    try:
        if run.model is None:
            raise BayesdegError(
                "run.json is from an older version and does not describe the model of the "
                "posterior; run the study again with `bayesdeg run`"
            )
        model = _model(run.model, draws, emulator_of(folder, run, emulator, cache))
        _refuse_other_members(members, model)
        for ends in run.model.measured.values():
            _known(ends)
    except (RecordError, BayesdegError) as fault:
        raise BayesdegError(f"{path}: {fault}") from fault
    vectors = np.stack([draws[name] for name in model.table.names], axis=-1)[:, :, None, :]
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.ones(len(vectors)))
    found = Posterior(model, chain, tested=run.model, members=members, run=run, verdict=verdict)
    if not members:
        return found
    return replace(found, number=_numbers(tree, vectors.shape[:2], len(members), path))


def bends_actuators(parameters: Iterable[str]) -> bool:
    """Return whether a posterior with these parameters can predict actuators.

    Examples
    --------
    >>> bends_actuators(["c1"]), bends_actuators(["c1", "paper_stiffness"])
    (False, True)
    """
    return not OF_ACTUATORS.isdisjoint(parameters)


def _refuse_other_members(members: Sequence[MemberEntry], model: JointModel) -> None:
    """Refuse sets of causes that do not match the draws, or invalid probabilities."""
    sets = {frozenset(member.causes) for member in members}
    theirs = {name for one in sets for name in one}
    known = {cause.name for cause in model.causes}
    shares = [member.probability or 0.0 for member in members]
    are_shares = min(shares, default=1.0) >= 0.0 and abs(sum(shares) - 1.0) < ROUNDING
    if members and not (len(sets) == len(members) and theirs == known and are_shares):
        raise RecordError(
            f"'averaged' in run.json does not match {POSTERIOR_AVERAGED}.nc; run the study again "
            "with --fresh"
        )


def _numbers(
    tree: xr.DataTree, shape: tuple[int, ...], members: int, path: Path
) -> NDArray[np.int64]:
    """Return the set of causes of each draw, (n,), for draws of shape (1, n)."""
    stats = tree["sample_stats"].to_dataset() if "sample_stats" in tree.children else xr.Dataset()
    found = stats["member"].to_numpy() if "member" in stats else np.empty(0)
    if found.shape != shape or len(found) > 1 or {*found[0].tolist()} != {*range(members)}:
        raise _impossible(path, "its draws do not match the sets of causes in run.json")
    number: NDArray[np.int64] = found[0].astype(np.int64)
    return number


def _posterior(tree: xr.DataTree, path: Path) -> xr.Dataset:
    if "posterior" not in tree.children:
        raise BayesdegError(
            f"{path}: the posterior has no draws; the file is damaged or from a different "
            "version; run the study again with --fresh"
        )
    return tree["posterior"].to_dataset()


def refuse_impossible_draws(draws: Mapping[str, Floats], path: Path) -> None:
    """Refuse impossible draws: not finite, or not positive where required.

    Raises
    ------
    BayesdegError
        With the parameter.
    """
    shapes = {values.shape for values in draws.values()}
    if len(shapes) != 1 or len(shape := shapes.pop()) != 2 or 0 in shape:
        raise _impossible(path, "its parameters have no draws, or different numbers of them")
    for name, values in draws.items():
        if not np.issubdtype(values.dtype, np.floating) or not np.all(np.abs(values) <= LARGEST):
            raise _impossible(path, f"draws of {name} are not finite")
        if name.startswith(_POSITIVE) and not np.all(values > 0.0):
            raise _impossible(path, f"{name} is {values.min():.3g}, but must be above 0")


def _impossible(path: Path, problem: str) -> BayesdegError:
    return BayesdegError(
        f"{path}: the posterior is damaged or not from bayesdeg: {problem}; run the study again "
        "with --fresh"
    )


def _model(entry: ModelEntry, draws: Mapping[str, Floats], forward: Surrogate) -> JointModel:
    """Rebuild a model from its record and parameter names."""
    nodes = _known(entry.nodes_pct)
    neo_hookean = entry.material_law == "neo_hookean"
    constants = _CONSTANTS[:1] if neo_hookean else _CONSTANTS
    wanted = [control_name(quantity, nodes, k) for quantity in constants for k in range(len(nodes))]
    elongation_nodes = _known(entry.elongation_nodes_pct)
    limits = [node_name(_ELONGATION, node) for node in elongation_nodes]
    broke = any(name.startswith(f"{_ELONGATION}_at_") for name in draws)
    _refuse_missing(dict.fromkeys((*wanted, *entry.parameters, *(limits if broke else ()))), draws)
    beside = [name for name in draws if name.startswith(_CONTROLS) and name not in wanted]
    if entry.parameters:  # an older version did not record them
        beside += [name for name in draws if "." not in name and name not in entry.parameters]
    if beside:
        raise RecordError(
            f"posterior and run.json do not match ({beside[0]} is not in run.json); run "
            "the study again with --fresh"
        )
    of_causes = [name for name in draws if "." in name and not is_dimension(name)]
    names = dict.fromkeys(name.split(".")[0] for name in of_causes)
    thickness, largest = entry.paper_thickness_mm, entry.largest_pressure_kPa
    if not (thickness and largest and thickness > 0.0 and largest > 0.0):
        raise RecordError(
            "run.json must give the paper's thickness and the largest pressure, both above 0, not "
            f"{thickness} and {largest}; run the study again with --fresh"
        )
    model = JointModel(
        base=tuple(Parameter(name, Flat(), "–", "") for name in draws if name not in of_causes),
        observations=(),
        world=FilmsAndActuators(
            nodes=nodes,
            elongation_nodes=elongation_nodes,
            forward=as_recorded(entry, forward),
            paper_thickness=thickness,
            largest_pressure=largest,
            criterion=_criterion(entry),
            size_ratio=entry.rupture_size_ratio or 1.0,
            law="neo_hookean" if neo_hookean else "yeoh",
            stiffening=entry.stiffening or 0.0,
            dimensions=dimensions_among(draws),
        ),
        causes=in_order(_flat(find(name)) for name in names),
    )
    _refuse_missing(model.table.names, draws)
    return model


def _refuse_missing(wanted: Iterable[str], draws: Mapping[str, Floats]) -> None:
    missing = [name for name in wanted if name not in draws]
    if missing:
        raise RecordError(
            f"posterior and run.json do not match ({', '.join(missing)} is missing); "
            "run the study again with --fresh"
        )


def as_recorded(entry: ModelEntry, mechanics: ForwardMap) -> ForwardMap:
    """Return the map for the readings of a model.

    Raises
    ------
    RecordError
        If they were read by no known operator.
    """
    if not entry.reading_operator:
        return mechanics
    for operator, (least, most) in POINTS_OF.items():
        if entry.reading_operator == operator and least <= (entry.reading_points or 0) <= most:
            points = int(entry.reading_points or 0)
            return as_read(mechanics, operator, points, of_line=entry.reading_of_line)
    ranges = ", ".join(
        f"{name} ({low} to {high} points)" for name, (low, high) in POINTS_OF.items()
    )
    raise RecordError(
        f"run.json: 'reading_operator' must be one of {ranges}, not {entry.reading_operator!r} of "
        f"{entry.reading_points}"
    )


def _criterion(entry: ModelEntry) -> RuptureCriterion:
    for criterion in RUPTURE_CRITERIA:
        if entry.rupture_criterion in (criterion, ""):
            return criterion
    raise RecordError(
        f"run.json: 'rupture_criterion' must be one of {', '.join(RUPTURE_CRITERIA)}, not "
        f"{entry.rupture_criterion!r}"
    )


def _flat(cause: Cause) -> Cause:
    """Return a cause with its parameters sampled on their own scale."""
    return replace(cause, parameters=tuple(replace(p, law=Flat()) for p in cause.parameters))


def emulator_of(
    folder: RunFolder, run: RunRecord, given: Path | None = None, cache: Path = CACHE
) -> Surrogate:
    """Return the emulator that a run used, identified by its training record.

    It is the one in the run folder, the package's, or one that was trained here.

    Raises
    ------
    BayesdegError
        If it is not to be had, or the one given is another.
    """
    training = run.emulator.training
    if not training:
        raise BayesdegError(
            "run.json does not record an emulator; run the study again with `bayesdeg run`"
        )
    if given is not None:
        found = read_trained(given)
        if _same(found, training):
            return found
        raise BayesdegError(
            f"{given} is not the emulator of this run; give the one given to `bayesdeg run`, "
            "or leave out --emulator"
        )
    own = folder.path / EMULATOR
    if own.exists() and _is_of(own, training):
        return read_trained(own)
    shipped = default_surrogate()
    if _same(shipped, training):
        return shipped
    kept = _kept(training, cache)
    if kept is not None and kept.exists() and _same(found := read_trained(kept), training):
        return found
    for path in sorted(cache.glob("*.npz")):  # emulators of one study have different names
        if _is_of(path, training):
            return read_trained(path)
    raise BayesdegError(
        f"the emulator of the run is not in the run folder ({EMULATOR}), in this "
        f"version of the package or in {cache.absolute()}; give its file with --emulator FILE, "
        "or run the study again with `bayesdeg run`"
    )


def _same(surrogate: Surrogate, training: Mapping[str, object]) -> bool:
    return _is_record(surrogate.record, training)


def _is_record(record: str, training: Mapping[str, object]) -> bool:
    # non-finite values are written as null
    return bool(json.loads(record, parse_constant=lambda _: None) == training)


def _is_of(path: Path, training: Mapping[str, object]) -> bool:
    """Return whether a file holds the emulator of a training record; False if damaged."""
    try:
        return _is_record(read_content(path, record_of), training)
    except BayesdegError:
        return False


def _kept(training: Mapping[str, object], cache: Path) -> Path | None:
    """Return the file of an emulator of that geometry."""
    trained = training.get("dimensions_mm")
    known = {field.name for field in fields(Dimensions)}
    if not isinstance(trained, dict) or set(trained) != known:
        return None
    numbers = {name: float(value or 0.0) for name, value in trained.items()}
    chambers = round(numbers.pop("chambers"))
    return cached_path(Geometry(Dimensions(**numbers, chambers=chambers)), Recipe(), cache)


def _known(numbers: Sequence[float | None]) -> tuple[float, ...]:
    known = tuple(number for number in numbers if number is not None)
    if not known or len(known) < len(numbers):
        raise RecordError(
            f"run.json: nodes and ranges of 'model' must list numbers, not {list(numbers)}"
        )
    return known


BAND_DRAWS, RUPTURE_DRAWS, ANSWER_DRAWS = 2000, 1000, 500
TIME, RATE_COLUMNS = "time_h", ("degradation_q05", "degradation_q95")
PRESSURES_AT_ONCE = 40  # bounds the memory
LEAST_ANSWERED = 0.5  # share of the specimens below which there is no band
NEARLY_ALL = 0.99
BAND_COLUMNS = tuple(f"q{round(100 * q):02d}" for q in QUANTILES)
PROBABILITY_COLUMNS = ("probability", "probability_q05", "probability_q95")
ROUNDING = 1e-6  # tolerance of probabilities that sum to 1
POINT = 1.0  # tolerance of degradation rates outside the measured range [%]


MODEL = "model"
AVERAGE = "average"


def by_each(stored: Posterior, predicted: Callable[[Posterior], pd.DataFrame]) -> pd.DataFrame:
    """Return what is predicted on average over causes that cannot be told apart, then by each.

    Parameters
    ----------
    stored : Posterior
        A finished run.
    predicted : callable
        Returns a table of a run, from the same random numbers each time.

    Returns
    -------
    DataFrame
        Where there are several sets of causes with ``model`` first, which is ``average`` or the
        model by its causes.
    """
    table = predicted(stored)
    if not stored.each:
        return table
    named = [(AVERAGE, table), *((run.name, predicted(run)) for run in stored.each)]
    for name, frame in named:
        frame.insert(0, MODEL, name)
    return pd.concat([frame for _, frame in named], ignore_index=True)


def answer_seed(seed: int) -> np.random.SeedSequence:
    """Return the seed of an answer, apart from the streams of the run or calibration itself."""
    return np.random.SeedSequence([seed, 1])


def predict(
    stored: Posterior,
    levels: Sequence[Level],
    pressure: Floats,
    *,
    seed: np.random.SeedSequence,
    progress: Progress,
    conditions: ServiceConditions = PROMPT,
) -> pd.DataFrame:
    """Return curvature bands and rupture probabilities of a new specimen.

    Parameters
    ----------
    stored : Posterior
    levels : sequence of Level
        Degradation rates, known or after a time in the soil, see `levels_at`.
    pressure : array
        As read, rising [kPa].
    seed : SeedSequence
        Everything random comes from it.
    progress : Progress
        Shows the levels.
    conditions : ServiceConditions
        In which the specimen is used.

    Returns
    -------
    DataFrame
        Of a time in the soil ``time_h`` and ``degradation_q05``, ``degradation_q95``; the columns
        of ``bands.csv`` and ``rupture.csv``; ``answered``, the share of specimens for
        which the forward map has an answer [–]; and ``why`` something is missing.
    """
    first, second = seed.spawn(2)
    specimens = draw_specimens(
        *(stored.model, stored.chain, np.random.default_rng(second)),
        draws=ANSWER_DRAWS,
        strata=4,
        conditions=conditions,
    )
    pieces = np.array_split(pressure, -(-len(pressure) // PRESSURES_AT_ONCE))
    progress.stage("predicting", total=len(levels) * len(pieces))
    frames = []
    for level in levels:
        for piece in pieces:
            table = _predicted(stored, specimens, level, piece, first)
            frames.append(_with_time(table, level))
            progress.advance(1, str(level) if len(levels) > 1 else "")
    return pd.concat(frames, ignore_index=True)


def _with_time(table: pd.DataFrame, level: Level) -> pd.DataFrame:
    """Add the time in the soil, and the interval of the degradation rate."""
    if level.is_known:
        return table
    low, _, high = level.interval
    table.insert(0, TIME, level.hours)
    for place, (name, value) in enumerate(zip(RATE_COLUMNS, (low, high), strict=True)):
        table.insert(2 + place, name, value)
    return table


def _predicted(
    stored: Posterior,
    specimens: Specimens,
    level: Level,
    pressure: Floats,
    seed: np.random.SeedSequence,
) -> pd.DataFrame:
    conditions = specimens.conditions
    # from the seed again, so that every row uses the same draws
    model, chain, generator = stored.model, stored.chain, np.random.default_rng(seed)
    table = curvature_bands(
        *(model, chain, generator),
        degradation=level.column(BAND_DRAWS),
        pressure=pressure,
        draws=BAND_DRAWS,
        conditions=conditions,
    )
    table[list(PROBABILITY_COLUMNS)] = np.nan
    if has_elongation(model.base):
        generator = np.random.default_rng(seed)
        rupture = rupture_table(
            *(model, chain, generator),
            degradation=level.column(RUPTURE_DRAWS),
            pressure=pressure,
            draws=RUPTURE_DRAWS,
            specimens=stored.checks(RUPTURE_DRAWS),
            conditions=conditions,
        )
        table[list(PROBABILITY_COLUMNS)] = rupture[list(PROBABILITY_COLUMNS)]
    answered = respond(specimens, level.of_draws(ANSWER_DRAWS), pressure).answered
    unknown = table["probability"].isna() & has_elongation(model.base)
    why = [_why(a, rupture=bool(u)) for a, u in zip(answered, unknown, strict=True)]
    return table.assign(answered=answered, why=why)


def _why(answered: float, *, rupture: bool) -> str:
    """Say why a row is empty or incomplete; empty if it is complete."""
    return _said(
        "unanswered",
        left=1.0 - answered,
        nothing=answered <= LEAST_ANSWERED,
        some=answered < NEARLY_ALL,
        lacks_rupture=rupture,
    )


def _said(part: str, **facts: object) -> str:
    return sentences("answers", part, **facts).replace(SPACE, " ")


def levels_at(
    *, degradation: Floats | None, hours: Floats | None, soil: Soil | None, seed: int | str | None
) -> tuple[Level, ...]:
    """Return the degradation rates at which to predict.

    Parameters
    ----------
    degradation : array, optional
        Known [%].
    hours : array, optional
        Otherwise: times in the soil [h].
    soil : Soil, optional
        The course of degradation; needed for times in the soil.
    seed : int
        Draws of the course come from it, the same for all times.
    """
    if hours is None or soil is None:
        return known_levels(() if degradation is None else degradation)
    generator = np.random.default_rng([int(seed or 0), COURSE_STREAM])
    return soil.drawn(generator, BAND_DRAWS).levels(hours)


def soil_of(path: Path) -> Soil:
    """Read the course of degradation in the soil from a run folder.

    Raises
    ------
    BayesdegError
        If the study has no readings of moisture that could tell it, or the file is damaged.
    """
    found = known_soil_of(path)
    if found is None:
        raise BayesdegError(f"{path}: {NO_COURSE}")
    return found


def known_soil_of(path: Path) -> Soil | None:
    """Read the course of degradation as `soil_of` does; None if the run has none."""
    draws = RunFolder(path).draws_of(POSTERIOR_COURSE)
    if draws is None:
        return None
    read = {str(name): drawn.to_numpy() for name, drawn in draws.items()}
    refuse_impossible_draws(read, path)
    values = {name: drawn.ravel().astype(np.float64) for name, drawn in read.items()}
    if not {p.name for p in COURSE} <= set(values):
        raise _impossible(path, "the course of degradation lacks a parameter")
    for name, drawn in values.items():
        if not np.all(drawn >= 0.0):
            raise _impossible(path, f"draws of {name} must be above 0")
    return Soil(values)


NO_COURSE = (
    "the study has no film moisture against time in the soil, so hours cannot be converted to "
    "degradation rates; give the rate itself, or add moisture.csv with fresh films and films of at "
    "least one later time, and run the study again"
)
COURSE_STREAM = 3  # stream of the seed: draws of the course are independent of all others


def settings(
    stored: Posterior,
    levels: Sequence[Level],
    wanted: Floats,
    *,
    risk: float,
    seed: np.random.SeedSequence,
    progress: Progress,
    conditions: ServiceConditions = PROMPT,
    experience: Experience | None = None,
) -> list[Setting]:
    """Return the pressure for each wanted curvature at each degradation rate.

    Parameters
    ----------
    stored : Posterior
    levels : sequence of Level
        Degradation rates, see `levels_at`.
    wanted : array
        Curvatures [1/m].
    risk : float
        Largest probability of rupture that is accepted [–].
    seed : SeedSequence
        Everything random comes from it.
    progress : Progress
        Shows the levels.
    conditions : ServiceConditions
        In which the specimens are used.
    experience : Experience, optional
        Above which nothing is allowed; by default the risk alone bounds the pressure.
    """
    generator = np.random.default_rng(seed)
    specimens = draw_specimens(stored.model, stored.chain, generator, conditions=conditions)
    first, checks = stored.model.world.largest_pressure, stored.checks()
    progress.stage("finding pressures", total=len(levels))
    found = []
    for level in levels:
        rates = level.of_draws(len(specimens.score) // specimens.strata)
        ceiling = np.inf if experience is None else ceiling_of(experience, level)
        allowed = largest_allowed(specimens, rates, risk, first=first, ceiling=ceiling)
        settings_there = (
            control(specimens, rates, curvature, risk=risk, first=first, allowed=allowed)
            for curvature in wanted
        )
        found += [
            replace(
                one,
                probability=not_below(one.probability, checks),
                hours=level.hours,
                rates=level.interval,
            )
            for one in settings_there
        ]
        progress.advance(1, str(level) if len(levels) > 1 else "")
    return found


def ceiling_of(experience: Experience, level: Level) -> float:
    """Return the pressure that tests allow at all likely degradation rates [kPa]."""
    return min(experience.ceiling(float(rate)) for rate in level.interval)


def settings_table(found: list[Setting]) -> pd.DataFrame:
    """Return settings as a table, one row each, with non-finite values empty."""
    rows = [
        ({} if s.hours is None else {TIME: s.hours})
        | {"degradation_pct": s.degradation}
        | ({} if s.hours is None else dict(zip(RATE_COLUMNS, s.rates[[0, -1]], strict=True)))
        | {
            "wanted_per_m": s.wanted,
            "risk": s.risk,
            "reached": int(s.reached),
            "pressure_kPa": s.pressure,
        }
        | dict(zip(("needed_q05_kPa", "needed_q50_kPa", "needed_q95_kPa"), s.needed, strict=True))
        | {"allowed_kPa": s.allowed.pressure}
        | dict(zip(BAND_COLUMNS, s.curvature, strict=True))
        | dict(zip(PROBABILITY_COLUMNS, s.probability, strict=True))
        | {"why": statement(s)}
        for s in found
    ]
    return pd.DataFrame(rows).replace([np.inf, -np.inf], np.nan)


def statement(setting: Setting) -> str:
    """Say why a wanted curvature is not reached; empty if it is."""
    return "" if setting.reached else _said("out_of_reach", s=setting)


def basis(
    experience: Experience, allowed: Mapping[float, float], *, beyond: bool, strong: bool
) -> tuple[str, ...]:
    """Say which tests limit pressures, or that higher ones rest on no test.

    Parameters
    ----------
    experience : Experience
        How far actuators were tested, and where they burst.
    allowed : mapping of float to float
        Largest pressure that is allowed [kPa] by degradation rate [%].
    beyond : bool
        Whether more was allowed than was tested.
    strong : bool
        Whether anything is known of the elongation at break.
    """
    near = dict.fromkeys(one for rate in allowed for one in experience.near(rate))
    said = [str(Caution("burst", {"b": one, "tested": experience.pressure})) for one in near]
    over = {r: c for r, pressure in allowed.items() if pressure > (c := experience.ceiling(r))}
    if beyond and over:
        said.append(str(Caution("rests_on", {"over": over, "strong": strong})))
    return tuple(said)


def allowed_by_rate(found: Sequence[Setting]) -> dict[float, float]:
    """Return the largest pressure that settings allow [kPa] by degradation rate [%]."""
    return {float(rate): one.allowed.pressure for one in found for rate in one.rates}


@dataclass(frozen=True)
class Caution:
    """A warning about predictions.

    Parameters
    ----------
    kind : str
        The macro of ``report/templates/answers.j2`` that words it.
    facts : mapping
        Names and numbers in it.
    """

    kind: str
    facts: Mapping[str, object] = field(default_factory=dict)

    def __str__(self) -> str:
        """Return it in words."""
        return _said(self.kind, **self.facts)


def unanswered_conditions(
    stored: Posterior, degradation: Floats, conditions: ServiceConditions
) -> tuple[str, ...]:
    """Warn about conditions without effect; parameters as in `predict`."""
    ends = np.unique(degradation[[0, -1]])
    names = moving_nothing(stored.model, stored.chain, ends, conditions)
    causes = [cause.name for cause in stored.model.causes]
    given = {name: getattr(conditions, name) for name in names}
    return tuple(
        str(Caution("moves_nothing", {"name": n, "value": v, "causes": causes}))
        for n, v in given.items()
    )


def rates_of(levels: Sequence[Level]) -> Floats:
    """Return the requested degradation rates, sorted: known ones, or the ends of intervals."""
    ends = [level.interval[[0, -1]] for level in levels]
    rates = np.unique(np.concatenate([np.empty(0), *ends]))
    # after a time in the soil a small rate is not a fraction given by mistake
    known = all(level.is_known for level in levels)
    return rates if known else np.unique(np.where(_is_small(rates), 0.0, rates))


def hours_beyond(measured: Mapping[str, Range], levels: Sequence[Level]) -> tuple[str, ...]:
    """Warn about times in the soil longer than that of any film.

    Parameters
    ----------
    measured : mapping
        As in `bayesdeg.pipeline.posterior.Posterior.measured`.
    levels : sequence of Level
        Degradation rates.
    """
    longest = max((level.hours or 0.0 for level in levels), default=0.0)
    last = measured.get(TIME, (0.0, np.inf))[1]
    facts = {"last": last, "asked": longest}
    return (str(Caution("hours_beyond", facts)),) if longest > 1.001 * last else ()


def cautions(
    stored: Posterior, levels: Sequence[Level], pressure: Floats, conditions: ServiceConditions
) -> tuple[str, ...]:
    """Return warnings for predictions at these levels and pressures."""
    rates = rates_of(levels)
    return (
        *warnings(stored, rates, pressure),
        *hours_beyond(stored.measured, levels),
        *unanswered_conditions(stored, rates, conditions),
    )


def setting_cautions(
    stored: Posterior,
    levels: Sequence[Level],
    found: Sequence[Setting],
    conditions: ServiceConditions,
    *,
    beyond: bool,
) -> tuple[str, ...]:
    """Return warnings for settings."""
    set_to = np.array([s.pressure for s in found if np.isfinite(s.pressure)])
    strong = has_elongation(stored.model.base)
    return (
        *cautions(stored, levels, set_to, conditions),
        *basis(stored.experience, allowed_by_rate(found), beyond=beyond, strong=strong),
        *small_risk(stored, min(s.risk for s in found)),
    )


def warnings(stored: Posterior, degradation: Floats, pressure: Floats) -> tuple[str, ...]:
    """Say what a user of predictions at these places should know.

    Parameters
    ----------
    stored : Posterior
    degradation : array
        [%].
    pressure : array
        [kPa].
    """
    return (*_about_model(stored), *extrapolations(stored.measured, degradation, pressure))


def extrapolations(
    measured: Mapping[str, Range], degradation: Floats, pressure: Floats
) -> tuple[str, ...]:
    """Warn about predictions outside the measurements.

    Parameters
    ----------
    measured : mapping
        As in `bayesdeg.pipeline.posterior.Posterior.measured`.
    degradation, pressure : array
        [%] and [kPa].

    Examples
    --------
    >>> extrapolations({"pressure_kPa": (0.0, 240.0)}, np.array([0.0]), np.array([300.0]))
    ('pressures were measured up to 240 kPa: predictions at 300 kPa are extrapolations',)
    """
    found = (
        *_beyond_rates(measured, degradation),
        *_beyond_pressures(measured, float(np.max(pressure, initial=0.0))),
        *(Caution("small_rate", {"rate": r}) for r in degradation[_is_small(degradation)][:1]),
    )
    return tuple(map(str, found))


def small_risk(stored: Posterior, risk: float) -> tuple[str, ...]:
    """Warn about a risk below any probability that the specimens can support."""
    checks = stored.checks()
    if not has_elongation(stored.model.base) or risk * checks >= 1.0:
        return ()
    return (str(Caution("small_risk", {"risk": risk, "checks": checks})),)


def _is_small(degradation: Floats) -> NDArray[np.bool_]:
    """Return rates that look like fractions instead of percent."""
    return (degradation > 0.0) & (degradation < 1.0)


def _beyond_pressures(measured: Mapping[str, Range], highest: float) -> Iterator[Caution]:
    tested = measured.get("pressure_kPa")
    if tested is not None and highest > 1.001 * tested[1]:
        yield Caution("pressures_beyond", {"high": tested[1], "asked": highest})


def _beyond_rates(measured: Mapping[str, Range], degradation: Floats) -> Iterator[Caution]:
    for name, what in (("degradation_pct", "actuators"), ("film_degradation_pct", "films")):
        if name not in measured:
            continue
        low, high = measured[name]
        outside = degradation[(degradation < low - POINT) | (degradation > high + POINT)]
        if len(outside):
            facts = {"what": what, "low": low, "high": high, "asked": outside.tolist()}
            yield Caution("rates_beyond", facts)


def _about_model(stored: Posterior) -> Iterator[str]:
    """Yield warnings of the run about the predictive model."""
    if not stored.is_stored:
        if stored.members:
            yield str(Caution("averaged", {"members": stored.members, "by_command": False}))
        return
    convergence = stored.run.convergence.get("final" if stored.model.causes else "base")
    if convergence is not None and not convergence.usable:
        yield convergence.sentence
    yield from map(str, doubts_of_run(stored))


def doubts_of_run(stored: Posterior) -> Iterator[Caution]:
    """Yield warnings from the verdict and the data of a run."""
    if stored.verdict.outcome == "unexplained":
        yield Caution("unexplained")
    if stored.members:
        yield Caution("averaged", {"members": stored.members, "by_command": True})
    elif stored.verdict.outcome == "ambiguous":
        yield Caution("ambiguous", {"causes": stored.verdict.causes, "model": stored.name})
    if stored.run.update is not None:
        yield Caution("updated", {"update": stored.run.update})
    if "pressure_kPa" not in stored.measured:
        yield Caution("no_actuator")
    if not has_elongation(stored.model.base):
        yield Caution("no_rupture")
