"""The figures of the benchmark of hidden effects as the tables of the documentation."""

from collections.abc import Iterable
from typing import Any

Json = dict[str, Any]

# key, words, key of the number of studies or sizes
SAID = (
    ("named_correctly", "right, of single causes of 5 sd and more", "visible_studies"),
    ("named_alone", "of these, named alone", "visible_studies"),
    ("named_correctly_strong", "right, of single causes of 10 sd and more", "strong_studies"),
    ("wrongly_named", "another cause named, of all single ones", "single_studies"),
    ("false_name_rate", "named where nothing is hidden", "none_studies"),
    ("none_adequate", "`adequate` where nothing is hidden", "none_studies"),
    ("outside_catalogue_named", "named where the effect has no entry", "outside_studies"),
    ("two_causes_both_named", "both named, of two causes that show", "pair_studies"),
    (
        "two_causes_both_named_not_on_one_scale",
        "of these, no pressure loss, other film or wall thickness",
        "pair_studies_not_on_one_scale",
    ),
    ("two_causes_both_in_a_stated_set", "both named or in a stated set", "pair_studies"),
    ("two_causes_stated_exactly", "stated exactly, as a product of sets", "pair_studies"),
    ("three_causes_all_named", "all named, of three causes that show", "triple_studies"),
    ("three_causes_all_in_a_stated_set", "all named or in a stated set", "triple_studies"),
    ("size_coverage_90", "sizes inside their 90 % intervals", "sizes"),
    ("size_coverage_90_usual_scatter", "of these, usual scatter", "sizes_usual_scatter"),
    ("size_coverage_90_little_scatter", "of these, little scatter", "sizes_little_scatter"),
    ("ambiguous_rate", "`ambiguous`", "studies"),
    ("same_verdict", "same verdict at standard effort", "compared_efforts"),
    ("same_verdict_redrawn", "same verdict with other random numbers", "compared_draws"),
)
BASELINE = {
    "named_correctly": "baseline_named_correctly",
    "false_name_rate": "baseline_false_name_rate",
    "outside_catalogue_named": "baseline_outside_named",
}


def markdown(figures: Json) -> str:
    """Return the rates, the power curve and what was said of each hidden cause."""
    parts = [_rates(figures), _power(figures["power"]), _said(figures["confusion"])]
    return "\n\n".join(parts)


def _rates(figures: Json) -> str:
    rows = [
        (words, figures[of], _share(figures[key]), _share(figures.get(BASELINE.get(key, ""))))
        for key, words, of in SAID
        if figures.get(key) is not None
    ]
    return as_table(("what", "of", "pipeline", "closed form"), rows)


def _power(rows: Iterable[Json]) -> str:
    shown = [
        (row["size_sd"], row["studies"], *(_share(row[k]) for k in ("named", "right", "baseline")))
        for row in rows
        if row["studies"]
    ]
    heads = (
        "size after a refit of all else [sd]",
        "studies",
        "named alone",
        "right",
        "closed form",
    )
    return as_table(heads, shown)


def _said(table: dict[str, dict[str, int]]) -> str:
    def words(counts: dict[str, int]) -> str:
        return ", ".join(f"{said} {n}" for said, n in sorted(counts.items(), key=lambda i: -i[1]))

    rows = [
        (f"`{hidden}`", sum(counts.values()), words(counts)) for hidden, counts in table.items()
    ]
    return as_table(("hidden, 5 standard deviations and more", "studies", "what was said"), rows)


def _share(value: object) -> str:
    return f"{value:.2f}" if isinstance(value, float) else ""


def as_table(heads: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> str:
    """Return a table in Markdown."""
    lines = [heads, ("---",) * len(heads), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)
