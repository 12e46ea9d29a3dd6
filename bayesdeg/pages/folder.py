"""The run folder: its file names, and how its files are read and written.

Every file is written under a temporary name and then renamed, so an interrupted run leaves the old
file or the new one, never half of one. `bayesdeg.pages.tables` lists the columns of the tables.
"""

import hashlib
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from bayesdeg.errors import BayesdegError
from bayesdeg.files import (
    RUN_MB,
    as_named,
    parse_json,
    read_bytes,
    reason,
    refuse_special,
    spreadsheet_safe,
    write_bytes,
    write_text,
    written,
)
from bayesdeg.pages.hdf5 import refuse_unsound
from bayesdeg.pages.record import RunRecord, VerdictRecord
from bayesdeg.pages.tables import TABLES, CellKind, Column, Tables
from bayesdeg.records import LARGEST, FileRecord, RecordError, plain

INDEX: Final = "index.html"
LEFT_OUT: Final = "left_out.txt"
ADDED: Final = "added.csv"
"""Rows of actuator.csv that entered a run since, see `bayesdeg.run.update`."""
EMULATOR: Final = "emulator.npz"
"""The emulator of the run, so that the folder predicts wherever it is copied to."""

VERDICT: Final = "verdict"
RUN: Final = "run"
POSTERIOR: Final = "posterior"
POSTERIOR_BASE: Final = "posterior_base"
POSTERIOR_COURSE: Final = "posterior_course"
POSTERIOR_AVERAGED: Final = "posterior_averaged"
"""Over causes that cannot be told apart, see `bayesdeg.analysis.averaged`."""

#: Names of the JSON documents and of the netCDF posteriors.
DOCUMENTS: Final = (VERDICT, RUN)
#: Crops of photographs, as many as the report shows.
PICTURES: Final = tuple(f"photograph_{number}.jpg" for number in range(1, 7))
POSTERIORS: Final = (POSTERIOR, POSTERIOR_BASE, POSTERIOR_COURSE, POSTERIOR_AVERAGED)

#: Largest posterior file, with pointwise likelihoods; 400 readings take some 30 [MB].
MOST_ARRAYS_MB: Final = 1000.0
PICTURE_MB: Final = 2.0  # a crop written by a run has 0.05

#: All files with fixed names that a run writes.
RUN_FILES: Final = (
    *(INDEX, LEFT_OUT, ADDED, EMULATOR, *PICTURES),
    *(f"{name}.json" for name in DOCUMENTS),
    *(f"{name}.nc" for name in POSTERIORS),
    *(table.file for table in TABLES.values()),
)


