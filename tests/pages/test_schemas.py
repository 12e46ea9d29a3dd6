"""The published JSON schemas are those of the records, and what a run writes obeys them."""

import json
from pathlib import Path

import pytest

from bayesdeg.pages.record import RunRecord, VerdictRecord
from bayesdeg.records import LARGEST, VERSION, Real, Record, RecordError
from docs.write_schemas import SCHEMAS, write_schemas
from tests.pages.synthetic_run import write_full

PUBLISHED = Path(__file__).resolve().parents[2] / "docs" / "schemas"


def test_published_schemas_are_up_to_date(tmp_path):
    write_schemas(tmp_path)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {path.name for path in PUBLISHED.glob("*.json")}
    for name in names:
        published, written = (folder / name for folder in (PUBLISHED, tmp_path))
        assert published.read_text("utf-8") == written.read_text("utf-8"), (
            f"{name} is out of date: run `uv run python docs/write_schemas.py`"
        )


def every_record(known=Record):
    for one in known.__subclasses__():
        yield one
        yield from every_record(one)


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_file_says_which_version_of_its_format_it_is(name):
    schema = json.loads(SCHEMAS[name].schema_text())
    assert schema["properties"]["schema_version"]["default"] == VERSION


@pytest.mark.parametrize("kind", [VerdictRecord, RunRecord])
def test_what_is_written_comes_back(kind, tmp_path):
    folder = write_full(tmp_path, "ambiguous")
    record = folder.read_verdict() if kind is VerdictRecord else folder.read_run()
    assert kind.read(json.loads(record.text())) == record
    assert next(iter(json.loads(record.text()))) == "schema_version"


@pytest.mark.parametrize("name", SCHEMAS)
def test_the_schema_has_the_keys_that_are_written(name):
    schema = json.loads(SCHEMAS[name].schema_text())
    classes = {one.__name__: one for one in every_record()}
    for title, part in ({SCHEMAS[name].__name__: schema} | schema.get("$defs", {})).items():
        if title in classes:
            fields = classes[title].model_fields
            keys = {field.serialization_alias or name for name, field in fields.items()}
            assert set(part["properties"]) <= keys, title


def test_numbers_that_no_reader_accepts_are_written_as_null():
    class Size(Record):
        value: Real = float("nan")

    for value in (2.0 * LARGEST, -2.0 * LARGEST, float("inf"), float("nan")):
        assert Size(value=value).document() == {"value": None}
    assert Size(value=LARGEST).document() == {"value": LARGEST}


def test_keys_of_another_version_are_passed_over_and_a_newer_format_is_refused():
    verdict = VerdictRecord.read({"outcome": "adequate", "colour": "red"})
    assert "colour" not in verdict.document()
    with pytest.raises(RecordError, match="newer bayesdeg"):
        VerdictRecord.read({"outcome": "adequate", "schema_version": VERSION + 1})
