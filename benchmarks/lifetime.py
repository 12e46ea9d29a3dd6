"""Virtual burials: coverage of 90 % intervals of the time to failure in the soil.

    uv run python benchmarks/lifetime.py --burials 120 --json

Actuators are put into a soil that follows a law of its own: enzymes that saturate (Michaelis and
Menten) take what binds the moisture, each piece at a rate and down to a limit of its own. Curvature
and stretch come from the second surrogate of the finer mesh (``fine_library.py``), stiffness and
limit of elongation from the laws of the virtual laboratory. An actuator fails when it bursts at
the pressure of its duty, or bends by less than asked; when it did so is found by following it.

The package sees a study folder alone: films weighed up to 24 h, films torn, actuators inflated. It
calibrates the base model and the course of degradation as ``bayesdeg run`` does, and predicts with
the saturating exponential of its course. In a third of the studies the limit of elongation falls so
far that actuators burst. Each study has several burials; what was computed is kept in
``.cache/lifetime``. ``life_coverage_90`` is the share of burials whose time to failure lies in its
90 % interval; one that outlives the films is held if the interval is open.
"""

import argparse
import json
import sys
import tempfile
import time
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from fine_library import shipped_library
from hidden_studies import HiddenStudy, made
from numpy.typing import NDArray
from scipy.special import lambertw
from threadpoolctl import threadpool_limits

from bayesdeg.actuator.inputs import ForwardMap, Inputs
from bayesdeg.analysis.calibrate import calibrate
from bayesdeg.analysis.films import course_of
from bayesdeg.assembly.assemble import assemble
from bayesdeg.data.study import read_study
from bayesdeg.inference.sampling import EFFORTS
from bayesdeg.laboratory.truth import Three, Truth
from bayesdeg.pages.checkpoints import NoCheckpoints
from bayesdeg.prediction.lifetime import Duty, life_summary, lifetime_of
from bayesdeg.prediction.posterior import Posterior
from bayesdeg.progress import Silent
from bayesdeg.run.stages import Streams

Floats = NDArray[np.float64]

STORE = Path(".cache/lifetime")
SEED = 20
EACH = 4  # burials of a study
FILM_TIMES, FILMS = (0.0, 4.0, 8.0, 12.0, 16.0, 20.0, 24.0), 9
LAST = 24.0  # h, to which a burial is followed
STEP = 0.25  # h, between which what happens is taken as straight
WEAK: Three = (120.0, 12.0, 2.0)  # elongation at break of actuators that burst in the soil [%]
DRY = 2.0  # of a film [g]


class SoilTruth(NamedTuple):
    """What the soil does to pieces of material.

    Parameters
    ----------
    limit : float
        Degradation rate that is approached [%].
    time : float
        What is there over the rate at which it is taken at first [h].
    saturation : float
        K of Michaelis and Menten, over what is there at first: large for a first-order decay.
    rate_scatter, limit_scatter : float
        Standard deviation of the logarithms from piece to piece.
    moisture, moisture_scatter, weighing : float
        Of fresh films, from film to film, and its error of weighing [%].
    """

    limit: float
    time: float
    saturation: float
    rate_scatter: float = 0.05
    limit_scatter: float = 0.02
    moisture: float = 20.0
    moisture_scatter: float = 0.2
    weighing: float = 0.1


class Piece(NamedTuple):
    """How pieces differ from the mean: factors of their rate and of their limit, (n,)."""

    rate: Floats
    limit: Floats


class Burial(NamedTuple):
    """An actuator in the soil: its piece, and its stiffness and limit in standard deviations."""

    piece: Piece
    stiffness: float
    elongation: float


def left_of(hours: Floats, saturation: float) -> Floats:
    r"""Return what Michaelis and Menten leave, q(t) with q(0) = 1 and dq/dt(0) = −1.

    .. math:: \dot q = -\frac{(K + 1) q}{K + q}, \quad
        q = K W\!\left(e^{(1 - (K + 1) t)/K}/K\right)
    """
    inside = np.exp((1.0 - (saturation + 1.0) * hours) / saturation) / saturation
    found: Floats = saturation * np.array(
        [lambertw(complex(one)).real for one in inside.ravel()]
    ).reshape(inside.shape)
    return found


def degradation(soil: SoilTruth, piece: Piece, hours: Floats) -> Floats:
    """Return degradation rates of pieces, (n, n_times) [%]."""
    scaled = hours * piece.rate[:, None] / soil.time
    rate: Floats = soil.limit * piece.limit[:, None] * (1.0 - left_of(scaled, soil.saturation))
    return rate


