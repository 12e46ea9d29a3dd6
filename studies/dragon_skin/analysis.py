"""Causes supported by the record, their effect on C1, and prediction of a load case."""

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from bayesdeg.inference import sampling
from bayesdeg.inference.laplace import Evidence, Laplace, derivatives, evidence, positive_inverse
from bayesdeg.inference.model import JointModel
from dragon_skin import scene
from dragon_skin.causes import GEOMETRICAL, MECHANICAL
from dragon_skin.posterior import Posterior
from dragon_skin.record import CASE_OF_TAKE, CASES, REST, TIP

Floats = NDArray[np.float64]

WORTH = 1.0  # gain in log evidence that makes the search go on
DECISIVE = 3.0  # Bayes factor of 20


@dataclass(frozen=True)
class Fit:
    """A posterior, linearised at its mode, with its marginal likelihood."""

    posterior: Posterior
    mode: Floats
    evidence: Evidence

    @property
    def log_evidence(self) -> float:
        """Log marginal likelihood of the readings used."""
        return self.evidence.log_evidence

    def draws(self, generator: np.random.Generator, count: int) -> dict[str, Floats]:
        """Draw sampled parameters, by name."""
        return self.posterior.table.named(self.evidence.resample(generator, count))

    def modulus(self, generator: np.random.Generator) -> tuple[float, float]:
        """Return mean and standard deviation of E = 6 C1 [kPa]."""
        modulus = 6.0 * self.draws(generator, 4000)["c1"]
        return float(modulus.mean()), float(modulus.std())

    @property
    def values(self) -> dict[str, float]:
        """Sampled parameters at the mode, by name."""
        return {name: float(v) for name, v in self.posterior.table.named(self.mode).items()}


def fit(
    posterior: Posterior,
    generator: np.random.Generator,
    *,
    draws: int,
    near: Fit | None = None,
) -> Fit:
    """Find the mode and estimate the evidence by importance sampling around it.

    ``near`` is a fit of a similar posterior, to begin from.
    """
    known = near.values if near is not None else {}
    here, mode = posterior.at_mode({k: v for k, v in known.items() if k in posterior.table.names})
    # the posterior has what these functions ask of a model: a table and a log density
    model = cast(JointModel, here)
    covariance = positive_inverse(-derivatives(model, mode)[1])
    found = evidence(model, Laplace(mode, covariance, 0.0), generator, draws=draws)
    return Fit(here, mode, found)


def search(
    base: Posterior, generator: np.random.Generator, *, draws: int
) -> tuple[Fit, list[dict[str, Any]]]:
    """Add the geometrical cause that gains most, as long as one gains.

    Returns
    -------
    Fit
        With all causes that were added.
    list of dict
        One a round: gain in log evidence and E of each cause tried.
    """
    here, rounds = fit(base, generator, draws=draws), list[dict[str, Any]]()
    while remaining := [name for name in GEOMETRICAL if name not in here.posterior.causes]:
        tried = {
            name: fit(
                here.posterior.with_causes((*here.posterior.causes, name)),
                generator,
                draws=draws,
                near=here,
            )
            for name in remaining
        }
        best = max(tried, key=lambda name: tried[name].log_evidence)
        added = tried[best].log_evidence > here.log_evidence + WORTH
        rounds.append(
            {
                "added": best if added else None,
                "tried": {name: compare(t, here, generator) for name, t in tried.items()},
            }
        )
        if not added:
            break
        here = tried[best]
    return here, rounds


def compare(one: Fit, other: Fit, generator: np.random.Generator) -> dict[str, float]:
    """Return the gain in log evidence of one fit over another, and its E [kPa]."""
    mean, sd = one.modulus(generator)
    return {
        "gain": one.log_evidence - other.log_evidence,
        "gain_error": float(np.hypot(one.evidence.error, other.evidence.error)),
        "modulus_kPa": mean,
        "modulus_sd_kPa": sd,
    }


def one_by_one(supported: Fit, generator: np.random.Generator, *, draws: int) -> dict[str, Any]:
    """Take each supported cause away, and add each mechanical one, all else left as it is."""
    causes = supported.posterior.causes

    def variant(*names: str) -> Fit:
        posterior = supported.posterior.with_causes(names)
        return fit(posterior, generator, draws=draws, near=supported)

    removed = {name: variant(*(c for c in causes if c != name)) for name in causes}
    added = {name: variant(*causes, name) for name in MECHANICAL}
    return {
        "removed": {name: compare(f, supported, generator) for name, f in removed.items()},
        "added": {
            name: {
                **compare(f, supported, generator),
                **_moments(f.draws(generator, 4000)[name]),
            }
            for name, f in added.items()
        },
    }


