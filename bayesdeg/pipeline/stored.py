"""A finished run becomes a model again that predicts, from its folder alone."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.causes.catalogue import find, in_order
from bayesdeg.causes.cause import Cause
from bayesdeg.data.settings import Dimensions
from bayesdeg.emulator.kept import CACHE, Recipe, cached_path
from bayesdeg.emulator.surrogate import Surrogate
from bayesdeg.emulator.trained import default_surrogate, read_trained
from bayesdeg.errors import BayesdegError
from bayesdeg.inference.ensemble import Chain
from bayesdeg.inference.model import Model
from bayesdeg.inference.parameters import control_name
from bayesdeg.priors import Flat, Parameter
from bayesdeg.report.fields import LARGEST, Json, RunFaultError, entries_of, mapping_of, number_of
from bayesdeg.report.folder import POSTERIOR, POSTERIOR_BASE, RUN, RunFolder
from bayesdeg.report.record import Run, Verdict

Floats = NDArray[np.float64]
Range = tuple[float, float]

_NEEDED = ("volume_ratio", "paper_stiffness")
# beginnings of names of what can only be above 0
_POSITIVE = (*_NEEDED, "c1_", "c3_", "elongation_at_")


@dataclass(frozen=True)
class Stored:
    """What a run folder holds of a calibrated model.

    Parameters
    ----------
    model : Model
        Predicts; its priors are flat and its data are left out, so it cannot be calibrated.
    chain : Chain
        The draws that were kept.
    measured : mapping of str to (float, float)
        Ranges of ``pressure_kPa`` and ``degradation_pct`` of the actuators that were read, and of
        ``film_degradation_pct``; what was not measured is not there.
    run, verdict : Run, Verdict
        What is recorded of the run.
    """

    model: Model
    chain: Chain
    measured: Mapping[str, Range]
    run: Run
    verdict: Verdict

    @property
    def name(self) -> str:
        """The model by its causes: ``base``, ``base+pressure_offset``."""
        return "+".join(["base", *(cause.name for cause in self.model.causes)])


def model_document(model: Model) -> dict[str, object]:
    """Return what `read_stored` needs of a model beside its posterior: ``model`` of ``run.json``.

    Parameters
    ----------
    model : Model
        The base model of a run.
    """
    actuator, tensile = model.actuator, model.tensile
    measured: dict[str, Iterable[float]] = {}
    if actuator is not None:
        measured["pressure_kPa"] = actuator.pressure[actuator.mask]
        measured["degradation_pct"] = actuator.degradation.ravel()
    films = [] if tensile is None else tensile.degradation.tolist()
    films += [s.degradation for s in model.statistics if s.quantity == "young_modulus"]
    measured |= {"film_degradation_pct": films} if films else {}
    return {
        "nodes_pct": list(model.nodes),
        "elongation_nodes_pct": list(model.elongation_nodes),
        "paper_thickness_mm": model.paper_thickness,
        "largest_pressure_kPa": model.largest_pressure,
        "measured": {name: [float(min(v)), float(max(v))] for name, v in measured.items()},
    }


def read_stored(
    path: Path, *, base: bool = False, emulator: Path | None = None, cache: Path = CACHE
) -> Stored:
    """Read a finished run's posterior, and rebuild the model that it is of.

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
            f"{path}: there is no such folder; name a run folder, such as reports/NAME, that "
            "`bayesdeg run` has written"
        )
    folder = RunFolder(path)
    run, verdict, content = folder.read_run(), folder.read_verdict(), folder.read_json(RUN)
    tree = folder.read_posterior(POSTERIOR_BASE if base else POSTERIOR)
    draws = {str(n): v.to_numpy() for n, v in _posterior(tree, path).items()}
    _refuse_impossible(draws, path)
    if any(name not in draws for name in _NEEDED):
        raise BayesdegError(
            f"{path}: the study has no readings of actuators, so its posterior does not say how an "
            "actuator bends; add actuator.csv to the study and run it again"
        )
    try:
        document = mapping_of(content, "model")
        training = mapping_of(mapping_of(content, "emulator"), "training")
        model = _model(document, draws, _emulator(training, emulator, cache))
        measured = _ranges(mapping_of(document, "measured"))
    except (RunFaultError, BayesdegError) as fault:
        raise BayesdegError(f"{path}: {fault}") from fault
    vectors = np.stack([draws[name] for name in model.table.names], axis=-1)[:, :, None, :]
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.ones(len(vectors)))
    return Stored(model, chain, measured, run, verdict)


def _posterior(tree: xr.DataTree, path: Path) -> xr.Dataset:
    if "posterior" not in tree.children:
        raise BayesdegError(
            f"{path}: the posterior holds no draws, so the file is damaged or from another "
            "version; run the study again with --fresh"
        )
    return tree["posterior"].to_dataset()


