"""The answers' numbers as tables, for the page and the terminal."""

from typing import Any

from rich.console import Console
from rich.table import Table

from bayesdeg.material.criteria import CRITERIA
from nagai_2021.agreement import MODELS
from nagai_2021.published import LEVELS, R_SQUARED
from nagai_2021.words import percent


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
            ["what acts", "of the counts", "Bayes factor", "bursts at 0 %", "20 %", "25 %"],
            hypotheses,
        ),
        _table(
            "Factor on strain at which half would burst, and the probability that none below "
            "25 % does if a common factor makes it two in three there",
            ["criterion", "0 %", "20 %", "25 %", "none below"],
            needed,
        ),
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


def _interval(by_level: dict[str, list[float]], level: int) -> str:
    low, middle, high = (by_level[key][level] for key in ("q05", "median", "q95"))
    return f"{middle:.2g} [{low:.2g}, {high:.2g}]"
