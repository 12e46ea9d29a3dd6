"""The published numbers, and materials and curvature curves consistent with them.

Nagai, Kurita, Shintake (2021), Front. Robot. AI 8:760485; doi:10.3389/frobt.2021.760485.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.material.degradation import (
    NODES,
    Controls,
    bernstein_weights,
    constants,
    satisfies_baker_ericksen,
)
from bayesdeg.observations.curvature import actuator_parameters
from bayesdeg.observations.specimens import control_name, material_parameters
from bayesdeg.priors import Distribution
from bayesdeg.surrogate.surrogate import Surrogate

Floats = NDArray[np.float64]

LEVELS = np.array([0.0, 5.0, 10.0, 15.0, 20.0, 25.0])
R_SQUARED = np.array([0.984, 0.997, 0.982, 0.931, 0.920, 0.861])
RUPTURED = np.array([0, 0, 0, 0, 0, 2])
SPECIMENS = 3
PRESSURES = np.arange(20.0, 241.0, 20.0)
"""Without 0 kPa, where curvature is zero by its definition; that reading counts in R²."""
YOUNG_FRESH = (1.73, 0.15)
YOUNG_DEGRADED = (5.5 * 1.73, 0.5)
ELONGATION_FRESH = (209.8, 6.3)
ELONGATION_DROP = 4.0

NODES_USED = NODES[2]
DEGRADATIONS = np.arange(0.0, 36.0)
"""Grid of D_R on which curves are known [%]; errors that lead out of it are cut."""


@dataclass(frozen=True)
class Materials:
    """Unknowns of the material and the actuator, one row a draw.

    Parameters
    ----------
    c1, softening, c3 : array, shape (n, 3)
        Control values at D_R = 0, 12.5, 25 % (`bayesdeg.material.degradation`), at the ends
        those of the constants themselves: C1 [MPa], C2/√(3 C1 C3) [–], C3 [MPa].
    volume_ratio, paper_stiffness : array, shape (n,)
        [–], [N/m].
    """

    c1: Floats
    softening: Floats
    c3: Floats
    volume_ratio: Floats
    paper_stiffness: Floats

    def __len__(self) -> int:
        """Return the number of draws."""
        return len(self.c1)

    def constants(self, degradation: Floats) -> tuple[Floats, Floats, Floats]:
        """Return C1, C2, C3 at levels of D_R, each (n, n_levels) [MPa]."""
        controls = Controls(self.c1, self.softening, self.c3)
        found = constants(controls, bernstein_weights(degradation, NODES_USED))
        return found[..., 0], found[..., 1], found[..., 2]

    def take(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> "Materials":
        """Return some of the draws."""
        return Materials(**{name: values[rows] for name, values in vars(self).items()})

    def inputs(self, degradation: Floats, pressure: Floats) -> Inputs:
        """Return inputs of the forward map, (n, n_levels, n_pressures)."""
        c1, c2, c3 = (c[..., None] for c in self.constants(degradation))
        scale = np.cbrt(self.volume_ratio)[:, None, None]
        return Inputs(pressure, c1, c2, c3, scale, self.paper_stiffness[:, None, None])


@dataclass(frozen=True)
class Curves:
    """Simulated curves on the grid of D_R.

    Parameters
    ----------
    log_curvature : array, shape (n, n_grid, n_pressures)
        ln κ, κ in 1/m.
    growth : array, shape (n, n_grid, n_pressures)
        −∂ ln κ / ∂ ln stiffness [–].
    """

    log_curvature: NDArray[np.float32]
    growth: NDArray[np.float32]

    def __len__(self) -> int:
        """Return the number of draws."""
        return len(self.log_curvature)

    def at_levels(self) -> Floats:
        """Return κ at the six levels, (n, 6, n_pressures) [1/m]."""
        return np.exp(self.log_curvature[:, LEVELS.astype(int)].astype(np.float64))


def draw(
    surrogate: Surrogate, generator: np.random.Generator, count: int
) -> tuple[Materials, Curves]:
    """Draw materials that agree with the published moduli, and their curves, by rejection."""
    kept: list[tuple[Materials, Curves]] = []
    while sum(len(materials) for materials, _ in kept) < count:
        materials = _propose(generator, 40_000)
        materials = materials.take(_agrees(materials))
        prediction = surrogate(materials.inputs(DEGRADATIONS, PRESSURES))
        whole = np.all(prediction.status == 0, axis=(1, 2))
        curvature = prediction.curvature[whole]
        growth = prediction.slope[whole] / curvature
        curves = Curves(np.log(curvature).astype(np.float32), growth.astype(np.float32))
        kept.append((materials.take(whole), curves))
    first = slice(0, count)
    joined = Materials(
        *(
            np.concatenate([getattr(materials, name) for materials, _ in kept])[first]
            for name in Materials.__dataclass_fields__
        )
    )
    logs = np.concatenate([curves.log_curvature for _, curves in kept])[first]
    return joined, Curves(logs, np.concatenate([curves.growth for _, curves in kept])[first])


def sensitivity(materials: Materials) -> Floats:
    """Return d ln C1 / d D_R at the six levels, (n, 6) [%/point]."""
    above, below = (materials.constants(LEVELS + step)[0] for step in (0.5, -0.5))
    return 100.0 * np.log(above / below)


def _propose(generator: np.random.Generator, count: int) -> Materials:
    known = (*material_parameters(NODES_USED), *actuator_parameters(float(PRESSURES[-1])))
    laws: dict[str, Distribution] = {p.name: p.law for p in known}

    def nodes(quantity: str) -> Floats:
        names = [control_name(quantity, NODES_USED, k) for k in range(len(NODES_USED))]
        return np.stack([laws[name].sample(generator, count) for name in names], axis=-1)

    c1 = nodes("c1")
    c1[:, 0] = generator.normal(*YOUNG_FRESH, count) / 6.0
    c1[:, 2] = generator.normal(*YOUNG_DEGRADED, count) / 6.0
    ratio, paper = (laws[n].sample(generator, count) for n in ("volume_ratio", "paper_stiffness"))
    return Materials(c1, nodes("c2_ratio"), nodes("c3"), ratio, paper)


def _agrees(materials: Materials) -> NDArray[np.bool_]:
    """Tell which draws have the published signs and trends: C1 and −C2 grow with D_R, C1 convex."""
    c1 = materials.c1
    trend = (c1[:, 0] > 0.0) & (c1[:, 2] - 2.0 * c1[:, 1] + c1[:, 0] >= 0.0)
    trend &= c1[:, 1] >= c1[:, 0]  # the slope at 0, the smallest of a convex curve
    trend &= np.all(materials.softening < 0.0, axis=-1)
    agrees = np.zeros(len(c1), dtype=bool)
    c1, c2, c3 = materials.take(trend).constants(DEGRADATIONS)
    # up to 25 % by construction; errors of D_R lead beyond
    stable = np.all((c3 > 0.0) & satisfies_baker_ericksen(c1, c2, c3), axis=-1)
    last = int(np.searchsorted(DEGRADATIONS, NODES_USED[-1]))
    grows = c2[:, last] < c2[:, 0]
    agrees[trend] = stable & grows
    return agrees
