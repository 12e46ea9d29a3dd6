"""Objects of the library: a model, its calibration, the verdict, the report."""

import html
import os
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from copy import copy
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Self, cast

import numpy as np
import pandas as pd
import xarray as xr

from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.analysis.calibrate import Fit
from bayesdeg.analysis.films import course_of
from bayesdeg.analysis.judge import Judgement
from bayesdeg.analysis.model_kind import ModelKind, kind_of, kind_of_study
from bayesdeg.assembly.assemble import Assembly, assemble_own
from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.findings import Candidate
from bayesdeg.data.settings import Settings
from bayesdeg.data.study import Study
from bayesdeg.errors import BayesdegError, use_one_of
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.own_map import Forward, Readings, UserMap
from bayesdeg.inference.sampling import EFFORTS, Chain
from bayesdeg.inference.tree import to_datatree
from bayesdeg.pages.headline import size_of
from bayesdeg.pages.left_out import Guard
from bayesdeg.pages.output import run_folder
from bayesdeg.pages.record import ModelEntry, VerdictRecord
from bayesdeg.pages.wording import SPACE, worded
from bayesdeg.prediction.posterior import Posterior
from bayesdeg.prediction.soil import Soil
from bayesdeg.prediction.stored import NO_COURSE
from bayesdeg.priors import Parameter
from bayesdeg.progress import Progress
from bayesdeg.quantities import Effort
from bayesdeg.run import writing
from bayesdeg.run.record import Results
from bayesdeg.run.stages import (
    Clock,
    Streams,
    add_page,
    conclude,
    of_final,
    with_average,
    with_options,
)

SHOWN = 5  # candidates in a printed verdict
_CANDIDATE = [
    *("cause", "probability", "log_bayes_factor", "log_bayes_factor_error", "elpd_diff"),
    *("elpd_diff_se", "explained_fraction", "parameter", "mean", "sd", "q05", "q95", "unit", "why"),
]


def _row(entry: Candidate) -> dict[str, object]:
    """Return a candidate of ``verdict.json`` as a row, with the size of its first parameter."""
    known = entry.document()
    effects = ({"parameter": n, **one.document()} for n, one in entry.effect.items())
    return {key: known[key] for key in _CANDIDATE if key in known} | next(effects, {})


class CauseName(str):
    """The name of a cause in a verdict; `Model.with_causes` accepts it."""

    cause: Cause | None

    def __new__(cls, name: str, cause: Cause | None = None) -> Self:
        """Return a name that carries its cause."""
        made = super().__new__(cls, name)
        made.cause = cause
        return made


