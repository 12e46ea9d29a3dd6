"""Functions and causes that a study folder brings along, with faults that name file and line."""

import hashlib
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayesdeg.causes.cause import Cause
from bayesdeg.data import readings as files
from bayesdeg.data.settings import FILE as SETTINGS_FILE
from bayesdeg.data.settings import OwnForward
from bayesdeg.data.study import CAUSES, Study
from bayesdeg.errors import BayesdegError, Fault, StudyError, use_one_of
from bayesdeg.files import STUDY_MB, read_bytes
from bayesdeg.inference.model import JointModel
from bayesdeg.pipeline.formula import Forward, OwnMap, Readings

Floats = NDArray[np.float64]

DRAWS = 32  # from the priors, at which a forward map is tried


@dataclass(frozen=True)
class Code:
    """A Python file of a study, or a function in it.

    Parameters
    ----------
    path : Path
        Where it is.
    name : str
        As the user knows it: ``model.py``, ``causes/drag.py``.
    """

    path: Path
    name: str

    def module(self) -> ModuleType:
        """Run the file; nothing is written beside it.

        Raises
        ------
        StudyError
            If it is no Python, or fails.
        """
        source = read_bytes(self.path, most_mb=STUDY_MB)
        module = ModuleType(f"study_{hashlib.sha256(source).hexdigest()[:12]}")
        module.__file__ = str(self.path)
        try:
            code = compile(source, str(self.path), "exec")
        except (SyntaxError, ValueError) as error:
            row, text = getattr(error, "lineno", None), getattr(error, "text", None)
            problem = f"is not valid Python: {getattr(error, 'msg', error)}"
            value = None if text is None else text.strip()
            raise StudyError(
                [Fault(self.name, problem, "correct that line", row, value=value)]
            ) from error
        try:
            exec(code, module.__dict__)
        except Exception as error:
            raise StudyError([self.fault(error, "fails when it is read")]) from error
        return module

    def fault(self, error: BaseException, what: str) -> Fault:
        """Return a fault for an exception, with the last line of this file that it went through."""
        frames = traceback.extract_tb(error.__traceback__)
        rows = [frame.lineno for frame in frames if frame.filename == str(self.path)]
        problem = f"{what}: {type(error).__name__}: {error}"
        return Fault(self.name, problem, "correct that line", rows[-1] if rows else None)

    def watched(self, function: Callable[..., Any], what: str) -> Callable[..., Any]:
        """Return a function whose exceptions name the line of this file."""

        def call(*arguments: Any) -> Any:
            try:
                with np.errstate(all="ignore"):  # no number is no answer, which is counted
                    return function(*arguments)
            except BayesdegError:
                raise
            except KeyError as error:
                raise StudyError([self._unknown(error, what, arguments)]) from error
            except Exception as error:
                raise StudyError([self.fault(error, f"{what} fails")]) from error

        return call

    def _unknown(self, error: KeyError, what: str, arguments: tuple[Any, ...]) -> Fault:
        """Return a fault for a name that is neither a parameter nor an input."""
        known = [str(name) for given in arguments if isinstance(given, dict) for name in given]
        asked = str(error.args[0]) if error.args else ""
        problem = f"{what} asks for {asked!r}, which it is not given"
        remedy = use_one_of(asked, known) if known else "correct that line"
        return replace(self.fault(error, what), problem=problem, remedy=remedy)


def own_map(study: Study) -> OwnMap:
    """Return the readings of a study with the function that predicts them.

    Raises
    ------
    StudyError
        If the function is not to be had.
    """
    forward = study.settings.forward
    assert forward is not None
    file, _, name = forward.function.partition(":")
    code = Code(study.folder / file, file)
    functions = {key: one for key, one in vars(code.module()).items() if callable(one)}
    if name not in functions:
        problem = f"names a function that {file} does not have"
        remedy = use_one_of(name, functions) if functions else f"write def {name}(values, x)"
        place = (None, "forward.function", forward.function)
        raise StudyError([Fault(SETTINGS_FILE, problem, remedy, *place)])
    called: Forward = code.watched(functions[name], name)
    return OwnMap((_readings(study, forward),), {forward.reading: called}, forward.function)


