"""What a run does differently with films and actuators and with a forward map of one's own."""

from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Protocol, override

import numpy as np
import pandas as pd

from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.inputs import ForwardMap
from bayesdeg.actuator.reading import mechanics_of
from bayesdeg.analysis.calibrate import Fit, base_of, base_without_chain
from bayesdeg.analysis.films import Examination, begin_examination
from bayesdeg.analysis.judge import JUDGE_EFFORTS, OWN_EFFORTS
from bayesdeg.assembly.assemble import Assembly, assemble
from bayesdeg.assembly.outline import outline
from bayesdeg.assembly.suspects import assemble_screened
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.causes.cause import Cause
from bayesdeg.criticism.checks.count_misfit import can_be_counted
from bayesdeg.criticism.fit.search import SearchEffort
from bayesdeg.criticism.fit.trials import CandidateFit
from bayesdeg.data.plausibility import Doubt, doubts, names_alike, refuse_impossible
from bayesdeg.data.study import Study
from bayesdeg.errors import BayesdegError
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.own_map import own_map_of, probe
from bayesdeg.inference.sampling import EFFORTS
from bayesdeg.observations.catalogue import TABLES
from bayesdeg.observations.means import Means
from bayesdeg.observations.published import RSquared
from bayesdeg.observations.specimens import FilmsAndActuators
from bayesdeg.pages import tables as columns
from bayesdeg.pages.headline import forward_map_words
from bayesdeg.pages.record import BasisEntry, ModelEntry
from bayesdeg.pages.tables import ALL_LEVELS
from bayesdeg.pages.wording import sentences
from bayesdeg.prediction.predictive import specimens_tested
from bayesdeg.prediction.stored import bends_actuators, model_document
from bayesdeg.quantities import Effort
from bayesdeg.surrogate.kept import refuse_whole_range
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.trained import default_surrogate, find, to_bytes

MOST_OF_ONE_LEVEL = 2  # rows per model: its one level, and all levels pooled
SCORED_FIRST = ("model", "level", "elpd", "elpd_se", "elpd_diff", "elpd_diff_se", "rmse", "crps")
SCORED_ELSE = ("rmse_per_m", "crps_per_m")


USES = ("fitted", "held against the model", "shown")


@dataclass(frozen=True)
class Basis:
    """A file that statements of the report rest on.

    Parameters
    ----------
    file : str
        Its name.
    supports : str
        The statements; empty of published statistics.
    count : int, optional
        Its specimens or films; None of published statistics.
    counts : str
        What is counted.
    virtual : bool
        Whether they are of a virtual experiment.
    quantities : tuple of str
        Published ones.
    use : str
        One of `USES`: whether the model is fitted to them, held against them, or they are shown.
    """

    file: str
    supports: str = ""
    count: int | None = None
    counts: str = ""
    virtual: bool = False
    quantities: tuple[str, ...] = ()
    use: str = "fitted"


def bases(study: Study, model: JointModel) -> Iterator[Basis]:
    """Yield the files behind the statements of the report."""
    virtual = study.settings.virtual
    for name, table in TABLES.items():
        frame = study.given(name)
        if frame is not None and table.supports:
            count = int(frame[next(iter(table.columns))].nunique())
            said = table.supports_in(degrades=study.degrades)
            yield Basis(table.file, said, count, table.counts, virtual)
    if study.summary is not None:
        used = {
            s.quantity
            for s in model.data_of(Means).statistics
            if not s.source.startswith("shrinkage.csv")
        }
        used |= set() if not model.of_kind(RSquared) else {"r_squared"}
        held = {"ruptured_count", "tested_count"} - used if can_be_counted(model) else set()
        named = {str(quantity) for quantity in study.summary["quantity"]}
        parts = (named & used, named & held, named - used - held)
        for use, quantities in zip(USES, parts, strict=True):
            if quantities:
                yield Basis("summary.csv", quantities=tuple(sorted(quantities)), use=use)


