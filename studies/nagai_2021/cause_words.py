"""Texts on the causes: questions, assumptions and answers from the numbers."""

from typing import Any

from nagai_2021.cause_agreement import WITH
from nagai_2021.causes import INTERVAL, ROOM
from nagai_2021.noise import ASSUMED, OF_THE_PACKAGE, at, largest
from nagai_2021.words import percent, scales

CLEAR = 3.0
"""A Bayes factor that stays above this by two Monte Carlo errors is called a gain."""
ACCOUNTS = 0.01
"""Least probability of the counts by which a cause is said to account for them."""

AGREEMENT_OF_CAUSES: dict[str, Any] = {
    "question": "(c) Which causes can explain R² lower at 0 % than at 5 %?",
    "assumptions": [
        "The imagined experiments, materials, D_R errors and reading noise are those of (a); the "
        "simulation stays as it is. Each cause acts through the package's own code, with one size "
        "for all actuators, from its own prior.",
        f"Not published, so assumed: one loading from 0 to 240 kPa, a reading every {INTERVAL:g} s "
        f"(which creep and drying depend on), a horizontal mount. The room is at {ROOM:g} % "
        "relative humidity after storage at 67 %, as the paper says.",
        "Where the emulator refuses a reading, next to ballooning or beyond its training, a draw "
        "counts as explaining nothing, so a Bayes factor with a share outside is too low rather "
        "than too high; answers.json also has it as if the share outside explained as much as "
        "the rest.",
        "Draws are aimed at where a cause explains the R², and weighted back to the prior. Monte "
        "Carlo errors are estimated from these draws and are on the small side: between runs with "
        "other seeds Bayes factors differed by up to about twice what they say.",
        "How often the published order arises is counted before seeing the R², over draws within "
        "that range. The size of a cause that may have either sign is given with both.",
    ],
}
RUPTURE_OF_CAUSES: dict[str, Any] = {
    "question": "(d) Which causes can explain 2 of 3 ruptures at 25 %, none below?",
    "assumptions": [
        "Material, elongation limit, its scatter and the criteria are those of (b), without strain "
        "concentration; causes as in (c), with the strain at the last reading of the loading.",
        "The equivalent of a multiaxial state uses Yeoh's constants alone, also where the second "
        "invariant acts.",
        "Where the emulator refuses the strain of a level, the draw counts as one that makes the "
        "counts impossible.",
    ],
}


def agreement_texts(c: dict[str, Any]) -> list[str]:
    """Return what else there is to say of (c)."""
    widths = "; ".join(
        f"{name}: {', '.join(f'{factor(found)} at {width}' for width, found in by_width.items())}"
        for name, by_width in c["prior_widths"].items()
    )
    outside = [
        f"{name} ({percent(found[WITH]['share_outside'])})"
        for name, found in c["causes"].items()
        if found[WITH]["share_outside"] >= 0.01
    ]
    return [
        "Evidence of all six R² is that of the five at 5 to 25 % times that of the one at 0 % "
        "given those. The contradiction is in the second: a cause that gains in the first alone "
        "says why agreement falls with D_R, not why it is lower at 0 % than at 5 %.",
        _of_order(c),
        f"What is believed of sizes beforehand matters. Bayes factors of the leading causes with "
        f"the prior's width halved and doubled (its bounds kept): {widths}.",
        f"Draws outside the emulator's range: {_listed(outside)}.",
        f"Not in the comparison: {_reasons(c)}.",
    ]


def rupture_texts(d: dict[str, Any]) -> list[str]:
    """Return what else there is to say of (d)."""
    unmoved = [name for name, found in d["causes"].items() if not found["changes_bursts"]]
    return [
        f"Strain and strength are left as they are by: {_listed(unmoved)}.",
        f"Not in the comparison: {_reasons(d)}.",
    ]


def agreement_answer(c: dict[str, Any], by_noise: list[dict[str, Any]]) -> str:
    """Return the answer to (c) in plain words."""
    wide = at(by_noise, OF_THE_PACKAGE)
    most = largest(wide)
    causes = c["causes"]
    gains = [name for name, found in causes.items() if _clear(found[WITH])]
    fresh = [name for name in gains if _lifts_fresh(causes[name])]
    rest = [name for name in gains if name not in fresh]
    silent = _silent(c)
    order = max((causes[name]["alone"]["as_far_below"] for name in silent), default=0.0)
    noise = c["without_cause"]["alone"]["as_far_below"]
    return (
        f"At a reading error of {scales(at(by_noise, ASSUMED))}: {_of_fresh(c, fresh)} "
        f"{_of_rest(c, rest)}At {scales(wide)} no cause has a larger factor than "
        f"{factor(wide['causes'][most])} ({most}). What does not act at 0 % ({_listed(silent)}) "
        f"makes the published order arise in at most {percent(order)} of experiments, noise alone "
        f"in {percent(noise)}."
    )


