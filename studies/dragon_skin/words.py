"""Texts of the page: questions, assumptions, and answers with their numbers."""

from typing import Any

from dragon_skin.analysis import DECISIVE
from dragon_skin.causes import CAUSES
from dragon_skin.published import MODULI

TITLE = "What a sagging Dragon Skin 10 beam says of its stiffness, and what its model gets wrong"

SOURCE = (
    "Record: motion capture of a silicone cantilever, Soft Robotics Lab, ETH Zürich, "
    "github.com/srl-ethz/diffPD_sim2real at commit 825e7b7 (MIT licence), reduced to the first "
    "(held by hand) and last (at rest) position of six markers in six takes."
)

ASSUMPTIONS = [
    "Dragon Skin 10, 30 × 30 × 100 mm, density 1070 kg/m³, gravity 9.80709 m/s², tip weights "
    "0.51012 N and 1.00062 N: as the source states them, taken as exact.",
    "Neo-Hookean, W = C1 (Ī₁ − 3), that is Yeoh's law with C2 = C3 = 0; nearly incompressible, "
    "K/C1 = 10⁴; E = 6 C1. C2/C1 is one of the nuisances. Prior on C1: uniform from 25 to 75 kPa "
    "(E from 150 to 450 kPa).",
    "One end face is clamped. The weight pulls evenly on the upper 4 mm of the end face: its "
    "resultant is that of a line on the upper tip edge, without the dent such a line makes, which "
    "no mesh resolves. The dent is one of the nuisances.",
    "A ball moves rigidly with the patch of surface (4 × 8 mm at the tip's edge) that it is glued "
    "to, its centre 6 mm above it.",
    "Errors of coordinates are independent and normal with one unknown size; what is common to a "
    "marker, a take or a load case is in the nuisances. Their sizes are unknown too (log-normal "
    "priors, ln sd 0.8). Poses and marker displacements are integrated out to first order.",
    "Static. Creep, rate and the friction of the weight's hook are not told apart from a tip that "
    "rests elsewhere.",
]


def answers(results: dict[str, Any]) -> list[str]:
    """Return the answer in a few sentences."""
    return [
        _modulus(results),
        _supported(results),
        _undecided(results),
        _held_out(results),
        _published(results),
    ]


def _modulus(results: dict[str, Any]) -> str:
    wide, narrow, stated = (_value(results, n) for n in ("everything", "supported", "as stated"))
    c1 = results["posterior"]["everything"]["c1"]
    before, after = (
        results["posterior"][name]["noise"]["mean"] for name in ("as stated", "supported")
    )
    return (
        f"C1 = {c1['mean']:.1f} ± {c1['sd']:.1f} kPa, E = {wide}, with everything that the record "
        f"cannot exclude as a nuisance. With only what it demands, E = {narrow}; with markers, "
        f"hand and frame as stated, E = {stated}, which is far too sure: that model misses the "
        f"markers by {before:.2f} mm a coordinate, the supported one by {after:.2f} mm."
    )


def _supported(results: dict[str, Any]) -> str:
    removed = results["one_by_one"]["removed"]
    named = [
        f"{label(name)} ({-r['gain']:.0f})"
        for name, r in sorted(removed.items(), key=lambda item: item[1]["gain"])
        if -r["gain"] > DECISIVE
    ]
    return (
        "The record demands (loss of log evidence when taken away): " + ", ".join(named) + ". "
        "They say where markers, hand and camera frame were." + _unexplained(results)
    )


def _unexplained(results: dict[str, Any]) -> str:
    left = results["posterior"]["everything"].get("rest_misfit_size")
    if left is None:
        return ""
    return (
        " The rest misfit is what remains unexplained: about "
        f"{left['mean']:.1f} mm and {2.0 * left['mean']:.1f}° of the tip by load case, even with "
        "every mechanical cause active."
    )


def _undecided(results: dict[str, Any]) -> str:
    added, groups = results["one_by_one"]["added"], results["mechanical"]
    best = max(added, key=lambda name: added[name]["gain"])
    near = [n for n in added if n != best and added[n]["gain"] > added[best]["gain"] - DECISIVE]
    texts = [
        f"Of the mechanical causes, {label(best)} gains most (log evidence "
        f"{added[best]['gain']:+.1f}; {_size(results, best)}), "
        + ("enough to be demanded" if best in groups["demanded"] else "not enough to be demanded")
    ]
    if near:
        texts.append(
            ", but not enough to be told from "
            + ", ".join(f"{label(n)} ({added[n]['gain']:+.1f})" for n in near)
        )
    texts.append(".")
    if groups["undecided"]:
        moduli = [added[name]["modulus_kPa"] for name in groups["undecided"]]
        texts.append(
            " The record neither demands nor excludes "
            + ", ".join(label(name) for name in groups["undecided"])
            + f": alone, each changes log evidence by less than {DECISIVE:.0f}, yet E goes from "
            f"{min(moduli):.0f} to {max(moduli):.0f} kPa. Weight, lever and clamp act on the sag "
            "as stiffness does, so C1 cannot be known better without measuring them."
        )
    return "".join(texts)


def _size(results: dict[str, Any], name: str) -> str:
    parameter, a = CAUSES[name].parameter, results["one_by_one"]["added"][name]
    unit = "" if parameter is None else parameter.unit
    return f"{a['mean']:.1f} ± {a['sd']:.1f} {unit}, E = {a['modulus_kPa']:.0f} kPa"


def _held_out(results: dict[str, Any]) -> str:
    totals = {
        name: sum(case["log_score"] for case in cases.values())
        for name, cases in results["held_out"].items()
    }
    gain = totals["supported"] - totals["as stated"]
    by_case = ", ".join(
        f"{round(results['held_out']['supported'][c]['log_score'] - stated['log_score']):+d}"
        for c, stated in results["held_out"]["as stated"].items()
    )
    worst = max(abs(c["height_error_mm"]) for c in results["held_out"]["supported"].values())
    inside = [c["within_90_pct"] for c in results["held_out"]["supported"].values()]
    return (
        f"Fitted to two load cases, the supported model predicts the third better than the "
        f"model as stated by {gain:.0f} in log density ({by_case} by load case, lightest first). "
        f"The tip's height comes out to "
        f"{worst:.1f} mm at worst, with {100 * sum(inside) / len(inside):.0f} % of the coordinates "
        "inside their 90 % bands."
    )


def _published(results: dict[str, Any]) -> str:
    recipe, share = results["recipe"], results["published"]
    low, high = recipe["range_kPa"]
    value = recipe["as_published_kPa"]
    places = ", ".join(
        f"{MODULI[name]:.1f} kPa ({name}) at {100 * p:.0f} %" for name, p in share.items()
    )
    return (
        f"The published values stand at these points of the posterior's distribution: {places}. "
        "The record does not decide between them. The source matched one marker's height in one "
        "take, in a frame fitted to the held shape. That recipe gives "
        f"{value:.0f} kPa with these finite elements for the take and marker it used, "
        f"{value - MODULI['used']:+.0f} kPa from the value the source used and "
        f"{value - MODULI['static']:+.0f} kPa from its static one, which came from its own, "
        f"dynamic finite elements; over all takes and markers it gives {low:.0f} to {high:.0f} "
        "kPa, more than the published values differ. The dynamic value, from the beam's "
        "motion, a static record cannot test."
    )


def _value(results: dict[str, Any], name: str) -> str:
    modulus = results["posterior"][name]["modulus_kPa"]
    return f"{modulus['mean']:.0f} ± {modulus['sd']:.0f} kPa"


def label(name: str) -> str:
    """Return a cause's name in words."""
    return name.replace("_", " ")
