"""Texts of the page: questions, assumptions, and answers with their numbers."""

from typing import Any

from nagai_2021.noise import ALONE, ASSUMED, OF_THE_PACKAGE, at, largest

TITLE = "What the published numbers of a degrading soft actuator allow to conclude"

_GEOMETRY = (
    "The paper gives neither walls nor chambers. Everything here rests on an assumed geometry: "
    "50 × 10 × 10 mm, five chambers, walls of 2 mm (1.5 mm between chambers), on paper; "
    "its curves come from the emulator that ships with the package."
)
_MATERIAL = (
    "Material: 6 C1 = 1.73 ± 0.15 MPa at 0 % and 5.5 times that (9.5 ± 0.5 MPa) at 25 %, quadratic "
    "in between, rising and convex; C2 below 0 and larger in magnitude at 25 % than at 0 %; C3, "
    "the paper's stiffness (3·10⁴ N/m, ln sd 0.7) and α = 0.62 ± 0.07 from the package's priors; "
    "stable, and solvable up to 240 kPa."
)

NOISE: dict[str, Any] = {
    "question": "First of all: what rests on the reading error?",
    "texts": [
        "The paper states no error of its curvature readings, and R² measure every misfit against "
        "it. Questions (a) and (c) are answered with the second row of this table; the last row "
        "is the package's own prior where a study says nothing of its readings.",
        "The paper itself names two reasons besides differences in D_R: “Additionally, the "
        "degradation of the structure of the physical actuator may be inhomogeneous, which could "
        "lead to discrepancies in the simulation model. Even though the room humidity was "
        "maintained constant with a humidifier (60% RH), there may be subtle changes in humidity, "
        "which may change the water content of the actuator and therefore its compliance. This "
        "may be the reason why errors are observed, especially in the case of 0% degradation "
        "rate.” Of the catalogue these are degraded_skin, which does not act at 0 %, and "
        "humidity_drift, which does.",
    ],
    "assumptions": ["Those of (a) and (c), but for the prior of the reading error."],
}

AGREEMENT: dict[str, Any] = {
    "question": "(a) Can an error in D_R alone explain the published R²?",
    "texts": [
        "The paper attributes the error first to slight differences in D_R between the actuator "
        "and the model, of which it says that there is none at 0 %; to inhomogeneous degradation; "
        "and to humidity, especially at 0 %. There, D_R error alone leaves reading noise "
        "as the only misfit, yet the R² at 0 % (0.984) is lower than at 5 % (0.997), where the "
        "same noise weighs more since the actuator bends less.",
        "At 15 to 25 % a D_R error of a few points gives each R² by itself. But so does an error "
        "of stiffness at every level, and so does plain reading noise of about 0.5 1/m, which is "
        "1.3° over the actuator's length: from 5 to 25 % the published R² mean a nearly constant "
        "misfit in 1/m. With so large a noise, R² tell nothing about D_R.",
    ],
    "caption": (
        "Left: 1 − R² of imagined experiments under the posterior of each model, 5 to 95 %, "
        "against the published values. Right: the D_R error that alone gives each published R² "
        "(mean of both directions), median and 5 to 95 %."
    ),
    "assumptions": [
        _GEOMETRY,
        _MATERIAL,
        "R² is 1 − SSE/SST on the pooled 3 × 13 readings of a level, 0 to 240 kPa; the paper does "
        "not say. At 25 % the two curves that ended early are taken as whole.",
        "D_R error: sd half-normal with 2 points, an unknown share of its variance common to a "
        "level; none at 0 %. Stiffness error: the same at every level with 10 % (humidity, cure, "
        "scatter).",
        "Reading noise: half-normal with 2 % and 0.1 1/m, its size varying by level (ln sd "
        "half-normal with 0.3).",
        "The likelihood allows 10 % in 1 − R² and the rounding of the third decimal. Models have "
        "equal prior odds; other explanations are not in the comparison.",
    ],
}

