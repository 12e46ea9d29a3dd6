"""Curvatures per second in batches of the sampler's size, and training time."""

import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from emulator_held_out import HeldOut

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.data.settings import Dimensions
from bayesdeg.surrogate.campaign import build, runs
from bayesdeg.surrogate.kept import Recipe
from bayesdeg.surrogate.solutions import SolutionStore
from bayesdeg.surrogate.surrogate import Surrogate
from bayesdeg.surrogate.trained import to_bytes

WALKERS, SPECIMENS, PRESSURES = 64, 18, 12
REPEATS = 15
CAUSES = ("base", "skin", "paper_slack", "second_invariant")


@dataclass(frozen=True)
class Rate:
    """Predictions a second of one core, by its own time and by the clock on the wall [1/s]."""

    processor: float
    wall: float


def batch() -> Inputs:
    """Return the inputs of half an ensemble: walkers about a posterior, specimens, pressures."""
    rng = np.random.default_rng(1)
    level = np.linspace(0.0, 1.0, SPECIMENS)[None, :, None]
    c1 = np.exp(
        np.log(0.288)
        + np.log(1.588 / 0.288) * level
        + 0.03 * rng.standard_normal((WALKERS, SPECIMENS, 1))
    )
    walker = rng.standard_normal((3, WALKERS, 1, 1))
    c3 = np.exp(np.log(0.003) + np.log(0.1175 / 0.003) * level + 0.2 * walker[0])
    return Inputs(
        pressure=np.tile(np.linspace(20.0, 220.0, PRESSURES), (SPECIMENS, 1)),
        c1=c1,
        c2=(-0.1 - 0.1 * level) * np.sqrt(3.0 * c1 * c3),
        c3=c3,
        linear_scale=np.cbrt(0.62 + 0.02 * walker[1]),
        paper_stiffness=3e4 * np.exp(0.1 * walker[2]),
    )


def with_cause(inputs: Inputs, cause: str) -> Inputs:
    """Return the inputs with one cause at work in every walker, at sizes of its own."""
    share = np.linspace(0.5, 1.0, WALKERS)[:, None, None]
    if cause == "skin":
        return replace(inputs, skin=0.5 * share)
    if cause == "paper_slack":
        return replace(inputs, paper_slack=0.02 * share)
    if cause == "second_invariant":
        return replace(inputs, second_invariant=0.05 * share)
    return inputs


def points_per_second(emulator: Surrogate) -> dict[str, Rate]:
    """Time all kinds of batches in turn; the rates are of the median batch."""
    batches = {cause: with_cause(batch(), cause) for cause in CAUSES}
    processor: dict[str, list[float]] = {cause: [] for cause in CAUSES}
    wall: dict[str, list[float]] = {cause: [] for cause in CAUSES}
    answered = {cause: np.isfinite(emulator(inputs).sd) for cause, inputs in batches.items()}
    for _ in range(REPEATS):
        for cause, inputs in batches.items():
            start, clock = time.process_time(), time.perf_counter()
            emulator(inputs)
            processor[cause].append(time.process_time() - start)
            wall[cause].append(time.perf_counter() - clock)
    # refused values are no predictions
    return {
        cause: Rate(
            float(answered[cause].sum()) / statistics.median(processor[cause]),
            float(answered[cause].sum()) / statistics.median(wall[cause]),
        )
        for cause in CAUSES
    }


def speedup(curves: Sequence[HeldOut], rate: Rate) -> dict[str, float]:
    """Compare a curve of twelve pressures: the fine mesh's median against the emulator."""
    seconds = statistics.median(held.seconds for held in curves)
    emulated = PRESSURES / rate.processor
    return {
        "ratio": seconds / emulated,
        "finite_element_seconds": seconds,
        "emulator_seconds": emulated,
    }


def training(store: SolutionStore, shipped: Surrogate) -> dict[str, object]:
    """Train anew from the solutions in the store, unless it lacks some."""
    geometry, recipe = Geometry(Dimensions()), Recipe()
    wanted = runs(geometry, recipe)
    seconds = store.seconds()
    coarse = [run.key() for run in wanted if run.resolution == recipe.coarse_mesh]
    facts = core_hours([run.key() for run in wanted], seconds) | {
        "coarse_runs": len(coarse),
        "fine_runs": len(wanted) - len(coarse),
        "coarse_core_hours": core_hours(coarse, seconds)["core_hours"],
    }
    if facts["runs_not_in_store"]:
        return facts
    start, clock = time.process_time(), time.perf_counter()
    trained = build(geometry, store)
    return facts | {
        "training_seconds": time.perf_counter() - clock,
        "training_processor_seconds": time.process_time() - start,
        "same_bytes_as_shipped": to_bytes(trained) == to_bytes(shipped),
    }


def core_hours(keys: Sequence[str], seconds: Mapping[str, float]) -> dict[str, object]:
    known = [seconds[key] for key in keys if key in seconds]
    return {
        "runs": len(keys),
        "runs_not_in_store": len(keys) - len(known),
        "core_hours": sum(known) / 3600.0,
    }
