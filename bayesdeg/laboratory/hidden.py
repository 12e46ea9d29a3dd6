"""Hidden effects of benchmark studies, and a method's answers: files and their faults.

Truths and answers have one row per study. An answer is a product of sets: one cause of each set
acts, so ``[["creep", "mullins"], ["gravity"]]``, in a cell ``creep|mullins;gravity``, means "creep
or mullins, and also gravity".
"""

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from enum import StrEnum

from pydantic import Field, ValidationError

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.outcome import Outcome
from bayesdeg.data.cells import read_cells, read_number
from bayesdeg.errors import Fault, StudyError, nearest, use_one_of
from bayesdeg.files import parse_json
from bayesdeg.records import FileRecord, Names, NeededText, Number, Numbers, Record, RecordError
from bayesdeg.records import Text as Words

Sets = tuple[tuple[str, ...], ...]

JSON_LINES = (".jsonl", ".ndjson", ".json")
NEEDED = ("study", "outcome", "causes")
COLUMNS = (*NEEDED, "p_value", "sizes", "probabilities")
#: No study hides more than two causes; more sets than this have too many combinations.
MOST_SETS = 4
#: Outcomes with causes; the others have none.
SAYING = (Outcome.NAMED, Outcome.AMBIGUOUS)
_SIZE = re.compile(r"(?P<name>[^=]+)=(?P<mean>[^\[\]]+)\[(?P<low>[^:\]]+):(?P<high>[^\]]+)\]")
_AS_SIZE = "write cause.parameter=mean[q05:q95], such as pressure_offset.offset=14[13.2:14.8]"
_AS_PROBABILITY = "write cause=probability, such as creep=0.9;mullins=0.1"
_AS_LINE = "write one JSON object per line, as in docs/schemas"


class Origin(StrEnum):
    """How an effect was planted in a study."""

    NOTHING = "nothing"
    RULE = "rule"
    """By the catalogue's own function, with which bayesdeg explains data."""
    PHYSICS = "physics"
    """A cause of the catalogue, planted by a solved material field, not by its rule."""
    OUTSIDE = "outside"
    """An effect without an entry in the catalogue."""


class HiddenTruth(FileRecord):
    """One line of the truth file.

    Examples
    --------
    >>> truth = HiddenTruth(study="0001", origin=Origin.RULE, hidden={"creep": {"amount": 0.1}})
    >>> truth.causes, truth.is_outside
    (('creep',), False)
    """

    study: NeededText = Field(description="name of the study folder")
    origin: Origin = Field(description="how the effect was planted in the study")
    design: Words = Field(default="", description="design of the tests")
    hidden: Mapping[str, Numbers] = Field(
        default={}, description="true sizes by cause and parameter, in the units of the catalogue"
    )
    visible: Numbers = Field(
        default={},
        description="visibility by cause: its size after a refit of everything else, in standard "
        "deviations of noise and scatter; `together` for two",
    )
    mechanism: Words = Field(default="", description="of an effect outside the catalogue")

    @property
    def causes(self) -> tuple[str, ...]:
        """Names of the hidden causes."""
        return tuple(self.hidden)

    @property
    def is_outside(self) -> bool:
        """Whether the hidden effect has no entry in the catalogue."""
        return self.origin is Origin.OUTSIDE


class StatedSize(Record):
    """A size with its 90 % interval, in the unit of the catalogue."""

    mean: Number = None
    q05: Number = None
    q95: Number = None


class HiddenAnswer(FileRecord):
    """A method's answer for one study: a line of JSON, or a CSV row of the same content.

    Examples
    --------
    >>> answer = HiddenAnswer(study="0001", outcome=Outcome.NAMED, sets=(("creep", "mullins"),))
    >>> sets_text(answer.sets)
    'creep|mullins'
    """

    study: NeededText = Field(description="name of the study folder")
    outcome: Outcome = Field(description="outcome; only named and ambiguous have causes")
    sets: tuple[Names, ...] = Field(
        default=(), description="product of sets: one cause of each set acts"
    )
    alternatives: tuple[Names, ...] = Field(
        default=(), description="instead of sets: combinations of causes, one of which acts"
    )
    p_value: Number = Field(default=None, description="p-value of the misfit without a cause")
    sizes: Mapping[str, StatedSize] = Field(default={}, description="sizes by cause.parameter")
    probabilities: Numbers = Field(
        default={}, description="probability that a cause acts, by cause; 0 if not listed"
    )


def sets_text(sets: Iterable[Iterable[str]]) -> str:
    """Return a product of sets as written in a cell.

    Examples
    --------
    >>> sets_text([["creep", "mullins"], ["gravity"]])
    'creep|mullins;gravity'
    """
    return ";".join("|".join(names) for names in sets)


