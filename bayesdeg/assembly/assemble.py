"""The base model of a study: data, parameters, priors and the study's own code.

Errors in functions and causes of a study folder become faults that name file and line.
"""

import hashlib
import traceback
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.actuator.reading import as_read
from bayesdeg.assembly.aside import Exclusion
from bayesdeg.assembly.outline import outline, stated_priors
from bayesdeg.causes.cause import Cause
from bayesdeg.causes.fold import with_causes
from bayesdeg.data import readings as files
from bayesdeg.data.batches import recorded_batches
from bayesdeg.data.settings import FILE as SETTINGS_FILE
from bayesdeg.data.settings import Settings, UserForward
from bayesdeg.data.study import CAUSES, Study
from bayesdeg.data.uncertain import is_dimension
from bayesdeg.errors import BayesdegError, Fault, StudyError, use_one_of
from bayesdeg.files import STUDY_MB, read_bytes
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.own_map import (
    FOR_ARRAYS,
    Forward,
    Readings,
    UserMap,
    is_for_numbers,
    probe,
    user_map,
)
from bayesdeg.observations.counts import RuptureCounts
from bayesdeg.observations.kinds import ROUNDING
from bayesdeg.observations.specimens import LEAST_STIFFENING, FilmsAndActuators, no_map
from bayesdeg.pages.record import ForwardMapEntry, MapNoiseEntry
from bayesdeg.priors import Parameter, check_priors, with_least, with_priors
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.trained import refuse_lacking, surrogate_for

Floats = NDArray[np.float64]

DRAWS = 32  # prior draws at which a forward map is tried
PRIOR_DRAWS = 400  # prior draws for counting answers: a share of 5 % has a standard error of 1 %
CALLED_TWICE = 32  # of these
#: Relative to the largest prediction; parallel sums differ by less and are not noise.
SAME_ANSWER = 1e-9
NO_STUDY = Study("", Path())


@dataclass(frozen=True)
class Assembly:
    """The base model of a study and what belongs to it.

    Parameters
    ----------
    model : JointModel
        Base model.
    candidates : tuple of Cause
        Causes that can be judged with the columns at hand.
    unjudged : dict of str to str
        Causes that cannot, and why.
    missing : tuple of (str, str)
        Data that are not there, and what that costs.
    alike : tuple of Cause
        Those of the unjudged that act on the films of a study without actuators, and that these
        films cannot tell from another form of the law, nor from each other.
    counts : RuptureCounts, optional
        How many of the actuators of others burst.
    of_counts : tuple of Cause
        Causes that such counts may show.
    aside : tuple of Exclusion
        Suspects: specimens and readings that do not seem to belong with the rest.
    batches : dict of str to str
        The batch of each specimen of which one is recorded.
    study, whole : Study
        The study without what was set aside, and with it; of readings in a script a title alone.
    beyond : tuple of Exclusion
        Readings that were set aside since no curve goes so far.
    """

    model: JointModel
    candidates: tuple[Cause, ...]
    unjudged: dict[str, str]
    missing: tuple[tuple[str, str], ...]
    alike: tuple[Cause, ...] = ()
    counts: RuptureCounts | None = None
    of_counts: tuple[Cause, ...] = ()
    aside: tuple[Exclusion, ...] = ()
    batches: dict[str, str] = field(default_factory=dict)
    study: Study = NO_STUDY
    whole: Study = NO_STUDY
    beyond: tuple[Exclusion, ...] = ()

    @property
    def sets_aside(self) -> bool:
        """Whether the model is without some of the suspects."""
        return any(one.is_out for one in self.aside)

    @cached_property
    def answers(self) -> ForwardMapEntry | None:
        """Where the user's forward map fails, and its noise; evaluated once."""
        return None if user_map(self.model) is None else answers_of(self.model)

    @property
    def causes(self) -> tuple[Cause, ...]:
        """All causes that a model of the study may have, with the priors of the study."""
        known = {one.name: one for one in (*self.candidates, *self.alike, *self.of_counts)}
        return tuple(known.values())

    def extended(self, *causes: Cause) -> JointModel:
        """Return the model with active causes and the data that it is fitted to.

        Raises
        ------
        ValueError
            If a cause acts on nothing of the model, or names clash.
        """
        return self.with_its_counts(self.model.extended(*causes))

    def with_its_counts(self, model: JointModel) -> JointModel:
        """Return a model with published rupture counts as data, if one of its causes needs them.

        A cause that acts only on rupture makes them data. Otherwise they only test the model, see
        `bayesdeg.observations.counts`.
        """
        are_data = any(cause.is_of_rupture_alone for cause in model.causes)
        if self.counts is None or not are_data:
            return model
        return model.with_observations(self.counts)

    def with_parameters(self, names: Collection[str]) -> JointModel:
        """Return the model whose parameters have these names, with the causes that they belong to.

        Raises
        ------
        BayesdegError
            If there is none.
        """
        wanted = set(names)
        of_causes = (name for name in names if "." in name and not is_dimension(name))
        known = {cause.name: cause for cause in self.causes}
        acting = dict.fromkeys(name.split(".")[0] for name in of_causes)
        model = self.extended(*(known[name] for name in acting if name in known))
        if set(model.table.names) != wanted:
            raise BayesdegError(
                "the posterior is of a different model from that of the study in this version; run "
                "the study again"
            )
        return model


