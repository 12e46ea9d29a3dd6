"""Tests on films: moisture, shrinkage, tension, break."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd

from bayesdeg.causes.cause import FilmConditions
from bayesdeg.laboratory.design import SPECIMEN, Design
from bayesdeg.laboratory.effects import HiddenEffect
from bayesdeg.laboratory.specimens import (
    alike_along,
    constants_of,
    draw_specimens,
    noise,
    significant,
    stated_sd,
)
from bayesdeg.laboratory.truth import Truth
from bayesdeg.material.stress import yeoh_basis
from bayesdeg.measure.course import saturating
from bayesdeg.measure.mixture import Mixture, film_volume
from bayesdeg.measure.moisture import mass_loss_from_degradation

Floats = npt.NDArray[np.float64]

DRY_MASS = 2.0  # of an undegraded film [g]
DRY_MASS_SCATTER = 0.05
MASS_POURED = 30.0  # stated by the source [g]
MASS_POURED_SCATTER = 0.01
VOLUME_RATIO_RANGE = (0.32, 0.99)  # a film neither gains volume nor was larger than what was poured


def weigh_moisture(
    table: pd.DataFrame, truth: Truth, generator: np.random.Generator
) -> pd.DataFrame:
    r"""Weigh films that come out of the soil, moist and dry.

    .. math:: M_C = M_{C0} (1 - D_R(t)/100) + \sigma z, \quad M_0 = M_d / (1 - M_C/100)

    The dry mass falls with the degradation rate by Eq. 6 of doi:10.3389/frobt.2021.760485.

    Parameters
    ----------
    table : pandas.DataFrame
        ``film_id``, ``time_h``.
    truth : Truth
        Course of degradation, moisture and its scatter.
    generator : numpy.random.Generator
        Source of randomness.

    Returns
    -------
    pandas.DataFrame
        The columns of ``moisture.csv``.
    """
    z = generator.standard_normal((2, len(table)))
    time = table["time_h"].to_numpy(np.float64)
    rate = saturating(time, truth.degradation_limit, truth.time_constant)
    content = truth.moisture_initial * (1.0 - rate / 100.0) + truth.moisture_scatter * z[0]
    lost = mass_loss_from_degradation(rate, moisture_initial_pct=truth.moisture_initial)
    dry = DRY_MASS * np.exp(DRY_MASS_SCATTER * z[1]) * (1.0 - lost / 100.0)
    moist = dry / (1.0 - content / 100.0)
    return table.assign(mass_equilibrated_g=moist.round(4), mass_dry_g=dry.round(4))


def weigh_shrinkage(
    table: pd.DataFrame,
    truth: Truth,
    generator: np.random.Generator,
    mixture: Mixture | None = None,
) -> pd.DataFrame:
    r"""Weigh films when poured, cured and conditioned.

    A conditioned film holds as much water as undegraded films do; the cured one had the volume
    :math:`V_1 = V_2/\alpha` and lost nothing but water since.

    Parameters
    ----------
    table : pandas.DataFrame
        ``film_id``.
    truth : Truth
        Volume ratio, moisture, and their scatter.
    generator : numpy.random.Generator
        Source of randomness.
    mixture : Mixture, optional
        What is poured; default 2 : 1 : 8.

    Returns
    -------
    pandas.DataFrame
        The columns of ``shrinkage.csv``.
    """
    z = generator.standard_normal((3, len(table)))
    mixture = mixture or Mixture()
    poured = MASS_POURED * np.exp(MASS_POURED_SCATTER * z[0])
    moisture = truth.moisture_initial + truth.moisture_scatter * z[1]
    ratio = np.clip(truth.volume_ratio + truth.volume_ratio_scatter * z[2], *VOLUME_RATIO_RANGE)
    solids = poured * mixture.solids
    conditioned = solids / (1.0 - moisture / 100.0)
    volume = film_volume(poured, conditioned, mixture)
    cured = conditioned + mixture.water_density * volume * (1.0 / ratio - 1.0)
    return table.assign(
        mass_poured_g=poured.round(4),
        mass_cured_g=cured.round(4),
        mass_conditioned_g=conditioned.round(4),
    )


def tear_films(
    design: Design,
    truth: Truth,
    generator: np.random.Generator,
    effects: Sequence[HiddenEffect] = (),
) -> tuple[pd.DataFrame, pd.DataFrame, pd.DataFrame]:
    """Stretch films until they break.

    Parameters
    ----------
    design : Design
        Its ``tensile`` and ``breaks``; a specimen in both is one film.
    truth : Truth
        Material, scatter, reading errors.
    generator : numpy.random.Generator
        Source of randomness.
    effects : sequence of HiddenEffect
        What is hidden in the stresses, in the order of application.

    Returns
    -------
    tensile, breaks, films : pandas.DataFrame
        The columns of ``tensile.csv`` and ``break.csv``, and the films as they really are.
        Uniaxial readings at or above a film's own limit are not there.
    """
    columns = list(SPECIMEN)
    both = pd.concat([design.tensile[columns], design.breaks[columns]])
    both = both.drop_duplicates("specimen_id")
    films = draw_specimens(
        both["specimen_id"],
        truth,
        degradation=both["degradation_pct"].to_numpy(np.float64),
        sd=stated_sd(both, truth),
        generator=generator,
    )
    limit = films["limit_stretch"].loc[design.breaks["specimen_id"]].to_numpy()
    breaks = design.breaks[columns].assign(
        degradation_sd_pct=stated_sd(design.breaks, truth),
        elongation_pct=(100.0 * (limit - 1.0)).round(2),
    )
    return _stretch(design.tensile, films, truth, generator, effects=effects), breaks, films


def _stretch(
    table: pd.DataFrame,
    films: pd.DataFrame,
    truth: Truth,
    generator: np.random.Generator,
    *,
    effects: Sequence[HiddenEffect],
) -> pd.DataFrame:
    limit = films["limit_stretch"].loc[table["specimen_id"]].to_numpy()
    if "stretch" in table:
        stretch = table["stretch"].to_numpy(np.float64)
    else:
        stretch = 1.0 + table["elongation_share"].to_numpy(np.float64) * (limit - 1.0)
    stretch = stretch.round(4)
    mode, measure = table["mode"].to_numpy(str), table["stress_measure"].to_numpy(str)
    where = films.index.get_indexer(pd.Index(table["specimen_id"]))
    constants = constants_of(films, truth)[where]
    stress = np.sum(yeoh_basis(stretch, mode, measure) * constants, axis=-1)
    level = films["degradation_pct"].to_numpy()[where]
    tests = FilmConditions(stretch[:, None], mode, measure[:, None] == "cauchy", level)
    for hidden in effects:
        if hidden.cause.on_stress is not None:
            column = stress[None, :, None]
            column = hidden.cause.on_stress(column, tests, hidden.effect, constants[None])
            stress = column[0, :, 0]
    z = alike_along(
        stretch,
        generator.standard_normal(stress.shape),
        specimen=[f"{name} {kind}" for name, kind in zip(table["specimen_id"], mode, strict=True)],
        length=truth.tensile_noise_length,
    )
    stress += noise(stress, z, floor=truth.tensile_noise_floor, share=truth.tensile_noise)
    read = table[list(SPECIMEN)].assign(
        degradation_sd_pct=stated_sd(table, truth),
        mode=mode,
        stretch=stretch,
        stress_MPa=significant(stress, 5),
        stress_measure=measure,
    )
    whole = (mode != "uniaxial") | (stretch < limit)
    kept: pd.DataFrame = read.loc[whole]
    return kept.reset_index(drop=True)