@dataclass(frozen=True)
class RunFolder:
    """The folder of one run.

    Parameters
    ----------
    path : pathlib.Path
        The folder; it is made when something is first written.

    Examples
    --------
    >>> import tempfile
    >>> folder = RunFolder(Path(tempfile.mkdtemp()) / "run")
    >>> folder.write_table("misfit_null", pd.DataFrame({"statistic": [1.5], "replicate": [0]}))
    >>> folder.read_table("misfit_null").columns.tolist()
    ['replicate', 'statistic']
    >>> folder.read_table("bands") is None
    True
    """

    path: Path

    def write_table(self, name: str, frame: pd.DataFrame) -> None:
        """Write a table, documented columns first and in their order.

        Non-finite values of columns that must be finite are left empty; a text that a
        spreadsheet would take for a formula gets a leading quote.

        Parameters
        ----------
        name : str
            A key of `bayesdeg.pages.tables.TABLES`.
        frame : pandas.DataFrame
            At least the documented columns; it may have no rows.

        Raises
        ------
        ValueError
            If there is no table of that name, or a column is missing or holds something else.
        """
        columns = _columns(name)
        if problem := _problem(columns, frame):
            raise ValueError(f"table {name!r}: {problem}")
        known = [column.name for column in columns]
        ordered = frame[known + [column for column in frame.columns if column not in known]]
        safe = _texts(_finite(columns, ordered), spreadsheet_safe)
        with written(self.path / f"{name}.csv") as part:
            safe.to_csv(part, index=False, encoding="utf-8")

    def read_table(self, name: str) -> pd.DataFrame | None:
        """Read a table.

        Parameters
        ----------
        name : str
            A key of `bayesdeg.pages.tables.TABLES`.

        Returns
        -------
        pandas.DataFrame or None
            None if the run wrote no such table; empty cells are missing values.

        Raises
        ------
        BayesdegError
            If the file is there but cannot be read, or a column is missing or holds something
            else.
        """
        columns, path = _columns(name), self.path / f"{name}.csv"
        if not path.exists():
            return None
        try:
            content = io.BytesIO(read_bytes(path, most_mb=RUN_MB))
            text = pd.read_csv(content, dtype=str, keep_default_na=False, na_values=[""])
        except OSError as fault:
            raise self._corrupted(path.name, reason(fault)) from fault
        except ValueError as fault:
            raise self._corrupted(path.name, str(fault)) from fault
        if problem := _problem(columns, text) or _unbounded(columns, text):
            raise self._corrupted(path.name, problem)
        numbers = {
            column.name: text[column.name].to_numpy(object).astype(np.float64)
            for column in columns
            if column.kind is CellKind.NUMBER
        }
        return _texts(text, as_named).assign(**numbers)

    def write_json(self, name: str, content: Mapping[str, object]) -> None:
        """Write ``verdict`` or ``run``; values that are not finite become null.

        Raises
        ------
        ValueError
            If there is no document of that name.
        """
        text = json.dumps(plain(content), indent=2, ensure_ascii=False, allow_nan=False)
        write_text(self.path / f"{_known(name, DOCUMENTS)}.json", text + "\n")

    def read_tables(self) -> Tables:
        """Read every table that is there.

        Raises
        ------
        BayesdegError
            If a file is there but damaged.
        """
        frames = {name: self.read_table(name) for name in TABLES}
        return Tables({name: frame for name, frame in frames.items() if frame is not None})

    def write(self, record: VerdictRecord | RunRecord) -> None:
        """Write the verdict or the run record."""
        name = VERDICT if isinstance(record, VerdictRecord) else RUN
        write_text(self.path / f"{name}.json", record.text())

    def read_json(self, name: str) -> dict[str, object]:
        """Read ``verdict`` or ``run``.

        Raises
        ------
        BayesdegError
            If the file is missing, or is not a JSON object.
        """
        file = f"{_known(name, DOCUMENTS)}.json"
        try:
            content = parse_json(read_bytes(self.path / file, most_mb=RUN_MB))
        except (FileNotFoundError, NotADirectoryError) as fault:
            raise self._incomplete(file) from fault
        except OSError as fault:
            raise self._corrupted(file, reason(fault)) from fault
        except ValueError as fault:
            raise self._corrupted(file, str(fault)) from fault
        if not isinstance(content, dict):
            raise self._corrupted(file, "it holds no JSON object")
        return content

    def read_verdict(self) -> VerdictRecord:
        """Read and check the verdict.

        Raises
        ------
        BayesdegError
            If it is missing or breaks its format.
        """
        return self._read(VERDICT, VerdictRecord)

    def read_run(self) -> RunRecord:
        """Read and check the run record.

        Raises
        ------
        BayesdegError
            If it is missing or breaks its format.
        """
        return self._read(RUN, RunRecord)

    def write_posterior(self, name: str, tree: xr.DataTree) -> None:
        """Write one of `POSTERIORS` as netCDF."""
        file = f"{_known(name, POSTERIORS)}.nc"
        write_bytes(self.path / file, tree.to_netcdf(engine="h5netcdf"))

    def read_posterior(self, name: str) -> xr.DataTree:
        """Read one of `POSTERIORS` into memory.

        Raises
        ------
        BayesdegError
            If the file is missing, cannot be read, or is not the one that the run wrote.
        """

        def read(path: Path) -> xr.DataTree:
            with xr.open_datatree(path, engine="h5netcdf") as tree:
                loaded = tree.load()
            for group in loaded.children.values():
                group.to_dataset()  # inconsistent sizes are found here
            return loaded

        return self._read_netcdf(name, read)

    def draws_of(self, name: str) -> xr.Dataset | None:
        """Return the draws of one of `POSTERIORS`; None where the run has none."""
        if not (self.path / f"{_known(name, POSTERIORS)}.nc").exists():
            return None
        tree = self.read_posterior(name)
        return tree["posterior"].to_dataset() if "posterior" in tree.children else None

    def read_draws(self, name: str) -> tuple[xr.Dataset, NDArray[np.float64]]:
        """Read the draws of one of `POSTERIORS` and their log densities, and nothing else.

        Raises
        ------
        BayesdegError
            If the file is missing, cannot be read, or is not the one that the run wrote.
        """

        def read(path: Path) -> tuple[xr.Dataset, NDArray[np.float64]]:
            groups = ("posterior", "sample_stats")
            draws, stats = (
                xr.load_dataset(path, group=group, engine="h5netcdf") for group in groups
            )
            return draws, stats["lp"].to_numpy().ravel()

        return self._read_netcdf(name, read)

    def _read_netcdf[T](self, name: str, read: Callable[[Path], T]) -> T:
        """Read one of `POSTERIORS`; any error of a library means that the file is damaged."""
        file = f"{_known(name, POSTERIORS)}.nc"
        if not (self.path / file).exists():
            raise self._incomplete(file)
        try:
            refuse_special(self.path / file)
            self._refuse_other(file)
        except (OSError, ValueError) as fault:
            raise self._corrupted(file, str(fault)) from fault
        try:
            refuse_unsound(self.path / file, self._hash(file), most_mb=MOST_ARRAYS_MB)
            return read(self.path / file)
        except MemoryError:
            raise
        except Exception as fault:  # for a damaged file the libraries may raise anything
            raise self._corrupted(file, str(fault)) from fault

    def posterior_hashes(self) -> dict[str, str]:
        """Return the hash of each existing posterior by file, for ``run.json``."""
        files = (f"{name}.nc" for name in POSTERIORS)
        return {file: self._hash(file) for file in files if (self.path / file).exists()}

    def _refuse_other(self, file: str) -> None:
        """Refuse a posterior whose hash is not the one in ``run.json``."""
        if not (self.path / f"{RUN}.json").exists():
            return
        known = self.read_run().posteriors.get(file)
        if known is not None and known != self._hash(file):
            raise ValueError("it is not the posterior that this run wrote")

    def _hash(self, file: str) -> str:
        with (self.path / file).open("rb") as content:
            return hashlib.file_digest(content, "sha256").hexdigest()

    def remove(self, file: str) -> None:
        """Remove a file of an earlier run, if there is one."""
        (self.path / file).unlink(missing_ok=True)

    def write_emulator(self, content: bytes | None) -> None:
        """Write the emulator of the run; without one, remove that of an earlier run."""
        if content is None:
            self.remove(EMULATOR)
        else:
            write_bytes(self.path / EMULATOR, content)

    def write_picture(self, name: str, content: bytes) -> None:
        """Write a crop of a photograph, one of `PICTURES`."""
        write_bytes(self.path / _known(name, PICTURES), content)

    def read_pictures(self) -> dict[str, bytes]:
        """Return the existing crops of photographs by name."""
        there = (name for name in PICTURES if (self.path / name).is_file())
        try:
            return {name: read_bytes(self.path / name, most_mb=PICTURE_MB) for name in there}
        except OSError as fault:
            raise self._corrupted("photograph", reason(fault)) from fault

    def write_left_out(self, text: str) -> None:
        """Write the tracebacks of failed stages; without any, remove those of an earlier run."""
        if text:
            write_text(self.path / LEFT_OUT, text)
        else:
            self.remove(LEFT_OUT)

    def write_page(self, html: str) -> Path:
        """Write the report and return its path."""
        write_text(self.path / INDEX, html)
        return self.path / INDEX

    def _read[T: FileRecord](self, name: str, kind: type[T]) -> T:
        try:
            return kind.read(self.read_json(name))
        except RecordError as fault:
            raise self._corrupted(f"{name}.json", str(fault)) from fault

    def _incomplete(self, file: str) -> BayesdegError:
        return BayesdegError(
            f"{self.path}: {file} is missing, so this is no complete run folder; finish the run "
            "with `bayesdeg run`, or start it again with --fresh"
        )

    def _corrupted(self, file: str, problem: str) -> BayesdegError:
        return BayesdegError(
            f"{self.path / file}: {problem}; the file is damaged or from another version: "
            "run the study again with --fresh"
        )