@dataclass(frozen=True, repr=False, eq=False)
class Model:
    """Model of an experiment: its data, forward map, priors and active causes.

    Parameters
    ----------
    data : Study or sequence of Readings
        A study of actuators or films, or readings of any other experiment.
    forward : callable, optional
        For a study, a forward map of its actuators, such as an `emulator`; by default the one
        shipped with the package or trained here. For readings, a function of ``values``, a mapping
        of names to arrays (k,), and ``x`` as in the `Readings`, that returns predictions (k, n).
        Parameters of active causes are among the values, as ``cause.parameter``.
    parameters : sequence of Parameter
        Unknowns of your own forward map, with their priors.
    catalogue : sequence of Cause
        Candidate causes for your own readings; a study uses those of the package.
    causes : sequence of Cause or str
        Active causes; see `with_causes`.

    Raises
    ------
    StudyError
        If the data of a study are impossible.
    BayesdegError
        If there is no emulator of the geometry, a cause does not exist, or shapes do not match.

    Examples
    --------
    >>> import bayesdeg as bd
    >>> def hooke(values, x):
    ...     return values["k"][:, None] * x
    >>> readings = bd.Readings([1.0, 2.0, 3.0], [2.1, 3.9, 6.2])
    >>> bd.Model([readings], hooke, parameters=[bd.Parameter("k", bd.LogNormal(2, 1))])
    Model of reading: k, reading_error
    """

    data: Study | Readings | Sequence[Readings]
    forward: ForwardMap | Forward | Mapping[str, Forward] | None = None
    _: KW_ONLY
    parameters: Sequence[Parameter] = ()
    catalogue: Sequence[Cause] = ()
    causes: Sequence[Cause | str] = ()
    assembly: Assembly = field(init=False)
    judgement: Judgement | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        """Build the model that the verbs use."""
        if not isinstance(self.data, Study):
            own = cast(Forward | Mapping[str, Forward] | None, self.forward)
            readings = UserMap.of(self.data, own)
            assembly = assemble_own(readings, self.parameters, self.catalogue)
        elif self.parameters or self.catalogue:
            raise BayesdegError(
                "a study has its own parameters and catalogue: set priors in [priors] "
                "of study.toml, and give causes to criticise(fit, causes=[...])"
            )
        else:
            found = cast(ForwardMap | None, self.forward)
            assembly = kind_of_study(self.data).assembled(self.data, found)
        object.__setattr__(self, "assembly", assembly)
        stated = self.causes
        object.__setattr__(self, "causes", ())
        self._activate(map(self.cause, stated))

    def _activate(self, causes: Iterable[Cause]) -> None:
        """Set the active causes; a user's forward map is tried with them."""
        object.__setattr__(self, "causes", tuple(causes))
        if self.causes:
            self.kind.try_out(self.density)

    @property
    def active(self) -> tuple[Cause, ...]:
        """The active causes."""
        return cast(tuple[Cause, ...], self.causes)

    @property
    def kind(self) -> ModelKind:
        """What it is of: films and actuators, or readings and a forward map of the user's."""
        return kind_of(self.assembly.model)

    @property
    def density(self) -> JointModel:
        """The sampled density.

        Raises
        ------
        BayesdegError
            If a cause acts on nothing of it, or names clash.
        """
        try:
            return self.assembly.extended(*self.active)
        except ValueError as fault:
            raise BayesdegError(str(fault)) from fault

    @property
    def settings(self) -> Settings:
        """Settings of the study, or defaults."""
        return self.assembly.study.settings

    @property
    def title(self) -> str:
        """What it is of, in words."""
        return self.settings.title or self.assembly.study.name

    @property
    def name(self) -> str:
        """The model named by its causes: ``base``, ``base+pressure_offset``."""
        return "+".join(["base", *sorted(cause.name for cause in self.active)])

    @property
    def is_parallel(self) -> bool:
        """Whether other processes can compute it, which excludes functions of the user."""
        return self.is_parallel_with(self.assembly)

    def is_parallel_with(self, assembly: Assembly) -> bool:
        """Whether they can judge it with these candidates."""
        tried = (*self.active, *assembly.candidates)
        return self.kind.is_parallel(assembly.model, tried)

    def cause(self, given: Cause | str) -> Cause:
        """Return a cause by name, with the priors of the study, or a given cause unchanged.

        Raises
        ------
        BayesdegError
            If there is none of that name; the message suggests the nearest.
        """
        if isinstance(given, Cause):
            return given
        known = {**self.kind.catalogue}
        known |= {one.name: one for one in (*self.assembly.causes, *self.active)}
        if given not in known:
            remedy = use_one_of(given, known) if known else "give the bayesdeg.Cause itself"
            raise BayesdegError(f"there is no cause {given!r}; {remedy}")
        return known[given]

    def with_causes(self, *causes: Cause | str) -> Self:
        """Return the model with additional active causes.

        Parameters
        ----------
        *causes : Cause or str
            Names from the catalogue, as a verdict lists them, or your own causes.

        Raises
        ------
        BayesdegError
            If a name is unknown; the message suggests the nearest.
        """
        known = (one.cause or one if isinstance(one, CauseName) else one for one in causes)
        active = {one.name: one for one in (*self.active, *map(self.cause, known))}
        found = copy(self)
        object.__setattr__(found, "judgement", None)
        found._activate(active.values())
        return found

    def with_verdict(self, verdict: "Verdict") -> Self:
        """Return the model that ``bayesdeg run`` uses for predictions after this verdict.

        Its causes are ``verdict.predicted_with``, including a cause of rupture indicated by
        published counts. As in the command, predictions of its calibration are averaged over all
        sets of causes that the verdict could not tell apart.

        Parameters
        ----------
        verdict : Verdict
            Verdict on this model.

        Raises
        ------
        BayesdegError
            If the verdict is of a different model.
        """
        if verdict.model is not self:
            raise BayesdegError(
                "the verdict is of a different model; call with_verdict on the criticised model, "
                "verdict.model"
            )
        found = self.with_causes(*verdict.predicted_with)
        object.__setattr__(found, "judgement", verdict.judgement)
        return found

    def with_candidates(self, causes: str | Iterable[Cause | str]) -> Assembly:
        """Return what is judged, with different candidates: ``all`` of the study, or a list.

        Raises
        ------
        BayesdegError
            If there is none, or a name is unknown.
        """
        known = self.assembly
        listed: Iterable[Cause | str] = [causes] if isinstance(causes, str) else causes
        wanted = known.candidates if causes == "all" else [self.cause(one) for one in listed]
        if not wanted and not known.unjudged:
            raise BayesdegError(f"there are no candidate causes; {self.kind.remedy_no_candidates}")
        if causes == "all":
            return known
        names = [one.name for one in wanted]
        return replace(
            known,
            candidates=tuple(one for one in wanted if one.name not in known.unjudged),
            unjudged={n: known.unjudged[n] for n in names if n in known.unjudged},
            alike=tuple(one for one in known.alike if one.name in names),
            of_counts=tuple(one for one in known.of_counts if one.name in names),
        )

    def __repr__(self) -> str:
        """Return its title and parameters."""
        names = ", ".join(p.name for p in self.density.table.parameters)
        active = f" with {self.name.removeprefix('base+')}" if self.causes else ""
        return f"Model of {self.title}{active}: {names}"


