"""numpyro's No-U-Turn sampler on a density of ours: nothing of our sampler, starts apart.

numpyro is handed values and gradients by a callback. Gradients are central differences, all in one
batch: they need no second implementation of the model, and a sampler that accepts by energy does
not become wrong by them.
"""

import time
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from numpyro.infer import MCMC, NUTS

numpyro.enable_x64()

STEP = 1e-4  # in standard deviations of the posterior
IMPOSSIBLE = -1e12


@dataclass(frozen=True)
class Nuts:
    """Draws of one chain.

    Parameters
    ----------
    vectors : array, shape (n, n_parameters)
        On the unconstrained scale, after adaptation.
    divergent : int
        Draws whose path was cut off.
    gradients : int
        Gradients after adaptation.
    seconds, wall_seconds : float
        Of the processor and by the clock on the wall, after adaptation.
    """

    vectors: np.ndarray
    divergent: int
    gradients: int
    seconds: float
    wall_seconds: float


def potential(density, width):
    """Return −log density as a jax function of a vector."""
    size = len(width)
    moves = STEP * np.vstack([np.zeros(size), np.diag(width), -np.diag(width)])

    def with_gradient(vector):
        around = np.asarray(vector)[None] + moves
        found = np.maximum(density.log_prob(around), IMPOSSIBLE)
        slope = (found[1 : size + 1] - found[size + 1 :]) / (2.0 * STEP * width)
        return -found[0], -slope

    shapes = (
        jax.ShapeDtypeStruct((), jnp.float64),
        jax.ShapeDtypeStruct((size,), jnp.float64),
    )
    called = partial(jax.pure_callback, with_gradient, shapes, vmap_method="sequential")

    @jax.custom_vjp
    def energy(vector):
        return called(vector)[0]

    energy.defvjp(called, lambda slope, cotangent: (cotangent * slope,))
    return energy


def nuts(density, start, covariance, *, warmup, draws, seed):
    """Sample from a start with a dense mass matrix that goes on adapting in the warm-up."""
    kernel = NUTS(
        potential_fn=potential(density, np.sqrt(np.diag(covariance))),
        inverse_mass_matrix=jnp.asarray(covariance),
        dense_mass=True,
    )
    chain = MCMC(kernel, num_warmup=warmup, num_samples=draws, progress_bar=False)
    key, other = jax.random.split(jax.random.key(seed))
    chain.warmup(key, init_params=jnp.asarray(start))
    begin, clock = time.process_time(), time.perf_counter()
    chain.run(other, extra_fields=("diverging", "num_steps"))
    vectors = np.asarray(chain.get_samples())
    fields = chain.get_extra_fields()
    return Nuts(
        vectors,
        int(np.sum(fields["diverging"])),
        int(np.sum(fields["num_steps"])),
        time.process_time() - begin,
        time.perf_counter() - clock,
    )
