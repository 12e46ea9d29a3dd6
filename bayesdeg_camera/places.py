"""What a study of photographs or recordings must have: one source of readings, and its files."""

from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from bayesdeg.data.study import Study
from bayesdeg.errors import Fault, StudyError

_READINGS = {"actuator": "actuator.csv", "markers": "markers.csv", "photos": "photos.csv"}


def raise_faults(faults: Iterable[Fault]) -> None:
    """Raise a `StudyError` if there are faults."""
    if found := tuple(faults):
        raise StudyError(found)


def contradictions(study: Study, table: str, kind: str) -> list[Fault]:
    """Return the faults of a study with readings of a second kind, or of a different actuator.

    ``kind`` is what the table names, in the plural.
    """
    faults = [
        Fault(
            table,
            f"is given together with {file}",
            f"keep either the {kind} or the readings from them",
        )
        for name, file in _READINGS.items()
        if file != table and study.table(name) is not None
    ]
    if not study.settings.is_default_mould:
        problem = "is available only for the default actuator, not for points on a different one"
        faults.append(Fault(table, problem, "give bend angles of the end faces in actuator.csv"))
    return faults


def named_files(
    folder: Path, table: str, inner: str, names: Iterable[str], kind: str
) -> tuple[dict[str, Path], list[Fault]]:
    """Return the path of each file, and the faults of the other names.

    The column ``file`` of the table names them; they are in an inner folder of the study. ``kind``
    is what they are, in the plural.
    """
    root = folder / inner
    if not root.is_dir():
        return {}, [Fault(table, f"names {kind}, but there is no folder {inner}", "add it")]
    places, faults = {}, []
    for name in names:
        if problem := wrong_place(folder, root, name):
            remedy = f"put it into the folder {inner} of the study and give its name there"
            faults.append(Fault(table, problem, remedy, None, "file", name))
        else:
            places[name] = root / name
    return places, faults


def wrong_place(study: Path, folder: Path, name: str) -> str:
    """Say why a name is not a file in a folder of the study, with links resolved."""
    way = PurePosixPath(name)
    outside = "is not in the study"
    if way.is_absolute() or ".." in way.parts or "\\" in name or ":" in name or "\0" in name:
        return outside
    try:
        whole = (folder / name).resolve()
        if not whole.is_relative_to(study.resolve()):
            return outside
        return "" if whole.exists() else "does not exist"
    except (OSError, RuntimeError):  # a name that is too long, or a loop of links
        return "does not exist"