def rupture_answer(d: dict[str, Any]) -> str:
    """Return the answer to (d) in plain words."""
    best = {name: _best(found) for name, found in d["causes"].items()}
    able = [name for name, found in best.items() if found["probability"] >= ACCOUNTS]
    others = [name for name in best if name not in able]
    start = [found["probability"] for found in d["without_cause"].values()]
    who = "; ".join(f"{name}, {_by_criteria(d['causes'][name])}" for name in able) or "none"
    most = max(others, key=lambda name: _largest_factor(d["causes"][name]))
    largest = _largest_factor(d["causes"][most])
    highest = max(best[name]["probability"] for name in others)
    return (
        f"Account for the counts (probability of {percent(ACCOUNTS)} or more; the elongation limit "
        f"alone {min(start):.0e} to {max(start):.0e}): {who}. Every other cause leaves them "
        f"below {_above(highest)} with any criterion; the most it gains is a factor {largest:.1f} "
        f"({most})."
    )


def factor(found: dict[str, Any], key: str = "bayes_factor") -> str:
    """Return a Bayes factor with its Monte Carlo error in words."""
    value, error = found[key], found[f"{key}_error"]
    if value >= 1e4:
        return f"{value:.1e} ± {error:.0e}"
    if value < 0.01:
        return "below 0.01"
    digits = 0 if value >= 20.0 else 1 if value >= 1.0 else 2
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def _of_fresh(c: dict[str, Any], names: list[str]) -> str:
    causes = c["causes"]
    if not names:
        return (
            f"No Bayes factor of a cause beside an error of D_R that gains at 0 % stays above "
            f"{CLEAR:g} by two Monte Carlo errors."
        )
    factors = [causes[name][WITH]["bayes_factor"] for name in names]
    each = _listed([f"{name} ({factor(causes[name][WITH])})" for name in names])
    return (
        f"Beside an error of D_R, {each} make the published R² more probable than that error "
        f"alone, by these Bayes factors, that at 0 % included; R² tell them apart by no more than "
        f"a factor {max(factors) / min(factors):.1f}."
    )


def _of_rest(c: dict[str, Any], names: list[str]) -> str:
    if not names:
        return ""
    each = [
        f"{name} ({factor(c['causes'][name][WITH])}, of which at 0 % "
        f"{factor(c['causes'][name][WITH], 'bayes_factor_of_fresh')})"
        for name in names
    ]
    return f"Gains that are not clearly, or not at all, made at 0 %: {_listed(each)}. "


def _of_order(c: dict[str, Any]) -> str:
    """Say how often the published order arises, and what does without a D_R error."""
    causes, start = c["causes"], c["without_cause"][WITH]["as_far_below"]
    most = max(causes, key=lambda name: causes[name][WITH]["as_far_below"])
    alone = [f"{n} ({factor(f['alone'])})" for n, f in causes.items() if _clear(f["alone"])]
    return (
        f"R² at 0 % falls as far below that at 5 % as published in {percent(start)} of experiments "
        f"with a D_R error alone, with a cause beside it in up to "
        f"{percent(causes[most][WITH]['as_far_below'])} ({most}). Without a D_R error the R² are "
        f"clearly more probable than with it alone by: {_listed(alone)}."
    )


def _silent(c: dict[str, Any]) -> list[str]:
    return [name for name, found in c["causes"].items() if not found["changes_fresh"]]


def _clear(found: dict[str, Any]) -> bool:
    return bool(found["bayes_factor"] - 2.0 * found["bayes_factor_error"] > CLEAR)


def _lifts_fresh(found: dict[str, Any]) -> bool:
    beside = found[WITH]
    least = beside["bayes_factor_of_fresh"] - 2.0 * beside["bayes_factor_of_fresh_error"]
    return bool(found["changes_fresh"] and least > 1.0)


def _best(found: dict[str, Any]) -> dict[str, Any]:
    best: dict[str, Any] = max(found["criteria"].values(), key=lambda f: f["probability"])
    return best


def _largest_factor(found: dict[str, Any]) -> float:
    return float(max(f["bayes_factor"] for f in found["criteria"].values()))


def _by_criteria(found: dict[str, Any]) -> str:
    return ", ".join(
        f"{percent(f['probability'])} by {name.replace('_', ' ')} (Bayes factor {factor(f)})"
        for name, f in found["criteria"].items()
    )


def _above(value: float) -> str:
    """Return the next power of ten."""
    power = 1.0
    while power / 10.0 > value and power > 1e-12:
        power /= 10.0
    return f"{power:.0e}"


def _reasons(answer: dict[str, Any]) -> str:
    return "; ".join(f"{name} ({reason})" for name, reason in answer["cannot_act"].items())


def _listed(names: list[str]) -> str:
    if len(names) < 2:
        return names[0] if names else "none"
    return f"{', '.join(names[:-1])} and {names[-1]}"
