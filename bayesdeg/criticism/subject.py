"""What can be judged: readings, a model of them, and causes that may extend it."""

from dataclasses import dataclass, fields
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.inference.density import Density

Floats = NDArray[np.float64]
Labels = NDArray[np.str_]


@dataclass(frozen=True)
class Places:
    """Where each reading stands, all of shape (n,).

    Parameters
    ----------
    kind : array of str
        What was read, such as ``curvature``.
    family : array of str
        Which kinds a discrepancy may have in common, such as ``actuator`` for curvature and bend
        angle.
    along : array
        Where on its path: pressure [kPa], stretch [–], height.
    level : array
        Degradation rate [%], or what else was set for the whole specimen.
    specimen : array of str
        Whose reading it is: what is held out together.
    history : array of str
        How the load was applied: branch, cycle, mount, mode of tension.
    time : array
        When [s]; nan where it was not recorded.
    """

    kind: Labels
    family: Labels
    along: Floats
    level: Floats
    specimen: Labels
    history: Labels
    time: Floats

    def __len__(self) -> int:
        """Return the number of readings."""
        return len(self.kind)

    def subset(self, rows: NDArray[np.bool_]) -> "Places":
        """Return where some of the readings stand."""
        return Places(*(getattr(self, field.name)[rows] for field in fields(self)))


class Subject(Density, Protocol):
    """A model of readings that can be criticised and extended by causes.

    Readings are flat, of shape (n,); vectors are the sampler's, (k, n_parameters).
    `bayesdeg.criticism.model_readings.ModelReadings` is the one of studies,
    `bayesdeg.criticism.custom.CustomModel` one for any other forward map.
    """

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Active causes."""
        ...

    @property
    def places(self) -> Places:
        """Where the readings stand."""
        ...

    @property
    def observed(self) -> Floats:
        """The readings, (n,)."""
        ...

    @property
    def groups(self) -> tuple[str, ...]:
        """What is held out one after another; `without` and `only` take places in it."""
        ...

    @property
    def group(self) -> Labels:
        """Which of `groups` each reading belongs to, (n,); empty if it is never held out."""
        ...

    def extended(self, *causes: Cause) -> Self:
        """Return the model with further causes active."""
        ...

    def expected(self, vectors: Floats) -> Floats:
        """Return readings of specimens that are as the model's mean, (k, n); nan if refused."""
        ...

    def scatter(self, vector: Floats) -> Floats:
        """Return the covariance of readings about them, of specimens and errors, (n, n)."""
        ...

    def simulated(self, vectors: Floats, generator: np.random.Generator) -> Floats:
        """Draw readings of new specimens in the same tests, (k, n); nan where refused."""
        ...

    def rest(self) -> Density:
        """Return priors and likelihood of all that is not among the readings."""
        ...

    def without(self, groups: NDArray[np.intp]) -> Self:
        """Return the model without the readings of some groups."""
        ...

    def only(self, groups: NDArray[np.intp]) -> Self:
        """Return the model with the readings of some groups alone."""
        ...

    def group_density(self, vectors: Floats) -> Floats:
        """Return the log density of all that was read on each group, (k, n_groups)."""
        ...


def with_neutral(vector: Floats, density: Density, extended: Density) -> Floats:
    """Return a vector of an extended model with the added parameters at their neutral values."""
    known = dict(zip(density.table.names, vector, strict=True))
    return np.array(
        [
            known[p.name] if p.name in known else float(p.law.to_unconstrained(p.neutral or 0.0))
            for p in extended.table.parameters
        ]
    )


def typical_size(cause: Cause) -> Floats:
    """Return the size that the catalogue gives for a cause, on the unconstrained scale, (k,)."""
    sizes = [
        float(p.law.to_unconstrained(cause.typical.get(p.name, p.neutral or 0.0)))
        for p in cause.parameters
    ]
    return np.array(sizes)


def columns_of(extended: Density, cause: Cause) -> list[int]:
    """Return where the parameters of a cause stand in the vectors of an extended model."""
    names = extended.table.names
    return [names.index(cause.qualified(p.name)) for p in cause.parameters]