def _refuse_impossible(draws: Mapping[str, Floats], path: Path) -> None:
    """Refuse draws that no calibration leaves: not finite, or not positive where it must be."""
    shapes = {values.shape for values in draws.values()}
    if len(shapes) != 1 or len(shape := shapes.pop()) != 2 or 0 in shape:
        raise _impossible(path, "its parameters have no draws, or not the same number of them")
    for name, values in draws.items():
        if not np.issubdtype(values.dtype, np.floating) or not np.all(np.isfinite(values)):
            raise _impossible(path, f"draws of {name} are no finite numbers")
        if name.startswith(_POSITIVE) and not np.all(values > 0.0):
            raise _impossible(path, f"{name} is {values.min():.3g}, and can only be above 0")


def _impossible(path: Path, problem: str) -> BayesdegError:
    return BayesdegError(
        f"{path}: the posterior is damaged, or is not of bayesdeg: {problem}; run the study again "
        "with --fresh"
    )


def _model(document: Json, draws: Mapping[str, Floats], forward: Surrogate) -> Model:
    """Rebuild a model from its document and the names of its draws."""
    if not document:
        raise BayesdegError(
            "run.json is from an older version and does not say what the posterior is of; run the "
            "study again with `bayesdeg run`"
        )
    nodes = _numbers(document, "nodes_pct")
    wanted = [
        control_name(quantity, nodes, k)
        for quantity in ("c1", "c2_ratio", "c3")
        for k in range(len(nodes))
    ]
    missing = [name for name in wanted if name not in draws]
    if missing:
        raise RunFaultError(
            f"posterior and run.json do not belong together ({', '.join(missing)} is missing); "
            "run the study again with --fresh"
        )
    names = dict.fromkeys(name.split(".")[0] for name in draws if "." in name)
    thickness, largest = (
        number_of(document, name) for name in ("paper_thickness_mm", "largest_pressure_kPa")
    )
    if not (thickness and largest and thickness > 0.0 and largest > 0.0):
        raise RunFaultError(
            "run.json must give the paper's thickness and the largest pressure, both above 0, not "
            f"{thickness} and {largest}; run the study again with --fresh"
        )
    return Model(
        base=tuple(Parameter(name, Flat(), "–", "") for name in draws if "." not in name),
        nodes=nodes,
        elongation_nodes=_numbers(document, "elongation_nodes_pct"),
        forward=forward,
        causes=in_order(_flat(find(name)) for name in names),
        paper_thickness=thickness,
        largest_pressure=largest,
    )


def _flat(cause: Cause) -> Cause:
    """Return a cause whose parameters are sampled as they are known."""
    return replace(cause, parameters=tuple(replace(p, law=Flat()) for p in cause.parameters))


def _emulator(training: Json, given: Path | None, cache: Path) -> Surrogate:
    """Return the emulator that the run used, told by the record of its training."""
    if not training:
        raise BayesdegError(
            "run.json does not record an emulator; run the study again with `bayesdeg run`"
        )
    if given is not None:
        found = read_trained(given)
        if _same(found, training):
            return found
        raise BayesdegError(
            f"{given} is not the emulator of this run; give the one that `bayesdeg run` was given, "
            "or leave out --emulator"
        )
    shipped = default_surrogate()
    if _same(shipped, training):
        return shipped
    kept = _kept(training, cache)
    if kept is not None and kept.exists() and _same(found := read_trained(kept), training):
        return found
    raise BayesdegError(
        "the emulator that the run used is neither in this version of the package nor in "
        f"{cache}; give its file with --emulator FILE, or run the study again with `bayesdeg run`"
    )


def _same(surrogate: Surrogate, training: Json) -> bool:
    # what is not finite is written as null
    return bool(json.loads(surrogate.record, parse_constant=lambda _: None) == training)


def _kept(training: Json, cache: Path) -> Path | None:
    """Return where an emulator of that geometry is kept."""
    trained = mapping_of(training, "dimensions_mm")
    known = {field.name for field in fields(Dimensions)}
    if set(trained) != known:
        return None
    numbers = {name: number_of(trained, name) or 0.0 for name in trained}
    chambers = round(numbers.pop("chambers"))
    return cached_path(Geometry(Dimensions(**numbers, chambers=chambers)), Recipe(), cache)


def _ranges(measured: Json) -> dict[str, Range]:
    return {name: (ends[0], ends[-1]) for name in measured if (ends := _numbers(measured, name))}


def _numbers(content: Json, key: str) -> tuple[float, ...]:
    values = entries_of(content, key)
    if not values or any(isinstance(v, bool) or not isinstance(v, int | float) for v in values):
        raise RunFaultError(f"run.json: {key!r} must list numbers, not {values!r}")
    numbers = [v for v in values if isinstance(v, int | float)]
    if not all(-LARGEST <= v <= LARGEST for v in numbers):
        raise RunFaultError(f"run.json: {key!r} must list finite numbers of a usual size")
    return tuple(float(v) for v in numbers)
