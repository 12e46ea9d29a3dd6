"""Second invariant: a law in I₁ alone, fitted in uniaxial tension, errs in other stress states.

Mechanism
    Uniaxial data hardly separate I₁ from I₂. Chamber walls and equibiaxial films are in other
    stress states, where a term in I₂ gives a different stress.

Equation
    Energy r (√Ī₂ − √3) with r = x C1 of the material, added to Yeoh's. Its nominal stress is r/√I₂
    times 1 − λ⁻³ in uniaxial (I₂ = 2λ + λ⁻²), λ³ − λ⁻³ in equibiaxial (I₂ = λ⁴ + 2λ⁻²) and λ − λ⁻³
    in planar tension (I₂ = λ² + 1 + λ⁻²); its Cauchy stress is λ times that. Young's modulus is
    6 C1 + √3 r = 6 C1 (1 + x/(2√3)).

Typical size
    x = 0.6–0.7 in vulcanised rubber (all three modes of Treloar's data). Curvature −13 … −23 % for
    x = 0.5 in fresh material at the same C1, most at high pressure, and −12 % at 25 %, where
    strains are small and all of it is the larger modulus (+14 %). The emulator is trained up to
    x = 1, where the prior ends.

Revealed by
    Films in a second mode; a misfit at high pressure and low degradation rate. Films in one mode
    alone do not show it: a different energy in I₁ gives the same curve.

Refuted by
    Equibiaxial films predicted by the law fitted in uniaxial tension.

Source
    Carroll (2011), J. Elast. 103:173, doi:10.1007/s10659-010-9279-0, for the root; Treloar (1944),
    doi:10.1039/TF9444000059, for the data.
"""

from dataclasses import replace

import numpy as np

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.blindness import in_one_mode
from bayesdeg.causes.cause import Cause, Conditions, Effect, FilmConditions, Floats, Stage
from bayesdeg.material.hyperelastic import root_second_invariant_basis
from bayesdeg.priors import Parameter, TruncatedNormal


def add_to_energy(inputs: Inputs, conditions: Conditions, effect: Effect) -> Inputs:
    """Return inputs with r larger by x C1."""
    before = 0.0 if inputs.second_invariant is None else inputs.second_invariant
    return replace(inputs, second_invariant=before + effect["ratio"] * inputs.c1)


def add_to_stress(
    stress: Floats, films: FilmConditions, effect: Effect, constants: Floats
) -> Floats:
    """Return stresses with the I₂ term of r = x C1 added, in each curve's labelled measure."""
    measure = np.where(films.cauchy, "cauchy", "nominal")
    basis = root_second_invariant_basis(films.stretch, films.mode[:, None], measure)
    added: Floats = stress + effect["ratio"] * constants[..., :1] * basis
    return added


CAUSE = Cause(
    name="second_invariant",
    stage=Stage.MATERIAL,
    parameters=(
        Parameter(
            "ratio",
            TruncatedNormal(0.0, 0.5, 0.0, 1.0),
            "–",
            "coefficient r of the energy r (√I₂ − √3), over C1",
            0.0,
        ),
    ),
    mechanism="the energy depends on the second invariant too, which uniaxial tests do not show",
    typical={"ratio": 0.5},
    revealed_by="films in a second mode, or a misfit at high pressure and low degradation rate; "
    "refuted by equibiaxial films predicted by the law of uniaxial ones",
    confusable_with=("film_mismatch", "stress_measure"),
    on_inputs=add_to_energy,
    on_stress=add_to_stress,
    blind_on_films=in_one_mode,
)
