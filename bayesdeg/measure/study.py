"""A study folder → `Study`: settings and checked tables, or all faults at once."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path

import pandas as pd

from bayesdeg.errors import Fault, StudyError
from bayesdeg.files import STUDY_MB, read_bytes, reason
from bayesdeg.measure.checking import CheckedTable, check_table
from bayesdeg.measure.nearest import nearest
from bayesdeg.measure.settings import Dimensions, Settings
from bayesdeg.measure.settings_file import FILE as SETTINGS_FILE
from bayesdeg.measure.settings_file import parse_settings
from bayesdeg.measure.tables import TABLES

DATA_FILES = tuple(table.file for table in TABLES.values())


@dataclass(frozen=True, repr=False)
class Study:
    """A study as it was read; a table is ``None`` if its file is not there.

    Parameters
    ----------
    name : str
        Name of the folder.
    folder : Path
        Where it was read from.
    settings : Settings
        The contents of ``study.toml``.
    moisture, shrinkage, tensile, breaks, actuator, summary : pandas.DataFrame or None
        The checked tables: the columns of the contract, always all of them, then extra ones as
        text. Cells not recorded hold their default, or nan. Rows of an actuator after its
        rupture are left out.
    hashes : mapping of str to str
        SHA-256 of each input file.
    recorded : mapping of str to frozenset of str
        By table, the columns in which the file itself gives at least one cell.
    passed_over : mapping of str to int
        By file, the number of comments that look like rows of data.
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
    hashes: Mapping[str, str] = field(default_factory=dict)
    recorded: Mapping[str, frozenset[str]] = field(default_factory=dict)
    passed_over: Mapping[str, int] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Return its name, and how much of which data it has."""
        tables = {name: getattr(self, name) for name in TABLES}
        rows = [f"{TABLES[n].file} {len(t)} rows" for n, t in tables.items() if t is not None]
        return f"Study {self.name}: {', '.join(rows)}"

    @property
    def geometry(self) -> Dimensions:
        """Dimensions of the actuator as moulded, from ``[actuator]`` of ``study.toml``."""
        return self.settings.dimensions


def read_study(folder: Path | str) -> Study:
    r"""Read a study folder and check everything in it.

    Parameters
    ----------
    folder : Path or str
        Holds ``study.toml`` and at least one of the data files.

    Returns
    -------
    Study

    Raises
    ------
    StudyError
        With every fault of every file.

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
    contents, unreadable = _read_files(folder)
    if not contents and unreadable:
        raise StudyError(unreadable)
    settings, wrong_settings = parse_settings(contents.get(SETTINGS_FILE, b""))
    tables = {
        name: check_table(
            contents[table.file], table, degradation_sd_pct=settings.degradation_sd_pct
        )
        for name, table in TABLES.items()
        if table.file in contents
    }
    faults = [*unreadable, *_wrong_files(folder, set(contents), unreadable), *wrong_settings]
    faults += [fault for table in tables.values() for fault in table.faults]
    if not faults and "tensile" in tables:
        faults += _absent_modes(settings, tables["tensile"].frame)
    if faults:
        raise StudyError(faults)
    return _assemble(folder, settings, tables, contents)


def _absent_modes(settings: Settings, tensile: pd.DataFrame) -> Iterator[Fault]:
    """Refuse to fit modes of which there are no curves: nothing would be fitted."""
    there = sorted(set(tensile["mode"]))
    if set(settings.fit_modes) & set(there):
        return
    asked = ", ".join(settings.fit_modes)
    problem = "names no mode of which tensile.csv has a curve, so none would be fitted"
    remedy = f"name at least one of {', '.join(there)}, or leave the key out to fit all"
    yield Fault(SETTINGS_FILE, problem, remedy, None, "tensile.fit_modes", asked)


def _assemble(
    folder: Path,
    settings: Settings,
    tables: Mapping[str, CheckedTable],
    contents: Mapping[str, bytes],
) -> Study:
    frames = {name: table.frame for name, table in tables.items()}
    return Study(
        folder.resolve().name,
        folder,
        settings,
        frames.get("moisture"),
        frames.get("shrinkage"),
        frames.get("tensile"),
        frames.get("breaks"),
        frames.get("actuator"),
        frames.get("summary"),
        {file: sha256(content).hexdigest() for file, content in contents.items()},
        {name: table.recorded for name, table in tables.items()},
        {TABLES[name].file: t.passed_over for name, t in tables.items() if t.passed_over},
    )


def _read_files(folder: Path) -> tuple[dict[str, bytes], tuple[Fault, ...]]:
    if not folder.is_dir():
        problem = "is not a folder" if folder.exists() else "does not exist"
        remedy = f"name a folder that holds {SETTINGS_FILE} and the data"
        return {}, (Fault(str(folder), problem, remedy),)
    contents, faults = {}, []
    for path in sorted(folder.iterdir()):
        if path.name not in (SETTINGS_FILE, *DATA_FILES):
            continue
        try:
            contents[path.name] = read_bytes(path, most_mb=STUDY_MB)
        except OSError as error:
            remedy = "give a file that can be read"
            faults.append(Fault(path.name, f"cannot be read ({reason(error)})", remedy))
    return contents, tuple(faults)


def _wrong_files(folder: Path, found: set[str], unreadable: tuple[Fault, ...]) -> Iterator[Fault]:
    there = found | {fault.file for fault in unreadable}
    misnamed = dict(_misnamed(folder, there))
    for name, meant in misnamed.items():
        remedy = f"did you mean {meant!r}? Rename it, or give it a name less like that"
        yield Fault(name, "is not a file that is read", remedy)
    if SETTINGS_FILE not in {*there, *misnamed.values()}:
        yield Fault(SETTINGS_FILE, "is missing", "add it; it may be empty, all keys have defaults")
    if not ({*there, *misnamed.values()} & set(DATA_FILES)):
        remedy = f"add at least one of {', '.join(DATA_FILES)}"
        yield Fault(folder.resolve().name, "holds no data file", remedy)


def _misnamed(folder: Path, there: set[str]) -> Iterator[tuple[str, str]]:
    known = {Path(name).stem: name for name in (SETTINGS_FILE, *DATA_FILES)}
    for path in sorted(folder.iterdir()):
        if path.name in there or path.suffix.casefold() not in (".csv", ".toml"):
            continue
        best = nearest(path.stem, known, cutoff=0.85)
        if best is not None:
            yield path.name, known[best]
