"""Finite element runs named by their content, and the store of their solutions."""

import hashlib
import json
import os
import time
import warnings
from contextlib import suppress
from dataclasses import asdict, dataclass
from enum import StrEnum
from io import BytesIO
from numbers import Real
from pathlib import Path
from typing import Any
from uuid import uuid4
from zipfile import ZipFile, ZipInfo

import numpy as np

from bayesdeg.actuator.curve import Curve, CurveSolution, PathSamples
from bayesdeg.actuator.families import geometry_of_record
from bayesdeg.actuator.material import LayerGroups, MaterialGroups
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.actuator.outputs import OUTPUTS
from bayesdeg.actuator.sensitivity import INPUTS
from bayesdeg.actuator.status import MODEL_VERSION, Backend, Resolution, Status
from bayesdeg.errors import BayesdegError, ResumableError
from bayesdeg.files import RUN_MB, read_bytes, reason

Solution = CurveSolution | PathSamples


class Kind(StrEnum):
    """Kind of result of a run."""

    CURVE = "curve"
    SAMPLES = "samples"


@dataclass(frozen=True)
class Run:
    """One finite element run.

    Parameters
    ----------
    geometry : Moulded
        Geometry as moulded, of any family.
    resolution : Resolution
        Resolution of the mesh.
    curve : Curve
        Loads and material in dimensionless groups.
    kind : Kind
        Readings at the curve's loads, or readings and derivatives where the path stopped.
    held : bool
        Whether the tip is held and only its force is read.
    origin : Moulded, optional
        The actuator whose mesh is moved onto this one; by default it has its own mesh.
    backend : Backend
        Assembly of the equations.

    Examples
    --------
    >>> from bayesdeg.actuator.geometry import Geometry
    >>> from bayesdeg.data.settings import Dimensions
    >>> material = MaterialGroups(c2_ratio=-0.014, c3_ratio=0.004, paper_group=120.0)
    >>> run = Run(Geometry(Dimensions()), Resolution(3.5, 2.5, 5.0), Curve((0.2, 0.4), material))
    >>> len(run.key())
    64
    """

    geometry: Moulded
    resolution: Resolution
    curve: Curve
    kind: Kind = Kind.CURVE
    held: bool = False
    origin: Moulded | None = None
    backend: Backend = Backend.KERNELS

    def parameters(self) -> dict[str, object]:
        """Return all that the solution depends on, including the model's version, as plain JSON."""
        whole = asdict(self) | {"geometry": self.geometry.record()}
        if self.curve.layer is None:  # runs without a layer keep their earlier names
            whole["curve"].pop("layer")
        if not self.held:  # likewise from before forces
            whole.pop("held")
        if self.backend is Backend.KERNELS:  # likewise from before backends
            whole.pop("backend")
        whole.pop("origin")  # likewise from before moved dimensions
        if self.origin is not None:
            whole["origin"] = self.origin.record()
        return {"model_version": MODEL_VERSION, **{k: _plain(v) for k, v in whole.items()}}

    def key(self) -> str:
        """Return the content's name: version of the model, geometry, mesh, inputs, kind, hashed."""
        return key_of(self.parameters())

    def __str__(self) -> str:
        """Return the non-zero parameters in words."""
        shape = self.geometry.record()
        shape.pop("dimensions")
        sizes = vars(self.geometry.dimensions)
        groups = [asdict(part) for part in (self.resolution, self.curve.material)]
        values = sizes | shape | groups[0] | groups[1]
        named = ", ".join(_worded(name, value) for name, value in values.items() if value)
        loads = self.curve.loads
        upto = f"{len(loads)} loads up to {loads[-1]:g}" if loads else "no load"
        tip = ", tip held" if self.held else ""
        tip += "" if self.backend is Backend.KERNELS else f", by {self.backend}"
        return f"{self.kind} run {self.key()[:12]} ({upto}, {named}{tip})"