class ModelKind(Protocol):
    """What a run is of; what a class does not override is that of films and actuators."""

    is_of_actuators: bool = True
    #: Causes that a model may have besides those given to it.
    catalogue: Mapping[str, Cause] = CATALOGUE
    #: Tables of a run folder that it does not have.
    without: frozenset[str] = frozenset()
    #: What to do where no cause is a candidate.
    remedy_no_candidates: str = "name at least one cause, or 'all'"

    # ---- before calibration

    def assembled(self, study: Study, forward: ForwardMap | None) -> Assembly:
        """Refuse impossible data, find the surrogate, and build the base model of a study.

        Raises
        ------
        BayesdegError
            If there is no surrogate of the geometry.
        """
        plan = outline(study, emulated=forward is None or isinstance(forward, Surrogate))
        refuse_impossible(doubts(study, plan.expected))
        if forward is None and plan.needs_forward:
            geometry = geometry_of_study(study.settings)
            refuse_whole_range(geometry)
            found = find(geometry)
            if found.surrogate is None:
                raise BayesdegError(
                    f"{found.reason}; use Model(study, bayesdeg.emulator(study)), which finds the "
                    "emulator that `bayesdeg run` trained here, or trains one"
                )
            forward = found.surrogate
        return assemble_screened(study, forward)

    def doubts(self, study: Study) -> tuple[Doubt | str, ...]:
        """Return doubts about the data of a study.

        Raises
        ------
        StudyError
            If they are impossible.
        """
        return refuse_impossible(doubts(study, outline(study).expected))

    def try_out(self, density: JointModel) -> None:
        """Report code of a user that fails, before anything is computed."""
        return

    def is_parallel(self, model: JointModel, causes: tuple[Cause, ...]) -> bool:
        """Return whether other processes can compute a model with these causes.

        Functions of a user exist in this process only.
        """
        forward = mechanics_of(model.world.forward)
        return isinstance(forward, Surrogate) and all(map(_is_ours, causes))

    def surrogate_bytes(self, forward: Surrogate | None) -> bytes:
        """Return the stored surrogate of a run, by default the one of the package."""
        return to_bytes(forward or default_surrogate())

    # ---- verdict

    def search_effort(self, effort: Effort) -> SearchEffort:
        """Return what the search for causes may cost."""
        return JUDGE_EFFORTS[effort]

    def start_of_search(
        self, base: Fit, seed: np.random.SeedSequence
    ) -> tuple[CandidateFit, np.random.SeedSequence]:
        """Return the base model as the search takes it, and the seed of the search."""
        return base_of(base), seed

    def fold_seed(self, verdict: np.random.SeedSequence) -> np.random.SeedSequence:
        """Return the seed with which a verdict holds out data."""
        return verdict.spawn(3)[1]

    def gain(self, table: pd.DataFrame) -> pd.DataFrame:
        """Return the gain on held-out data in the units of the readings."""
        return table

    def is_averaged(self, final: JointModel) -> bool:
        """Return whether predictions are averaged over causes that cannot be told apart."""
        return bends_actuators(final.table.names)

    def begin_films(
        self,
        study: Study,
        model: JointModel,
        seed: np.random.SeedSequence,
        executor: Executor | None,
    ) -> Examination | None:
        """Start the analysis of the films alone; None if there can be none."""
        effort = EFFORTS[study.settings.sampling.effort]
        return begin_examination(study, model, effort=effort, seed=seed, executor=executor)

    # ---- prediction and record of a run

    def refuse_unpredictable(self, final: JointModel, study: Study) -> None:
        """Refuse a posterior that predicts nothing, being of films alone.

        Raises
        ------
        BayesdegError
            Saying what the study lacks.
        """
        if not bends_actuators(final.table.names):
            raise BayesdegError(
                f"{study.name} has no actuator readings, so its posterior cannot predict "
                "actuators; add actuator.csv to the study"
            )

    def tested(self, base: JointModel, final: JointModel, study: Study) -> ModelEntry | None:
        """Return what predictions need to know of a model and its data; None if nothing.

        Counts that the final model fits are checks too.
        """
        tested = specimens_tested(final) or None
        return model_document(base, study).model_copy(update={"rupture_checks": tested})

    def basis(self, study: Study, model: JointModel) -> tuple[BasisEntry, ...]:
        """Return the statements of the report with the data behind them."""
        dimensions = (
            one for one in study.settings.uncertain if one.parameter.name in model.table.names
        )
        return (
            *(_entry("statement", "basis", one) for one in bases(study, model)),
            *(_entry("dimension", "dimension_basis", one) for one in dimensions),
        )

    def source(self, model: JointModel) -> str:
        """Return where a user's forward map stands; empty if there is none."""
        return ""

    def degrades(self, study: Study) -> bool:
        """Return whether reports speak of degradation."""
        return study.degrades


class ActuatorKind(ModelKind):
    """Films and actuators."""


