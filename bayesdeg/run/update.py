"""Adding further actuator readings to a finished run."""

import hashlib
import html
import os
import re
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

import bayesdeg
from bayesdeg.analysis.calibrate import Fit
from bayesdeg.analysis.model_kind import kind_of
from bayesdeg.assembly.aside import readings_at
from bayesdeg.assembly.assemble import Assembly, assemble
from bayesdeg.assembly.outline import outline
from bayesdeg.assembly.reach import readings_beyond
from bayesdeg.criticism.posterior.convergence import Convergence
from bayesdeg.data.added import FILE, ExtendedTable, extend
from bayesdeg.data.plausibility import Doubt, doubts, refuse_impossible
from bayesdeg.data.study import Study
from bayesdeg.errors import BayesdegError, Fault, StudyError
from bayesdeg.files import STUDY_MB, read_bytes, reason, write_bytes
from bayesdeg.inference.laplace import Laplace
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import EFFORTS, Chain
from bayesdeg.inference.update import ENOUGH, FEWEST, RELIABLE_K, Updated, drawn_evenly, take_in
from bayesdeg.observations.curvature import ActuatorCurves, actuator_curves
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.pages import tables as columns
from bayesdeg.pages.folder import (
    ADDED,
    EMULATOR,
    INDEX,
    POSTERIOR,
    POSTERIOR_BASE,
    POSTERIOR_COURSE,
    RUN,
    RunFolder,
)
from bayesdeg.pages.left_out import Guard, OptionalStage, table_stage
from bayesdeg.pages.output import update_folder
from bayesdeg.pages.record import (
    ConvergenceEntry,
    InDoubt,
    RunRecord,
    TakenInEntry,
    UpdateEntry,
    VerdictRecord,
)
from bayesdeg.pages.wording import SPACE, sentences
from bayesdeg.prediction.posterior import Posterior
from bayesdeg.prediction.stored import (
    emulator_of,
    known_soil_of,
    refuse_impossible_draws,
    run_in,
    study_of,
)
from bayesdeg.progress import Progress
from bayesdeg.quantities import EFFORTS as KNOWN_EFFORTS
from bayesdeg.run.record import Results, in_doubt
from bayesdeg.run.run_record import (
    comparisons,
    draw_counts,
    emulator_entry,
    library_versions,
    peaks_of_memory,
)
from bayesdeg.run.stages import with_counts
from bayesdeg.run.writing import BUILDS, Files, TableSources

Floats = NDArray[np.float64]

RECOMPUTED = (
    *(columns.CONSTANTS, columns.PARAMETERS, columns.TENSILE, columns.ELONGATION),
    *(columns.BANDS, columns.RUPTURE, columns.OBSERVATIONS, columns.LEVELS, columns.DECISIONS),
    *(columns.FITTED, columns.LIFETIME, columns.SHARES, columns.CRITERIA),
)
"""Tables that follow from the posterior and are recomputed.

All others are kept from the run: those of the verdict and of checks, which an update does not
repeat, and those of films, which actuator readings do not change.
"""

REPEATED_STAGES = (
    *(OptionalStage.COMPARISONS, OptionalStage.IN_DOUBT),
    *(OptionalStage.READINGS, OptionalStage.REFUSED),
)
"""Further files that an update writes again."""

VOLUME = "cavity_volume_ml"  # needs the curvatures of the same specimens again
COUNTS_STREAM = 3  # stream of the seed for simulated rupture counts
MOVED = 8  # parameters in a printed update
DRAWS = 12000  # draws of equal weight for tables: three for each effective one
ENSEMBLES = 4  # number of chains into which they are divided
CHECKED, SAME = 50, 1e-3  # draws whose density is compared with the run's, and the tolerance [nats]
_NUMBERED = re.compile(r"_updated(_\d+)?$")


@dataclass(frozen=True)
class FinishedRun:
    """A finished run and its study.

    Parameters
    ----------
    folder : RunFolder
        Of the run.
    run, verdict : RunRecord, VerdictRecord
        What is recorded of it.
    study : Study
        As it was read for the run, without rows that were added since.
    earlier : bytes, optional
        Rows that were added since.
    """

    folder: RunFolder
    run: RunRecord
    verdict: VerdictRecord
    study: Study
    earlier: bytes | None


