"""Output folders of commands: checked, refused if something would be destroyed, and locked."""

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from pydantic import Field

from bayesdeg.data.settings import FILE as SETTINGS_FILE
from bayesdeg.data.settings import parse_settings
from bayesdeg.data.study import Study
from bayesdeg.errors import BayesdegError
from bayesdeg.files import (
    RUN_MB,
    STUDY_MB,
    parse_json,
    read_bytes,
    reason,
    refuse_special,
    write_text,
)
from bayesdeg.laboratory.writing import FIRST_WORDS, TRUTH_FILE
from bayesdeg.observations.catalogue import DATA_FILES
from bayesdeg.pages.folder import ADDED, RUN, RUN_FILES, RunFolder
from bayesdeg.records import FileRecord, Text, Texts

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

LOCK = ".lock"
OWNER = ".study.json"
"""File in a run folder that identifies its study, even for an unfinished run."""

CHECKPOINTS = "checkpoints"
OTHER = "name a different folder with --out"


class Owner(FileRecord):
    """The content of ``.study.json``."""

    study: Text = Field(default="", description="name of the study")
    folder: Text = Field(default="", description="relative path from the run folder to the study")
    hashes: Texts = Field(default={}, description="SHA-256 of the files of the study")


@contextmanager
def run_folder(path: Path, study: Study) -> Iterator[RunFolder]:
    """Claim a folder for the run of a study, before anything is computed.

    Parameters
    ----------
    path : Path
        The folder; it is made if it is not there.
    study : Study
        Whose run it is.

    Raises
    ------
    BayesdegError
        If it is in a study, holds another study's run or files that no run wrote, cannot be
        written to, or is in use by another command.
    """
    refuse_study(path)
    with claimed(path):
        _refuse_other_run(path, study)
        place, hashes = _from(path, study.folder), dict(study.hashes)
        write_text(path / OWNER, Owner(study=study.name, folder=place, hashes=hashes).text())
        yield RunFolder(path)


@contextmanager
def update_folder(path: Path, report: Path, study: Study) -> Iterator[RunFolder]:
    """Claim a folder for an updated run, before anything is computed.

    Parameters
    ----------
    path : Path
        The folder; it is made if it is not there.
    report : Path
        The run that is updated, which stays as it is.
    study : Study
        Whose run it is.

    Raises
    ------
    BayesdegError
        If it is the run itself, or holds a run that was not made by an update; and as
        `run_folder`.
    """
    if path.resolve() == report.resolve():
        raise BayesdegError(
            f"{path} is the run being updated, which is not changed; name a different folder with "
            "--out"
        )
    if _is_there(path / f"{RUN}.json") and not _is_there(path / ADDED):
        raise BayesdegError(f"{path} holds a run that would be overwritten; {OTHER}")
    with run_folder(path, study) as folder:
        yield folder


@contextmanager
def virtual_study(path: Path, files: Iterable[str]) -> Iterator[Path]:
    """Claim a folder for a virtual study, before anything is computed.

    Parameters
    ----------
    path : Path
        The folder; it is made if it is not there.
    files : iterable of str
        Names of the files that will be written.

    Raises
    ------
    BayesdegError
        If data that are not virtual would be overwritten or removed, if it is within another study,
        cannot be written to, or is in use by another command.
    """
    refuse_study(path, itself=False)
    with claimed(path):
        for name in files:
            if (path / name).exists() and not is_virtual(path / name):
                raise BayesdegError(
                    f"{path / name} is not from a virtual experiment and would be overwritten or "
                    f"removed; {OTHER}, such as {path.name}_virtual"
                )
        yield path


def is_virtual(path: Path) -> bool:
    """Return whether an existing file says that it is from a virtual experiment."""
    try:
        content = read_bytes(path, most_mb=STUDY_MB)
        if path.name == TRUTH_FILE:
            record = parse_json(content)
            return isinstance(record, dict) and {"causes", "constants", "command"} <= set(record)
    except (OSError, ValueError):
        return False
    if content.decode("utf-8-sig", "replace").startswith(FIRST_WORDS):
        return True
    return path.name == SETTINGS_FILE and parse_settings(content)[0].virtual


def output_file(path: Path) -> Path:
    """Return the path of an output file after checking it.

    Parameters
    ----------
    path : Path
        As the user names it.

    Raises
    ------
    BayesdegError
        If it is a file of a study or of a run, or cannot be written.
    """
    folder = path.parent
    of_study = path.name in (SETTINGS_FILE, *DATA_FILES) and _is_there(folder / SETTINGS_FILE)
    of_run = path.name in RUN_FILES and _is_there(folder / f"{RUN}.json")
    if of_study or of_run:
        whose = "the data of a study" if of_study else "the results of a run"
        raise BayesdegError(f"{path} belongs to {whose}; name a different file with --out")
    try:
        was_there = path.exists()
        if was_there:
            refuse_special(path)
        with path.open("ab"):
            pass
        if not was_there:
            path.unlink()
    except OSError as fault:
        raise BayesdegError(
            f"{path} cannot be written ({reason(fault)}); name a file in an existing, writable "
            "folder"
        ) from fault
    return path