@dataclass(frozen=True, repr=False, eq=False)
class Calibration:
    """A calibrated model.

    Parameters
    ----------
    model : Model
        The calibrated model.
    fit : Fit
        Mode, evidence and chain.
    effort, seed : str, int
        Settings of the calibration.
    seconds : float
        Its duration.
    """

    model: Model
    fit: Fit
    effort: Effort
    seed: int
    seconds: float

    @property
    def _kept(self) -> Chain:
        """The draws that a run folder keeps."""
        return self.fit.chain.thinned(EFFORTS[self.effort].kept)

    @cached_property
    def posterior(self) -> xr.DataTree:
        """Draws by name as an arviz ``DataTree``, with ``log_likelihood`` of whole specimens."""
        generator = np.random.default_rng(Streams.of(self.seed).drawing)
        return to_datatree(self.fit.model, self._kept, generator)

    @cached_property
    def drawn(self) -> Posterior:
        """Draws used to predict new specimens, as stored in a run folder.

        They are over all sets of causes that the verdict could not tell apart, if the model is that
        of a verdict.

        Raises
        ------
        BayesdegError
            If the study has no actuator readings.
        """
        fit, model = self.fit, self.model
        kind, assembly = model.kind, model.assembly
        kind.refuse_unpredictable(fit.model, assembly.study)
        final = Results(assembly, fit, fit, of_final(model.judgement, fit))
        averaged = with_average(final, Streams.of(self.seed).averaged, Guard(strict=True)).averaged
        tested = kind.tested(assembly.model, fit.model, assembly.study) or ModelEntry()
        return replace(averaged or Posterior(fit.model, self._kept), tested=tested)

    def soil(self, progress: Progress) -> Soil:
        """Return the course of degradation as ``bayesdeg run`` finds it with the same seed.

        Raises
        ------
        BayesdegError
            If the study has no moisture of films.
        """
        progress.stage("course of degradation")
        effort = EFFORTS[self.effort]
        course = course_of(self.model.assembly.study, effort, Streams.of(self.seed).films)
        if course is None:
            raise BayesdegError(NO_COURSE)
        return course.soil(effort.kept)

    @property
    def log_evidence(self) -> float:
        """Logarithm of the marginal likelihood [nats]."""
        return float(self.fit.evidence.log_evidence)

    @property
    def converged(self) -> bool:
        """Whether the draws are reliable; `print` says what to do if not."""
        return bool(self.fit.diagnosis.usable)

    def summary(self) -> pd.DataFrame:
        """Return mean, sd, 90 % interval, unit, R̂ and effective sample size by parameter."""
        table = writing.parameters(self.fit, self.model.name).set_index("parameter")
        return table[["mean", "sd", "q05", "q95", "unit", "r_hat", "ess_bulk"]]

    def __repr__(self) -> str:
        """Return its title, whether it converged, and the summary."""
        frame = self.summary().to_string(float_format=lambda value: f"{value:.4g}")
        return f"{self._title()}\n{worded(self.fit.diagnosis)}\n{frame}"

    def _title(self) -> str:
        return f"{self.model.title}: {self.model.name}, effort {self.effort}"

    def _repr_html_(self) -> str:
        frame = self.summary().to_html(float_format=lambda value: f"{value:.4g}")
        head, said = html.escape(self._title()), html.escape(worded(self.fit.diagnosis))
        return f"<h4>{head}</h4><p>{said}</p>{frame}"


