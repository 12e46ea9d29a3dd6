"""Virtual studies in which walls break at the weakest of their integration points.

    uv run python benchmarks/rupture_studies.py --out studies/gelatin_rupture

writes the study of that name; its fields are solved first where they are missing, half a minute
each (``rupture_fields.py``). Nothing here asks the statistical model that is fitted, nor any cause.

Every integration point of the finer mesh has a strength of its own, as strong as films of its own
volume would be: ε_i = ε̃ (E_i V₀/(v_i ln 2))^(1/m), E_i exponential, ε̃ the median and V₀ the volume
of films. An actuator bursts at the pressure at which the first point is strained beyond its
strength. Flaws are cracks: their number is Poisson and grows with the degradation rate beyond an
onset, each sits at a random point, of the volume or of a skin of 0.5 mm, and starts to tear where
the energy stored about it does, W(ε_c) = W(ε_i) a₀/a (Greensmith 1963; Rivlin and Thomas 1953, doi:
10.1002/pol.1953.120100303), with the ratio a/a₀ of its length to that of an ordinary defect drawn
from a log-normal law. Specimens of a level are of one material; their stiffness scatters, and so
does the degradation rate that is recorded of them.
"""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from rupture_fields import LARGEST, SKIN, Field, field_of, path_of, solved, world_truth

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import FINE
from bayesdeg.data.settings import Dimensions, Noise, RuptureOptions, Settings
from bayesdeg.files import write_text
from bayesdeg.laboratory.experiment import (
    Bent,
    Breaking,
    Design,
    VirtualExperiment,
    experiment_with,
    read_actuators,
)
from bayesdeg.laboratory.truth import Truth
from bayesdeg.laboratory.writing import TRUTH_FILE, Provenance, study_files
from bayesdeg.material.hyperelastic import yeoh_basis
from bayesdeg.material.strength import GUMBEL
from bayesdeg.priors import LogNormal

Floats = NDArray[np.float64]

CRITERION: Final = "weakest_link"
FILM_VOLUME = Settings().rupture.film_volume
SPREAD = 0.4  # standard deviation of ln length of flaws
MARGIN, MARGIN_FLAWED = (-0.35, 0.25), (0.25, 0.7)
OWN_MARGIN = 0.08
"""ln of the films' median strain at break over what the largest pressure demands: where it lies,
and its standard deviation from node to node of the degradation rate."""
STEP = 20.0  # kPa
REPLICATES = 3
WORST = 25.0  # %, at which the number of flaws is given
GRID = np.linspace(0.0, 4.0, 4001)  # strains at which energies are looked up


@dataclass(frozen=True)
class Flaws:
    """Cracks in actuators.

    Parameters
    ----------
    number : float
        Mean number in an actuator of 25 % degradation.
    onset : float
        Degradation rate up to which there are none [%]; from there the number grows straight.
    length : float
        Median of a/a₀, their length over that of an ordinary defect [–].
    surface : bool
        Whether they sit in the skin alone.
    """

    number: float
    onset: float
    length: float
    surface: bool

    def expected(self, level: float) -> float:
        """Return the mean number at a degradation rate [%]."""
        return self.number * max(0.0, (level - self.onset) / (WORST - self.onset))


class Inflated(NamedTuple):
    """Actuators that were inflated until they burst.

    Parameters
    ----------
    stiffness : array, shape (n,)
        Deviation of ln stiffness.
    burst : array, shape (n,)
        Pressure at which the first point breaks [kPa]; inf beyond the largest that was solved.
    whole : array, shape (n,)
        The same without flaws.
    flaws : array, shape (n,)
        How many there are.
    """

    stiffness: Floats
    burst: Floats
    whole: Floats
    flaws: NDArray[np.int64]


@dataclass(frozen=True)
class RuptureStudy:
    """What is true in a study.

    Parameters
    ----------
    world : int
        Whose fields it uses, see ``rupture_fields.py``.
    truth : Truth
        Material, scatter, errors of reading; the scatter of the elongation says Weibull's modulus.
    flaws : Flaws, optional
        None where there are none.
    """

    world: int
    truth: Truth
    flaws: Flaws | None

    @property
    def modulus(self) -> float:
        """Weibull's modulus of films."""
        return float(GUMBEL / self.truth.elongation_scatter)