def _worded(name: str, value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(_worded(f"{name} {key}", part) for key, part in value.items())
    return f"{name}={value:g}" if isinstance(value, int | float) else f"{name}={value}"


def key_of(parameters: dict[str, object]) -> str:
    """Return the name of a run with these parameters."""
    return hashlib.sha256(json.dumps(parameters, sort_keys=True).encode()).hexdigest()


def run_of(parameters: dict[str, Any]) -> Run:
    """Return the run with these parameters, the inverse of ``Run.parameters``.

    Raises
    ------
    KeyError, TypeError, ValueError
        If they are from a different version of the package.
    """
    shape, curve = parameters["geometry"], parameters["curve"]
    return Run(
        geometry_of_record(shape),
        Resolution(**parameters["resolution"]),
        Curve(
            tuple(curve["loads"]),
            MaterialGroups(**curve["material"]),
            LayerGroups(**curve["layer"]) if "layer" in curve else None,
        ),
        Kind(parameters["kind"]),
        bool(parameters.get("held", False)),
        geometry_of_record(parameters["origin"]) if "origin" in parameters else None,
        Backend(parameters.get("backend", Backend.KERNELS)),
    )


def _plain(value: object) -> object:
    """Normalise equal numbers: 14 and 14.0 are the same length."""
    if isinstance(value, dict):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(part) for part in value]
    return float(value) if isinstance(value, Real) else str(value)


# valid results, even if the path ends before its last load
ANSWERS = (Status.CONVERGED, Status.LIMIT_POINT, Status.BUCKLED)

_ABANDONED = 3600.0  # age after which a temporary file is abandoned [s]
_EPOCH = (1980, 1, 1, 0, 0, 0)  # fixed date, so that equal solutions give equal bytes


class _DamagedError(Exception):
    """A damaged file; the message says what was found."""


@dataclass(frozen=True)
class Failure:
    """A run that ended without a solution, and its status."""

    run: Run
    status: Status


@dataclass(frozen=True)
class SolutionStore:
    """Solutions on disk, each in a file named by its run's key; campaigns may share the folder.

    Every file is written completely or not at all, contains no pickle and names its run in its
    ``record`` (JSON); its bytes depend only on the solution. The time of a run is in a second file
    next to it.

    Parameters
    ----------
    folder : Path
        Created with the first solution.
    """

    folder: Path

    def get(self, run: Run, *, timeout: float = 0.0) -> Solution | None:
        """Return the solution of a run; None if it is missing.

        A run given up after less than the ``timeout`` counts as missing [s], and so does a damaged
        file, which is named in a warning.
        """
        try:
            return self._read(run, timeout)
        except _DamagedError as fault:
            path = self._path(run.key())
            warnings.warn(f"{path} is damaged and is solved again: {fault}", stacklevel=2)
            return None

    def _read(self, run: Run, timeout: float) -> Solution | None:
        path = self._path(run.key())
        try:
            content = read_bytes(path, most_mb=RUN_MB)
        except FileNotFoundError:
            return None
        except OSError as fault:
            raise BayesdegError(f"{path} cannot be read: {reason(fault)}") from fault
        solution, record = decode(content, run)
        given_up = solution.status is Status.TIMED_OUT and float(record["timeout_s"]) < timeout
        return None if given_up else solution

    def put(
        self, run: Run, solution: Solution, *, seconds: float | None = None, timeout: float = np.inf
    ) -> bool:
        """Write a solution, unless an equally good one exists; return whether it was written.

        ``seconds`` and ``timeout`` are the times taken and allowed [s]. If the folder cannot be
        written, as when the disk is full, a ResumableError says so; existing solutions stay.
        """
        with suppress(_DamagedError):
            allowed = timeout if solution.status is Status.TIMED_OUT else np.inf
            if self._read(run, allowed) is not None:
                return False
        key = run.key()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            if seconds is not None:
                _write(self.folder / f"{key}.seconds", f"{seconds:.3f}\n".encode())
            _write(self._path(key), encode(run, solution, timeout=timeout))
        except OSError as fault:
            raise ResumableError(
                f"the store {self.folder} cannot be written: {reason(fault)}; solutions so far "
                "stay there: free some space or allow writing, and run the same command again to "
                "resume"
            ) from fault
        return True

    def failures(self) -> list[Failure]:
        """Return the runs of this version of the model that failed or timed out."""
        found = []
        for path in sorted(self.folder.glob("*.npz")):
            try:
                record = json.loads(str(_members(read_bytes(path, most_mb=RUN_MB))["record"]))
                status, run = Status[record["status"]], run_of(record["run"])
            except Exception:  # of a different version, or damaged: the next campaign reports it
                continue
            if status not in ANSWERS and path.stem == run.key():
                found.append(Failure(run, status))
        return found

    def seconds(self) -> dict[str, float]:
        """Return the times of runs by key: wall time of one core [s]."""
        times = {}
        for path in sorted(self.folder.glob("*.seconds")):
            with suppress(OSError, ValueError):  # not important
                times[path.stem] = float(read_bytes(path, most_mb=RUN_MB))
        return times

    def clean(self) -> None:
        """Remove temporary files that a killed process left behind an hour ago or earlier."""
        for path in self.folder.glob("*.part"):
            with suppress(OSError):  # removed by another campaign
                if time.time() - path.stat().st_mtime > _ABANDONED:
                    path.unlink(missing_ok=True)

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.npz"