def refuse_study(path: Path, *, itself: bool = True) -> None:
    """Refuse a folder that is a study or lies in one: results and data share file names.

    Parameters
    ----------
    path : Path
        The folder, which need not be there.
    itself : bool
        Whether it may not be a study itself.

    Raises
    ------
    BayesdegError
        Naming the study.
    """
    whole = path.resolve()
    for folder in (whole, *whole.parents)[0 if itself else 1 :]:
        if _is_there(folder / SETTINGS_FILE):
            place = "is" if folder == whole else "lies in"
            raise BayesdegError(
                f"{path} {place} the study {folder}; results must not be mixed with its data; "
                f"{OTHER}"
            )


@contextmanager
def claimed(path: Path) -> Iterator[None]:
    """Create a folder, check that it is writable, and lock it until the command ends.

    The lock belongs to the operating system and ends with the process. A folder that stays empty is
    removed again.

    Raises
    ------
    BayesdegError
        If it cannot be written to, or another command is writing there.
    """
    new = [folder for folder in (path, *path.parents) if not _is_there(folder)]
    try:
        path.mkdir(parents=True, exist_ok=True)
        file = _locked(path / LOCK)
    except OSError as fault:
        _remove_empty(new)
        raise BayesdegError(
            f"{path} cannot be created or written to ({_why(fault)}); {OTHER}"
        ) from fault
    try:
        yield
    finally:
        (path / LOCK).unlink(missing_ok=True)
        file.close()
        _remove_empty(new)


def _why(fault: OSError) -> str:
    if isinstance(fault, FileExistsError | NotADirectoryError):
        return f"{fault.filename} is not a folder"
    return reason(fault)


def _locked(path: Path) -> IO[bytes]:
    """Open and lock a file; another process may remove it in between."""
    while True:
        if path.exists():
            refuse_special(path)
        file = path.open("ab")
        try:
            _lock(file)
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                    return file
        except BlockingIOError as fault:
            file.close()
            raise BayesdegError(
                f"another command is writing to {path.parent}; wait until it ends, or {OTHER}"
            ) from fault
        file.close()


def _lock(file: IO[bytes]) -> None:
    """Lock a file for this process, if the file system supports locks.

    Record locks are not inherited by worker processes, which may outlive a killed command.
    """
    try:
        if sys.platform == "win32":
            msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except (BlockingIOError, PermissionError) as fault:
        raise BlockingIOError from fault
    except OSError:
        return


def _refuse_other_run(path: Path, study: Study) -> None:
    """Refuse a folder that holds anything but earlier runs of the same study."""
    owner = owner_of(path)
    if owner is None:
        taken = sorted(name for name in RUN_FILES if _is_there(path / name))
        if taken and not _is_there(path / CHECKPOINTS):
            raise BayesdegError(
                f"{path} holds {taken[0]}, which was not written by a run and would be "
                f"overwritten; {OTHER}"
            )
        return
    if not _is_same(path, owner, study):
        whose = owner.folder or owner.study
        raise BayesdegError(
            f"{path} holds the run of a different study, {whose}, not of {study.folder}; {OTHER}, "
            "or remove that run"
        )


def owner_of(path: Path) -> Owner | None:
    """Return the owner recorded in a run folder; None if it holds no run."""
    for name in (OWNER, f"{RUN}.json"):
        with suppress(OSError, ValueError):
            return Owner.read(parse_json(read_bytes(path / name, most_mb=RUN_MB)))
    return None


def _is_same(path: Path, owner: Owner, study: Study) -> bool:
    """Return whether a run is of a study: same place or same files."""
    if not owner.folder:  # from a version that did not record it
        return owner.study in ("", study.name)
    folder = (path / owner.folder).resolve()
    return folder == study.folder.resolve() or dict(owner.hashes) == dict(study.hashes)


def _from(path: Path, folder: Path) -> str:
    """Return the relative path from a run folder to its study, valid if both are moved."""
    try:
        return os.path.relpath(folder.resolve(), path.resolve())
    except ValueError:  # on another drive
        return str(folder.resolve())


def _is_there(path: Path) -> bool:
    try:
        return path.exists()
    except OSError:  # such as a name that is too long
        return False


def _remove_empty(folders: Iterable[Path]) -> None:
    for folder in folders:
        with suppress(OSError):
            folder.rmdir()