def drawn_study(number: int, worlds: Sequence[int], *, seed: int, flawed: bool) -> RuptureStudy:
    """Draw a study: elongation of films, its scatter, errors, and flaws if there are any.

    Films break at strains about those that the largest pressure demands of actuators, so that some
    actuators burst and some do not; where there are flaws films bear more, and few burst without.
    """
    generator = np.random.default_rng((seed, number))
    world = int(worlds[number % len(worlds)])
    modulus = float(np.exp(generator.uniform(np.log(7.0), np.log(30.0))))
    margin = float(generator.uniform(*(MARGIN_FLAWED if flawed else MARGIN)))
    ratio = np.exp(margin + OWN_MARGIN * generator.standard_normal(3))
    at_nodes = demand_at_nodes(world, world_truth(world), modulus) * ratio
    fresh, middle, last = (100.0 * at_nodes).tolist()
    truth = replace(
        world_truth(world),
        elongation=(fresh, middle, last),
        elongation_scatter=GUMBEL / modulus,
        curvature_noise_length=float(generator.uniform(5.0, 24.0)),
        tensile_noise_length=0.1,
        reading_correlation=0.3,
    )
    flaws = Flaws(
        number=float(generator.uniform(10.0, 25.0)),
        onset=float(generator.uniform(6.0, 17.0)),
        length=float(np.exp(generator.uniform(np.log(25.0), np.log(100.0)))),
        surface=bool(generator.random() < 0.5),
    )
    return RuptureStudy(world, truth, flaws if flawed else None)


def demand_at_nodes(world: int, truth: Truth, modulus: float) -> Floats:
    """Return the strain that breaks a film as often as the largest pressure breaks an actuator.

    At 0, 12.5 and 25 %; that of the middle is the geometric mean of 10 and 15 %.
    """
    found = {}
    for level, largest in LARGEST.items():
        field = field_of(world, level)
        weights = 2.0 * truth.volume_ratio * field.volume / FILM_VOLUME
        strains = (field.strain**modulus @ weights) ** (1.0 / modulus)
        found[level] = np.interp(
            largest / (1e3 * truth.constants([level])[0, 0]), field.load, strains
        )
    return np.array([found[0.0], np.sqrt(found[10.0] * found[15.0]), found[25.0]])


def inflated(
    study: RuptureStudy, level: float, field: Field, count: int, generator: np.random.Generator
) -> Inflated:
    """Draw actuators of a level, the strengths of their points and their flaws; inflate them."""
    truth, rows = study.truth, []
    law = _EnergyLaw.of(truth, level)
    volume = 2.0 * truth.volume_ratio * field.volume / FILM_VOLUME  # the field is of a half
    share = field.volume * (field.depth < SKIN if study.flaws and study.flaws.surface else 1.0)
    deviation = truth.stiffness_scatter * generator.standard_normal(count)
    to_pressure = 1e3 * truth.constants([level])[0, 0] * np.exp(deviation)
    median = float(truth.limit_stretch([level])[0]) - 1.0
    for _ in range(count):
        scaled = generator.standard_exponential(len(volume)) / (volume * np.log(2.0))
        strength = median * scaled ** (1.0 / study.modulus)
        number = generator.poisson(study.flaws.expected(level)) if study.flaws else 0
        places = generator.choice(len(volume), number, p=share / share.sum())
        longer = np.exp(SPREAD * generator.standard_normal(number))
        weak = strength.copy()
        if study.flaws:
            torn = law.torn(median, longer * study.flaws.length)
            np.minimum.at(weak, places, torn)
        rows.append((first_broken(field, weak), first_broken(field, strength), number))
    loads, without, numbers = np.array(rows).reshape(-1, 3).T
    return Inflated(deviation, loads * to_pressure, without * to_pressure, numbers.astype(int))