class OwnMapKind(ModelKind):
    """Readings and a forward map of one's own."""

    is_of_actuators = False
    catalogue: Mapping[str, Cause] = MappingProxyType({})
    without = frozenset({columns.CONSTANTS, columns.MEASURED})
    remedy_no_candidates = "give criticise(fit, causes=[...]) or Model(..., catalogue=[...])"

    @override
    def assembled(self, study: Study, forward: ForwardMap | None) -> Assembly:
        return assemble(study)

    @override
    def doubts(self, study: Study) -> tuple[Doubt | str, ...]:
        answers = assemble(study).answers
        return (*names_alike(study), *(() if answers is None else forward_map_words(answers)))

    @override
    def try_out(self, density: JointModel) -> None:
        probe(density)

    @override
    def is_parallel(self, model: JointModel, causes: tuple[Cause, ...]) -> bool:
        return False

    @override
    def surrogate_bytes(self, forward: Surrogate | None) -> bytes:
        return b""

    @override
    def search_effort(self, effort: Effort) -> SearchEffort:
        return OWN_EFFORTS[effort]

    @override
    def start_of_search(
        self, base: Fit, seed: np.random.SeedSequence
    ) -> tuple[CandidateFit, np.random.SeedSequence]:
        of_study = _of_study(seed)
        start = base_without_chain(base.model, np.random.SeedSequence(of_study))
        return start, np.random.SeedSequence(of_study)

    @override
    def fold_seed(self, verdict: np.random.SeedSequence) -> np.random.SeedSequence:
        return np.random.SeedSequence(_of_study(verdict)).spawn(2)[1]

    @override
    def gain(self, table: pd.DataFrame) -> pd.DataFrame:
        # a single level is the same as all levels
        several = table["degradation_pct"].nunique() > MOST_OF_ONE_LEVEL
        rows = table if several else table[table["degradation_pct"] == ALL_LEVELS]
        plain = rows.rename(columns={"degradation_pct": "level"}).reset_index(drop=True)
        others = (name for name in plain if name not in (*SCORED_FIRST, *SCORED_ELSE))
        return plain[[*SCORED_FIRST, *others]]

    @override
    def is_averaged(self, final: JointModel) -> bool:
        return False

    @override
    def refuse_unpredictable(self, final: JointModel, study: Study) -> None:
        return

    @override
    def begin_films(
        self,
        study: Study,
        model: JointModel,
        seed: np.random.SeedSequence,
        executor: Executor | None,
    ) -> Examination | None:
        return None

    @override
    def tested(self, base: JointModel, final: JointModel, study: Study) -> ModelEntry | None:
        return None

    @override
    def basis(self, study: Study, model: JointModel) -> tuple[BasisEntry, ...]:
        own = own_map_of(model)
        given = "readings given in Python" if study.settings.forward is None else "readings.csv"
        origin = "virtual experiment" if study.settings.virtual else "measured"
        counts = [len(np.unique(block.places.specimen)) for block in own.readings]
        read = ", ".join(
            f"{len(block.y)} of {block.name} on {count} specimens"
            for block, count in zip(own.readings, counts, strict=True)
        )
        return (
            BasisEntry(
                statement="verdict, gain, posterior", rests_on=f"{given}: {read} ({origin})"
            ),
            BasisEntry(statement="what is predicted", rests_on=own.source),
        )

    @override
    def source(self, model: JointModel) -> str:
        return own_map_of(model).source

    @override
    def degrades(self, study: Study) -> bool:
        return True


def kind_of(model: JointModel) -> ModelKind:
    """Return what a model is of."""
    return ActuatorKind() if isinstance(model.world, FilmsAndActuators) else OwnMapKind()


def kind_of_study(study: Study) -> ModelKind:
    """Return what a study is of."""
    return ActuatorKind() if study.settings.forward is None else OwnMapKind()


def _of_study(seed: np.random.SeedSequence) -> int:
    """Return the seed of the study from which a stream was spawned."""
    return int(str(seed.entropy))


def _is_ours(cause: Cause) -> bool:
    """Return whether a cause is from the catalogue, whatever its priors."""
    known = CATALOGUE.get(cause.name)
    return known is not None and replace(cause, parameters=known.parameters) == known


def _entry(statement: str, basis: str, one: object) -> BasisEntry:
    fill = partial(sentences, "run", one=one)
    return BasisEntry(statement=fill(statement), rests_on=fill(basis))