def _readings(study: Study, forward: OwnForward) -> Readings:
    table = study.others[files.NAME]

    def given(name: str, default: Any) -> Any:
        return table[name].to_numpy() if name in table else default

    leveled = files.LEVEL in table and files.LEVEL in (forward.inputs or ())
    timed = files.TIME in (forward.inputs or ())
    return Readings(
        {name: table[name].to_numpy(np.float64) for name in forward.inputs or ()},
        table[forward.reading].to_numpy(np.float64),
        specimen=given(files.SPECIMEN, None),
        name=forward.reading,
        unit=forward.unit,
        error=forward.error,
        scatter=forward.scatter,
        level=given(files.LEVEL, 0.0) if leveled else 0.0,
        time=given(files.TIME, np.nan) if timed else np.nan,
        history=given(files.HISTORY, "once"),
        level_unit="%" if leveled else "",
    )


def own_causes(study: Study) -> tuple[Cause, ...]:
    """Return the causes of a study's own: ``CAUSE``, or ``CAUSES``, of each file.

    Raises
    ------
    StudyError
        With every file that fails or has none, and every name that is there twice.
    """
    found: dict[str, Cause] = {}
    faults: list[Fault] = []
    for path in sorted((study.folder / CAUSES).glob("*.py")):
        code = Code(path, f"{CAUSES}/{path.name}")
        try:
            for cause in _causes_of(code):
                if cause.name in found:
                    problem = f"has a cause {cause.name!r}, which another file has as well"
                    faults.append(Fault(code.name, problem, "give it another name"))
                found[cause.name] = cause
        except StudyError as error:
            faults += error.faults
    if faults:
        raise StudyError(faults)
    return tuple(found.values())


def _causes_of(code: Code) -> Iterator[Cause]:
    there = vars(code.module())
    listed = there.get("CAUSES", [there[name] for name in ("CAUSE",) if name in there])
    causes = list(listed) if isinstance(listed, Iterable) else [listed]
    wrong = [type(one).__name__ for one in causes if not isinstance(one, Cause)]
    if wrong or not causes:
        problem = f"has {', '.join(wrong)} where a cause belongs" if wrong else "has no CAUSE"
        raise StudyError([Fault(code.name, problem, "write CAUSE = bayesdeg.Cause(...)")])
    for cause in causes:
        hooks = {
            name: code.watched(hook, f"{name} of {cause.name}")
            for name in ("on_inputs", "on_reading")
            if (hook := getattr(cause, name)) is not None
        }
        yield replace(cause, **hooks)


def try_out(study: Study, model: JointModel, causes: Iterable[Cause]) -> None:
    """Ask forward map and causes at draws from the priors, before anything is computed.

    Raises
    ------
    StudyError
        If something fails, has the wrong shape, or has no answer at any of the draws.
    """
    forward = study.settings.forward
    assert forward is not None
    file, _, name = forward.function.partition(":")
    predicted = _asked(model, file)
    lost = np.flatnonzero(~np.isfinite(predicted).any(axis=0))
    if len(lost):
        specimen = model.places.specimen[lost[0]]
        problem = (
            f"{name} has no finite answer for {len(lost)} of {predicted.shape[1]} readings, the "
            f"first being reading {lost[0] + 1} (specimen {specimen}), at any of {DRAWS} draws "
            "from the priors"
        )
        remedy = "let it return numbers there, or leave these rows out of readings.csv"
        raise StudyError([Fault(file, problem, remedy)])
    for cause in causes:
        _asked(model.extended(cause), f"{CAUSES}, {cause.name}")


def _asked(model: JointModel, place: str) -> Floats:
    vectors = model.table.sample(np.random.default_rng(0), DRAWS)
    try:
        with np.errstate(all="ignore"):
            return model.expected(vectors)
    except StudyError:
        raise
    except (BayesdegError, ValueError, TypeError) as error:
        problem, _, remedy = str(error).partition("; ")
        raise StudyError([Fault(place, problem, remedy or "correct it")]) from error