def answers_of(model: JointModel) -> ForwardMapEntry:
    """Count prior draws without a finite prediction, and call the map twice with the same values.

    Each kind of readings whose predictions differ between the two calls is listed with their
    standard deviation, the rms difference over √2.
    """
    vectors = model.table.sample(np.random.default_rng(0), PRIOR_DRAWS)
    with np.errstate(all="ignore"):
        first = model.expected(vectors)
        change = model.expected(vectors[:CALLED_TWICE]) - first[:CALLED_TWICE]
    answered = np.isfinite(first)
    kinds, noise = model.places.kind, []
    for kind in dict.fromkeys(kinds.tolist()):
        rows = kinds == kind
        moved = change[:, rows][np.isfinite(change[:, rows])]
        largest = np.max(np.abs(first[:, rows]), where=answered[:, rows], initial=0.0)
        if np.any(np.abs(moved) > SAME_ANSWER * largest):
            unit, sd = model.scales[kind].unit, float(np.sqrt(np.mean(moved**2) / 2.0))
            noise.append(MapNoiseEntry(kind=kind, unit=unit, sd=sd))
    return ForwardMapEntry(
        prior_draws=PRIOR_DRAWS,
        prior_unanswered=float(np.mean(~answered.all(axis=1))),
        noise=tuple(noise),
    )


def assemble_own(
    own: UserMap, parameters: Iterable[Parameter], candidates: Iterable[Cause] = ()
) -> Assembly:
    """Build the base model of readings in a script and a user's forward map.

    Raises
    ------
    BayesdegError
        If names clash, or shapes do not match.
    """
    model = own.model(parameters)
    probe(model)
    named = Study(own.title, Path(own.title), Settings(title=own.title, seed=0))
    return Assembly(model, tuple(candidates), {}, (), study=named, whole=named)


def _assemble_study(study: Study) -> Assembly:
    """Build the base model of a study with its own forward map and causes.

    Raises
    ------
    StudyError
        If code of the study fails, or a prior or a cause does not exist.
    """
    own, causes, stated = map_of_study(study), own_causes(study), study.settings
    assert stated.forward is not None
    try:
        base = own.model(stated.parameters)
    except BayesdegError as fault:
        raise StudyError([Fault("study.toml", str(fault), "rename one of them")]) from fault
    check_priors(stated.priors, with_causes(base.base, causes).names)
    tried = tuple(
        replace(one, parameters=stated_priors(one, study))
        for one in causes
        if stated.causes.candidates is None or one.name in stated.causes.candidates
    )
    known = [cause.name for cause in causes]
    unknown = [
        Fault("study.toml", "is not a cause of this study",
              use_one_of(name, known) if known else "add causes/NAME.py",
              None, "causes.candidates", name)
        for name in stated.causes.candidates or () if name not in known
    ]  # fmt: skip
    if unknown:
        raise StudyError(unknown)
    [read] = own.readings
    least = {read.parameter_of("error"): ROUNDING * study.digits.get(read.name, 0.0)}
    model = replace(base, base=with_priors(with_least(base.base, least), stated.priors))
    try_out(study, model, tried)
    absent = (("causes/*.py", "no cause can be named; only a misfit can be found"),)
    return Assembly(model, tried, {}, () if tried else absent, study=study, whole=study)


