"""Predictions of a finished run with a user's forward map, from its folder and its study."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bayesdeg.errors import BayesdegError
from bayesdeg.inference.sampling import Chain
from bayesdeg.pipeline.assemble import assemble
from bayesdeg.pipeline.formula import DrawnFormula, OwnMap, cause_of
from bayesdeg.pipeline.output import owner_of
from bayesdeg.pipeline.reading import read_study
from bayesdeg.report.folder import POSTERIOR, POSTERIOR_BASE, RunFolder
from bayesdeg.report.record import RunRecord, VerdictRecord


@dataclass(frozen=True)
class OwnStored:
    """A user's calibrated forward map, from a run folder and its study.

    Parameters
    ----------
    own : OwnMap
        The forward map.
    fit : DrawnFormula
        Model, and the draws that were kept.
    run, verdict : RunRecord, VerdictRecord
        What is recorded of the run.
    """

    own: OwnMap
    fit: DrawnFormula
    run: RunRecord
    verdict: VerdictRecord

    @property
    def name(self) -> str:
        """The model, named by its causes."""
        return "+".join(["base", *(cause.name for cause in self.fit.model.causes)])


def is_own(path: Path) -> bool:
    """Return whether a folder is of a run with a user's forward map."""
    return bool(RunFolder(path).read_run().forward) if path.is_dir() else False


def read_own(path: Path, *, base: bool = False) -> OwnStored:
    """Read a finished run's posterior and its function.

    Parameters
    ----------
    path : Path
        The run folder.
    base : bool
        The base model instead of the final one.

    Raises
    ------
    BayesdegError
        If the study is not where it was, has changed since, or was none but a script.
    """
    folder = RunFolder(path)
    run, verdict = folder.read_run(), folder.read_verdict()
    if ":" not in run.forward:
        raise BayesdegError(
            f"{path} was written from Python and its forward map is not stored: predict from "
            "Python with bayesdeg.predict or bayesdeg.control"
        )
    owner = owner_of(path)
    study = read_study(path / ("" if owner is None else owner.folder))
    changed = sorted(n for n, h in run.hashes.items() if study.hashes.get(n) != h)
    if changed:
        raise BayesdegError(
            f"{', '.join(changed)} of {study.name} changed since the run; run it again, so that "
            "the posterior belongs to the current function"
        )
    found = assemble(study)
    assert found.own is not None
    tree = folder.read_posterior(POSTERIOR_BASE if base else POSTERIOR)
    draws = {str(n): v.to_numpy() for n, v in tree["posterior"].to_dataset().items()}
    names = dict.fromkeys(name.split(".")[0] for name in draws if "." in name)
    model = found.model.extended(*(cause_of(name, found.candidates) for name in names))
    if set(model.table.names) != set(draws):
        raise BayesdegError(f"{path}: the posterior is of a different model; run the study again")
    vectors = model.table.vectors(draws)[:, :, None, :]
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.ones(len(vectors)))
    return OwnStored(found.own, DrawnFormula(model, chain), run, verdict)
