"""Summary of verdicts on studies with hidden effects, for the published figures."""

from collections import Counter
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np
from hidden_studies import CAREFULLY

Json = dict[str, Any]

# size of an effect after a refit of all else [standard deviations]: what a test must plant to be
# seen, which is more than twice what noise alone gives any one effect, and what nobody overlooks
VISIBLE, STRONG = 5.0, 10.0
# a study without another scale sees pressure over stiffness: each of these looks like the others
ON_ONE_SCALE = frozenset({"pressure_loss", "film_mismatch", "wall_thickness"})
BINS = (0.0, 2.0, 3.5, 5.0, 7.0, 10.0, 15.0, 25.0, np.inf)


def summary_of_record(studies: Iterable[Json]) -> Json:
    """Return the figures of recorded studies of one seed, whichever way each was judged."""
    ways: dict[str, list[Json]] = {"quick": [], "standard": [], "redrawn": []}
    for one in studies:
        ways["redrawn" if one.get("draw", 0) else one["effort"]].append(one)
    return summary(ways["quick"], ways["standard"], ways["redrawn"])


def summary(found: list[Json], again: list[Json], redrawn: Iterable[Json] = ()) -> Json:
    """Return the figures of the benchmark.

    Some of the studies `found` were judged `again` at standard effort, some, `redrawn`, with other
    random numbers.
    """
    single = [one for one in found if one["kind"] == "single"]
    seen = [one for one in single if _z(one) >= VISIBLE]
    none = [one for one in found if one["kind"] == "none"]
    outside = [one for one in found if one["kind"] == "outside"]
    pairs = [one for one in found if one["kind"] == "pair" and _z(one) >= VISIBLE]
    apart = [one for one in pairs if not ON_ONE_SCALE & set(one["hidden"])]
    triples = [one for one in found if one["kind"] == "triple" and _z(one) >= VISIBLE]
    usual, careful = (
        [
            covered
            for one in found
            if (one["design"] in CAREFULLY) is with_care
            for covered in _covered(one)
        ]
        for with_care in (False, True)
    )
    first = {one["number"]: one for one in found}
    same = [_same(first[one["number"]], one) for one in again if one["number"] in first]
    alike = [_same(first[one["number"]], one) for one in redrawn if one["number"] in first]
    return {
        "studies": len(found),
        "named_correctly": share(_right(one) for one in seen),
        "named_correctly_strong": share(_right(one) for one in seen if _z(one) >= STRONG),
        "named_alone": share(one["causes"] == list(one["hidden"]) for one in seen),
        "named_correctly_all_sizes": share(_right(one) for one in single),
        "visible_studies": len(seen),
        "strong_studies": sum(_z(one) >= STRONG for one in seen),
        "single_studies": len(single),
        "false_name_rate": share(one["outcome"] == "named" for one in none),
        "none_adequate": share(one["outcome"] == "adequate" for one in none),
        "none_studies": len(none),
        "outside_catalogue_named": share(one["outcome"] == "named" for one in outside),
        "outside_unexplained": share(one["outcome"] == "unexplained" for one in outside),
        "outside_studies": len(outside),
        "outside": _said(outside),
        "two_causes_both_named": share(_both(one) for one in pairs),
        "two_causes_both_in_a_stated_set": share(_both_stated(one) for one in pairs),
        "two_causes_stated_exactly": share(_exactly_stated(one) for one in pairs if "sets" in one),
        "two_causes_none_wrong": share(not _wrong(one) for one in pairs),
        "pair_studies": len(pairs),
        "two_causes_both_named_not_on_one_scale": share(_both(one) for one in apart),
        "pair_studies_not_on_one_scale": len(apart),
        "three_causes_all_named": share(_both(one) for one in triples),
        "three_causes_all_in_a_stated_set": share(_both_stated(one) for one in triples),
        "triple_studies": len(triples),
        "size_coverage_90": share([*usual, *careful]),
        "sizes": len(usual) + len(careful),
        "size_coverage_90_usual_scatter": share(usual),
        "sizes_usual_scatter": len(usual),
        "size_coverage_90_little_scatter": share(careful),
        "sizes_little_scatter": len(careful),
        "ambiguous_rate": share(one["outcome"] == "ambiguous" for one in found),
        "wrongly_named": share(_wrong(one) for one in single),
        "baseline_named_correctly": share(
            one["baseline"]["named"] in one["hidden"] for one in seen
        ),
        "baseline_false_name_rate": share(bool(one["baseline"]["named"]) for one in none),
        "baseline_outside_named": share(bool(one["baseline"]["named"]) for one in outside),
        "seconds_per_verdict": float(np.median([one["seconds_verdict"] for one in found])),
        "seconds_per_fit": float(np.median([one["seconds_fit"] for one in found])),
        "same_verdict": share(same),
        "compared_efforts": len(same),
        "same_verdict_redrawn": share(alike),
        "compared_draws": len(alike),
        "power": _power(single),
        "confusion": _said(seen),
        "pairs": _said(pairs),
    }


