"""The posterior of a finished run, read back from its folder."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.actuator.reading import ReadByOperator, as_read
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.reading import read_study
from bayesdeg.causes.catalogue import find, in_order
from bayesdeg.causes.cause import Cause
from bayesdeg.data.settings import POINTS_OF, RUPTURE_CRITERIA, Dimensions, RuptureCriterion
from bayesdeg.data.study import Study
from bayesdeg.data.uncertain import dimensions_among, is_dimension
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
    node_name,
)
from bayesdeg.observations.tensile import Tensile
from bayesdeg.pages.folder import (
    EMULATOR,
    POSTERIOR,
    POSTERIOR_AVERAGED,
    POSTERIOR_BASE,
    POSTERIOR_COURSE,
    RunFolder,
)
from bayesdeg.pages.output import Owner, owner_of
from bayesdeg.pages.record import MemberEntry, ModelEntry, RunRecord, VerdictRecord
from bayesdeg.prediction.experience import bursts_of
from bayesdeg.prediction.posterior import TIME, Posterior
from bayesdeg.prediction.predictive import specimens_tested
from bayesdeg.prediction.soil import Soil
from bayesdeg.priors import Flat, Parameter
from bayesdeg.records import LARGEST, RecordError
from bayesdeg.surrogate.kept import CACHE, Recipe, cached_path, read_content, record_of
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.trained import default_surrogate, read_trained

Floats = NDArray[np.float64]

# prefixes of the names of positive parameters
_CONSTANTS = ("c1", "c2_ratio", "c3")
_CONTROLS = tuple(f"{name}_{kind}_" for name in _CONSTANTS for kind in ("at", "control"))
_ELONGATION = "elongation"
_POSITIVE = (PAPER_STIFFNESS, "volume_ratio", "c1_", "c3_", f"{_ELONGATION}_at_")
ROUNDING = 1e-6  # tolerance of probabilities that sum to 1
NO_COURSE = (
    "the study has no film moisture against time in the soil, so hours cannot be converted to "
    "degradation rates; give the rate itself, or add moisture.csv with fresh films and films of at "
    "least one later time, and run the study again"
)


def model_document(model: JointModel, study: Study | None = None) -> ModelEntry:
    """Return ``model`` of ``run.json``, from which `read_stored` rebuilds the base model of a run.

    The study is for the ruptures that it cites, and the times of its films in the soil.
    """
    measured: dict[str, Iterable[float]] = {}
    for tests in model.of_kind(Curvature):
        measured["pressure_kPa"] = tests.tests.pressure[tests.tests.mask]
        measured["degradation_pct"] = tests.tests.degradation.ravel()
    films = [float(level) for one in model.of_kind(Tensile) for level in one.levels]
    means = model.data_of(Means).statistics
    films += [s.degradation for s in means if s.quantity == "young_modulus"]
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


def run_in(path: Path) -> tuple[RunFolder, RunRecord, VerdictRecord]:
    """Return the folder of a finished run with its records.

    Raises
    ------
    BayesdegError
        If it is none, or damaged.
    """
    if not path.is_dir():
        raise BayesdegError(
            f"{path}: no such folder; name a run folder, such as reports/NAME, that "
            "`bayesdeg run` has written"
        )
    folder = RunFolder(path)
    return folder, folder.read_run(), folder.read_verdict()


def study_of(path: Path, run: RunRecord) -> Study:
    """Read the study of a run, which must be where it was and unchanged.

    Raises
    ------
    BayesdegError
        If it is not.
    """
    owner = owner_of(path) or Owner()
    place = path / owner.folder
    if not owner.folder or not place.is_dir():
        raise BayesdegError(
            f"{path}: the study {owner.folder or run.study} of this run no longer exists, but its "
            "readings are needed: put it back, or run it again"
        )
    study = read_study(place)
    # code that was added to a study with its own map changed nothing that was calibrated
    names = set(run.hashes) if run.forward else {*run.hashes, *study.hashes}
    changed = sorted(n for n in names if study.hashes.get(n) != run.hashes.get(n))
    if changed:
        raise BayesdegError(
            f"{', '.join(changed)} of {study.name} changed since the run; run it again, so that "
            "the posterior belongs to the current study"
        )
    return study


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
        calibrated that says how actuators bend, if its emulator is not to be had, or, with a
        user's forward map, if the study has changed or was a script.
    """
    folder, run, verdict = run_in(path)
    entry = ModelEntry() if run.model is None else run.model
    members = () if base else entry.averaged
    name = POSTERIOR_BASE if base else POSTERIOR_AVERAGED if members else POSTERIOR
    if run.forward and ":" not in run.forward:
        raise BayesdegError(
            f"{path} was written from Python and its forward map is not stored: predict from "
            "Python with bayesdeg.predict or bayesdeg.control"
        )
    study = study_of(path, run) if run.forward else None
    tree = folder.read_posterior(name)
    if "posterior" not in tree.children:
        raise BayesdegError(
            f"{path}: the posterior has no draws; the file is damaged or from a different "
            "version; run the study again with --fresh"
        )
    draws = {str(n): v.to_numpy() for n, v in tree["posterior"].to_dataset().items()}
    if study is not None:
        assembly = assemble(study)
        try:
            model = assembly.with_parameters(draws)
        except BayesdegError as fault:
            raise BayesdegError(f"{path}: {fault}") from fault
    else:
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
            model = stored_model(entry, draws, emulator_of(folder, run, emulator, cache))
            _refuse_other_members(members, model)
            for ends in entry.measured.values():
                _known(ends)
        except (RecordError, BayesdegError) as fault:
            raise BayesdegError(f"{path}: {fault}") from fault
    vectors = model.table.vectors(draws)[:, :, None, :]
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.ones(len(vectors)))
    found = Posterior(model, chain, tested=entry, members=members, run=run, verdict=verdict)
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