def assemble(study: Study, forward: ForwardMap | None = None) -> Assembly:
    """Build the base model of a study.

    Parameters
    ----------
    study : Study
        Checked data and settings.
    forward : ForwardMap, optional
        By default the emulator that ships with the package.

    Raises
    ------
    StudyError
        If a prior is given for a parameter that does not exist.
    BayesdegError
        If a candidate does not exist, or there is no emulator of the study's geometry.
    """
    if study.settings.forward is not None:
        return _assemble_study(study)
    emulated = forward is None or isinstance(forward, Surrogate)
    plan = outline(study, emulated=emulated)
    geometry = geometry_of_study(study.settings)
    if plan.needs_forward and (forward is None or isinstance(forward, Surrogate)):
        forward = surrogate_for(geometry, forward)
        refuse_lacking(forward, plan.asked, plan.dimensions)
    if plan.has_actuators and forward is not None:
        points, of_line = study.settings.reading.points, study.line_points
        forward = as_read(
            forward, study.settings.reading.operator, of_line or points, of_line=of_line is not None
        )
    world = FilmsAndActuators(
        nodes=plan.nodes,
        elongation_nodes=plan.elongation_nodes or (0.0,),
        forward=no_map if forward is None or not plan.needs_forward else forward,
        paper_thickness=study.settings.paper.thickness,
        largest_pressure=plan.largest,
        criterion=study.settings.rupture.criterion,
        size_ratio=geometry.volume / study.settings.rupture.film_volume,
        degrades=plan.degrades,
        law=study.settings.material.law,
        # C3/C1 if C3 is not a parameter
        stiffening=LEAST_STIFFENING
        if study.settings.material.law == "neo_hookean" and plan.needs_forward
        else 0.0,
        dimensions=tuple(one.name for one in plan.dimensions),
    )
    model = JointModel(plan.base, plan.observations, world)
    return Assembly(
        model,
        plan.candidates,
        plan.unjudged,
        plan.missing,
        plan.alike,
        counts=plan.counts,
        of_counts=plan.of_counts,
        batches=recorded_batches(study.actuator) | recorded_batches(study.tensile),
        study=study,
        whole=study,
    )


