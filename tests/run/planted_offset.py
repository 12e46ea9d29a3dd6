"""A study folder with every kind of data and an offset of pressure in it, solved in closed form."""

import json
from dataclasses import asdict, replace
from functools import cache

import numpy as np

from bayesdeg.causes.catalogue import find
from bayesdeg.data.settings import Dimensions
from bayesdeg.data.study import read_study
from bayesdeg.observations.breaks import Breaks
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.observations.tensile import Tensile
from tests.criticism.linear_case import tight_model, with_known_scatter
from tests.inference.small_study import altered, values_of
from tests.surrogate.closed_form import trained

OFFSET = 12.0
ONE_EACH = np.array([0, 2, 4])  # specimens: one a degradation rate
SETTINGS = """title = "Planted"
seed = 7
[causes]
candidates = ["pressure_offset", "erosion", "creep"]
[sampling]
effort = "quick"
[tensile]
fit_modes = ["uniaxial", "equibiaxial"]
[priors]
tensile_noise = { law = "lognormal", median = 0.03, sigma = 0.1 }
tensile_noise_floor = { law = "lognormal", median = 0.01, sigma = 0.1 }
curvature_noise = { law = "lognormal", median = 0.02, sigma = 0.1 }
curvature_noise_floor = { law = "lognormal", median = 0.1, sigma = 0.1 }
stiffness_scatter = { law = "lognormal", median = 0.05, sigma = 0.1 }
elongation_scatter = { law = "lognormal", median = 0.1, sigma = 0.1 }
"""
MOISTURE = "film_id,time_h,mass_equilibrated_g,mass_dry_g\n" + "".join(
    f"m{i},{time},2.5,{2.5 * (1.0 - 0.2 * (1.0 - 0.3 * (1.0 - np.exp(-time / 10.0))) - e)}\n"
    for i, (time, e) in enumerate(
        (time, 0.004 * e) for time in (0, 6, 12, 24) for e in (-1, 0, 0.5, 1)
    )
)
SUMMARY = (
    "quantity,degradation_pct,value,sd,n,unit,source\n"
    "young_modulus,0,1.8,0.15,3,MPa,the paper\n"
    "volume_ratio,,0.62,0.02,4,–,the paper\n"
    "r_squared,25,0.861,,13,–,the paper\n"
)


@cache
def emulator():
    """The emulator of the closed form, as one of the default geometry."""
    found = trained()
    record = json.loads(found.record) | {"dimensions_mm": asdict(Dimensions())}
    return replace(found, record=json.dumps(record))


@cache
def model():
    """Films and three actuators of `tight_model`, the pressure read too high."""
    cause = find("pressure_offset")
    whole = tight_model()
    chosen = altered(whole, actuator=whole.data_of(Curvature).tests.subset(ONE_EACH))
    base = with_known_scatter(chosen)
    values = values_of() | {"pressure_offset.offset": np.array([OFFSET])}
    active = altered(base, forward=trained()).extended(cause)
    return active.with_observations(
        *data_of_actuators(
            active.data_of(Curvature).tests.with_readings(
                active.data_of(Curvature).drawn(active.tests(values), np.random.default_rng(4))[0]
            ),
            active.base,
        )
    )


COUNTS = "".join(
    f"tested_count,{level},3,,,–,the paper\nruptured_count,{level},{burst},,,–,the paper\n"
    for level, burst in ((0, 0), (25, 2))
)


# narrow: of counts alone a ridge is left, along which an importance sample has few effective draws
DRY = "".join(
    f'"dry_embrittlement.{name}" = {{ law = "truncated_normal", {numbers}, low = 0, high = 9 }}\n'
    for name, numbers in (("cut", "mean = 1.8, sd = 0.2"), ("widening", "mean = 0.3, sd = 0.05"))
)


def counted_study(folder):
    """Write the study with published counts of ruptures, which dry air may explain."""
    settings = SETTINGS.replace('"creep"', '"dry_embrittlement"') + DRY
    return planted_study(folder, settings=settings, summary=SUMMARY + COUNTS)


def planted_study(folder, *, settings=SETTINGS, summary=SUMMARY):
    """Write the study into a folder and read it."""
    data, films, breaks = (
        model().data_of(Curvature).tests,
        model().data_of(Tensile).tests,
        model().data_of(Breaks).table,
    )
    rows = [
        f"{name},{data.degradation[i, 0]},0.0,{data.pressure[i, j]},{data.curvature[i, j]}\n"
        for i, name in enumerate(data.specimens)
        for j in np.flatnonzero(data.mask[i])
    ]
    actuator = "specimen_id,degradation_pct,degradation_sd_pct,pressure_kPa,curvature_per_m\n"
    actuator += "".join(rows)
    tensile = "specimen_id,degradation_pct,mode,stretch,stress_MPa,stress_measure\n" + "".join(
        f"{name},{films.degradation[i]},{films.modes[i]},{films.stretch[i, j]},"
        f"{films.stress[i, j]},{'cauchy' if films.cauchy[i, j] else 'nominal'}\n"
        for i, name in enumerate(films.specimens)
        for j in np.flatnonzero(films.mask[i])
    )
    lengths = zip(breaks.specimens, breaks.degradation, breaks.elongation, strict=True)
    broken = "specimen_id,degradation_pct,elongation_pct\n"
    broken += "".join(f"{name},{level},{length}\n" for name, level, length in lengths)
    files = {
        "study.toml": settings,
        "actuator.csv": actuator,
        "tensile.csv": tensile,
        "break.csv": broken,
        "summary.csv": summary,
        "moisture.csv": MOISTURE,
    }
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return read_study(folder)
