"""The run folder: the one place that knows its file names, and how they are read and written.

Every file is written beside its place and then renamed, so an interrupted run leaves the old file
or the new one, never half of one. The columns of the tables stand in `bayesdeg.report.columns`.
"""

import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr

from bayesdeg.errors import BayesdegError
from bayesdeg.report.columns import TABLES, Column, Kind
from bayesdeg.report.fields import RunFaultError
from bayesdeg.report.record import Run, Verdict, run_of, verdict_of

INDEX: Final = "index.html"
LEFT_OUT: Final = "left_out.txt"
VERDICT: Final = "verdict"
RUN: Final = "run"
POSTERIOR: Final = "posterior"
POSTERIOR_BASE: Final = "posterior_base"
POSTERIOR_COURSE: Final = "posterior_course"

#: Documents kept as JSON and posteriors kept as netCDF, by name.
DOCUMENTS: Final = (VERDICT, RUN)
POSTERIORS: Final = (POSTERIOR, POSTERIOR_BASE, POSTERIOR_COURSE)


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
        """Write a table, its columns in the documented order and any others after them.

        Parameters
        ----------
        name : str
            A key of `bayesdeg.report.columns.TABLES`.
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
        self._write(f"{name}.csv", lambda path: ordered.to_csv(path, index=False, encoding="utf-8"))

    def read_table(self, name: str) -> pd.DataFrame | None:
        """Read a table.

        Parameters
        ----------
        name : str
            A key of `bayesdeg.report.columns.TABLES`.

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
            text = pd.read_csv(path, dtype=str, keep_default_na=False, na_values=[""])
        except (OSError, ValueError) as fault:
            raise self._corrupted(path.name, str(fault)) from fault
        if problem := _problem(columns, text):
            raise self._corrupted(path.name, problem)
        numbers = {
            column.name: text[column.name].to_numpy(object).astype(np.float64)
            for column in columns
            if column.kind is Kind.NUMBER
        }
        return text.assign(**numbers)

    def write_json(self, name: str, content: Mapping[str, object]) -> None:
        """Write ``verdict`` or ``run``; values that are not finite become null.

        Raises
        ------
        ValueError
            If there is no document of that name.
        """
        text = json.dumps(_plain(content), indent=2, ensure_ascii=False, allow_nan=False)
        self._write(f"{_known(name, DOCUMENTS)}.json", lambda path: _write_text(path, text + "\n"))

    def read_json(self, name: str) -> dict[str, object]:
        """Read ``verdict`` or ``run``.

        Raises
        ------
        BayesdegError
            If the file is missing, or is not a JSON object.
        """
        file = f"{_known(name, DOCUMENTS)}.json"
        try:
            content = json.loads((self.path / file).read_text(encoding="utf-8"))
        except FileNotFoundError as fault:
            raise self._incomplete(file) from fault
        except (OSError, ValueError) as fault:
            raise self._corrupted(file, str(fault)) from fault
        if not isinstance(content, dict):
            raise self._corrupted(file, "it holds no JSON object")
        return content

    def read_verdict(self) -> Verdict:
        """Read and check the verdict.

        Raises
        ------
        BayesdegError
            If it is missing or breaks its format.
        """
        return self._typed(VERDICT, verdict_of)

    def read_run(self) -> Run:
        """Read and check what is recorded of the run itself.

        Raises
        ------
        BayesdegError
            If it is missing or breaks its format.
        """
        return self._typed(RUN, run_of)

    def write_posterior(self, name: str, tree: xr.DataTree) -> None:
        """Write one of `POSTERIORS` as netCDF."""
        file = f"{_known(name, POSTERIORS)}.nc"
        self._write(file, lambda path: tree.to_netcdf(path, engine="h5netcdf"))

    def read_posterior(self, name: str) -> xr.DataTree:
        """Read one of `POSTERIORS` into memory.

        Raises
        ------
        BayesdegError
            If the file is missing or cannot be read.
        """
        file = f"{_known(name, POSTERIORS)}.nc"
        if not (self.path / file).exists():
            raise self._incomplete(file)
        try:
            with xr.open_datatree(self.path / file, engine="h5netcdf") as tree:
                return tree.load()
        except (OSError, ValueError, KeyError) as fault:
            raise self._corrupted(file, str(fault)) from fault

    def remove(self, file: str) -> None:
        """Remove a file of an earlier run, if there is one."""
        (self.path / file).unlink(missing_ok=True)

    def write_left_out(self, text: str) -> None:
        """Write the tracebacks of what was left out; remove those of an earlier run if none."""
        if text:
            self._write(LEFT_OUT, lambda path: _write_text(path, text))
        else:
            self.remove(LEFT_OUT)

    def write_page(self, html: str) -> Path:
        """Write the report and return its path."""
        self._write(INDEX, lambda path: _write_text(path, html))
        return self.path / INDEX

    def _typed[T](self, name: str, parse: Callable[[Mapping[str, object]], T]) -> T:
        try:
            return parse(self.read_json(name))
        except RunFaultError as fault:
            raise self._corrupted(f"{name}.json", str(fault)) from fault

    def _write(self, file: str, write: Callable[[Path], object]) -> None:
        self.path.mkdir(parents=True, exist_ok=True)
        beside = self.path / f".{file}.{os.getpid()}.part"
        try:
            write(beside)
            beside.replace(self.path / file)
        finally:
            beside.unlink(missing_ok=True)

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
    return TABLES[_known(name, tuple(TABLES))]


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
            if not _fits(cell, column.kind):
                return f"column {column.name}, row {row + 1}: {cell!r} is not {column.kind.value}"
    return None


def _fits(cell: object, kind: Kind) -> bool:
    if kind is Kind.TEXT or cell is None or cell is pd.NA:
        return True
    if kind is Kind.LEVEL and cell == "all":
        return True
    try:
        float(str(cell))
    except ValueError:
        return False
    return True


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
