"""Stress measure: the stress of a tensile test is not the one that its label says.

Mechanism
    Force over undeformed area is fitted with the formula of the Cauchy stress, or the other way.
    The constants are then wrong everywhere, the more the larger the stretch.

Equation
    What is labelled nominal is λ^s times the nominal stress, what is labelled Cauchy λ^(−s) times
    the Cauchy stress: s = 0 as labelled, s = 1 exchanged, in uniaxial, equibiaxial and planar
    tension alike. Nothing lies between: evidence is that of two models.

Typical size
    s = 1. A neo-Hookean solid stretched to 3.1 seems 32 % too soft at small strain and to have a
    negative C2.

Revealed by
    Tensile curves that agree with curvatures at small strain after exchange only; films tested in
    two modes, which one law fits in the right measure only. With one mode, one label
    and no actuators another form of the law takes it up.

Refuted by
    Forces and areas as they were recorded.

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
    """Return stresses as read where s of the stretch went into the wrong measure."""
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
    mechanism="a tensile stress labelled nominal was Cauchy's, or the other way",
    typical={"confusion": 1.0},
    revealed_by="tensile curves that agree with the actuators, or with each other across modes, in "
    "the other measure only; refuted by the recorded forces and areas",
    confusable_with=("film_mismatch", "second_invariant"),
    on_stress=confuse_measure,
    blind_on_films=in_one_mode_and_measure,
)
