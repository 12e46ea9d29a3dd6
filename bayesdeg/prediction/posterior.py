"""A model and draws of it: what every prediction is asked of."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.outcome import Outcome
from bayesdeg.errors import BayesdegError
from bayesdeg.inference.model import JointModel
from bayesdeg.inference.sampling import Chain
from bayesdeg.pages.record import MemberEntry, ModelEntry, RunRecord, VerdictRecord
from bayesdeg.prediction.experience import Experience, experience_of
from bayesdeg.prediction.predictive import DRAWS, fewest_checks, specimens_tested

Range = tuple[float, float]

TIME = "time_h"  # in the soil, in tables and among the measured ranges
NOT_RECORDED = RunRecord(title="calibration")
NOT_JUDGED = VerdictRecord(outcome=Outcome.NOT_JUDGED)


@dataclass(frozen=True)
class Posterior:
    """A model, draws of it, and what was tested: fresh, stored, updated or averaged over causes.

    Parameters
    ----------
    model : JointModel
        Predicts. That of a stored run has flat priors and no data, so it cannot be calibrated.
    chain : Chain
        Draws.
    tested : ModelEntry
        Ranges of what was measured, ruptures, and how many specimens the model was checked on.
    members : tuple of MemberEntry
        Sets of causes over which the draws are averaged; none where they are of one set.
    number : array, shape (n,)
        Of the member that each draw belongs to.
    run, verdict : RunRecord, VerdictRecord
        Of the run that stored it; a fresh calibration has none, and the defaults say nothing.
    """

    model: JointModel
    chain: Chain
    tested: ModelEntry = field(default_factory=ModelEntry)
    members: tuple[MemberEntry, ...] = ()
    number: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    run: RunRecord = NOT_RECORDED
    verdict: VerdictRecord = NOT_JUDGED

    @property
    def is_stored(self) -> bool:
        """Whether a run wrote it."""
        return self.run != NOT_RECORDED

    @property
    def name(self) -> str:
        """The model by its causes: ``base``, ``base+creep``, ``base+creep or base+mullins``."""
        own = tuple(cause.name for cause in self.model.causes)
        sets = [m.causes for m in self.members] or [own]
        return " or ".join("+".join(["base", *causes]) for causes in sets)

    @property
    def measured(self) -> Mapping[str, Range]:
        """Ranges of what was measured, by name; what was not measured is not there."""
        ends = {k: [n for n in v if n is not None] for k, v in self.tested.measured.items()}
        return {name: (float(known[0]), float(known[-1])) for name, known in ends.items() if known}

    @property
    def experience(self) -> Experience:
        """How far actuators were tested, and where they burst."""
        return experience_of(self.tested)

    def checks(self, draws: int = DRAWS) -> int:
        """Return N, where 1/N is the least probability of rupture that can be known."""
        tested = int(self.tested.rupture_checks or 0) or specimens_tested(self.model)
        return fewest_checks(tested, draws)

    @property
    def each(self) -> tuple["Posterior", ...]:
        """The posterior of each set of causes over which it is averaged; none if there is one."""
        several = len(self.members) > 1
        return tuple(self._only([k]) for k in range(len(self.members)) if several)

    def with_cause(self, name: str) -> "Posterior":
        """Return the posterior of those sets of causes that include one.

        Raises
        ------
        BayesdegError
            If none does, or all do.
        """
        shared = set.intersection(*(set(m.causes) for m in self.members)) if self.members else set()
        known = sorted({cause for m in self.members for cause in m.causes} - shared)
        if name not in known:
            listed = f"give one of {', '.join(known)}" if known else "leave out --cause"
            raise BayesdegError(
                f"--cause {name} is none of the causes that the run could not tell apart; {listed}"
            )
        return self._only([k for k, m in enumerate(self.members) if name in m.causes])

    def _only(self, numbers: Sequence[int]) -> "Posterior":
        """Return some of the members, rising; causes that only others have are gone."""
        members = tuple(self.members[k] for k in numbers)
        names = {name for member in members for name in member.causes}
        model = replace(self.model, causes=tuple(c for c in self.model.causes if c.name in names))
        kept = np.isin(self.number, numbers)
        columns = [self.model.table.names.index(name) for name in model.table.names]
        chain = replace(
            self.chain,
            vectors=self.chain.vectors[:, kept][..., columns],
            log_prob=self.chain.log_prob[:, kept],
        )
        number = np.searchsorted(numbers, self.number[kept])
        return replace(self, model=model, chain=chain, members=members, number=number)