def parse_sets(text: str) -> Sets:
    """Return the product of sets in a cell; empty for an empty cell.

    Raises
    ------
    ValueError
        If a name is missing between two separators.

    Examples
    --------
    >>> parse_sets("creep|mullins; gravity"), parse_sets("")
    ((('creep', 'mullins'), ('gravity',)), ())
    """
    if not text.strip():
        return ()
    sets = tuple(tuple(name.strip() for name in part.split("|")) for part in text.split(";"))
    if not all(all(names) for names in sets):
        raise ValueError("has an empty name; write a|b;c for a or b, and c")
    return sets


def read_answers(content: bytes, file: str) -> tuple[HiddenAnswer, ...]:
    r"""Read a method's answers from CSV or JSON lines.

    ``file`` is its name, for faults; the ending decides between JSON lines and CSV with `COLUMNS`.

    Raises
    ------
    StudyError
        Lists every fault of the file.

    Examples
    --------
    >>> read_answers(b"study,outcome,causes\n0001,adequate,\n", "answers.csv")[0].outcome
    <Outcome.ADEQUATE: 'adequate'>
    >>> read_answers(b"study,outcome,causes\n0001,named,crep\n", "answers.csv")
    Traceback (most recent call last):
    ...
    bayesdeg.errors.StudyError: answers.csv, row 2, column causes, value 'crep': is not a cause; ...
    """
    faults: list[Fault] = []
    rows = _rows(content, file, faults)
    return _sound(HiddenAnswer, rows, wrong_answer, file, faults)


def read_truths(content: bytes, file: str) -> tuple[HiddenTruth, ...]:
    r"""Read the truths from JSON lines.

    ``file`` is its name, for faults.

    Raises
    ------
    StudyError
        Lists every fault of the file.

    Examples
    --------
    >>> read_truths(b'{"study": "0001", "origin": "nothing"}\n', "truths.jsonl")[0].causes
    ()
    """
    faults: list[Fault] = []
    rows = _lines(content, file, faults)
    return _sound(HiddenTruth, rows, _wrong_truth, file, faults)


def _sound[T: (HiddenAnswer, HiddenTruth)](
    kind: type[T],
    rows: Iterable[tuple[int, object]],
    wrong: Callable[[T, str, int], Iterable[Fault]],
    file: str,
    faults: list[Fault],
) -> tuple[T, ...]:
    """Return the records of rows, one per study; raise an error with all their faults."""
    found: list[T] = []
    first: dict[str, int] = {}
    twice: list[Fault] = []
    for row, content in rows:
        try:
            record = kind.read(content)
        except RecordError as fault:
            faults.append(Fault(file, str(fault), "correct it", row))
            continue
        except ValidationError as fault:
            faults.append(Fault(file, str(fault.errors()[0]["msg"]), "correct it", row))
            continue
        faults += wrong(record, file, row)
        found.append(record)
        if record.study in first:
            problem = f"is also on row {first[record.study]}"
            twice.append(Fault(file, problem, "keep one row per study", row, "study", record.study))
        first.setdefault(record.study, row)
    faults += twice
    if not first:
        faults.append(Fault(file, "has no study", "give one row per study"))
    if faults:
        raise StudyError(faults)
    return tuple(found)


def lines_of(records: Iterable[FileRecord]) -> str:
    """Return records as JSON lines.

    Examples
    --------
    >>> print(lines_of([HiddenTruth(study="0001", origin=Origin.NOTHING)])[:37])
    {"schema_version": 1, "study": "0001"
    """
    return "".join(f"{json.dumps(record.document(), ensure_ascii=False)}\n" for record in records)


def wrong_answer(answer: HiddenAnswer, file: str, row: int | None = None) -> Iterator[Fault]:
    """Yield contradictions in a well-formed answer; file and row are its place, for the faults."""

    def fault(column: str, value: object, problem: str, remedy: str) -> Fault:
        return Fault(file, problem, remedy, row, column, str(value))

    groups = (*answer.sets, *answer.alternatives)
    said = [name for names in groups for name in names]
    for name in dict.fromkeys(said):
        if name not in CATALOGUE:
            yield fault("causes", name, "is not a cause", use_one_of(name, CATALOGUE))
        elif any(names.count(name) > 1 for names in groups):
            yield fault("causes", name, "is twice in a set", "give it once")
    if len(answer.sets) > MOST_SETS:
        yield fault("causes", len(answer.sets), "are too many sets", f"give at most {MOST_SETS}")
    if answer.sets and answer.alternatives:
        yield fault("alternatives", len(answer.alternatives), "are given besides sets", "give one")
    if not all(groups):
        yield fault("causes", "", "has an empty set", "remove it")
    if bool(said) != (answer.outcome in SAYING):
        word = "names causes" if said else "names no cause"
        remedy = "named and ambiguous need causes, the other outcomes have none"
        yield fault("outcome", answer.outcome, f"does not fit a row that {word}", remedy)
    chances = {"p_value": answer.p_value}
    for column, value in (
        chances | {f"probabilities {k}": v for k, v in answer.probabilities.items()}
    ).items():
        if value is not None and not 0.0 <= value <= 1.0:
            remedy = "give a number from 0 to 1"
            yield fault(column.split()[0], value, "is not a probability", remedy)
    for name in answer.probabilities:
        if name not in CATALOGUE:
            yield fault("probabilities", name, "is not a cause", use_one_of(name, CATALOGUE))
    for name, size in answer.sizes.items():
        cause, _, parameter = name.partition(".")
        known = [p.name for p in CATALOGUE[cause].parameters] if cause in CATALOGUE else []
        if not known:
            yield fault("sizes", name, "is not of a known cause", use_one_of(cause, CATALOGUE))
        elif parameter not in known:
            remedy = use_one_of(parameter, known)
            yield fault("sizes", name, "is not a parameter of this cause", remedy)
        if size.q05 is None or size.q95 is None or size.q05 > size.q95:
            remedy = f"give q05 and q95, with q05 ≤ q95; {_AS_SIZE}"
            yield fault("sizes", name, "has no interval", remedy)


