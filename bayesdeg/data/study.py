"""Read a study folder: settings and checked tables, or all faults at once."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd
import pandera.pandas as pa

from bayesdeg.data import readings
from bayesdeg.data.captures import FILE as CAPTURES_FILE
from bayesdeg.data.captures import CapturedLine
from bayesdeg.data.cells import Cells, check_header, least_digit, read_cells, read_number
from bayesdeg.data.families import MeshDimensions
from bayesdeg.data.foreign import translated
from bayesdeg.data.part import PartError, bending_of, plane_of, read_part
from bayesdeg.data.photographs import FILE as PHOTOS_FILE
from bayesdeg.data.photographs import TracedPhotograph
from bayesdeg.data.settings import FILE as SETTINGS_FILE
from bayesdeg.data.settings import AnyDimensions, Settings, parse_settings
from bayesdeg.data.tables import BASE_TABLES, Table, broken, row_check, words_of
from bayesdeg.errors import Fault, StudyError, nearest, use_one_of
from bayesdeg.files import STUDY_MB, as_named, read_bytes, reason
from bayesdeg.quantities import DIMENSIONLESS, QUANTITIES, UNLOADING

MARKERS_FILE = "markers.csv"
#: Tables that give lines of points, and their files.
OF_LINES = {"photos": PHOTOS_FILE, "captures": CAPTURES_FILE}
#: Folder of a study's own causes.
CAUSES = "causes"
#: Number of equal faults in a column that are listed one by one.
TOLD_ONE_BY_ONE = 5
#: Share of a film's stretch range by which stretch may fall back during loading.
LARGEST_SLIP = 0.03
#: Statistics that concern degradation or shrinkage at any rate.
OF_DEGRADATION = ("volume_ratio", "mass_loss_slope")


class Why(StrEnum):
    """Reason why rows are not used."""

    AFTER_BURST = "after_burst"
    OUTSIDE_RANGE = "outside_stretch_range"
    UNDEFORMED = "undeformed"
    UNLOADED = "unloaded"
    BEYOND_REACH = "beyond_reach"
    SET_ASIDE = "set_aside"


@dataclass(frozen=True)
class Unused:
    """Rows of a file that no likelihood uses.

    Parameters
    ----------
    file : str
        Its name.
    why : Why
        The reason.
    rows : int
        Number of rows, at least one.
    specimens : tuple of str
        Specimens of these rows.
    """

    file: str
    why: Why
    rows: int
    specimens: tuple[str, ...]


def unused_of(file: str, why: Why, table: pd.DataFrame) -> tuple[Unused, ...]:
    """Return the entry for unused rows; empty if there are none.

    Examples
    --------
    >>> rows = pd.DataFrame({"specimen_id": ["a", "a", "b"]})
    >>> unused_of("force.csv", Why.UNLOADED, rows)[0].specimens
    ('a', 'b')
    """
    if table.empty:
        return ()
    named = table["specimen_id"].astype(str) if "specimen_id" in table else pd.Series(dtype=str)
    return (Unused(file, why, len(table), tuple(dict.fromkeys(named))),)


def undeformed(tensile: pd.DataFrame) -> pd.Series:
    """Return which film rows have a stretch of exactly 1 and a stress of exactly 0.

    Every material law, with any cause, satisfies them, so they carry no information; and an exactly
    met prediction lets a density grow without bound as its error shrinks.

    Examples
    --------
    >>> films = pd.DataFrame({"stretch": [1.0, 1.0, 1.2], "stress_MPa": [0.0, 0.001, 0.0]})
    >>> undeformed(films).tolist()
    [True, False, False]
    """
    return (tensile["stretch"] == 1.0) & (tensile["stress_MPa"] == 0.0)


def at_rest(tables: Iterable[tuple[str, pd.DataFrame | None]]) -> tuple[Unused, ...]:
    """Return the rows of tables without load, whose readings are 0 by the laws or by definition.

    Tables are of films or actuators, with the names of their files.
    """
    found: list[Unused] = []
    for file, table in tables:
        if table is None:
            continue
        if "stretch" in table:
            found += unused_of(file, Why.UNDEFORMED, table[undeformed(table)])
        else:
            found += unused_of(file, Why.UNLOADED, table[table["pressure_kPa"] == 0.0])
    return tuple(found)


@dataclass(frozen=True)
class CheckedTable:
    """A file after reading and checks.

    Parameters
    ----------
    frame : pandas.DataFrame
        Columns of the contract in its order, then extra ones as text. Absent or empty cells
        hold their default, or nan for "not recorded". Only use it if there is no fault.
    faults : tuple of Fault
        All faults of the file.
    recorded : frozenset of str
        Columns in which the file itself gives at least one cell.
    passed_over : int
        Comments that look like rows of data.
    unread : tuple of Unused
        Rows after a burst.
    digits : mapping of str to float
        Resolution of each numeric column, in its unit.
    """

    frame: pd.DataFrame
    faults: tuple[Fault, ...]
    recorded: frozenset[str]
    passed_over: int = 0
    unread: tuple[Unused, ...] = ()
    digits: Mapping[str, float] = field(default_factory=dict)


def check_table(
    content: bytes, table: pa.DataFrameSchema, *, degradation_sd_pct: float
) -> CheckedTable:
    r"""Read one file of a study and check it against its table.

    A cell that cannot be read is one fault and takes no part in further checks, so that one slip is
    reported once.

    Parameters
    ----------
    content : bytes
        The file as stored.
    table : pandera.DataFrameSchema
        Of a `bayesdeg.data.tables.Table`.
    degradation_sd_pct : float
        Standard error of a degradation rate where none is recorded [%].

    Examples
    --------
    >>> from bayesdeg.data.tables import BREAKS
    >>> content = b"specimen_id,degradation_pct,elongation_pct\na,0,210\nb,5,2oo\n"
    >>> print(check_table(content, BREAKS, degradation_sd_pct=1.0).faults[0])
    break.csv, row 3, column elongation_pct, value '2oo': is not a number; give the number alone; the unit belongs in the header
    """  # noqa: E501
    columns = table.columns
    required = [name for name, column in columns.items() if column.required]
    optional = [name for name, column in columns.items() if not column.required]
    cells, faults = read_cells(content, table.name, required or optional)
    if cells is None:
        return CheckedTable(pd.DataFrame(), faults, frozenset())
    place = Fault(table.name, "", "", cells.header_row)
    names = list(cells.texts.columns)
    blamed = check_header(names, place, required=required, optional=optional)
    whole, cells = cells.texts, replace(cells, texts=_until_rupture(cells.texts))
    frame, wrong_cells = _read_columns(cells, table)
    # the values of a misspelt column are unknown, so do not use its default
    fillable = {name: column for name, column in columns.items() if name not in blamed}
    frame = _fill(frame, fillable, degradation_sd_pct)
    wrong_rows = tuple(_broken_rules(frame, cells, table, wrong_cells))
    in_order = sorted((*wrong_cells, *wrong_rows), key=lambda fault: fault.row or 0)
    recorded = frozenset(str(name) for name in names if (cells.texts[name] != "").any())
    return CheckedTable(
        _finish(frame, table),
        _capped((*faults, *blamed.values(), *in_order)),
        recorded,
        len(cells.rows_in_comments),
        unused_of(table.name, Why.AFTER_BURST, whole.drop(index=cells.texts.index)),
        {str(n): least_digit(cells.texts[n]) for n in cells.texts if frame[n].dtype == float},
    )


def _until_rupture(texts: pd.DataFrame) -> pd.DataFrame:
    if not {"specimen_id", "ruptured"} <= set(texts.columns):
        return texts
    burst = texts["ruptured"].map(lambda text: text != "" and read_number(text) == 1.0).astype(int)
    earlier = burst.groupby(texts["specimen_id"]).cumsum() - burst
    return texts[earlier == 0]


def _read_columns(
    cells: Cells, table: pa.DataFrameSchema
) -> tuple[pd.DataFrame, tuple[Fault, ...]]:
    faults: list[Fault] = []
    read: dict[str, pd.Series] = {}
    for name, column in table.columns.items():
        if name in cells.texts:
            values = _read_column(cells, column, faults)
            values[_refused(cells, column, values, faults)] = np.nan
            read[name] = values
    extra = {name: cells.texts[name] for name in cells.texts if name not in read}
    return pd.DataFrame(read | extra, index=cells.texts.index), tuple(faults)


def _read_column(cells: Cells, column: pa.Column, faults: list[Fault]) -> pd.Series:
    values: list[object] = []
    for row, text in cells.texts[column.name].items():
        value: object = None if column.dtype.type == "str" else np.nan
        if text == "":
            if not column.nullable:
                remedy = f"give {_meant(column.name)}, or remove the row"
                faults.append(_fault(cells, int(str(row)), column.name, "is empty", remedy))
        elif column.dtype.type == "str":
            value = as_named(text)
        else:
            number = read_number(text)
            if isinstance(number, float):
                value = number
            else:
                faults.append(_fault(cells, int(str(row)), column.name, *number))
        values.append(value)
    return pd.Series(values, index=cells.texts.index, dtype=_while_checked(column))


def _meant(column: str) -> str:
    """Return the meaning of a column with its unit."""
    if column not in QUANTITIES:
        return "a value"
    meaning, unit = QUANTITIES[column].meaning, QUANTITIES[column].unit
    return f"the {meaning}" if unit == DIMENSIONLESS else f"the {meaning} [{unit}]"


def _while_checked(column: pa.Column) -> type:
    """Return a type that allows missing cells."""
    return object if column.dtype.type == "str" else float


def _refused(cells: Cells, column: pa.Column, values: pd.Series, faults: list[Fault]) -> pd.Series:
    """Return cells that break a check of their column, and report the first broken check."""
    refused = pd.Series(False, index=values.index)
    for check in column.checks:
        for row in broken(check, values[~refused]):
            text = str(cells.texts.loc[row, column.name])
            remedy = check.description or use_one_of(text, words_of(column))
            faults.append(_fault(cells, row, column.name, check.error, remedy))
            refused[row] = True
    return refused


def _fill(
    frame: pd.DataFrame, columns: Mapping[str, pa.Column], degradation_sd_pct: float
) -> pd.DataFrame:
    filled = frame.copy()
    for name, column in columns.items():
        if name not in filled and not column.required:
            filled[name] = pd.Series(np.nan, index=frame.index, dtype=_while_checked(column))
        default = degradation_sd_pct if name == "degradation_sd_pct" else column.default
        if default is not None and name in filled:
            filled[name] = filled[name].fillna(default)
    return filled


def _broken_rules(
    frame: pd.DataFrame,
    cells: Cells,
    table: pa.DataFrameSchema,
    wrong_cells: tuple[Fault, ...],
) -> Iterator[Fault]:
    spoilt = {(fault.row, fault.column) for fault in wrong_cells}
    words = ("repeats an earlier row", "remove one of them")
    repeated = row_check(None, *words, tuple(frame.columns), lambda rows: ~rows.duplicated())
    for check in (repeated, *table.checks):
        column, needs = check.statistics["column"], check.statistics["needs"]
        if frame.empty or not set(needs) <= set(frame.columns):
            continue
        rows = broken(check, frame)
        for row in rows:
            if spoilt.isdisjoint((row, name) for name in needs):
                yield _fault(cells, row, column, check.error, check.description)
        if check is repeated:
            frame = frame.drop(index=rows)


def _fault(cells: Cells, row: int, column: str | None, problem: str, remedy: str) -> Fault:
    if column is None:
        value: str | None = ",".join(str(text) for text in cells.texts.loc[[row]].to_numpy()[0])
    else:
        value = str(cells.texts.loc[row, column]) if column in cells.texts else None
    return Fault(cells.file, problem, remedy, row, column, value)


def _capped(faults: tuple[Fault, ...]) -> tuple[Fault, ...]:
    kept: list[Fault] = []
    seen: dict[tuple[str | None, str], list[Fault]] = {}
    for fault in faults:
        alike = seen.setdefault((fault.column, fault.problem), [])
        alike.append(fault)
        if len(alike) <= TOLD_ONE_BY_ONE:
            kept.append(fault)
    for alike in seen.values():
        more = len(alike) - TOLD_ONE_BY_ONE
        if more > 0:
            problem = f"{alike[0].problem}: and {more} more such row{'s' if more > 1 else ''}"
            kept.append(replace(alike[0], problem=problem, row=None, value=None))
    return tuple(kept)


def _finish(frame: pd.DataFrame, table: pa.DataFrameSchema) -> pd.DataFrame:
    listed = {name: column.dtype.type for name, column in table.columns.items() if name in frame}
    extra = [name for name in frame.columns if name not in listed]
    read = frame[[*listed, *extra]].reset_index(drop=True)
    finished = read.astype(listed)
    for name in extra:
        read[name] = read[name].where(read[name] != "")
    for name in [*extra, *(name for name, kind in listed.items() if kind == "str")]:
        # before pandas 3, missing values become text
        finished[name] = read[name].astype("str").where(read[name].notna())
    return finished


@dataclass(frozen=True, repr=False)
class Study:
    """A study as read; a table is ``None`` if its file is missing.

    Parameters
    ----------
    name : str
        Name of the folder.
    folder : Path
        Where it was read from.
    settings : Settings
        The contents of ``study.toml``.
    moisture, mass_loss, shrinkage, tensile, breaks, actuator, summary : DataFrame or None
        The checked tables: all columns of the contract, then extra ones as text. Cells not
        recorded hold their default, or nan. Rows of an actuator after its rupture are left
        out.
    hashes : mapping of str to str
        SHA-256 of each input file.
    recorded : mapping of str to frozenset of str
        By table, the columns in which the file itself gives at least one cell.
    passed_over : mapping of str to int
        By file, the number of comments that look like rows of data.
    others : mapping of str to DataFrame
        Checked tables of further kinds of data by their names.
    line_points : int, optional
        Number of evenly spaced points by which lines of ``markers.csv`` were read.
    unread : tuple of Unused
        Rows left out on reading: after a burst, outside ``stretch_range``.
    digits : mapping of str to float
        Resolution of each numeric column, in its unit.
    photographs : tuple of TracedPhotograph
        What was traced in each photograph of ``photos.csv``, including refused ones.
    captured : tuple of CapturedLine
        What was read at each hold of ``captures.csv``.
    """

    name: str
    folder: Path
    settings: Settings = field(default_factory=Settings)
    moisture: pd.DataFrame | None = None
    shrinkage: pd.DataFrame | None = None
    tensile: pd.DataFrame | None = None
    breaks: pd.DataFrame | None = None
    actuator: pd.DataFrame | None = None
    summary: pd.DataFrame | None = None
    mass_loss: pd.DataFrame | None = None
    hashes: Mapping[str, str] = field(default_factory=dict)
    recorded: Mapping[str, frozenset[str]] = field(default_factory=dict)
    passed_over: Mapping[str, int] = field(default_factory=dict)
    others: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    line_points: int | None = None
    unread: tuple[Unused, ...] = ()
    digits: Mapping[str, float] = field(default_factory=dict)
    photographs: tuple[TracedPhotograph, ...] = ()
    captured: tuple[CapturedLine, ...] = ()

    def __repr__(self) -> str:
        """Return its name and numbers of rows."""
        files = {name: table.file for name, table in BASE_TABLES.items()}
        tables = {name: self.given(name) for name in (*BASE_TABLES, *self.others)}
        rows = [
            f"{files.get(name, f'{name}.csv')} {len(table)} rows"
            for name, table in tables.items()
            if table is not None
        ]
        return f"Study {self.name}: {', '.join(rows)}"

    def table(self, name: str) -> pd.DataFrame | None:
        """Return a table of any kind by name; None if it is missing."""
        found: pd.DataFrame | None = self.others.get(name, getattr(self, name, None))
        return found

    def given(self, name: str) -> pd.DataFrame | None:
        """Return a table read from its own file; None if it was derived from lines of points."""
        of_lines = name == "actuator" and self.line_points
        of_others = name == "markers" and self.lines_file != MARKERS_FILE
        return None if of_lines or of_others else self.table(name)

    @property
    def unused(self) -> tuple[Unused, ...]:
        """Rows of its files that no likelihood uses."""
        # a row of markers.csv is a point; a row of a photograph or recording is a whole line
        bent = "actuator.csv" if self.line_points is None else self.lines_file
        actuator = "markers" if bent == MARKERS_FILE else "actuator"
        tables = {"tensile.csv": "tensile", bent: actuator, "force.csv": "force"}
        return (*self.unread, *at_rest((file, self.table(n)) for file, n in tables.items()))

    @property
    def lines_file(self) -> str:
        """The file with lines of points."""
        there = (file for name, file in OF_LINES.items() if name in self.others)
        return next(there, MARKERS_FILE)

    @property
    def degrades(self) -> bool:
        """Whether anything degrades: a specimen, a mean, or a recorded moisture or α.

        Otherwise the model has no parameter of degradation or shrinkage, and reports do not
        mention them.

        Examples
        --------
        >>> fresh = pd.DataFrame({"degradation_pct": [0.0, 0.0]})
        >>> Study("silicone", Path("silicone"), tensile=fresh).degrades
        False
        >>> Study("gelatin", Path("gelatin"), tensile=fresh, moisture=pd.DataFrame()).degrades
        True
        """
        if any(one is not None for one in (self.moisture, self.mass_loss, self.shrinkage)):
            return True
        if self.summary is not None and self.summary["quantity"].isin(OF_DEGRADATION).any():
            return True
        tables = (self.table(name) for name in (*BASE_TABLES, *self.others))
        found = (table for table in tables if table is not None and "degradation_pct" in table)
        return any(bool((table["degradation_pct"].abs() > 0.0).any()) for table in found)

    @property
    def geometry(self) -> AnyDimensions:
        """Dimensions of the actuator as moulded, from ``[actuator]`` of ``study.toml``."""
        return self.settings.dimensions


def read_study(folder: Path | str, tables: Mapping[str, Table] = BASE_TABLES) -> Study:
    r"""Read a study folder and check everything in it.

    Parameters
    ----------
    folder : Path or str
        Contains ``study.toml`` and at least one data file.
    tables : mapping of str to Table
        Kinds of data to read; `bayesdeg.assembly.reading.read_study` reads all.

    Returns
    -------
    Study

    Raises
    ------
    StudyError
        Lists every fault of every file.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as made:
    ...     _ = (Path(made) / "study.toml").write_text("seed = 7")
    ...     _ = (Path(made) / "break.csv").write_text(
    ...         "specimen_id,degradation_pct,elongation_pct\na,0,209.8\n"
    ...     )
    ...     study = read_study(Path(made))
    >>> study.settings.seed, study.breaks["elongation_pct"].tolist(), study.tensile is None
    (7, [209.8], True)
    """
    folder = Path(folder)
    files = tuple(table.file for table in tables.values())
    contents, unreadable = _read_files(folder, (*files, readings.FILE))
    if not contents and unreadable:
        raise StudyError(unreadable)
    settings, wrong_settings = parse_settings(contents.get(SETTINGS_FILE, b""))
    if isinstance(settings.dimensions, MeshDimensions) and not wrong_settings:
        settings, wrong_settings = with_part(folder, settings, settings.dimensions)
    if settings.forward is not None:
        return _own_study(folder, settings, contents, [*unreadable, *wrong_settings])
    if contents.pop(readings.FILE, None) is not None:
        remedy = '[forward] function = "model.py:predict" in study.toml must name their model'
        wrong_settings += (Fault(readings.FILE, "has no effect without [forward]", remedy),)
    read = dict(contents)
    if MARKERS_FILE in read:
        form = settings.markers
        read[MARKERS_FILE], unmapped = translated(
            read[MARKERS_FILE], form, MARKERS_FILE, SETTINGS_FILE
        )
        wrong_settings += unmapped
    checked = {
        name: check_table(
            read[table.file], table.schema, degradation_sd_pct=settings.noise.degradation_sd_pct
        )
        for name, table in tables.items()
        if table.file in contents
    }
    faults = [*unreadable, *_wrong_files(folder, files, set(contents), unreadable)]
    faults += wrong_settings
    faults += [fault for table in checked.values() for fault in table.faults]
    if not faults and "tensile" in checked:
        faults += _absent_modes(settings, checked["tensile"].frame)
    if not faults and "tensile" in checked:
        faults += _unloading(checked["tensile"].frame)
    if not faults and settings.material.stretch_range is not None:
        faults += _empty_range(settings, checked.get("tensile"))
    if not faults and "shrinkage" in checked:
        faults += _too_light(settings, checked["shrinkage"].frame)
    if faults:
        raise StudyError(faults)
    named = dict(zip(tables, files, strict=True))
    return _assemble(folder, settings, checked, contents, files=named)


def with_part(
    folder: Path, settings: Settings, stated: MeshDimensions
) -> tuple[Settings, tuple[Fault, ...]]:
    """Return settings completed from the mesh of a part, and its faults.

    Without a boundary named constraint there is no layer.
    """
    place = (None, "actuator.file", stated.file)
    if Path(stated.file).name != stated.file:
        problem = "is not a file next to study.toml"
        return settings, (Fault(SETTINGS_FILE, problem, "put the mesh there", *place),)
    if settings.layer.is_slab or settings.constraint.height is not None:
        problem = "sets the place or material of a layer, which the mesh defines"
        remedy = "for paper or film, name a flat boundary of the mesh constraint"
        return settings, (Fault(SETTINGS_FILE, problem, remedy, None, "constraint"),)
    try:
        part = read_part(folder / stated.file)
    except PartError as fault:
        problem, _, remedy = str(fault).partition("; ")
        return settings, (Fault(SETTINGS_FILE, problem, remedy, *place),)
    length, width, height = (float(size) for size in part.size)
    found = replace(
        stated,
        length=length,
        width=2.0 * width if part.is_half else width,
        height=height,
        plane=plane_of(part),
        bending=bending_of(part),
        cells="tetrahedra" if part.is_tetrahedral else "hexahedra",
        path=str((folder / stated.file).resolve()),
        content=part.content,
    )
    kind = settings.constraint.kind if "constraint" in part.sides else "none"
    return replace(
        settings, dimensions=found, constraint=replace(settings.constraint, kind=kind)
    ), ()


def _own_study(
    folder: Path, settings: Settings, contents: dict[str, bytes], faults: list[Fault]
) -> Study:
    """Read a study with its own forward map: readings, and the code that predicts them.

    Raises
    ------
    StudyError
        Lists every fault.
    """
    forward = settings.forward
    assert forward is not None
    for name in sorted(set(contents) - {SETTINGS_FILE, readings.FILE}):
        problem = "is not used by a study with its own forward map"
        faults.append(Fault(name, problem, "remove it, or remove [forward] from study.toml"))
    if readings.FILE not in contents:
        name = settings.reading.name
        remedy = f"add it: a row per reading, with columns {name} and one for each input"
        raise StudyError([*faults, Fault(readings.FILE, "is missing", remedy)])
    content = contents[readings.FILE]
    table, inputs, missing = readings.readings_table(content, forward, settings.reading.name)
    checked = check_table(
        content, table.schema, degradation_sd_pct=settings.noise.degradation_sd_pct
    )
    code, unreadable = _read_code(folder, forward.function.partition(":")[0])
    faults += [*missing, *checked.faults, *unreadable]
    if faults:
        raise StudyError(faults)
    settings = replace(settings, forward=replace(forward, inputs=inputs))
    named = {readings.NAME: checked}
    return _assemble(folder, settings, named, contents | code, files={table.name: table.file})


def _read_code(folder: Path, model: str) -> tuple[dict[str, bytes], list[Fault]]:
    """Read the Python files of a study by their names in it."""
    contents, faults = {}, []
    for path in (folder / model, *sorted((folder / CAUSES).glob("*.py"))):
        name = path.relative_to(folder).as_posix()
        try:
            contents[name] = read_bytes(path, most_mb=STUDY_MB)
        except FileNotFoundError:
            remedy = f"add {name}, or name a different file"
            place = (None, "forward.function", model)
            faults.append(Fault(SETTINGS_FILE, "names a file that does not exist", remedy, *place))
        except OSError as error:
            faults.append(Fault(name, f"cannot be read ({reason(error)})", "give a different file"))
    return contents, faults


def _absent_modes(settings: Settings, tensile: pd.DataFrame) -> Iterator[Fault]:
    """Refuse modes without curves, as nothing would be fitted."""
    there = sorted(set(tensile["mode"]))
    if set(settings.tensile.fit_modes) & set(there):
        return
    asked = ", ".join(settings.tensile.fit_modes)
    problem = "names no mode that has a curve in tensile.csv, so none would be fitted"
    remedy = f"name at least one of {', '.join(there)}, or leave the key out to fit all"
    yield Fault(SETTINGS_FILE, problem, remedy, None, "tensile.fit_modes", asked)


def after_first_loading(tensile: pd.DataFrame) -> pd.Series:
    """Return which film readings follow a fall of stretch beyond noise.

    Tension and compression of a specimen are treated separately, in file order.

    Examples
    --------
    >>> rows = {"specimen_id": "a", "mode": "uniaxial", "stretch": [1.0, 2.0, 3.0, 2.0, 2.5]}
    >>> after_first_loading(pd.DataFrame(rows)).tolist()
    [False, False, False, True, True]
    """
    strain = tensile["stretch"] - 1.0
    keys = [tensile["specimen_id"], tensile["mode"], strain < 0.0]
    size = strain.abs().groupby(keys)
    noise = LARGEST_SLIP * (size.transform("max") - size.transform("min"))
    peak = size.cummax()
    fell = (peak - strain.abs() > noise) & (peak - size.transform("first") > noise)
    return fell.astype(int).groupby(keys).cummax() > 0


def _unloading(tensile: pd.DataFrame) -> Iterator[Fault]:
    """Refuse unloading of films: only the first loading of each is fitted."""
    named = pd.Series(False, index=tensile.index)
    if "branch" in tensile:
        named = tensile["branch"].str.casefold() == UNLOADING
    back = named | after_first_loading(tensile)
    if not back.any():
        return
    counts = tensile.loc[back, "specimen_id"].value_counts(sort=False)
    which = ", ".join(f"{name}: {count}" for name, count in counts.head(TOLD_ONE_BY_ONE).items())
    more = len(counts) - TOLD_ONE_BY_ONE
    which += f" and {more} more specimens" if more > 0 else ""
    were = "was" if back.sum() == 1 else "were"
    problem = f"{back.sum()} of {len(back)} rows {were} recorded after the first loading ({which})"
    remedy = (
        "unloading and later cycles are not modelled: keep the first loading of each specimen; "
        "if rows are only out of order, sort them by stretch"
    )
    column = "branch" if named.any() else "stretch"
    yield Fault("tensile.csv", problem, remedy, None, column)


def _empty_range(settings: Settings, tensile: CheckedTable | None) -> Iterator[Fault]:
    """Refuse a stretch range that contains no reading of a fitted mode."""
    place = (None, "material.stretch_range", str(list(settings.material.stretch_range or ())))
    if tensile is None:
        yield Fault(SETTINGS_FILE, "has no effect without tensile.csv", "remove the key", *place)
        return
    fitted = tensile.frame[tensile.frame["mode"].isin(settings.tensile.fit_modes)]
    if not in_range(settings, fitted).any():
        problem = "leaves no reading of tensile.csv to fit"
        low, high = fitted["stretch"].min(), fitted["stretch"].max()
        yield Fault(
            SETTINGS_FILE, problem, f"the films have stretches of {low:g} to {high:g}", *place
        )


def in_range(settings: Settings, tensile: pd.DataFrame) -> pd.Series:
    """Return which film readings lie in the stretch range."""
    low, high = settings.material.stretch_range or (0.0, np.inf)
    return tensile["stretch"].between(low, high)


def _too_light(settings: Settings, shrinkage: pd.DataFrame) -> Iterator[Fault]:
    """Refuse films that weigh less than the gelatin and glycerol poured."""
    solids = settings.shrinkage.mixture.solids
    share = shrinkage["mass_conditioned_g"] / shrinkage["mass_poured_g"]
    for row in shrinkage[share < solids].to_dict("records"):
        weight = float(row["mass_conditioned_g"])
        problem = (
            f"is {weight / row['mass_poured_g']:.3g} of the poured mass of film {row['film_id']}, "
            f"but the gelatin and glycerol of the recipe alone are {solids:.3g}"
        )
        remedy = f"check the masses, or the parts under [shrinkage] in {SETTINGS_FILE}"
        yield Fault("shrinkage.csv", problem, remedy, None, "mass_conditioned_g", f"{weight:g}")


def _assemble(
    folder: Path,
    settings: Settings,
    tables: Mapping[str, CheckedTable],
    contents: Mapping[str, bytes],
    *,
    files: Mapping[str, str],
) -> Study:
    frames = {name: table.frame for name, table in tables.items()}
    unread = [one for table in tables.values() for one in table.unread]
    if "tensile" in frames:
        kept = in_range(settings, frames["tensile"])
        unread += unused_of(files["tensile"], Why.OUTSIDE_RANGE, frames["tensile"][~kept])
        frames["tensile"] = frames["tensile"][kept].reset_index(drop=True)
    own = {name: frame for name, frame in frames.items() if name in BASE_TABLES}
    return Study(
        folder.resolve().name,
        folder,
        settings,
        **own,
        hashes={file: sha256(content).hexdigest() for file, content in contents.items()},
        recorded={name: table.recorded for name, table in tables.items()},
        passed_over={files[name]: t.passed_over for name, t in tables.items() if t.passed_over},
        others={name: frame for name, frame in frames.items() if name not in BASE_TABLES},
        line_points=None,
        unread=tuple(unread),
        digits={name: digit for t in tables.values() for name, digit in t.digits.items()},
        photographs=(),
        captured=(),
    )


def _read_files(
    folder: Path, data_files: tuple[str, ...]
) -> tuple[dict[str, bytes], tuple[Fault, ...]]:
    if not folder.is_dir():
        problem = "is not a folder" if folder.exists() else "does not exist"
        remedy = f"name a folder with {SETTINGS_FILE} and the data"
        return {}, (Fault(str(folder), problem, remedy),)
    contents, faults = {}, []
    for path in sorted(folder.iterdir()):
        if path.name not in (SETTINGS_FILE, *data_files):
            continue
        try:
            contents[path.name] = read_bytes(path, most_mb=STUDY_MB)
        except OSError as error:
            remedy = "give a readable file"
            faults.append(Fault(path.name, f"cannot be read ({reason(error)})", remedy))
    return contents, tuple(faults)


def _wrong_files(
    folder: Path, data_files: tuple[str, ...], found: set[str], unreadable: tuple[Fault, ...]
) -> Iterator[Fault]:
    there = found | {fault.file for fault in unreadable}
    known = {Path(name).stem: name for name in (SETTINGS_FILE, *data_files)}
    meant = set(there)
    for path in sorted(folder.iterdir()):
        if path.name in there or path.suffix.casefold() not in (".csv", ".toml"):
            continue
        best = nearest(path.stem, known, cutoff=0.85)
        if best is not None:
            meant.add(known[best])
            remedy = f"did you mean {known[best]!r}? Rename it, or give it a less similar name"
            yield Fault(path.name, "is not an input file", remedy)
    if SETTINGS_FILE not in meant:
        yield Fault(SETTINGS_FILE, "is missing", "add it; it may be empty: all keys have defaults")
    if not meant & set(data_files):
        remedy = f"add at least one of {', '.join(data_files)}"
        yield Fault(folder.resolve().name, "contains no data file", remedy)
