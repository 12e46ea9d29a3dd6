"""Degradation scale: all recorded degradation rates of the actuators are too large by one factor.

Mechanism
    Recorded rates of the actuators are proportional, but not equal, to those against which the
    films were measured. Two ways are likely in an experiment like the source's.

    *Different moisture bases.* A content by total mass, M, and one by dry mass, X = M/(1 − M), give
    rates D and D/(1 − M_C). With M_0 = 20 %, a rate of 25 % on one basis is 29.4 % on the other;
    the ratio is 1.25 at slight degradation and 1.18 at 25 %, so nearly a factor. Where rates of the
    actuators are by dry mass and those of the films by total mass, x = −0.15 … −0.20; the other way
    round, +0.18 … +0.25.

    *Walls lag behind films.* Water reaches the middle of a 0.5 mm film within hours, but not that
    of a 2 mm wall: with 10⁻¹¹ … 10⁻¹² m²/s, 60 % of a change takes 8–81 h if both faces are open.
    Conditioning for 24 h brings films to 97 % and more, such a wall to 90 … 33 %, and one with a
    closed inner face to 52 … 17 %. A rate measured on films is then too large for walls buried for
    the same time: x = −0.1 … −0.8.

Equation
    D = (1 + x) D_recorded; its standard error scales alike. Fresh specimens stay fresh.

Typical size
    x = −0.2 by a different basis, −0.1 … −0.8 in walls that lag; −0.2 is a shift by 5 points at
    25 %, by 1 at 5 %. The prior ends at 0: x a few percent above it reads like ``degraded_skin``,
    which a study could then not name alone, and x = 0.3 like degradation that starts at the
    surfaces. If your films may be on the dry basis, set a prior of both signs,
    ``"degradation_scale.excess" = { law = "truncated_normal", mean = 0.0, sd = 0.2,
    low = -0.9, high = 1.0 }`` under ``[priors]``.

Revealed by
    More curvature than simulated, in a ratio that is constant in pressure at small strain, absent
    in fresh specimens, and growing with the degradation rate; ``degradation_misread`` shifts
    slightly and strongly degraded specimens alike. Levels far apart tell the two apart.

Refuted by
    The same error in points at 5 % as at 25 %; moisture of pieces of the walls, on the same basis
    and as dry as the films.

Source
    Nagai, Kurita, Shintake (2021), doi:10.3389/frobt.2021.760485: Eq. 4 is by total mass, the
    control with bromelain by dry mass; 24 h at 67 % humidity. Crank (1975), The Mathematics of
    Diffusion, for a plane sheet. The diffusivity of water in the gel is assumed.
"""

from dataclasses import replace

from bayesdeg.causes.blindness import without_degraded
from bayesdeg.causes.cause import Cause, Conditions, Degradation, Effect, Stage
from bayesdeg.priors import Parameter, TruncatedNormal


def rescale(degradation: Degradation, conditions: Conditions, effect: Effect) -> Degradation:
    """Return degradation rates and their standard errors times 1 + x.

    Examples
    --------
    >>> import numpy as np
    >>> rates = Degradation(np.array([[0.0], [25.0]]), np.array([[0.5], [1.0]]))
    >>> tests = Conditions(np.full((2, 1), 20.0), rates.value)
    >>> rescale(rates, tests, {"excess": np.full((1, 1, 1), 0.2)}).value.ravel().tolist()
    [0.0, 30.0]
    """
    factor = 1.0 + effect["excess"]
    return replace(degradation, value=factor * degradation.value, sd=factor * degradation.sd)


CAUSE = Cause(
    name="degradation_scale",
    stage=Stage.DEGRADATION,
    parameters=(
        Parameter(
            "excess",
            TruncatedNormal(0.0, 0.25, -0.9, 0.0),
            "–",
            "true over recorded degradation rate of the actuators, minus 1",
            0.0,
        ),
    ),
    mechanism="all recorded degradation rates of the actuators are too large by one factor",
    typical={"excess": -0.18},
    revealed_by="more curvature than simulated, growing with the degradation rate; refuted by an "
    "error of as many points at small rates as at large ones",
    confusable_with=("degradation_misread", "degraded_skin", "erosion", "degraded_shrinkage"),
    on_degradation=rescale,
    blind=without_degraded,
    of_degradation=True,
)
