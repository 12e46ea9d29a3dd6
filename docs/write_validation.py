"""Write the tables of accuracy in `validation.md` and `README.md` from recorded results.

Each figure is computed from a file that a command wrote; the table names both, with the commit
that last changed the file. A claim without a recorded file is no row.

    uv run python docs/write_validation.py
"""

import csv
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))  # scripts, no package

import rupture
import scored_methods
from hidden_record import read_record
from hidden_summary import summary_of_record

from bayesdeg.laboratory.score import score, wilson

ROOT = Path(__file__).resolve().parents[1]
BENCHMARKS, REPORTS = ROOT / "benchmarks", ROOT / "reports"
PAGES = {"claims": ROOT / "docs" / "validation.md", "rates": ROOT / "README.md"}
UNKNOWN = "not known"
NORMAL_95 = 1.96  # half of a 95 % interval, in standard errors
Json = dict[str, Any]


class Claim(NamedTuple):
    """A row of the table.

    Parameters
    ----------
    text : str
    figure : str
        With its interval, if it has one.
    n : int
        Studies, specimens or readings that it rests on.
    command : str
        What writes the record.
    record : Path
    """

    text: str
    figure: str
    n: int
    command: str
    record: Path


#: Rates of hidden effects: words, figure and number of cases of `hidden_summary.summary`.
RATES = (
    ("right, single causes of 5 sd or more", "named_correctly", "visible_studies"),
    ("wrong cause named, all single causes", "wrongly_named", "single_studies"),
    ("named, nothing hidden", "false_name_rate", "none_studies"),
    ("named, effect not in the catalogue", "outside_catalogue_named", "outside_studies"),
    ("both named, two causes of 5 sd or more", "two_causes_both_named", "pair_studies"),
)
FURTHER = (
    ("named alone, single causes of 5 sd or more", "named_alone", "visible_studies"),
    ("both causes in the stated sets", "two_causes_both_in_a_stated_set", "pair_studies"),
    ("true size inside its 90 % interval", "size_coverage_90", "sizes"),
    ("same verdict with another seed", "same_verdict_redrawn", "compared_draws"),
    ("same verdict at standard effort", "same_verdict", "compared_efforts"),
)
SINGLE = (RATES[0], RATES[1], FURTHER[2])
#: Recorded verdicts: what was hidden, the file, options of the command, rates.
HIDDEN = (
    ("", "hidden_effects", "--studies 510 --again 60 --draws 3", (*RATES, *FURTHER)),
    ("planted by separate physics: ", "hidden_by_physics", "--first 700 --studies 233", SINGLE),
    ("other actuators: ", "other_actuators", "--studies 9", RATES[:1]),
)


def claims() -> Iterator[Claim]:
    """Yield every row, computed from the records."""
    for prefix, name, options, rates in HIDDEN:
        program = "other_actuators" if name == "other_actuators" else "hidden_effects"
        record = BENCHMARKS / f"{name}.jsonl"
        command = f"uv run python benchmarks/{program}.py {options} --record {_place(record)}"
        figures = _summary(record)
        for text, key, of in rates:
            yield Claim(
                prefix + text, _share(figures[key], figures[of]), figures[of], command, record
            )
    yield from _scored()
    yield from _ruptures()
    yield from _published()


def _summary(record: Path) -> Json:
    return summary_of_record(read_record(record).values())


def _share(share: float, n: int) -> str:
    low, high = wilson(share * n, n)
    return f"{share:.2f} ({low:.2f}–{high:.2f})"


def _scored() -> Iterator[Claim]:
    record = BENCHMARKS / "scored"
    truths, answers = scored_methods.recorded(record)
    command = f"uv run python benchmarks/scored_methods.py --record {_place(record)}"
    for method, given in answers.items():
        credit = score(given, truths, method).credit
        figure = f"{credit.share:.2f} ({credit.low:.2f}–{credit.high:.2f})"
        text = f"benchmark credit: {scored_methods.WORDS[method]}"
        yield Claim(text, figure, credit.studies, command, record)


def _ruptures() -> Iterator[Claim]:
    record = BENCHMARKS / "rupture.jsonl"
    found = rupture.summary(list(rupture.read_record(record).values()))
    command = f"uv run python benchmarks/rupture.py --quick --record {_place(record)}"
    coverage, error = found["burst_coverage_90"], NORMAL_95 * found["burst_coverage_90_error"]
    figure = f"{coverage:.3f} ({coverage - error:.3f}–{coverage + error:.3f})"
    text = "burst pressure inside its 90 % interval"
    yield Claim(text, figure, found["actuators"], command, record)
    text = "largest gap between predicted and observed rupture rates, by tenths"
    yield Claim(text, f"{found['reliability_error']:.3f}", found["actuators"], command, record)
    shares = (
        ("flaws named where four or more actuators burst early", "flaws_named", "flaws_visible"),
        ("a cause named without flaws", "anything_false", "without_flaws"),
    )
    for text, key, of in shares:
        yield Claim(text, _share(found[key], found[of]), found[of], command, record)