@dataclass(frozen=True)
class TakenIn:
    """One model of the run with further readings.

    Parameters
    ----------
    fit : Fit
        The updated calibration.
    updated : Updated
        How it was found.
    before : array, shape (n, n_parameters)
        Draws of the posterior before.
    """

    fit: Fit
    updated: Updated
    before: Floats


# ---- what is updated


def finished(report: Path) -> FinishedRun:
    """Read a finished run and its study.

    Raises
    ------
    BayesdegError
        If it is no folder of a finished run, if it has no actuators, or if its study is not where
        it was or has changed since.
    """
    folder, run, verdict = run_in(report)
    if run.forward:
        raise BayesdegError(
            f"{report}: runs with a user's forward map cannot be updated yet; add the readings to "
            "readings.csv and run the study again"
        )
    if run.model is None or "pressure_kPa" not in run.model.measured:
        raise BayesdegError(
            f"{report}: the study has no actuator readings to add to; add {FILE} to the study and "
            "run it again"
        )
    if any(one.set_aside for one in run.suspects):
        raise BayesdegError(
            f"{report}: the run set specimens or readings aside (suspects.csv), which only a new "
            f"run can reconsider: add the rows to {FILE} of the study and run it again"
        )
    study = study_of(report, run)
    if study.line_points is not None:
        raise BayesdegError(
            f"{report}: the run uses lines of points, to which no readings can be added yet; add "
            f"the points to {study.lines_file} and run the study again"
        )
    if run.update is None:
        return FinishedRun(folder, run, verdict, study, None)
    path = folder.path / ADDED
    try:
        earlier = read_bytes(path, most_mb=STUDY_MB)
    except OSError as fault:
        raise BayesdegError(f"{path}: {reason(fault)}; update the original run again") from fault
    if hashlib.sha256(earlier).hexdigest() != run.update.added_sha256:
        raise BayesdegError(
            f"{path}: this is not the file written with this run; update the original run again"
        )
    return FinishedRun(folder, run, verdict, study, earlier)


def read_new(path: Path) -> bytes:
    """Read new rows.

    Raises
    ------
    StudyError
        If the file cannot be read.
    """
    try:
        return read_bytes(path, most_mb=STUDY_MB)
    except OSError as fault:
        problem = f"cannot be read ({reason(fault)})"
        raise StudyError([Fault(str(path), problem, "give a file with rows")]) from fault


def _extended(of: FinishedRun, content: bytes, name: str) -> tuple[ExtendedTable, Study, Study]:
    """Return the added rows and the study before and after; refuse impossible data.

    Raises
    ------
    StudyError
        With every fault of the new rows.
    BayesdegError
        If the run's model cannot take them in.
    """
    study, sd = of.study, of.study.settings.noise.degradation_sd_pct
    recorded = read_bytes(study.folder / FILE, most_mb=STUDY_MB)
    before = study
    if of.earlier is not None:
        # checked when they were added
        merged = extend(recorded, None, of.earlier, ADDED, degradation_sd_pct=sd)
        before = replace(study, actuator=merged.table.frame)
    found = extend(recorded, of.earlier, content, name, degradation_sd_pct=sd)
    after = replace(
        study,
        actuator=found.table.frame,
        recorded={**study.recorded, "actuator": found.table.recorded},
    )
    if VOLUME in found.filled:
        raise BayesdegError(
            f"{name}: an update cannot use volumes ({VOLUME}); leave the column out, or add the "
            "rows to the study and run it again"
        )
    known = {p.name for p in outline(before).base}
    wanted = [p.name for p in outline(after).base if p.name not in known]
    if wanted:
        raise BayesdegError(
            f"{name}: the run lacks parameters for these readings ({', '.join(wanted)}); add the "
            "rows to the study and run it again, or leave out the column or specimen"
        )
    return found, before, after