def _columns(name: str) -> tuple[Column, ...]:
    return TABLES[_known(name, tuple(TABLES))].columns


def _known(name: str, names: Sequence[str]) -> str:
    if name not in names:
        raise ValueError(f"a run folder has no {name!r}; it has {', '.join(names)}")
    return name


def _problem(columns: Sequence[Column], frame: pd.DataFrame) -> str | None:
    missing = [column.name for column in columns if column.name not in frame.columns]
    if missing:
        return f"column {', '.join(missing)} is missing"
    for column in columns:
        for row, cell in enumerate(frame[column.name]):
            if not column.may_be_empty and pd.isna(cell):
                return f"column {column.name}, row {row + 1}: is empty"
            if not _fits(cell, column.kind):
                return f"column {column.name}, row {row + 1}: {cell!r} is not {column.kind.value}"
    return None


def _finite(columns: Sequence[Column], frame: pd.DataFrame) -> pd.DataFrame:
    """Return a table with non-finite values of finite columns removed."""
    numbers = [column for column in columns if column.kind is CellKind.NUMBER and column.finite]
    return frame.assign(
        **{
            column.name: frame[column.name].where(_magnitude(frame[column.name]) <= LARGEST)
            for column in numbers
        }
    )


def _texts(frame: pd.DataFrame, change: Callable[[object], object]) -> pd.DataFrame:
    """Return a table with every cell of its non-numeric columns changed."""
    names = [n for n in frame.columns if not pd.api.types.is_numeric_dtype(frame[n])]
    return frame.assign(**{str(name): frame[name].map(change) for name in names})


def _unbounded(columns: Sequence[Column], frame: pd.DataFrame) -> str | None:
    """Say which cell holds a number that no run can have written."""
    for column in columns:
        if column.kind is CellKind.TEXT:
            continue
        cells = frame[column.name]
        size = _magnitude(cells.where(cells != "all"))
        wrong = (size > LARGEST) & (column.finite | np.isfinite(size))
        if wrong.any():
            row = int(np.flatnonzero(wrong)[0])
            return f"column {column.name}, row {row + 1}: {cells.iloc[row]!r} is too large"
    return None


def _magnitude(cells: pd.Series) -> pd.Series:
    return cells.astype(object).where(cells.notna(), np.nan).astype(np.float64).abs()


def _fits(cell: object, kind: CellKind) -> bool:
    if kind is CellKind.TEXT or cell is None or cell is pd.NA:
        return True
    if kind is CellKind.LEVEL and cell == "all":
        return True
    try:
        float(str(cell))
    except ValueError:
        return False
    return True
