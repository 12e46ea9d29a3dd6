"""Write the JSON schemas of what bayesdeg writes: python docs/write_schemas.py [FOLDER]."""

import sys
from pathlib import Path

from bayesdeg.commands.answers import Answer
from bayesdeg.commands.next import Proposals
from bayesdeg.commands.update import UpdateAnswer
from bayesdeg.laboratory.hidden import HiddenAnswer, HiddenTruth
from bayesdeg.laboratory.score import Score
from bayesdeg.laboratory.writing import TruthRecord
from bayesdeg.pages.output import Owner
from bayesdeg.pages.record import RunRecord, VerdictRecord
from bayesdeg.records import FileRecord
from bayesdeg_camera.folder import TraceFile

SCHEMAS: dict[str, type[FileRecord]] = {
    "verdict": VerdictRecord,
    "run": RunRecord,
    "truth": TruthRecord,
    "study-of-a-run": Owner,
    "answer": Answer,
    "next": Proposals,
    "update": UpdateAnswer,
    "trace": TraceFile,
    "hidden-truth": HiddenTruth,
    "hidden-answer": HiddenAnswer,
    "score": Score,
}


def write_schemas(folder: Path) -> None:
    """Write the schema of every file, ``NAME.json`` each."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, record in SCHEMAS.items():
        (folder / f"{name}.json").write_text(record.schema_text(), encoding="utf-8")


if __name__ == "__main__":
    write_schemas(Path(sys.argv[1]) if sys.argv[1:] else Path(__file__).parent / "schemas")
