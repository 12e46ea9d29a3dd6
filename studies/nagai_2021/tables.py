"""Tables of the results, for the page and the terminal."""

from typing import Any

from rich.console import Console
from rich.table import Table

from bayesdeg.material.strength import CRITERIA
from nagai_2021.agreement import MODELS
from nagai_2021.cause_agreement import WITH
from nagai_2021.cause_words import factor
from nagai_2021.noise import ALONE, STATED, largest, of_model
from nagai_2021.published import LEVELS, R_SQUARED
from nagai_2021.words import percent, scales


def noise_tables(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the table of what rests on the reading error."""
    others = [name for name in MODELS if name != ALONE]
    rows = [
        [
            scales(one),
            *(factor(of_model(one, name)) for name in others),
            percent(one["models"][ALONE]["probability"]),
            *(factor(one["causes"][name]) for name in STATED),
            f"{factor(one['causes'][largest(one)])} ({largest(one)})",
        ]
        for one in found
    ]
    header = ["reading error", "noise", "stiffness", "D_R, stiffness", "P(D_R)", *STATED]
    title = (
        "Bayes factors over an error of D_R alone, by the scales of the half-normal priors of the "
        "reading error; causes beside an error of D_R; ± Monte Carlo error; P(D_R): probability of "
        "an error of D_R alone among the four"
    )
    return [_table(title, [*header, "largest of a cause"], rows)]


def agreement_tables(a: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the tables of (a)."""
    models = [
        [
            name,
            f"{m['log_evidence']:.1f} ± {m['log_evidence_error']:.1f}",
            f"{m['bayes_factor']:.2g}",
            *(percent(m[key]) for key in ("probability", "probability_without_fresh")),
        ]
        for name, m in a["models"].items()
    ]
    variants = [
        [words, *(percent(models[name]["probability"]) for name in MODELS)]
        for words, models in a["variants"].items()
    ]
    keys = ("sensitivity_pct_per_point", "required_degradation_error_points", "misfit_per_m")
    levels = [
        [f"{level:g} %", f"{r:.3f}", *(_interval(a[key], i) for key in keys)]
        for i, (level, r) in enumerate(zip(LEVELS, R_SQUARED, strict=True))
    ]
    levels[0][3] = "none by the paper's word"
    return [
        _table(
            "Models, at equal prior odds",
            ["model", "ln evidence", "Bayes factor over D_R error", "probability", "without 0 %"],
            models,
        ),
        _table("Probabilities under other assumptions", ["", *MODELS], variants),
        _table(
            "By level: median [5 %, 95 %]",
            ["D_R", "R²", "d ln C1/d D_R [%/point]", "D_R error needed [points]", "misfit [1/m]"],
            levels,
        ),
    ]


def rupture_tables(b: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the tables of (b)."""
    hypotheses = [
        [name, f"{h['probability']:.2g}", f"{h['bayes_factor']:.2g}"]
        + [percent(h["burst_probability"][i]) for i in (0, 4, 5)]
        for name, h in b["hypotheses"].items()
    ]
    needed = [
        [
            c.replace("_", " "),
            *(_interval(b["required_factor"][c], i) for i in (0, 4, 5)),
            f"{b['none_below_at_that_factor'][c]:.1g}",
        ]
        for c in CRITERIA
    ]
    return [
        _table(
            "Probability of the published counts, and mean probability that one actuator bursts",
            ["acting cause", "of the counts", "Bayes factor", "bursts at 0 %", "20 %", "25 %"],
            hypotheses,
        ),
        _table(
            "Factor on strain at which half would burst, and the probability that none below "
            "25 % does if a common factor makes it two in three there",
            ["criterion", "0 %", "20 %", "25 %", "none below"],
            needed,
        ),
    ]


def cause_agreement_tables(c: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the table of (c)."""
    rows = [
        [
            name,
            factor(found["alone"]),
            factor(found[WITH]),
            factor(found[WITH], "bayes_factor_of_fresh"),
            percent(found["alone"]["as_far_below"]),
            percent(found[WITH]["as_far_below"]),
            _size(found[WITH]["size"], found["unit"]),
        ]
        for name, found in c["causes"].items()
    ]
    header = ["cause", "alone", "with a D_R error", "of that: R² at 0 % given the rest"]
    header += ["as far below, alone", "with a D_R error", "size with a D_R error"]
    for name, words in (("alone", "no cause, no D_R error"), (WITH, "no cause")):
        found = c["without_cause"][name]
        cells = ["–", "–", "–", "–", "–", "–"]
        at = 0 if name == "alone" else 1
        cells[at], cells[3 + at] = factor(found), percent(found["as_far_below"])
        rows.append([words, *cells])
    title = (
        "Bayes factors over a D_R error alone ± Monte Carlo error; how often R² at 0 % falls as "
        "far below that at 5 % as published; posterior size, median [5 %, 95 %]"
    )
    return [_table(title, header, rows)]


def cause_rupture_tables(d: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the table of (d)."""
    rows = [
        [
            name,
            *(f"{found['criteria'][c]['probability']:.1e}" for c in CRITERIA),
            *(factor(found["criteria"][c]) for c in CRITERIA),
            percent(found["criteria"][CRITERIA[0]]["share_outside"]),
        ]
        for name, found in d["causes"].items()
        if found["changes_bursts"]
    ]
    start = [f"{d['without_cause'][c]['probability']:.1e}" for c in CRITERIA]
    words = [c.replace("_", " ") for c in CRITERIA]
    return [
        _table(
            "Probability of the published counts by criterion, and Bayes factors over no cause by "
            "the same criterion ± Monte Carlo error",
            ["cause", *words, *(f"factor, {w}" for w in words), "outside"],
            [*rows, ["no cause", *start, "–", "–", "–", "–"]],
        )
    ]


def show(parts: list[dict[str, Any]]) -> None:
    """Print the answers and their tables."""
    console = Console()
    for part in parts:
        console.print(f"\n[bold]{part['question']}[/bold]\n{part['answer']}\n")
        for content in part["tables"]:
            table = Table(*content["header"], title=content["title"])
            for row in content["rows"]:
                table.add_row(*row)
            console.print(table)


def _table(title: str, header: list[str], rows: list[list[str]]) -> dict[str, Any]:
    return {"title": title, "header": header, "rows": rows}


def _size(size: dict[str, float], unit: str) -> str:
    low, middle, high = (size[key] for key in ("q05", "median", "q95"))
    return f"{middle:.2g} [{low:.2g}, {high:.2g}] {unit}".removesuffix(" –")


def _interval(by_level: dict[str, list[float]], level: int) -> str:
    low, middle, high = (by_level[key][level] for key in ("q05", "median", "q95"))
    return f"{middle:.2g} [{low:.2g}, {high:.2g}]"