def level_grid(model: JointModel) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the degradation rates of predictions [%]."""
    top = max(model.world.nodes)
    return np.array(model.world.nodes) if top == 0.0 else np.arange(0.0, top + 1e-9, 5.0)


@dataclass(frozen=True)
class Code:
    """A Python file of a study, or a function in it.

    Parameters
    ----------
    path : Path
        Where it is.
    name : str
        As the user knows it: ``model.py``, ``causes/drag.py``.
    """

    path: Path
    name: str

    def module(self) -> ModuleType:
        """Run the file without writing bytecode.

        Raises
        ------
        StudyError
            If it is no Python, or fails.
        """
        source = read_bytes(self.path, most_mb=STUDY_MB)
        module = ModuleType(f"study_{hashlib.sha256(source).hexdigest()[:12]}")
        module.__file__ = str(self.path)
        try:
            code = compile(source, str(self.path), "exec")
        except (SyntaxError, ValueError) as error:
            row, text = getattr(error, "lineno", None), getattr(error, "text", None)
            problem = f"is not valid Python: {getattr(error, 'msg', error)}"
            value = None if text is None else text.strip()
            raise StudyError(
                [Fault(self.name, problem, "correct that line", row, value=value)]
            ) from error
        try:
            exec(code, module.__dict__)
        except Exception as error:
            raise StudyError([self.fault(error, "fails when it is read")]) from error
        return module

    def fault(self, error: BaseException, what: str) -> Fault:
        """Return a fault for an exception, with the last line of this file that it went through."""
        frames = traceback.extract_tb(error.__traceback__)
        rows = [frame.lineno for frame in frames if frame.filename == str(self.path)]
        problem = f"{what}: {type(error).__name__}: {error}"
        remedy = FOR_ARRAYS if is_for_numbers(error) else "correct that line"
        return Fault(self.name, problem, remedy, rows[-1] if rows else None)

    def watched(self, function: Callable[..., Any], what: str) -> Callable[..., Any]:
        """Return a function whose exceptions name the line of this file."""

        def call(*arguments: Any) -> Any:
            try:
                with np.errstate(all="ignore"):  # not a number counts as no answer
                    return function(*arguments)
            except BayesdegError:
                raise
            except KeyError as error:
                raise StudyError([self._unknown(error, what, arguments)]) from error
            except Exception as error:
                raise StudyError([self.fault(error, f"{what} fails")]) from error

        return call

    def _unknown(self, error: KeyError, what: str, arguments: tuple[Any, ...]) -> Fault:
        """Return a fault for a name that is neither a parameter nor an input."""
        known = [str(name) for given in arguments if isinstance(given, dict) for name in given]
        asked = str(error.args[0]) if error.args else ""
        problem = f"{what} uses {asked!r}, which is not among its inputs"
        remedy = use_one_of(asked, known) if known else "correct that line"
        return replace(self.fault(error, what), problem=problem, remedy=remedy)


def map_of_study(study: Study) -> UserMap:
    """Return the readings of a study with the function that predicts them.

    Raises
    ------
    StudyError
        If the function is not to be had.
    """
    forward = study.settings.forward
    assert forward is not None
    file, _, name = forward.function.partition(":")
    code = Code(study.folder / file, file)
    functions = {key: one for key, one in vars(code.module()).items() if callable(one)}
    if name not in functions:
        problem = f"names a function that {file} does not have"
        remedy = use_one_of(name, functions) if functions else f"write def {name}(values, x)"
        place = (None, "forward.function", forward.function)
        raise StudyError([Fault(SETTINGS_FILE, problem, remedy, *place)])
    called: Forward = code.watched(functions[name], name)
    reading = study.settings.reading.name
    return UserMap((_own_readings(study, forward),), {reading: called}, forward.function)


def _own_readings(study: Study, forward: UserForward) -> Readings:
    table, reading = study.others[files.NAME], study.settings.reading

    def given(name: str, default: Any) -> Any:
        return table[name].to_numpy() if name in table else default

    leveled = files.LEVEL in table and files.LEVEL in (forward.inputs or ())
    timed = files.TIME in (forward.inputs or ())
    return Readings(
        {name: table[name].to_numpy(np.float64) for name in forward.inputs or ()},
        table[reading.name].to_numpy(np.float64),
        specimen=given(files.SPECIMEN, None),
        name=reading.name,
        unit=reading.unit,
        error=reading.error,
        scatter=reading.scatter,
        level=given(files.LEVEL, 0.0) if leveled else 0.0,
        time=given(files.TIME, np.nan) if timed else np.nan,
        history=given(files.HISTORY, "once"),
        level_unit="%" if leveled else "",
    )


def own_causes(study: Study) -> tuple[Cause, ...]:
    """Return a study's own causes: ``CAUSE`` or ``CAUSES`` of each file.

    Raises
    ------
    StudyError
        With every file that fails or has none, and every name that is there twice.
    """
    found: dict[str, Cause] = {}
    faults: list[Fault] = []
    for path in sorted((study.folder / CAUSES).glob("*.py")):
        code = Code(path, f"{CAUSES}/{path.name}")
        try:
            for cause in _causes_of(code):
                if cause.name in found:
                    problem = f"has a cause {cause.name!r}, which another file also has"
                    faults.append(Fault(code.name, problem, "rename it"))
                found[cause.name] = cause
        except StudyError as error:
            faults += error.faults
    if faults:
        raise StudyError(faults)
    return tuple(found.values())


def _causes_of(code: Code) -> Iterator[Cause]:
    there = vars(code.module())
    listed = there.get("CAUSES", [there[name] for name in ("CAUSE",) if name in there])
    causes = list(listed) if isinstance(listed, Iterable) else [listed]
    wrong = [type(one).__name__ for one in causes if not isinstance(one, Cause)]
    if wrong or not causes:
        problem = f"has {', '.join(wrong)} instead of a cause" if wrong else "has no CAUSE"
        raise StudyError([Fault(code.name, problem, "write CAUSE = bayesdeg.Cause(...)")])
    for cause in causes:
        hooks = {
            name: code.watched(hook, f"{name} of {cause.name}")
            for name in ("on_inputs", "on_reading")
            if (hook := getattr(cause, name)) is not None
        }
        yield replace(cause, **hooks)


def try_out(study: Study, model: JointModel, causes: Iterable[Cause]) -> None:
    """Try forward map and causes at prior draws, before anything is computed.

    Raises
    ------
    StudyError
        If something fails, has the wrong shape, or has no answer at any of the draws.
    """
    forward = study.settings.forward
    assert forward is not None
    file, _, name = forward.function.partition(":")
    predicted = _answers(model, file)
    lost = np.flatnonzero(~np.isfinite(predicted).any(axis=0))
    if len(lost):
        specimen = model.places.specimen[lost[0]]
        problem = (
            f"{name} has no finite answer for {len(lost)} of {predicted.shape[1]} readings, the "
            f"first being reading {lost[0] + 1} (specimen {specimen}), at any of {DRAWS} prior "
            "draws"
        )
        remedy = "return finite numbers there, or remove these rows from readings.csv"
        raise StudyError([Fault(file, problem, remedy)])
    for cause in causes:
        _answers(model.extended(cause), f"{CAUSES}, {cause.name}")


def _answers(model: JointModel, place: str) -> Floats:
    vectors = model.table.sample(np.random.default_rng(0), DRAWS)
    try:
        with np.errstate(all="ignore"):
            return model.expected(vectors)
    except StudyError:
        raise
    except (BayesdegError, ValueError, TypeError) as error:
        problem, _, remedy = str(error).partition("; ")
        raise StudyError([Fault(place, problem, remedy or "correct it")]) from error