def _z(one: Json) -> float:
    """Return the size of the smallest hidden effect after a refit [standard deviations]."""
    return min(one["visible"].values(), default=0.0)


def _right(one: Json) -> bool:
    """Whether the hidden cause alone is named, or stands in a set that cannot be told apart."""
    if one["outcome"] == "named":
        return one["causes"] == list(one["hidden"]) and not one["one_of"]
    return one["outcome"] == "ambiguous" and _inseparable(one, one["causes"])


def _both(one: Json) -> bool:
    """Whether the hidden causes are named, and none beside them, not even as one of several."""
    named = one["outcome"] == "named" and not one["one_of"]
    return named and set(one["causes"]) == set(one["hidden"])


def _both_stated(one: Json) -> bool:
    """Whether every hidden cause is named, or stands in a set that cannot be told apart."""
    hidden, said = set(one["hidden"]), set(one["causes"])
    if one["outcome"] == "ambiguous":
        return hidden <= said and _inseparable(one, one["causes"])
    if one["outcome"] != "named" or not said <= hidden:
        return False
    sets = one["one_of"]
    return hidden <= said.union(*sets) and all(_inseparable(one, names) for names in sets)


def _exactly_stated(one: Json) -> bool:
    """Whether what is stated holds the hidden set, and else only what the study takes it for.

    As a choice from lists, of which each other name is one that the hidden cause of its list looks
    like; or as one of several sets.
    """
    hidden, lists = set(one["hidden"]), one["sets"]
    if one["outcome"] not in ("named", "ambiguous"):
        return False
    if one["alternatives"]:
        return any(set(names) == hidden for names in one["alternatives"])
    once = all(len(hidden & set(names)) == 1 for names in lists)
    return once and len(lists) == len(hidden) and all(_inseparable(one, n) for n in lists)


def _inseparable(one: Json, names: Iterable[str]) -> bool:
    """Whether a set holds a hidden cause, and else only what the study would take it for."""
    known = set(names) & set(one["hidden"])
    rivals = set().union(*(one["confusable"].get(name, ()) for name in known))
    return bool(known) and set(names) <= known | rivals


def _wrong(one: Json) -> bool:
    return one["outcome"] == "named" and not set(one["causes"]) & set(one["hidden"])


def _covered(one: Json) -> Iterable[bool]:
    """Whether the 90 % interval of the size of each rightly named cause holds the truth.

    Of causes that are planted by a physics to which their rule is an approximation no size is true.
    """
    if one["outcome"] != "named" or set(one["causes"]) != set(one["hidden"]):
        return
    known = {c: v for c, v in one["hidden"].items() if c not in one.get("about", ())}
    for cause, values in known.items():
        name = next(iter(one["effects"][cause]))
        effect = one["effects"][cause][name]
        yield effect["q05"] <= values[name] <= effect["q95"]


def _same(quick: Json, standard: Json) -> bool:
    return quick["outcome"] == standard["outcome"] and set(quick["causes"]) == set(
        standard["causes"]
    )


def share(flags: Iterable[bool]) -> float | None:
    """Return the share that is true; None without any."""
    found = list(flags)
    return float(np.mean(found)) if found else None


def _power(single: list[Json]) -> list[Json]:
    rows = []
    for low, high in pairwise(BINS):
        inside = [one for one in single if low <= _z(one) < high]
        rows.append(
            {
                "size_sd": f"{low:g}–{high:g}",
                "studies": len(inside),
                "named": share(one["causes"] == list(one["hidden"]) for one in inside),
                "right": share(_right(one) for one in inside),
                "baseline": share(one["baseline"]["named"] in one["hidden"] for one in inside),
            }
        )
    return rows


def _said(studies: list[Json]) -> dict[str, dict[str, int]]:
    """Return how often what was said of each that was hidden."""
    table: dict[str, Counter[str]] = {}
    for one in studies:
        said = "+".join(sorted(one["causes"])) if one["outcome"] == "named" else one["outcome"]
        if one["outcome"] == "ambiguous":
            inside = set(one["hidden"]) & set(one["causes"])
            said = "ambiguous, with it" if inside else "ambiguous, without it"
        table.setdefault("+".join(sorted(one["hidden"])), Counter())[said] += 1
    return {name: dict(counts) for name, counts in sorted(table.items())}