def hold_out(
    models: dict[str, Fit], generator: np.random.Generator, *, draws: int, kept: int = 300
) -> dict[str, Any]:
    """Predict where the tip rests in each load case from the other two.

    The frame comes from the clamp markers and the held tip of the case itself. The score is the
    log density of the 18 coordinates held out.
    """
    results: dict[str, Any] = {}
    for name, whole in models.items():
        results[name] = {}
        for case, words in enumerate(CASES):
            held_out = np.zeros(scene.SHAPE, dtype=bool)
            held_out[case == CASE_OF_TAKE, REST, TIP] = True
            rest = fit(whole.posterior.without(held_out), generator, draws=draws, near=whole)
            score = whole.log_evidence - rest.log_evidence
            error = float(np.hypot(whole.evidence.error, rest.evidence.error))
            predicted = _predict(rest, generator, kept)[:, held_out].reshape(kept, 2, 3, 3)
            seen = whole.posterior.observed.reshape(scene.SHAPE)[held_out].reshape(2, 3, 3)
            results[name][words] = {
                "log_score": score,
                "log_score_error": error,
                **_agreement(predicted, seen),
            }
    return results


def _agreement(predicted: Floats, seen: Floats) -> dict[str, float]:
    """Compare the height of the tip: mean of three markers and two repeats, and each coordinate."""
    height = predicted[..., 2].mean(axis=(1, 2))
    away = seen - predicted.mean(axis=0)
    return {
        "height_error_mm": float(seen[..., 2].mean() - height.mean()),
        "height_sd_mm": float(height.std()),
        "rms_mm": float(np.sqrt(np.mean(away**2))),
        "within_90_pct": float(
            np.mean(
                (seen > np.quantile(predicted, 0.05, 0)) & (seen < np.quantile(predicted, 0.95, 0))
            )
        ),
    }


def _predict(rest: Fit, generator: np.random.Generator, count: int) -> Floats:
    """Draw replicas of all readings, shape (count, 6, 2, 6, 3)."""
    values = rest.draws(generator, count)
    nuisances = rest.posterior.nuisances(values, generator)
    places = scene.seen(rest.posterior.forward, values, nuisances)
    noise = values["noise"][:, None, None, None, None]
    return places + noise * generator.standard_normal(places.shape)


def residuals(of: Fit, generator: np.random.Generator, *, kept: int = 200) -> dict[str, Floats]:
    """Return observed less predicted places, (take, state, marker, coordinate) [mm].

    ``all``: with every nuisance at its posterior mean; ``mechanics``: without those that move the
    tip at rest, so that what the mechanics misses is left.
    """
    values = of.draws(generator, kept)
    nuisances = of.posterior.nuisances(values, generator)
    seen = of.posterior.observed.reshape(scene.SHAPE)
    once = nuisances.copy()
    for name in ("repeat", "rest_misfit"):
        once[:, scene.columns(name)] = 0.0
    return {
        "all": seen - scene.seen(of.posterior.forward, values, nuisances).mean(axis=0),
        "mechanics": seen - scene.seen(of.posterior.forward, values, once).mean(axis=0),
    }


def linearisation_error(of: Fit, generator: np.random.Generator, *, kept: int = 200) -> float:
    """Return the root mean square of what the linear model leaves out of draws [mm]."""
    assert of.posterior.linear is not None
    values, linear = of.draws(generator, kept), of.posterior.linear
    nuisances = of.posterior.nuisances(values, generator)
    exact = scene.seen(of.posterior.forward, values, nuisances).reshape(kept, -1)
    about = scene.seen(of.posterior.forward, values, linear.centre[None]).reshape(kept, -1)
    missed = exact - about - (nuisances - linear.centre) @ linear.design.T
    return float(np.sqrt(np.mean(missed**2)))


def sample(
    of: Fit, effort: sampling.Effort, seed: np.random.SeedSequence
) -> tuple[dict[str, Floats], dict[str, float]]:
    """Sample a posterior with emcee.

    Returns
    -------
    draws : dict of array
        Parameters by name.
    quality : dict of float
        Largest R̂ and smallest effective sample size, both over all parameters, and steps.
    """
    chain = sampling.sample(cast(JointModel, of.posterior), of.evidence, effort=effort, seed=seed)
    quality = {
        "r_hat": float(chain.r_hat().max()),
        "effective": float(chain.effective().min()),
        "steps": chain.vectors.shape[1],
        "acceptance": float(chain.acceptance.mean()),
    }
    flat = chain.vectors.reshape(-1, chain.vectors.shape[-1])
    return of.posterior.table.named(flat), quality


def summarise(draws: dict[str, Floats]) -> dict[str, Any]:
    """Return moments and quantiles by parameter, E among them, and correlations with ln C1."""
    named = {"modulus_kPa": 6.0 * draws["c1"], **draws}
    log_c1 = np.log(draws["c1"])
    return {
        name: {**_moments(x), "correlation_with_ln_c1": float(np.corrcoef(x, log_c1)[0, 1])}
        for name, x in named.items()
    }


def sorted_out(added: dict[str, Any]) -> dict[str, list[str]]:
    """Sort mechanical causes by what their evidence says: demanded, undecided, spoken against."""
    gains = {name: a["gain"] for name, a in added.items()}
    return {
        "demanded": [name for name, gain in gains.items() if gain > DECISIVE],
        "undecided": [name for name, gain in gains.items() if abs(gain) <= DECISIVE],
        "spoken_against": [name for name, gain in gains.items() if gain < -DECISIVE],
    }


def _moments(x: Floats) -> dict[str, float]:
    low, middle, high = np.quantile(x, (0.05, 0.5, 0.95))
    return {
        "mean": float(x.mean()),
        "sd": float(x.std()),
        "q05": float(low),
        "median": float(middle),
        "q95": float(high),
    }
