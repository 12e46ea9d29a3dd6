"""The figures of the benchmark of hidden effects as the tables of the README."""

from collections.abc import Iterable

Json = dict[str, object]

SAID = (
    ("named_correctly", "right, of single causes of 5 standard deviations and more"),
    ("named_alone", "of these, named alone"),
    ("named_correctly_strong", "right, of single causes of 10 standard deviations and more"),
    ("wrongly_named", "another cause named, of all single ones"),
    ("false_name_rate", "named where nothing is hidden"),
    ("none_adequate", "`adequate` where nothing is hidden"),
    ("outside_catalogue_named", "named where the effect is not in the catalogue"),
    ("two_causes_both_named", "both named, of two causes that show"),
    ("two_causes_both_in_a_stated_set", "both named, or in a set of which one is said to act"),
    ("size_coverage_90", "sizes inside their 90 % intervals"),
    ("size_coverage_90_usual_scatter", "of these, with the usual scatter"),
    ("size_coverage_90_little_scatter", "of these, with little scatter"),
    ("ambiguous_rate", "`ambiguous`, of all studies"),
    ("same_verdict", "same verdict at standard effort"),
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
        (words, _share(figures.get(key)), _share(figures.get(BASELINE.get(key, ""))))
        for key, words in SAID
        if figures.get(key) is not None
    ]
    return _table(("what", "pipeline", "closed form"), rows)


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
    return _table(heads, shown)


def _said(table: dict[str, dict[str, int]]) -> str:
    def words(counts: dict[str, int]) -> str:
        return ", ".join(f"{said} {n}" for said, n in sorted(counts.items(), key=lambda i: -i[1]))

    rows = [
        (f"`{hidden}`", sum(counts.values()), words(counts)) for hidden, counts in table.items()
    ]
    return _table(("hidden, 5 standard deviations and more", "studies", "what was said"), rows)


def _share(value: object) -> str:
    return f"{value:.2f}" if isinstance(value, float) else ""


def _table(heads: tuple[str, ...], rows: Iterable[tuple[object, ...]]) -> str:
    lines = [heads, ("---",) * len(heads), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)
