"""Posterior of C1 and of model errors from the markers seen by the camera.

A coordinate of a marker is y = f(θ, ℓ) + ε with ε normal. θ is sampled: C1, the noise σ, what acts
through the finite element solution, and the sizes s of the other causes. ℓ ~ N(0, s² D) is
integrated out: poses and displaced markers, so small that f is linear in them about the most
probable ones, f(θ, ℓ) ≈ f(θ, ℓ₀) + A (ℓ − ℓ₀). The readings are then normal with mean
f(θ, ℓ₀) − A ℓ₀ and covariance σ² 1 + Σ s² A D Aᵀ.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from bayesdeg.priors import ParameterTable
from dragon_skin import scene
from dragon_skin.causes import C1, CAUSES, NOISE, RIG
from dragon_skin.marker_map import MarkerMap
from dragon_skin.record import HELD, NOMINAL, register

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

RESOLUTION = 1e-3  # a noise far below the last digit of the record has no meaning [mm]
LARGEST = 100.0  # nor has a prior spread beyond the beam's length [mm]
STEP = 1e-4  # of a prior standard deviation or so, in mm or rad


@dataclass(frozen=True)
class Linear:
    """The model in ℓ about a point, in the space of readings that ℓ can reach.

    Parameters
    ----------
    centre : array, shape (n_nuisances,)
        ℓ₀.
    design : array, shape (all readings, n_nuisances)
        A.
    basis : array, shape (n_used, n_reached)
        Orthonormal basis of the reached space.
    spans : array, shape (n_blocks, n_reached, n_reached)
        A D Aᵀ of each block in that basis, at a size of 1 [mm²].
    """

    centre: Floats
    design: Floats
    basis: Floats
    spans: Floats


@dataclass(frozen=True)
class Posterior:
    """A posterior density up to a constant, in the form that the project's sampler takes.

    Parameters
    ----------
    record : array, shape (6, 2, 6, 3)
        Marker positions: take, held or at rest, marker, coordinate [mm].
    forward : MarkerMap
        Finite element solutions.
    causes : tuple of str
        Names of the active causes.
    used : array of bool, shape (6, 2, 6, 3)
        Readings that count; the others are held out.
    linear : Linear, optional
        Set by `linearised`, which begins at the last one's centre.
    """

    record: Floats
    forward: MarkerMap
    causes: tuple[str, ...]
    used: Flags
    linear: Linear | None = None

    @cached_property
    def table(self) -> ParameterTable:
        """Sampled parameters."""
        rig = [block.size for block in RIG.values()]
        extra = [CAUSES[name].sampled for name in self.causes]
        return ParameterTable((C1, NOISE, *(p for p in (*rig, *extra) if p is not None)))

    @cached_property
    def blocks(self) -> tuple[str, ...]:
        """Names of the active blocks of ℓ."""
        return (*RIG, *(name for name in self.causes if name in scene.BLOCKS))

    def with_causes(self, causes: Iterable[str]) -> Self:
        """Return this posterior with other causes, to be linearised anew."""
        return replace(self, causes=tuple(causes))

    def without(self, held_out: Flags) -> Self:
        """Return this posterior with readings held out, to be linearised anew."""
        return replace(self, used=self.used & ~held_out)

    @cached_property
    def observed(self) -> Floats:
        """The record from a first guess of the pose, flat [mm]."""
        guess = register(self.record[:, HELD].mean(axis=0), NOMINAL)
        return guess.back(self.record).ravel()

    def sizes(self, values: Mapping[str, Floats]) -> Floats:
        """Return the sizes of the active blocks, shape (n, n_blocks)."""
        one = np.ones_like(values["c1"])
        return np.stack([values.get(f"{name}_size", one) for name in self.blocks], axis=1)

    def spread(self, values: Mapping[str, Floats]) -> Floats:
        """Return the prior standard deviations of ℓ, shape (n, n_nuisances); 0 if not active."""
        total = np.zeros((len(values["c1"]), scene.COUNT))
        for name, size in zip(self.blocks, self.sizes(values).T, strict=True):
            total[:, scene.columns(name)] = size[:, None] * scene.spread(name)
        return total

    def residual(self, values: Mapping[str, Floats]) -> Floats:
        """Return all readings less their mean under the prior of ℓ, shape (n, n_readings)."""
        assert self.linear is not None
        here = scene.seen(self.forward, values, self.linear.centre[None])
        known = self.linear.design @ self.linear.centre
        return self.observed - here.reshape(len(here), -1) + known

    def linearised(self, values: Mapping[str, float]) -> Self:
        """Return this posterior with f linear in ℓ about its most probable value at θ."""
        theta = {name: np.array([value]) for name, value in values.items()}
        noise, spread, use = values["noise"], self.spread(theta)[0], self.used.ravel()
        centre = np.zeros(scene.COUNT) if self.linear is None else self.linear.centre
        for _ in range(8):
            design, here = self._design(theta, centre)
            a = design[use] * spread / noise
            misfit = (self.observed - here + design @ centre)[use] / noise
            scaled = np.linalg.solve(a.T @ a + np.eye(scene.COUNT), a.T @ misfit)
            before, centre = centre, spread * scaled
            if np.max(np.abs(centre - before)) < 1e-3:  # mm or rad
                break
        design, _ = self._design(theta, centre)
        return replace(self, linear=self._reached(centre, design))

    def log_likelihood(self, values: Mapping[str, Floats]) -> Floats:
        """Return the log density of the readings used with ℓ integrated out, shape (n,)."""
        assert self.linear is not None
        residual = self.residual(values)[:, self.used.ravel()]
        reached = residual @ self.linear.basis
        variance = values["noise"] ** 2
        quadratic, log_determinant = _normal_terms(
            np.tensordot(self.sizes(values) ** 2, self.linear.spans, axes=1), variance, reached
        )
        beyond = np.sum(residual**2, axis=1) - np.sum(reached**2, axis=1)
        count, rank = self.linear.basis.shape
        density: Floats = -0.5 * (
            quadratic
            + beyond / variance
            + log_determinant
            + (count - rank) * np.log(variance)
            + count * np.log(2.0 * np.pi)
        )
        return density

    def log_prob(self, vectors: Floats, *, truncate: bool = True) -> Floats:
        """Return the log posterior density of vectors (n, n_parameters); −inf where not solved."""
        total = self.table.log_prior(vectors, truncate=truncate)
        values = self.table.named(vectors)
        tilt = values.get("gravity_tilt", np.zeros_like(values["c1"]))
        sizes = self.sizes(values).max(axis=1)
        possible = np.isfinite(total) & self.forward.covers(values["c1"], tilt)
        possible &= (values["noise"] > RESOLUTION) & (sizes < LARGEST)
        result = np.full(len(vectors), -np.inf)
        if possible.any():
            inside = {name: x[possible] for name, x in values.items()}
            result[possible] = total[possible] + self.log_likelihood(inside)
        return result

    def at_mode(self, near: Mapping[str, float]) -> tuple[Self, Floats]:
        """Return the posterior linearised at its mode, and the mode, unconstrained.

        Parameters
        ----------
        near : dict of float
            Where to begin; for parameters not named, at the median of the prior.
        """
        start = {p.name: float(p.law.quantile(0.5)) for p in self.table.parameters} | dict(near)
        mode = self.table.vectors({name: np.array([v]) for name, v in start.items()})[0]
        here = self
        for _ in range(4):
            values = {name: float(v) for name, v in self.table.named(mode).items()}
            here = here.linearised(values)
            before, mode = mode, here._climb(mode)
            if np.max(np.abs(mode - before)) < 1e-2:
                break
        return here, mode

    def nuisances(self, values: Mapping[str, Floats], generator: np.random.Generator) -> Floats:
        """Draw ℓ given θ and the readings used, shape (n, n_nuisances)."""
        assert self.linear is not None
        use, design = self.used.ravel(), self.linear.design
        residual, spread = self.residual(values)[:, use], self.spread(values)
        draws = generator.standard_normal(spread.shape) * spread
        errors = generator.standard_normal(residual.shape) * values["noise"][:, None]
        for i, sd in enumerate(spread):
            # a draw of the joint law, moved by what the readings say against it (Matheron's rule)
            a = design[use] * sd
            covariance = a @ a.T + values["noise"][i] ** 2 * np.eye(len(a))
            surprise = residual[i] - design[use] @ draws[i] - errors[i]
            draws[i] += sd * (a.T @ np.linalg.solve(covariance, surprise))
        return draws

    def _climb(self, start: Floats) -> Floats:
        def uphill(point: Floats) -> tuple[float, Floats]:
            steps = 1e-5 * np.vstack([np.zeros(len(point)), np.eye(len(point))])
            values = np.maximum(self.log_prob(point + steps, truncate=False), -1e12)
            return -float(values[0]), (values[0] - values[1:]) / 1e-5

        found = minimize(uphill, start, jac=True, method="L-BFGS-B", options={"ftol": 1e-7})
        best: Floats = found.x
        return best

    def _design(self, theta: Mapping[str, Floats], centre: Floats) -> tuple[Floats, Floats]:
        steps = STEP * np.eye(scene.COUNT)
        forth, back = (scene.seen(self.forward, theta, centre + s * steps) for s in (1.0, -1.0))
        design: Floats = ((forth - back) / (2.0 * STEP)).reshape(scene.COUNT, -1).T
        return design, scene.seen(self.forward, theta, centre[None]).ravel()

    def _reached(self, centre: Floats, design: Floats) -> Linear:
        pieces = [
            design[self.used.ravel(), scene.columns(name)] * scene.spread(name)
            for name in self.blocks
        ]
        left, strength, _ = np.linalg.svd(np.hstack(pieces), full_matrices=False)
        basis = left[:, strength > 1e-9 * strength[0]]
        spans = np.array([(basis.T @ piece) @ (basis.T @ piece).T for piece in pieces])
        return Linear(centre, design, basis, spans)


def _normal_terms(spans: Floats, variance: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Return zᵀ C⁻¹ z and ln |C| of C = spans + variance · 1 for each row, by one factorization."""
    count, size = points.shape
    whole = np.empty((count, size + 1, size + 1))
    whole[:, :size, :size] = spans
    whole[:, np.arange(size), np.arange(size)] += variance[:, None]
    whole[:, size, :size] = whole[:, :size, size] = points
    # well above zᵀ C⁻¹ z, since C is at least the variance
    whole[:, size, size] = 2.0 * np.sum(points**2, axis=1) / variance + 1.0
    factor = np.linalg.cholesky(whole)
    quadratic = np.sum(factor[:, size, :size] ** 2, axis=1)
    diagonal = factor[:, np.arange(size), np.arange(size)]
    return quadratic, 2.0 * np.sum(np.log(diagonal), axis=1)