def suspicions(before: Study, found: Sequence[Doubt], name: str) -> tuple[str, ...]:
    """Return doubts about new rows, those that the study had before left out.

    Parameters
    ----------
    before : Study
        Without the new rows.
    found : sequence of Doubt
        What is unlikely or impossible of the study with them.
    name : str
        Of the file they are from.

    Raises
    ------
    StudyError
        With what is impossible.
    """
    asked = [one for one in found if one.fault.file == FILE]
    known = {str(one) for one in (doubts(before, outline(before).expected) if asked else ())}
    new = [
        replace(doubt, fault=replace(doubt.fault, file=name))
        for doubt in asked
        if str(doubt) not in known
    ]
    return tuple(map(str, refuse_impossible(new)))


def refuse_beyond(studies: tuple[Study, Study], model: JointModel, name: str) -> None:
    """Refuse new readings that no curve of the material reaches.

    Parameters
    ----------
    studies : (Study, Study)
        Before and after the new rows.
    model : JointModel
        The run's base model, whose tests of actuators are replaced by theirs.
    name : str
        Of the file they are from.

    Raises
    ------
    StudyError
        With a fault for each specimen: a run sets such readings aside before any model is fitted,
        in a finished one each model would be pulled by how far its own curves go.
    """

    def beyond(study: Study) -> set[tuple[str, float, str, float]]:
        curves = actuator_curves(study)
        if curves is None:
            return set()
        tested = model.with_observations(*data_of_actuators(curves, model.base))
        return set(readings_at(tested.places, readings_beyond(study, tested)))

    before, after = studies
    new = beyond(after)
    pressures: dict[str, list[str]] = {}
    for specimen, pressure, *_ in sorted(new - beyond(before) if new else ()):
        pressures.setdefault(specimen, []).append(f"{pressure:g}")
    if pressures:
        raise StudyError(
            [
                Fault(
                    name,
                    "by films and priors it balloons below "
                    f"{' and '.join(dict.fromkeys(reached))} kPa, so no model curve reaches that "
                    "far",
                    f"leave these rows out, or add all rows to {FILE} of the study and run it "
                    "again, which sets such readings aside",
                    specimen=specimen,
                    column="pressure_kPa",
                )
                for specimen, reached in pressures.items()
            ]
        )


# ---- the posterior


def _drawn(of: FinishedRun, assembly: Assembly) -> dict[str, Posterior]:
    """Return the posteriors of a run by name; without a cause both are the same.

    Raises
    ------
    BayesdegError
        If draws are impossible, or are not those of a model of the study.
    """
    entry = of.run.model
    if entry is not None and entry.nodes_pct != assembly.model.world.nodes:
        nodes = assembly.model.world.nodes
        raise BayesdegError(
            f"{of.folder.path}: run.json has degradation nodes ({entry.nodes_pct}) that differ "
            f"from those of the study ({nodes}); run the study again"
        )
    found: dict[str, Posterior] = {}
    for posterior in (POSTERIOR, POSTERIOR_BASE):
        if posterior == POSTERIOR_BASE and not of.verdict.predicted_with:
            found[posterior] = found[POSTERIOR]
            continue
        stored, density = of.folder.read_draws(posterior)
        refuse_impossible_draws({str(n): v.to_numpy() for n, v in stored.items()}, of.folder.path)
        draws = {str(n): v.to_numpy().ravel() for n, v in stored.items()}
        model = assembly.with_parameters(draws)
        vectors = model.table.vectors(draws)[None, :, None, :]
        chain = Chain(vectors, density.reshape(vectors.shape[:3]), np.ones(1))
        found[posterior] = Posterior(model, chain)
    return found


