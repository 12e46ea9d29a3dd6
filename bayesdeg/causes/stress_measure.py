"""Stress measure: the stress of a tensile test is mislabelled.

Mechanism
    Force over undeformed area is fitted with the formula of the Cauchy stress, or vice versa. The
    constants are then wrong, the more so the larger the stretch.

Equation
    Stress labelled nominal is λ^s times the nominal stress, stress labelled Cauchy λ^(−s) times the
    Cauchy stress: s = 0 as labelled, s = 1 exchanged, in uniaxial, equibiaxial and planar tension
    alike. No values in between: evidence compares the two models.

Typical size
    s = 1. A neo-Hookean solid stretched to 3.1 appears 32 % too soft at small strain and with a
    negative C2.

Revealed by
    Tensile curves that agree with curvatures at small strain only after exchange; films tested in
    two modes, which one law fits only in the right measure. With one mode, one label and no
    actuators, a different form of the law absorbs it.

Refuted by
    Recorded forces and areas.

Source
    Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485, Eq. 2: the right-hand side is the
    Cauchy stress, the middle expression a misprint of it.
"""

import numpy as np

from bayesdeg.causes.blindness import in_one_mode_and_measure
from bayesdeg.causes.cause import Cause, Effect, FilmConditions, Floats, Stage
from bayesdeg.priors import Choice, Parameter


def confuse_measure(
    stress: Floats, films: FilmConditions, effect: Effect, constants: Floats
) -> Floats:
    """Return stresses as recorded if λ^s went into the wrong measure."""
    power = np.where(films.cauchy, -1.0, 1.0) * effect["confusion"]
    read: Floats = stress * films.stretch**power
    return read


CAUSE = Cause(
    name="stress_measure",
    stage=Stage.READING,
    parameters=(
        Parameter(
            "confusion",
            Choice(state=1.0, neutral=0.0),
            "–",
            "0: the stress is the one labelled; 1: nominal and Cauchy stress are exchanged",
            0.0,
        ),
    ),
    mechanism="tensile stress labelled nominal is Cauchy stress, or vice versa",
    typical={"confusion": 1.0},
    revealed_by="tensile curves that agree with the actuators, or with each other across modes, in "
    "only the other measure; refuted by the recorded forces and areas",
    confusable_with=("film_mismatch", "second_invariant"),
    on_stress=confuse_measure,
    blind_on_films=in_one_mode_and_measure,
)