def pieces(soil: SoilTruth, count: int, generator: np.random.Generator) -> Piece:
    z = generator.standard_normal((2, count))
    return Piece(np.exp(soil.rate_scatter * z[0]), np.exp(soil.limit_scatter * z[1]))


def weighed(soil: SoilTruth, generator: np.random.Generator) -> pd.DataFrame:
    """Return ``moisture.csv``: each film comes out of the soil once."""
    times = np.repeat(FILM_TIMES, FILMS)
    films = pieces(soil, len(times), generator)
    rate = np.diagonal(degradation(soil, films, times))
    z = generator.standard_normal((3, len(times)))
    fresh = soil.moisture + soil.moisture_scatter * z[0]
    content = fresh * (1.0 - rate / 100.0) + soil.weighing * z[1]
    dry = DRY * np.exp(0.05 * z[2])
    return pd.DataFrame(
        {
            "film_id": [f"M{i}" for i in range(len(times))],
            "time_h": times,
            "mass_equilibrated_g": (dry / (1.0 - content / 100.0)).round(4),
            "mass_dry_g": dry.round(4),
        }
    )


@cache
def library() -> ForwardMap:
    """Return the second surrogate, loaded once."""
    return shipped_library()


def bent(truth: Truth, rate: Floats, stiffness: float, pressure: float) -> tuple[Floats, Floats]:
    """Return curvature [1/m] and largest stretch [–] of an actuator at degradation rates (n,)."""
    constants = truth.constants(rate) * np.exp(truth.stiffness_scatter * stiffness)
    c1, c2, c3 = (constants[:, i, None] for i in range(3))
    one = np.ones((len(rate), 1))
    inputs = Inputs(
        pressure=pressure * one,
        c1=c1,
        c2=c2,
        c3=c3,
        linear_scale=np.cbrt(truth.volume_ratio) * one,
        paper_stiffness=truth.paper_stiffness * one,
        paper_thickness=truth.paper_thickness * one,
    )
    prediction = library()(inputs)
    return prediction.curvature[:, 0], prediction.peak_stretch[:, 0]


def first_below(hours: Floats, margin: Floats) -> float:
    """Return when a margin falls below zero, straight between times [h]; inf if it does not."""
    below = np.flatnonzero(margin < 0.0)
    if not len(below):
        return float("inf")
    k = int(below[0])
    if k == 0:
        return float(hours[0])
    share = margin[k - 1] / (margin[k - 1] - margin[k])
    return float(hours[k - 1] + share * (hours[k] - hours[k - 1]))


def lives(truth: Truth, soil: SoilTruth, duty: Duty, burial: Burial) -> tuple[float, float]:
    """Return when an actuator bends too little, and when it bursts [h]."""
    hours = np.arange(0.0, LAST + 0.5 * STEP, STEP)
    rate = degradation(soil, burial.piece, hours)[0]
    curvature, stretch = bent(truth, rate, burial.stiffness, duty.pressure)
    if not np.all(np.isfinite(curvature)):
        raise ValueError("the library has no answer for a burial")
    limit = (truth.limit_stretch(rate) - 1.0) * np.exp(truth.elongation_scatter * burial.elongation)
    return (
        first_below(hours, curvature / duty.curvature - 1.0),
        first_below(hours, np.log(limit / (stretch - 1.0))),
    )


def duty_of(truth: Truth, soil: SoilTruth, generator: np.random.Generator) -> Duty:
    """Return a duty that the mean actuator loses after 3 to 22 h."""
    pressure = float(generator.uniform(60.0, 160.0))
    mean = Piece(np.ones(1), np.ones(1))
    at = np.array([float(generator.uniform(3.0, 22.0))])
    curvature, _ = bent(truth, degradation(soil, mean, at)[0], 0.0, pressure)
    return Duty(round(pressure, 1), float(f"{curvature[0]:.3g}"), 0.05)


def study_of(number: int, folder: Path, generator: np.random.Generator) -> tuple[Truth, SoilTruth]:
    """Write the folder of a study, and return what nobody there knows."""
    soil = SoilTruth(
        limit=float(generator.uniform(26.0, 31.0)),
        time=float(generator.uniform(9.0, 16.0)),
        saturation=float(np.exp(generator.uniform(np.log(1.0), np.log(6.0)))),
    )
    plain = HiddenStudy(number, "none", "angle", (), 0.0)
    _, truth = made(
        *(plain, folder),
        forward=library(),
        seed=SEED,
        command=f"benchmarks/lifetime.py, study {number}",
        bursts=True,
        elongation=WEAK if number % 3 == 2 else None,
    )
    (folder / "truth.json").unlink()
    weighed(soil, generator).to_csv(folder / "moisture.csv", index=False)
    return truth, soil