def _taken_in(
    of: FinishedRun,
    posterior: str,
    drawn: Posterior,
    curves: tuple[ActuatorCurves, ActuatorCurves],
    specimens: tuple[str, ...],
    generator: np.random.Generator,
    enough: float,
) -> TakenIn:
    """Return one model of a run with further readings, from the tests before and after.

    Raises
    ------
    BayesdegError
        If this version has another density, or the draws do not lead to the new posterior.
    """
    before, model = (
        drawn.model.with_observations(*data_of_actuators(tests, drawn.model.base))
        for tests in curves
    )
    vectors, density = drawn.chain.vectors[0, :, 0], drawn.chain.log_prob[0, :, 0]
    some = np.unique(np.linspace(0, len(vectors) - 1, CHECKED).astype(np.intp))
    if not np.all(np.abs(before.log_prob(vectors[some]) - density[some]) <= SAME):
        raise BayesdegError(
            f"{of.folder.path}: this version of bayesdeg ({bayesdeg.__version__}; the run: "
            f"{of.run.version}) computes a density of its draws that differs from the record; run "
            "the study again"
        )
    entry = of.run.convergence.get("base" if posterior == POSTERIOR_BASE else "final")
    fewest = None if entry is None else entry.ess_min
    worth = 1.0 if fewest is None else min(1.0, fewest / len(vectors))
    updated = take_in(
        before,
        model,
        vectors,
        density,
        specimens,
        generator,
        independent=worth,
        enough=enough,
    )
    if not updated.reliable:
        sample = updated.posterior
        raise BayesdegError(
            f"the new readings move the posterior too far for its draws ({sample.effective:.0f} "
            f"effective draws, {FEWEST:.0f} required; Pareto k {sample.pareto_k:.2f}, at most "
            f"{RELIABLE_K:g}): add the rows to {FILE} of the study and run it again"
        )
    return TakenIn(_fit(model, updated, generator), updated, vectors)


