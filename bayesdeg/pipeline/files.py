"""The files of a run, each written on its own."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from bayesdeg.inference.ensemble import to_datatree
from bayesdeg.pipeline.calibrate import Sampled
from bayesdeg.report import columns
from bayesdeg.report.folder import POSTERIORS, RunFolder
from bayesdeg.report.left_out import Guard, posterior_stage, table_stage


@dataclass(frozen=True)
class Files:
    """Writes the files of a run, each on its own: one that fails is left out.

    Those of an earlier run in the same folder that are not written again are removed, so that all
    that is there belongs together.
    """

    folder: RunFolder
    guard: Guard
    written: set[str] = field(default_factory=set)

    def table(self, name: str, compute: Callable[[], pd.DataFrame | None]) -> pd.DataFrame | None:
        """Write what is computed as a table; None where it fails, or is nothing."""
        return self.guard.attempt(table_stage(name), self._table, name, compute)

    def _table(self, name: str, compute: Callable[[], pd.DataFrame | None]) -> pd.DataFrame | None:
        frame = compute()
        if frame is not None:
            self.folder.write_table(name, frame)
            self.written.add(name)
        return frame

    def posterior(
        self, name: str, fit: Sampled, generator: np.random.Generator, *, kept: int
    ) -> None:
        """Write draws of a posterior."""
        self.guard.attempt(posterior_stage(name), self._posterior, name, fit, generator, kept)

    def _posterior(
        self, name: str, fit: Sampled, generator: np.random.Generator, kept: int
    ) -> None:
        tree = to_datatree(fit.model, fit.chain.thinned(kept), generator)
        self.folder.write_posterior(name, tree)
        self.written.add(name)

    def remove_others(self) -> None:
        """Remove tables and posteriors of an earlier run that were not written again."""
        for name in set(columns.TABLES) - self.written:
            self.folder.remove(table_stage(name))
        for name in set(POSTERIORS) - self.written:
            self.folder.remove(posterior_stage(name))