@dataclass(frozen=True, repr=False, eq=False)
class Verdict:
    """Verdict on a model: what is wrong with it, if anything.

    Parameters
    ----------
    model : Model
        The criticised model.
    document : VerdictRecord
        The content of ``verdict.json``.
    judgement : Judgement or None
        Its basis; None if there was nothing to judge.
    tried : tuple of Cause
        All causes that were tried.
    seconds : float
        Its duration.
    """

    model: Model
    document: VerdictRecord
    judgement: Judgement | None
    tried: tuple[Cause, ...]
    seconds: float

    @property
    def outcome(self) -> str:
        """``adequate``, ``named``, ``ambiguous``, ``unexplained`` or ``not_judged``."""
        return str(self.document.outcome)

    @property
    def causes(self) -> tuple[CauseName, ...]:
        """Causes named, or that cannot be told apart, for `Model.with_causes`."""
        return self._named("causes")

    @property
    def predicted_with(self) -> tuple[CauseName, ...]:
        """Causes to calibrate with: one of those that cannot be told apart."""
        return self._named("predicted_with")

    def _named(self, key: str) -> tuple[CauseName, ...]:
        known = {cause.name: cause for cause in self.tried}
        names: Sequence[str] = getattr(self.document, key)
        return tuple(CauseName(name, known.get(name)) for name in names)

    @property
    def explanation(self) -> str:
        """Where the misfit is, what explains it, and how certain that is, in plain words."""
        return self.document.explanation

    @property
    def candidates(self) -> pd.DataFrame:
        """Every cause that was tried, best first: evidence, held-out gain, size with its unit.

        ``mean`` to ``unit`` are of the first parameter, the size of the cause.
        """
        return pd.DataFrame([_row(one) for one in self.document.candidates], columns=_CANDIDATE)

    def to_dict(self) -> dict[str, object]:
        """Return the content of ``verdict.json``."""
        return self.document.document()

    def _headline(self) -> str:
        record = self.document
        found = (f"{c} {size_of(record, c, interval=True)}".strip() for c in record.causes)
        said = (" or " if self.outcome == "ambiguous" else ", ").join(found)
        return f"{self.outcome}: {said}".replace(SPACE, " ") if said else self.outcome

    def __repr__(self) -> str:
        """Return the outcome with sizes, the explanation and the leading candidates."""
        short = ["cause", "probability", "log_bayes_factor", "elpd_diff", "explained_fraction"]
        tried = self.candidates.dropna(subset="probability")[short].head(SHOWN)
        said = [self._headline(), "", self.explanation]
        if len(tried):
            frame = tried.to_string(index=False, float_format=lambda value: f"{value:.3g}")
            said += ["", frame]
        return "\n".join([*said, *self._left_out()])

    def _left_out(self) -> list[str]:
        lost = self.document.left_out
        return [f"left out: {one.stage}. {one.why}" for one in lost]

    def _repr_html_(self) -> str:
        head, said = html.escape(self._headline()), html.escape(self.explanation)
        lost = "".join(f"<p>{html.escape(one)}</p>" for one in self._left_out())
        frame = self.candidates.drop(columns="why").to_html(
            index=False, na_rep="–", float_format=lambda value: f"{value:.3g}"
        )
        return f"<h4>{head}</h4><p>{said}</p>{frame}{lost}"


@dataclass(frozen=True, repr=False)
class Report:
    """A written report.

    Parameters
    ----------
    folder : Path
        The run folder.
    page : Path
        The page in it.
    """

    folder: Path
    page: Path

    def __fspath__(self) -> str:
        """Return the folder as a path."""
        return os.fspath(self.folder)

    def __repr__(self) -> str:
        """Return the place of the page."""
        return f"report: {self.page}"

    def _repr_html_(self) -> str:
        place = html.escape(self.page.resolve().as_uri(), quote=True)
        return f'<a href="{place}" target="_blank">{html.escape(str(self.page))}</a>'


def write_run(
    path: Path,
    base: Calibration,
    final: Calibration,
    verdict: Verdict,
    progress: Progress,
    executor: Executor | None,
    *,
    full: bool,
) -> Report:
    """Write a run folder and its page; parameters as of `bayesdeg.report`.

    Raises
    ------
    BayesdegError
        If the calibrations and the verdict do not belong together, or the folder is not free.
    """
    assembly, judgement = base.model.assembly, of_final(verdict.judgement, final.fit)
    settled = judgement is None or judgement.sampled or not final.fit.model.causes
    results = Results(assembly, base.fit, (final if settled else base).fit, judgement)
    guard, clock = Guard(), Clock({"base": base.seconds, "verdict": verdict.seconds})
    clock.seconds |= {"extended": final.seconds} if final.fit is not base.fit else {}
    results = with_average(results, Streams.of(base.seed).averaged, guard)
    study = with_options(assembly.study, base.effort, base.seed)
    with run_folder(path, study) as folder:
        work = partial(conclude, progress=progress, executor=executor, guard=guard, full=full)
        document = work(study, folder, results, clock)
        page = add_page(folder, document, guard)[1]
    if page is None:
        raise BayesdegError(f"{path}: the page could not be made; see left_out.txt there")
    return Report(path, page)