def first_broken(field: Field, strength: Floats) -> float:
    """Return the load at which a first point is strained beyond its strength; inf if none is.

    Examples
    --------
    >>> one = np.ones(1)
    >>> strain = np.array([[0.0], [0.1], [0.4]])
    >>> field = Field(np.array([0.0, 1.0, 2.0]), strain, one, one, one, one)
    >>> round(first_broken(field, np.array([0.2])), 6), first_broken(field, np.array([0.5]))
    (1.5, inf)
    """
    over = field.strain >= strength
    broken = over.any(axis=1)
    if not broken.any():
        return float("inf")
    k = int(np.argmax(broken))
    if k == 0:
        return 0.0
    some = over[k]
    low, high = (np.log(np.maximum(field.strain[i, some], 1e-9)) for i in (k - 1, k))
    part = (
        np.min((np.log(strength[some]) - low) / (high - low))
        if k > 1
        else np.min(strength[some] / field.strain[k, some])
    )
    return float(field.load[k - 1] + np.clip(part, 0.0, 1.0) * (field.load[k] - field.load[k - 1]))


@dataclass(frozen=True)
class _EnergyLaw:
    """Energy of uniaxial tension over the strain, as far as it rises, [MPa] at `GRID`."""

    energy: Floats

    @classmethod
    def of(cls, truth: Truth, level: float) -> "_EnergyLaw":
        stretch = 1.0 + GRID
        stress = yeoh_basis(stretch, "uniaxial", "nominal") @ truth.constants([level])[0]
        mean = 0.5 * (stress[1:] + stress[:-1])
        return cls(np.concatenate([[0.0], np.cumsum(mean * np.diff(GRID))]))

    def torn(self, strain: float, longer: Floats) -> Floats:
        """Return the strains at which cracks tear that are so many times as long."""
        stored = np.interp(strain, GRID, self.energy)
        found: Floats = np.interp(stored / longer, self.energy, GRID)
        return found


def made(
    study: RuptureStudy, generator: np.random.Generator, replicates: int = REPLICATES
) -> tuple[VirtualExperiment, dict[float, Inflated]]:
    """Make every test of a study; also return its actuators by level."""
    fields = {level: field_of(study.world, level) for level in LARGEST}
    drawn: dict[float, Inflated] = {}

    def inflate(source: np.random.Generator) -> tuple[pd.DataFrame, pd.DataFrame]:
        parts = [
            _tested(study, level, field, drawn, replicates, source)
            for level, field in fields.items()
        ]
        tables, actuators, bent = zip(*parts, strict=True)
        table = pd.concat(tables, ignore_index=True)
        readings = read_actuators(table, study.truth, _together(bent), source)
        return readings, pd.concat(actuators)

    breaking = Breaking(CRITERION, Geometry(Dimensions()).volume / FILM_VOLUME)
    design = Design(breaking=breaking)
    return experiment_with(design, study.truth, inflate, generator), drawn


def _tested(
    study: RuptureStudy,
    level: float,
    field: Field,
    drawn: dict[float, Inflated],
    replicates: int,
    source: np.random.Generator,
) -> tuple[pd.DataFrame, pd.DataFrame, Bent]:
    drawn[level] = found = inflated(study, level, field, replicates, source)
    error = study.truth.degradation_sd * source.standard_normal(replicates)
    recorded = np.maximum(level + error, 0.0).round(2) if level > 0.0 else np.zeros(replicates)
    names = [f"A{level:02.0f}-{copy + 1}" for copy in range(replicates)]
    pressure = np.arange(STEP, LARGEST[level] + 1.0, STEP)
    table = pd.DataFrame(
        {
            "specimen_id": np.repeat(names, len(pressure)),
            "degradation_pct": np.repeat(recorded, len(pressure)),
            "degradation_sd_pct": np.nan,
            "pressure_kPa": np.tile(pressure, replicates),
        }
    )
    actuators = pd.DataFrame(
        {
            "degradation_pct": level,
            "ln_stiffness": found.stiffness,
            "burst_kPa": found.burst,
            "burst_without_flaws_kPa": found.whole,
            "flaws": found.flaws,
        },
        index=pd.Index(names, name="specimen_id"),
    )
    return table, actuators, _bent(study.truth, level, field, found, pressure)