RUPTURE: dict[str, Any] = {
    "question": "(b) Can the elongation limit alone explain 2 of 3 ruptures at 25 %, none below?",
    "texts": [
        "Stiffness grows 5.5 times but the elongation at break falls only 4 times, so at equal "
        "pressure the actuator is further from its limit at 25 % than at 0 %. A factor on strain "
        "that is the same at all levels, such as a sharp corner, can't change that order: it "
        "bursts the fresh actuators first.",
    ],
    "caption": (
        "Left: uniaxial equivalent elongation at 240 kPa by three criteria, and the limit of the "
        "films; median and 5 to 95 %. Right: probability of the published counts; the dotted "
        "line is the most that any model can reach."
    ),
    "assumptions": [
        _GEOMETRY,
        _MATERIAL,
        "Demand: the largest principal stretch that 99 % of the volume stays below at 240 kPa. "
        "For the other criteria the second stretch lies between planar and equibiaxial.",
        "Limit: 209.8 ± 6.3 % at 0 %, a quarter (± 10 %) at 25 %, the logarithm quadratic in "
        "between with an uncertain middle; log-normal between actuators, ln sd half-normal "
        "with 0.2.",
        "Strain concentration: ln of the factor half-normal with 0.7, one factor for all levels.",
        "Flaws at 25 %, where the fracture surfaces turn jagged: a further fall of the limit, ln "
        "half-normal with 0.7, and further scatter, ln sd half-normal with 0.5. As this adds "
        "freedom where it is needed, it is a possibility, not a finding.",
        "Counts are binomial; D_R errors are left out here.",
    ],
}


def noise_answer(found: list[dict[str, Any]]) -> str:
    """Return in plain words what rests on the reading error."""
    parts = [
        f"{scales(one)} the Bayes factor of {_most(one)}, of {largest(one)} together with that "
        f"error {_round(one['causes'][largest(one)]['bayes_factor'])}"
        for one in (at(found, ASSUMED), at(found, OF_THE_PACKAGE))
    ]
    ends = [at(found, scale)["models"][ALONE]["probability"] for scale in (ASSUMED, OF_THE_PACKAGE)]
    return (
        f"Nearly everything about R². Over an error of D_R alone, at a reading error of "
        f"{'; at '.join(parts)}. The probability of that error alone goes from "
        f"{percent(ends[0])} to {percent(ends[1])}. So it is disfavoured if readings were good to "
        "about a tenth of 1/m; with the package's own prior, under which noise alone would do, "
        "R² do not tell why simulation and experiment differ."
    )


def scales(found: dict[str, Any]) -> str:
    """Return the scales of a reading error in words."""
    return f"{100.0 * found['noise']:.0f} % and {found['floor_per_m']:g} 1/m"


def _most(found: dict[str, Any]) -> str:
    """Say which error of D_R, stiffness or reading gains most over one of D_R alone."""
    models = found["models"]
    best = max((n for n in models if n != ALONE), key=lambda n: float(models[n]["bayes_factor"]))
    return f"{best} is {_round(models[best]['bayes_factor'])}"


def _round(value: float) -> str:
    """Return a number to two digits, without an exponent."""
    return f"{float(f'{value:.2g}'):g}"


def agreement_answer(a: dict[str, Any], by_noise: list[dict[str, Any]]) -> str:
    """Return the answer to (a) in plain words."""
    wide = at(by_noise, OF_THE_PACKAGE)
    alone = a["probability_degradation_error_alone"]
    low, high = a["range"]
    points = ", ".join(f"{v:.1f}" for v in a["required_degradation_error_points"]["median"][3:])
    order = a["ordering"]
    return (
        f"Hardly, if reading errors are about {scales(at(by_noise, ASSUMED))}: an error in D_R "
        f"alone has a probability of {percent(alone)} among the four explanations compared "
        f"({percent(low)} to {percent(high)} over all assumptions tried). With "
        f"{scales(wide)} it is {percent(wide['models'][ALONE]['probability'])}, noise alone "
        f"{percent(wide['models']['noise only']['probability'])}, and nothing can be "
        f"concluded. {points} points of error would do at 15, 20, 25 %, but an R² at "
        f"0 % below that at 5 % arises in {percent(order['fresh_below_5_pct'])} of such "
        f"experiments, as far below as published in {percent(order['as_far_below'])}."
    )


def rupture_answer(b: dict[str, Any]) -> str:
    """Return the answer to (b) in plain words."""
    alone, both = b["probability_limit_alone"], b["probability_with_concentration"]
    flaws = b["probability_with_flaws"]
    needed = b["required_factor"]
    low = min(v["q05"][-1] for v in needed.values())
    high = max(v["q95"][-1] for v in needed.values())
    return (
        f"No: the elongation limit alone makes the published counts probable to {_power(alone)} "
        f"depending on the criterion, with strain concentration to {_power(both)}, since strain "
        f"at 25 % would have to be {low:.1f} to {high:.1f} times as large and then fresh actuators "
        f"would burst first; flaws that cut the limit at 25 % alone raise it to "
        f"{percent(flaws[0])} to {percent(flaws[1])}."
    )


def percent(share: float) -> str:
    """Return a probability in words."""
    return "below 0.1 %" if share < 0.001 else f"{100.0 * share:.2g} %"


def _power(span: list[float]) -> str:
    return f"{span[0]:.0e} to {span[1]:.0e}"