def refuse_impossible_draws(draws: Mapping[str, Floats], path: Path) -> None:
    """Refuse draws that are not finite, or not positive where required.

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


def stored_model(entry: ModelEntry, draws: Mapping[str, Floats], forward: Surrogate) -> JointModel:
    """Rebuild a model, with flat priors and without data, from its record and parameter names.

    Raises
    ------
    RecordError
        If record and draws do not match.
    """
    nodes, elongation_nodes = _known(entry.nodes_pct), _known(entry.elongation_nodes_pct)
    neo_hookean = entry.material_law == "neo_hookean"
    constants = _CONSTANTS[:1] if neo_hookean else _CONSTANTS
    wanted = [control_name(quantity, nodes, k) for quantity in constants for k in range(len(nodes))]
    broke = any(name.startswith(f"{_ELONGATION}_at_") for name in draws)
    limits = [node_name(_ELONGATION, node) for node in elongation_nodes if broke]

    def refuse_missing(names: Iterable[str]) -> None:
        missing = [name for name in names if name not in draws]
        if missing:
            raise RecordError(
                f"posterior and run.json do not match ({', '.join(missing)} is missing); "
                "run the study again with --fresh"
            )

    refuse_missing(dict.fromkeys((*wanted, *entry.parameters, *limits)))
    beside = [name for name in draws if name.startswith(_CONTROLS) and name not in wanted]
    if entry.parameters:  # an older version did not record them
        beside += [name for name in draws if "." not in name and name not in entry.parameters]
    if beside:
        raise RecordError(
            f"posterior and run.json do not match ({beside[0]} is not in run.json); run "
            "the study again with --fresh"
        )
    of_causes = [name for name in draws if "." in name and not is_dimension(name)]
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
        causes=in_order(_flat(find(n)) for n in dict.fromkeys(n.split(".")[0] for n in of_causes)),
    )
    refuse_missing(model.table.names)
    return model


def _flat(cause: Cause) -> Cause:
    """Return a cause with its parameters sampled on their own scale."""
    return replace(cause, parameters=tuple(replace(p, law=Flat()) for p in cause.parameters))


def as_recorded(entry: ModelEntry, mechanics: ForwardMap) -> ForwardMap:
    """Return the map for the readings of a model.

    Raises
    ------
    RecordError
        If they were read by no known operator.
    """
    if not entry.reading_operator:
        return mechanics
    points = int(entry.reading_points or 0)
    for operator, (least, most) in POINTS_OF.items():
        if entry.reading_operator == operator and least <= points <= most:
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

    def is_same(record: str) -> bool:
        # non-finite values are written as null
        return bool(json.loads(record, parse_constant=lambda _: None) == training)

    def holds(path: Path) -> bool:
        try:
            return is_same(read_content(path, record_of))
        except BayesdegError:  # damaged
            return False

    if given is not None:
        found = read_trained(given)
        if is_same(found.record):
            return found
        raise BayesdegError(
            f"{given} is not the emulator of this run; give the one given to `bayesdeg run`, "
            "or leave out --emulator"
        )
    own = folder.path / EMULATOR
    if own.exists() and holds(own):
        return read_trained(own)
    shipped = default_surrogate()
    if is_same(shipped.record):
        return shipped
    kept = _kept(training, cache)
    if kept is not None and kept.exists() and is_same((found := read_trained(kept)).record):
        return found
    for path in sorted(cache.glob("*.npz")):  # emulators of one study have different names
        if holds(path):
            return read_trained(path)
    raise BayesdegError(
        f"the emulator of the run is not in the run folder ({EMULATOR}), in this "
        f"version of the package or in {cache.absolute()}; give its file with --emulator FILE, "
        "or run the study again with `bayesdeg run`"
    )


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


def soil_of(path: Path) -> Soil:
    """Read the course of degradation in the soil from a run folder.

    Raises
    ------
    BayesdegError
        If the study has no moisture of films to tell it, or the file is damaged.
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