def encode(run: Run, solution: Solution, *, timeout: float = np.inf) -> bytes:
    """Return a solution as the content of an npz file, the same bytes for the same solution."""
    record: dict[str, object] = {"run": run.parameters(), "status": solution.status.name}
    if solution.status is Status.TIMED_OUT:
        record["timeout_s"] = timeout
    values = {"record": json.dumps(record, sort_keys=True)} | vars(solution)
    buffer = BytesIO()
    with ZipFile(buffer, "w") as archive:
        for name, value in values.items():
            member, info = BytesIO(), ZipInfo(f"{name}.npy", _EPOCH)
            info.create_system, info.external_attr = 3, 0o644 << 16  # equal on every system
            np.lib.format.write_array(member, np.asarray(value), allow_pickle=False)
            archive.writestr(info, member.getvalue())
    return buffer.getvalue()


def decode(content: bytes, run: Run) -> tuple[Solution, dict[str, Any]]:
    """Return the solution of a run from the content of its file, and the file's record."""
    try:
        members = _members(content)
        record = json.loads(str(members.pop("record")))
        if key_of(record["run"]) != run.key():
            raise ValueError("it is the solution of a different run")
        _check_shapes(run, members)
        m = members
        end = (Status(int(m["status"])), float(m["limit_load"]), int(m["iterations"]))
        whole = (*end, str(m["solver"]))
        if run.kind is Kind.CURVE:
            arrays = (m["readings"], m["rates"], m["rest"], m["rest_rates"])
            return CurveSolution(*arrays, *whole), record
        return PathSamples(m["loads"], m["readings"], m["gradients"], *whole), record
    except Exception as fault:  # a damaged archive may raise anything
        raise _DamagedError(repr(fault)) from fault


def _members(content: bytes) -> dict[str, Any]:
    # read a whole member first, so that its checksum is verified
    with ZipFile(BytesIO(content)) as archive:
        parts = {name.removesuffix(".npy"): archive.read(name) for name in archive.namelist()}
    return {name: np.load(BytesIO(part), allow_pickle=False) for name, part in parts.items()}


def _check_shapes(run: Run, members: dict[str, Any]) -> None:
    n, inputs = len(members["readings"]), len(INPUTS)
    outputs = 1 if run.held else len(OUTPUTS)
    wanted: dict[str, tuple[int, ...]] = {"readings": (n, outputs)}
    if run.kind is Kind.CURVE:
        wanted |= {"rates": (n, outputs), "rest": (outputs,), "rest_rates": (outputs,)}
        if n > len(run.curve.loads):
            raise ValueError(f"it has {n} loads, not {len(run.curve.loads)}")
    else:
        wanted |= {"loads": (n,), "gradients": (n, outputs, inputs)}
    for name, shape in wanted.items():
        array = members[name]
        if array.shape != shape or array.dtype != np.float64:
            raise ValueError(f"{name} is {array.dtype} of shape {array.shape}, not {shape}")


def _write(path: Path, content: bytes) -> None:
    part = path.with_name(f".{path.stem[:12]}-{uuid4().hex}.part")
    try:
        with part.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