def buried(number: int) -> list[dict[str, Any]]:
    """Make a study, calibrate it from its folder, and hold its lives against its burials."""
    generator, begun = np.random.default_rng((SEED, number)), time.perf_counter()
    with tempfile.TemporaryDirectory() as name, threadpool_limits(limits=1):
        truth, soil = study_of(number, Path(name), generator)
        study = read_study(Path(name))
        streams, effort = Streams.of(number), EFFORTS["quick"]
        fit = calibrate(
            assemble(study).model,
            "base",
            effort=effort,
            seed=streams.base,
            checkpoints=NoCheckpoints(),
            progress=Silent(),
            executor=None,
        )
        course = course_of(study, effort, streams.films)
        assert course is not None
        found, posterior = [], Posterior(fit.model, fit.chain)
        for place in range(EACH):
            duty = duty_of(truth, soil, generator)
            z = generator.standard_normal(2)
            burial = Burial(pieces(soil, 1, generator), float(z[0]), float(z[1]))
            lost, burst = lives(truth, soil, duty, burial)
            life = lifetime_of(
                *(posterior, course.soil(effort.kept), duty, np.arange(0.0, LAST + 0.25, 0.5)),
                seed=np.random.SeedSequence([number, place]),
                progress=Silent(),
            )
            failed = min(lost, burst)
            low, middle, high = life_summary(posterior, life, duty).failure
            share = float(np.interp(min(failed, LAST), life.hours, life.failed.mean(axis=0)))
            found.append(
                {
                    "study": number,
                    "pressure": duty.pressure,
                    "curvature": duty.curvature,
                    "weak": number % 3 == 2,
                    "lost": _finite(lost),
                    "burst": _finite(burst),
                    "interval": [_finite(t) for t in (low, middle, high)],
                    "share": share,
                    "inside": bool(low <= failed <= high),
                    "usable": bool(fit.diagnosis.usable),
                }
            )
    seconds = round(time.perf_counter() - begun, 1)
    return [one | {"seconds": seconds} for one in found]


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def kept(number: int) -> list[dict[str, Any]]:
    """Return the burials of a study, from the store where they are there."""
    file = STORE / f"{number}.json"
    if not file.exists():
        STORE.mkdir(parents=True, exist_ok=True)
        found = buried(number)
        part = file.with_suffix(".part")
        part.write_text(json.dumps(found), encoding="utf-8")
        part.replace(file)
    known: list[dict[str, Any]] = json.loads(file.read_text(encoding="utf-8"))
    return known


def summary(burials: list[dict[str, Any]]) -> dict[str, Any]:
    inside = np.array([bool(one["inside"]) for one in burials])
    failed = [_earlier(one) for one in burials]
    share = np.array([float(one["share"]) for one in burials])
    ended = np.array([np.isfinite(t) for t in failed])
    wide = [
        one["interval"][2] - one["interval"][0]
        for one in burials
        if None not in (one["interval"][0], one["interval"][2])
    ]
    return {
        "burials": len(burials),
        "studies": len({one["study"] for one in burials}),
        "life_coverage_90": float(inside.mean()),
        "standard_error": float(np.sqrt(inside.mean() * (1.0 - inside.mean()) / len(inside))),
        "coverage_of_bursts": _mean(inside[[_bursts(one) for one in burials]]),
        "bursts": int(sum(_bursts(one) for one in burials)),
        "outlived": int((~ended).sum()),
        "below_interval": float(np.mean(share[ended] < 0.05)),
        "above_interval": float(np.mean(share[ended] > 0.95)),
        "median_width_h": float(np.median(wide)) if wide else None,
        "median_seconds_a_study": float(np.median([float(one["seconds"]) for one in burials])),
    }


def _earlier(one: dict[str, Any]) -> float:
    times = [float("inf") if one[n] is None else float(one[n]) for n in ("lost", "burst")]
    return min(times)


def _bursts(one: dict[str, Any]) -> bool:
    lost = float("inf") if one["lost"] is None else float(one["lost"])
    return one["burst"] is not None and float(one["burst"]) < lost


def _mean(values: NDArray[np.bool_]) -> float | None:
    return float(values.mean()) if len(values) else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--burials", type=int, default=120)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    burials: list[dict[str, Any]] = []
    number = 0
    while len(burials) < options.burials:
        burials += kept(number)
        number += 1
        done = summary(burials)
        print(
            f"{len(burials)} burials, {done['life_coverage_90']:.2f}", file=sys.stderr, flush=True
        )
    found = summary(burials[: options.burials])
    print(json.dumps(found, indent=1) if options.json else found)


if __name__ == "__main__":
    main()
