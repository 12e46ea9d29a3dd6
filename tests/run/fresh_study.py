"""A study of which nothing degrades: films and actuators as they were made, in closed form."""

from functools import cache

import numpy as np

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.assembly.reading import read_study
from bayesdeg.material.hyperelastic import yeoh_basis
from tests.inference.small_study import TRUTH
from tests.surrogate.closed_form import ClosedFormMap

OFFSET = 12.0
PRESSURES = np.linspace(20.0, 160.0, 8)
STRETCHES = np.linspace(1.1, 2.6, 6)
SETTINGS = 'title = "Silicone"\nseed = 5\n[sampling]\neffort = "quick"\n'
HEADS = {
    "actuator.csv": "specimen_id,degradation_pct,pressure_kPa,curvature_per_m\n",
    "tensile.csv": "specimen_id,degradation_pct,mode,stretch,stress_MPa,stress_measure\n",
    "break.csv": "specimen_id,degradation_pct,elongation_pct\n",
}
BREAKS = (("f1", 205.0), ("f2", 221.0), ("f3", 214.0))
RATIO_PRIOR = (
    "[priors]\n"
    'volume_ratio = { law = "truncated_normal", mean = 0.97, sd = 0.01, low = 0.5, high = 1 }\n'
)
SHRINKAGE = (
    "film_id,mass_poured_g,mass_cured_g,mass_conditioned_g\n"
    "s1,30.0,29.0,18.0\ns2,30.0,29.1,18.2\ns3,30.0,28.9,17.9\n"
)


def fresh_study(folder, texts=None):
    """Write the study into a folder, with other or further texts, and read it."""
    files = _files() | {"study.toml": SETTINGS} | (texts or {})
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return read_study(folder)


def _constants():
    c1, c3 = TRUTH["c1_at_0"], TRUTH["c3_at_0"]
    return c1, TRUTH["c2_ratio_at_0"] * np.sqrt(3.0 * c1 * c3), c3


def _rows(readings):
    return "".join(
        f"{name},0,{pressure},{reading}\n"
        for name, curve in zip(("a1", "a2", "a3"), readings, strict=True)
        for pressure, reading in zip(PRESSURES, curve, strict=True)
    )


@cache
def _files():
    """Return the tables: actuators as large as their mould, whose pressure was read too high."""
    generator = np.random.default_rng(4)
    stress = yeoh_basis(STRETCHES, "uniaxial") @ _constants()
    films = "".join(
        f"{name},0,uniaxial,{stretch},{reading},nominal\n"
        for name in ("f1", "f2", "f3")
        for stretch, reading in zip(
            STRETCHES,
            stress * np.exp(0.04 * generator.standard_normal())
            + 0.01 * generator.standard_normal(len(stress)),
            strict=True,
        )
    )
    broken = "".join(f"{name},0,{limit}\n" for name, limit in BREAKS)
    return {
        "tensile.csv": HEADS["tensile.csv"] + films,
        "break.csv": HEADS["break.csv"] + broken,
        "actuator.csv": HEADS["actuator.csv"] + _rows(_curvatures(generator)),
    }


def _curvatures(generator):
    """Return readings of three actuators, (3, n_pressures), with scatter and errors [1/m]."""
    stiffness = np.exp(0.04 * generator.standard_normal((1, 3, 1)))
    one = np.ones((1, 1, 1))
    part = Inputs(
        np.tile(PRESSURES - OFFSET, (3, 1)),
        *(constant * stiffness for constant in _constants()),
        linear_scale=one,
        paper_stiffness=TRUTH["paper_stiffness"] * one,
    )
    bent = ClosedFormMap()(part).curvature[0]
    error = generator.standard_normal((2, *bent.shape))
    return bent * (1.0 + 0.02 * error[0]) + 0.1 * error[1]