def _bent(truth: Truth, level: float, field: Field, found: Inflated, pressure: Floats) -> Bent:
    """Return what actuators do at pressures: bend angle over arc length, of the shrunk part."""
    scale = np.cbrt(truth.volume_ratio)
    kappa = 1e3 * field.angle / (field.length * scale)
    load = pressure / (1e3 * truth.constants([level])[0, 0] * np.exp(found.stiffness)[:, None])
    curvature = np.interp(load, field.load, kappa - kappa[0])
    angle = np.interp(load, field.load, np.degrees(field.angle - field.angle[0]))
    return Bent(curvature, angle, pressure >= found.burst[:, None])


def _together(parts: Sequence[Bent]) -> Bent:
    """Join levels; tests with fewer steps repeat their last."""
    size = max(one.curvature.shape[1] for one in parts)

    def joined(name: str) -> NDArray[Any]:
        arrays = [getattr(one, name) for one in parts]
        return np.concatenate(
            [np.pad(a, ((0, 0), (0, size - a.shape[1])), mode="edge") for a in arrays]
        )

    return Bent(joined("curvature"), joined("angle"), joined("burst"))


def settings_of(seed: int) -> Settings:
    """Return what ``study.toml`` says."""
    return Settings(
        seed=seed,
        rupture=RuptureOptions(CRITERION),
        noise=Noise(0.5),
        priors={"paper_stiffness": LogNormal(3e4, 0.4)},
    )


def write_study(
    folder: Path,
    study: RuptureStudy,
    experiment: VirtualExperiment,
    provenance: Provenance,
    settings: Settings | None = None,
) -> None:
    """Write the folder of a study, with ``truth.json``."""
    folder.mkdir(parents=True, exist_ok=True)
    settings = settings or settings_of(provenance.seed)
    for name, text in study_files(experiment, settings, provenance=provenance).items():
        if name == TRUTH_FILE:
            document = json.loads(text)
            document["causes"] = {} if study.flaws is None else {"flaws": asdict(study.flaws)}
            text = json.dumps(document, indent=2) + "\n"
        write_text(folder / name, text)


GELATIN = RuptureStudy(
    world=-1,
    truth=replace(
        world_truth(-1),
        elongation_scatter=GUMBEL / 12.0,
        curvature_noise_length=12.0,
        tensile_noise_length=0.1,
        reading_correlation=0.3,
    ),
    flaws=Flaws(number=30.0, onset=16.0, length=60.0, surface=False),
)
"""Films of the published elongation, with more scatter than three of them show, and flaws."""
SEED = 20211124
GELATIN_SETTINGS = Settings(
    title="Gelatin–glycerol actuators, 0 to 25 % degraded, inflated until they burst",
    note="Every specimen is virtual: bent by the fine finite element model, with a strength of its "
    "own at each integration point, scatter of specimens and errors of reading. The walls break at "
    "their weakest point. Which effect is hidden in it stands in truth.json, which the calibration "
    "never opens.",
    virtual=True,
    seed=SEED,
    rupture=RuptureOptions(CRITERION),
    noise=Noise(0.5),
)


def main() -> None:
    """Write the study in which actuators burst."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=SEED)
    given = parser.parse_args()
    for level in LARGEST:
        if not path_of(GELATIN.world, level).exists():
            solved(GELATIN.world, level)
    experiment, _ = made(GELATIN, np.random.default_rng(given.seed))
    command = f"python benchmarks/rupture_studies.py --out {given.out} --seed {given.seed}"
    provenance = Provenance(command=command, seed=given.seed, mesh=vars(FINE))
    write_study(given.out, GELATIN, experiment, provenance, GELATIN_SETTINGS)
    print(experiment.actuators.to_string())


if __name__ == "__main__":
    main()