def _wrong_truth(truth: HiddenTruth, file: str, row: int) -> Iterator[Fault]:
    for name in truth.causes:
        if not truth.is_outside and name not in CATALOGUE:
            remedy = use_one_of(name, CATALOGUE)
            yield Fault(file, "is not a cause", remedy, row, "hidden", name)
    if bool(truth.hidden) == (truth.origin is Origin.NOTHING):
        remedy = f"{Origin.NOTHING} is for studies in which nothing is hidden, and only for these"
        yield Fault(file, "does not fit what is hidden", remedy, row, "origin", truth.origin)


def _rows(content: bytes, file: str, faults: list[Fault]) -> Iterator[tuple[int, object]]:
    """Yield the rows of JSON lines, or CSV rows as equivalent objects, without faults."""
    if file.lower().endswith(JSON_LINES):
        yield from _lines(content, file, faults)
        return
    cells, wrong = read_cells(content, file)
    faults += wrong
    if cells is None:
        return
    file, names = cells.file, [str(name) for name in cells.texts.columns]
    header = [
        Fault(file, "is not a column of answers", use_one_of(name, COLUMNS), cells.header_row, name)
        for name in names
        if name not in COLUMNS
    ]
    remedy = f"add it; the columns are {', '.join(COLUMNS)}"
    header += [
        Fault(file, "is missing", remedy, cells.header_row, name)
        for name in NEEDED
        if name not in names and nearest(name, names) is None
    ]
    faults += header
    for index, texts in cells.texts.iterrows() if not header else ():
        row, found = int(str(index)), dict[str, object]()
        known = {str(name): str(text) for name, text in texts.items()}
        for name, (key, parse) in _PARSED.items():
            text = known.get(name, "")
            try:
                found[key] = parse(text)
            except ValueError as fault:
                problem, _, remedy = str(fault).partition("; ")
                faults.append(Fault(file, problem, remedy, row, name, text))
        if len(found) == len(_PARSED):
            yield row, found


def _needed(text: str) -> str:
    if not text:
        raise ValueError("is empty; give the name of the study's folder")
    return text


def _outcome(text: str) -> str:
    if text not in list(Outcome):
        raise ValueError(f"is not an outcome; {use_one_of(text, list(Outcome))}")
    return text


def _number(text: str) -> float | None:
    if not text:
        return None
    value = read_number(text.strip())
    if isinstance(value, tuple):
        raise ValueError("; ".join(value))
    return value


def _by_name(text: str, remedy: str) -> Iterator[tuple[str, str]]:
    for part in text.split(";") if text else ():
        name, equals, value = (one.strip() for one in part.partition("="))
        if not (name and equals and value):
            raise ValueError(f"cannot be read at {part!r}; {remedy}")
        yield name, value


def _sizes(text: str) -> dict[str, dict[str, float | None]]:
    found = {}
    for name, value in _by_name(text, _AS_SIZE):
        match = _SIZE.fullmatch(f"{name}={value}")
        if match is None:
            raise ValueError(f"cannot be read at {name!r}; {_AS_SIZE}")
        ends = {"mean": match["mean"], "q05": match["low"], "q95": match["high"]}
        found[name] = {end: _number(number) for end, number in ends.items()}
    return found


_PARSED: Mapping[str, tuple[str, Callable[[str], object]]] = {
    "study": ("study", _needed),
    "outcome": ("outcome", _outcome),
    "causes": ("sets", parse_sets),
    "p_value": ("p_value", _number),
    "sizes": ("sizes", _sizes),
    "probabilities": (
        "probabilities",
        lambda text: {name: _number(one) for name, one in _by_name(text, _AS_PROBABILITY)},
    ),
}
"""By column: the key of the record, and the reader of the cell."""


def _lines(content: bytes, file: str, faults: list[Fault]) -> Iterator[tuple[int, object]]:
    try:
        lines = content.decode("utf-8-sig").splitlines()
    except UnicodeDecodeError:
        faults.append(Fault(file, "is not UTF-8 text", "save it in UTF-8"))
        return
    for row, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            yield row, parse_json(line)
        except ValueError as fault:
            faults.append(Fault(file, f"is no JSON ({fault})", _AS_LINE, row))
            return  # a document over many lines would have a fault in each