def _published() -> Iterator[Claim]:
    command = "uv run python docs/publish_reports.py"
    for study, words in (
        ("gelatin_actuator", "virtual actuators, true offset {offset:g} kPa: {cause}"),
        ("treloar", "Treloar's rubber (real): {cause}"),
    ):
        record = REPORTS / study / "verdict.json"
        verdict = json.loads(record.read_text(encoding="utf-8"))
        (cause,) = verdict["causes"]
        (found,) = (one for one in verdict["candidates"] if one["cause"] == cause)
        gain = _gain(REPORTS / study / "gain.csv", f"base+{cause}")
        text = words.format(cause=f"`{cause}`", **_hidden(study))
        (size,) = found["effect"].values()
        unit = "" if size["unit"] == "–" else f" {size['unit']}"
        figure = f"{size['mean']:.3g}{unit} (90 %: {size['q05']:.3g}–{size['q95']:.3g})"
        n = _readings(study)
        yield Claim(text, figure, n, command, record)
        figure = f"{float(gain['elpd_diff']):.3g} ± {float(gain['elpd_diff_se']):.2g}"
        text = f"gain in log density of these held-out readings, `{study}`"
        yield Claim(text, figure, n, command, record)


def _hidden(study: str) -> dict[str, float]:
    """Return the sizes that a virtual study hides, by parameter."""
    truth = ROOT / "studies" / study / "truth.json"
    if not truth.exists():
        return {}
    causes: dict[str, dict[str, float]] = json.loads(truth.read_text(encoding="utf-8"))["causes"]
    return {name: size for sizes in causes.values() for name, size in sizes.items()}


def _gain(table: Path, model: str) -> dict[str, str]:
    with table.open(encoding="utf-8", newline="") as file:
        (row,) = (
            one
            for one in csv.DictReader(file)
            if (one["model"], one["degradation_pct"]) == (model, "all")
        )
    return row


def _readings(study: str) -> int:
    """Count the readings of the specimens that a published report judges."""
    names = ("observations.csv", "tensile.csv")
    table = next(p for p in (REPORTS / study / name for name in names) if p.exists())
    with table.open(encoding="utf-8", newline="") as file:
        return sum(row.get("model", "base") == "base" for row in csv.DictReader(file))


def _place(record: Path) -> str:
    return record.relative_to(ROOT).as_posix()


def age(record: Path) -> str:
    """Return commit and date that last changed a record; words where history cannot say."""
    path = _place(record)
    if _git("rev-parse", "--is-shallow-repository") != "false":
        return UNKNOWN
    if _git("status", "--porcelain", "--", path):
        return "not committed"
    return _git("log", "-1", "--format=%h, %cs", "--abbrev=8", "--", path) or UNKNOWN


def _git(*words: str) -> str:
    try:
        done = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):  # no git, or no history
        return ""
    return done.stdout.strip()


def tables() -> dict[str, str]:
    """Return the tables of both pages by name."""
    ages: dict[Path, str] = {}
    rows: list[tuple[str, ...]] = [
        ("claim", "figure (95 % interval)", "n", "command", "record changed")
    ]
    for one in claims():
        ages.setdefault(one.record, age(one.record))
        rows.append((one.text, one.figure, str(one.n), f"`{one.command}`", ages[one.record]))
    figures = _summary(BENCHMARKS / "hidden_effects.jsonl")
    rates: list[tuple[str, ...]] = [
        ("virtual studies with hidden effects", "of", "share (95 % interval)")
    ]
    rates += [(text, str(figures[of]), _share(figures[k], figures[of])) for text, k, of in RATES]
    return {"claims": _markdown(rows), "rates": _markdown(rates)}


def _markdown(rows: list[tuple[str, ...]]) -> str:
    lines = ["| " + " | ".join(line) + " |" for line in rows]
    return "\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]])


def block(name: str) -> re.Pattern[str]:
    """Return what finds a table between its marks, as its second group."""
    return re.compile(rf"(<!-- {name} -->\n)(.*?)(\n<!-- end -->)", re.DOTALL)


def main() -> None:
    """Write both tables into their pages."""
    for name, table in tables().items():
        text = PAGES[name].read_text(encoding="utf-8")
        found = block(name).search(text)
        if found is None:
            raise SystemExit(f"{PAGES[name].name}: add a block `<!-- {name} -->`")
        written = text[: found.start(2)] + table + text[found.end(2) :]
        PAGES[name].write_text(written, encoding="utf-8")


if __name__ == "__main__":
    main()
