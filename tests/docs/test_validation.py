"""The tables of accuracy are what `docs/write_validation.py` computes from the records."""

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def writing():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "docs"))
        patch.syspath_prepend(str(ROOT / "benchmarks"))
        import write_validation  # noqa: PLC0415

        yield write_validation


def without_age(table):
    """Commits get other names when branches are joined, so the last column is not compared."""
    return [line.rsplit(" | ", 1)[0] for line in table.splitlines()]


def test_the_tables_are_those_of_the_records(writing):
    tables = writing.tables()
    claims = writing.block("claims").search(writing.PAGES["claims"].read_text(encoding="utf-8"))
    assert without_age(claims[2]) == without_age(tables["claims"])
    rates = writing.block("rates").search(writing.PAGES["rates"].read_text(encoding="utf-8"))
    assert rates[2] == tables["rates"]


def test_a_checkout_without_history_has_no_ages(writing, monkeypatch):
    record = writing.BENCHMARKS / "rupture.jsonl"
    assert writing.age(record) != ""
    monkeypatch.setattr(writing, "ROOT", Path("/"))
    assert writing.age(record) == writing.UNKNOWN