def _fit(model: JointModel, updated: Updated, generator: np.random.Generator) -> Fit:
    """Return draws of equal weight from an updated posterior, for tables."""
    sample = updated.posterior
    places = drawn_evenly(sample, generator, DRAWS)
    vectors = sample.draws[places]
    known = sample.log_densities
    density = known[places] if len(known) else model.log_prob(vectors)
    shape = (ENSEMBLES, DRAWS // ENSEMBLES, 1)
    chain = Chain(vectors.reshape(*shape, -1), density.reshape(shape), np.ones(ENSEMBLES))
    best = int(np.argmax(density))
    laplace = Laplace(vectors[best], np.cov(vectors, rowvar=False), float(density[best]))
    # independent but for duplicates, and not from chains, so there is no R̂
    size, effective = len(model.table), (sample.effective,) * len(model.table)
    diagnosis = Convergence(
        model.table.names,
        (float("nan"),) * size,
        effective,
        effective,
        chain.vectors.shape[1],
        1,
        ENSEMBLES,
        True,
        (DRAWS / sample.effective,) * size,
        EFFORTS[KNOWN_EFFORTS[0]],
        False,
    )
    return Fit(model, laplace, sample, chain, diagnosis)


# ---- the new run folder


def default_target(report: Path) -> Path:
    """Return the default folder of an update.

    Examples
    --------
    >>> default_target(Path("reports/gelatin")).as_posix()
    'reports/gelatin_updated'
    >>> default_target(Path("reports/gelatin_updated")).as_posix()
    'reports/gelatin_updated_2'
    """
    whole = report.resolve() if report.name in ("", "..") else report
    plain = _NUMBERED.sub("", whole.name)
    if plain == whole.name:
        return whole.with_name(f"{plain}_updated")
    number = whole.name.rpartition("_")[2]
    return whole.with_name(f"{plain}_updated_{int(number) + 1 if number.isdigit() else 2}")


@dataclass(frozen=True, repr=False, eq=False)
class Update:
    """A finished run updated with new readings.

    Parameters
    ----------
    folder : Path
        The new run folder.
    entry : UpdateEntry
        What was added, and how.
    moved : DataFrame
        A row for each parameter of the final model: unit, mean and sd before and after, and the
        shift of the mean in standard deviations before.
    messages : tuple of str
        Doubts, and what was not updated.
    """

    folder: Path
    entry: UpdateEntry
    moved: pd.DataFrame
    messages: tuple[str, ...]

    @property
    def method(self) -> str:
        """``weights`` of the earlier draws, ``refit`` of a law to them, or about the mode."""
        return self._final.method

    @property
    def effective(self) -> float:
        """Effective draws of the updated posterior."""
        return float(self._final.effective or 0.0)

    @property
    def pareto_k(self) -> float:
        """Tail shape of their weights, reliable up to 0.7; nan for equal weights."""
        known = self._final.pareto_k
        return float("nan") if known is None else float(known)

    @property
    def _final(self) -> TakenInEntry:
        return self.entry.posteriors["final"]

    @cached_property
    def posterior(self) -> xr.DataTree:
        """The updated draws, as in ``posterior.nc`` of the new run folder."""
        return RunFolder(self.folder).read_posterior(POSTERIOR)

    def summary(self) -> pd.DataFrame:
        """Return mean and sd of every parameter before and after, and its shift in earlier sd."""
        return self.moved.set_index("parameter")

    def __fspath__(self) -> str:
        """Return the folder as a path."""
        return os.fspath(self.folder)

    def __repr__(self) -> str:
        """Return its method, and the parameters that shifted most."""
        frame = most_moved(self.moved).to_string(
            index=False, float_format=lambda value: f"{value:.4g}"
        )
        said = sentences("run", "taken_in", one=self._final).replace(SPACE, " ")
        return "\n".join([f"{self.folder}: {said}", *self.messages, "", frame])

    def _repr_html_(self) -> str:
        frame = most_moved(self.moved).to_html(
            index=False, float_format=lambda value: f"{value:.4g}"
        )
        said = sentences("run", "taken_in", one=self._final)
        head = html.escape(f"{self.folder}: {said}")
        notes = "".join(f"<p>{html.escape(one)}</p>" for one in self.messages)
        return f"<h4>{head}</h4>{notes}{frame}"


def most_moved(moved: pd.DataFrame, count: int = MOVED) -> pd.DataFrame:
    """Return the parameters that shifted most, in standard deviations.

    Examples
    --------
    >>> moved = pd.DataFrame({"parameter": ["a", "b"], "shift_sd": [0.1, -0.4]})
    >>> most_moved(moved, 1)["parameter"].tolist()
    ['b']
    """
    order = moved["shift_sd"].abs().sort_values(ascending=False, kind="stable").index
    return moved.loc[order[:count]]


def update(
    report: Path,
    content: bytes,
    name: str,
    *,
    out: Path | None,
    seed: int | None,
    emulator: Path | None,
    progress: Progress,
) -> Update:
    """Add further actuator readings to a finished run, and write a new run folder.

    Parameters
    ----------
    report : Path
        The run folder, which stays as it is.
    content : bytes
        Rows of ``actuator.csv``, of new or of earlier specimens.
    name : str
        Of the file they are from, for messages.
    out : Path, optional
        The new run folder.
    seed : int, optional
        By default that of the run.
    emulator : Path, optional
        The one that the run was given, if it was.
    progress : Progress
        Shows the work.

    Raises
    ------
    StudyError
        With every fault of the new rows.
    BayesdegError
        If the run cannot be updated, or the folder is not free.
    """
    begun = time.perf_counter()
    with threadpool_limits(limits=1):  # small matrices, and the same bits on every machine
        progress.stage("reading")
        of = finished(report)
        found, before, after = _extended(of, content, name)
        unlikely = doubts(after, outline(after).expected)
        doubted = suspicions(before, unlikely, name)
        forward = emulator_of(of.folder, of.run, emulator)
        # priors and scales stay those of the run, whatever pressures were added
        assembly = assemble(of.study, forward)
        refuse_beyond((before, after), assembly.model, name)
        drawn = _drawn(of, assembly)
        target = out or default_target(report)
        with update_folder(target, report, of.study) as folder:
            results, taken = _results(of, assembly, drawn, (before, after), found, seed, progress)
            progress.stage("predictions and tables")
            entry = _entry(of, found, taken)
            guard = Guard()
            results = with_counts(results, _seed(of, seed, COUNTS_STREAM), guard)
            _write(of, folder, after, results, guard, np.random.default_rng(_seed(of, seed, 0)))
            _finish(of, folder, after, results, (found, entry, unlikely), guard, begun)
        left_out = (f"{one.stage}: {one.why}" for one in guard.left_out)
        moved = _moved(taken[POSTERIOR])
        said = sentences("run", "updated", update=entry, degrades=of.run.degrades)
        return Update(target, entry, moved, (*doubted, said, *left_out))


def _results(
    of: FinishedRun,
    assembly: Assembly,
    drawn: Mapping[str, Posterior],
    studies: tuple[Study, Study],
    found: ExtendedTable,
    seed: int | None,
    progress: Progress,
) -> tuple[Results, dict[str, TakenIn]]:
    """Return the updated calibrations of the final and the base model."""
    taken: dict[str, TakenIn] = {}
    before, after = map(actuator_curves, studies)
    assert before is not None
    assert after is not None
    for number, posterior in enumerate((POSTERIOR, POSTERIOR_BASE)):
        if number and drawn[posterior] is drawn[POSTERIOR]:
            taken[posterior] = taken[POSTERIOR]
            continue
        progress.stage(f"adding the readings: {posterior}")
        generator = np.random.default_rng(_seed(of, seed, 1 + number))
        # the final model predicts; the base model is only kept up to date
        enough = ENOUGH if posterior == POSTERIOR else FEWEST
        taken[posterior] = _taken_in(
            of, posterior, drawn[posterior], (before, after), found.specimens, generator, enough
        )
    model = taken[POSTERIOR_BASE].fit.model
    whole = replace(assembly, model=model, study=studies[1], whole=studies[1])
    return Results(whole, taken[POSTERIOR_BASE].fit, taken[POSTERIOR].fit, None), taken


def _seed(of: FinishedRun, given: int | None, stream: int) -> np.random.SeedSequence:
    """Return a random stream used by no other update and no other part of the run."""
    number = given if given is not None else (of.run.seed or 0)
    times = 0 if of.run.update is None else int(of.run.update.times or 0)
    return np.random.SeedSequence([number, 2, times, stream])


def _write(
    of: FinishedRun,
    folder: RunFolder,
    after: Study,
    results: Results,
    guard: Guard,
    generator: np.random.Generator,
) -> None:
    """Write posteriors and tables that follow from them, and copy the others."""
    folder.remove(f"{RUN}.json")  # it becomes a run only when all else is written
    folder.remove(INDEX)
    files = Files(folder, guard)
    kept = EFFORTS[of.run.effort if of.run.effort in EFFORTS else "standard"].kept
    strict = Files(folder, Guard(strict=True), files.written)
    for name, fit in ((POSTERIOR_BASE, results.base), (POSTERIOR, results.final)):
        # half as many for the base model
        some = kept if fit is results.final else kept // 2
        strict.posterior(name, fit, generator, kept=some)
    soil = known_soil_of(of.folder.path)
    sources = TableSources(after, results, generator, guard, soil)
    for name in RECOMPUTED:
        files.table(name, partial(BUILDS[name], sources))
    # the course of degradation is unchanged
    old, new = (one.read_table(columns.PARAMETERS) for one in (of.folder, folder))
    if old is not None and new is not None and (old["model"] == "course").any():
        course = old[old["model"] == "course"]
        folder.write_table(columns.PARAMETERS, pd.concat([new, course], ignore_index=True))
    files.remove_others()
    for path in _as_before(of.folder.path):
        shutil.copyfile(path, folder.path / path.name)


def _as_before(path: Path) -> list[Path]:
    """Return the files of a run that an update does not change."""
    tables = [t.file for name, t in columns.TABLES.items() if name not in RECOMPUTED]
    names = (*tables, f"{POSTERIOR_COURSE}.nc", "deformed.npz", EMULATOR)
    pictures = sorted(path.glob("actuator_*pct.vtu"))
    return [*(path / name for name in names if (path / name).is_file()), *pictures]


def _entry(of: FinishedRun, found: ExtendedTable, taken: Mapping[str, TakenIn]) -> UpdateEntry:
    """Return the record of an update."""
    names = {"final": POSTERIOR, "base": POSTERIOR_BASE}
    before, model = of.run.update, of.run.model
    # sets of causes that were averaged before this or an earlier update
    averaged = (() if model is None else model.averaged) or (
        () if before is None else before.not_averaged
    )
    return UpdateEntry(
        run=str(of.folder.path.resolve()),
        times=1 + (0 if before is None else int(before.times or 0)),
        specimens=found.specimens,
        readings=found.rows,
        added_sha256=hashlib.sha256(found.added).hexdigest(),
        posteriors={
            label: TakenInEntry(
                method=str(taken[name].updated.method),
                effective=taken[name].updated.posterior.effective,
                pareto_k=taken[name].updated.posterior.pareto_k,
                weights_effective=taken[name].updated.weights.effective,
                weights_pareto_k=taken[name].updated.weights.pareto_k,
                log_density=taken[name].updated.weights.log_evidence,
            )
            for label, name in names.items()
        },
        as_before=("verdict.json", *(path.name for path in _as_before(of.folder.path))),
        not_averaged=averaged,
    )


def _finish(
    of: FinishedRun,
    folder: RunFolder,
    after: Study,
    results: Results,
    what: tuple[ExtendedTable, UpdateEntry, Sequence[Doubt]],
    guard: Guard,
    begun: float,
) -> None:
    """Write the rows, the unchanged verdict and, last, the run record."""
    base = results.base.model
    kind = kind_of(base)
    found, entry, unlikely = what
    write_bytes(folder.path / ADDED, found.added)
    doubted = guard.attempt(OptionalStage.IN_DOUBT, in_doubt, results, unlikely) or InDoubt()
    compare = partial(comparisons, after, results.final, results.counts_expected)
    compared = guard.attempt(OptionalStage.COMPARISONS, compare) or ()
    emulator = emulator_entry(results, guard)
    # failed stages of the run that an update does not repeat
    repeated = {*(table_stage(name) for name in RECOMPUTED), *REPEATED_STAGES}
    lost = (*(one for one in of.verdict.left_out if one.stage not in repeated), *guard.entries())
    convergence = {
        label: ConvergenceEntry(
            r_hat_max=None,
            ess_min=one.effective,
            sentence=sentences("run", "taken_in", one=one),
            usable=True,
        )
        for label, one in entry.posteriors.items()
    }
    folder.write(of.verdict.model_copy(update={**dict(doubted), "left_out": lost}))
    folder.write_left_out(guard.traces())
    new = {
        **dict(doubted),
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "version": bayesdeg.__version__,
        "versions": library_versions(),
        "counts": {**of.run.counts, **draw_counts(results)},
        "emulator": emulator,
        "seconds": {**of.run.seconds, "update": round(time.perf_counter() - begun, 2)},
        "memory": {**of.run.memory, **peaks_of_memory("update")},
        "rests_on": kind.basis(after, base),
        "comparisons": tuple(compared),
        "convergence": {**of.run.convergence, **convergence},
        "model": kind.tested(base, results.final.model, after),
        "posteriors": folder.posterior_hashes(),
        "left_out": lost,
        "update": entry,
    }
    folder.write(of.run.model_copy(update=new))


def _moved(taken: TakenIn) -> pd.DataFrame:
    """Return the shift of each parameter."""
    table = taken.fit.model.table
    new = taken.fit.chain.vectors.reshape(-1, len(table))
    before, after = (table.named(vectors) for vectors in (taken.before, new))
    rows = [
        {
            "parameter": p.name,
            "unit": p.unit,
            "mean_before": float(np.mean(before[p.name])),
            "sd_before": float(np.std(before[p.name])),
            "mean": float(np.mean(after[p.name])),
            "sd": float(np.std(after[p.name])),
        }
        for p in table.parameters
    ]
    frame = pd.DataFrame(rows)
    frame["shift_sd"] = (frame["mean"] - frame["mean_before"]) / frame["sd_before"]
    return frame
