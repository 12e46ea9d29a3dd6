"""The header of a table against the columns it should have."""

from collections.abc import Iterable, Sequence

from bayesdeg.errors import Fault
from bayesdeg.measure.nearest import nearest
from bayesdeg.measure.number import NUMBER
from bayesdeg.nomenclature import DIMENSIONLESS, QUANTITIES, stem

#: Endings by which a column is taken for the same quantity in another unit.
UNITS = frozenset(
    {"pa", "hpa", "kpa", "mpa", "gpa", "bar", "mbar", "psi", "atm", "mmhg", "n_per_mm2"}
    | {"ug", "mg", "g", "kg", "um", "mm", "cm", "m", "per_mm", "per_cm", "per_m", "deg", "rad"}
    | {"ms", "s", "sec", "seconds", "min", "minutes", "h", "hr", "hours", "d", "days"}
    | {"pct", "percent", "frac", "fraction", "ratio"}
)


def check_header(
    names: Sequence[str], place: Fault, *, required: Iterable[str], optional: Iterable[str]
) -> dict[str, Fault]:
    """Find columns that are missing, misspelt or in another unit.

    A column that is neither listed nor like a listed one that is absent is nobody's fault: it is
    kept.

    Parameters
    ----------
    names : sequence of str
        The header as it stands.
    place : Fault
        Carries file and row of the header.
    required, optional : iterable of str
        Columns that must and that may be there.

    Returns
    -------
    dict of str to Fault
        One for each column that should be there, not for each row.

    Examples
    --------
    >>> place = Fault("tensile.csv", "", "", 1)
    >>> names = ["stretch", "stress_kPa"]
    >>> faults = check_header(names, place, required=["stretch", "stress_MPa"], optional=[])
    >>> faults["stress_MPa"].column, faults["stress_MPa"].remedy
    ('stress_kPa', 'give it in MPa and name the column stress_MPa')
    """
    required, optional = tuple(required), tuple(optional)
    if not set(names) & {*required, *optional} and any(NUMBER.fullmatch(name) for name in names):
        remedy = f"begin with a line that names the columns: {', '.join(required)}"
        fault = Fault(place.file, "has no header", remedy, place.row, value=",".join(names))
        return {required[0]: fault}
    listed = {*required, *optional}
    there = tuple(listed & set(names))
    # `stress_MPa_raw` beside `stress_MPa` is the user's own
    unlisted = [name for name in names if name not in listed and not name.startswith(there)]
    faults = {}
    for column in (*required, *optional):
        if column in names:
            continue
        blamed = _blame(column, unlisted, place, is_required=column in required)
        if blamed is not None:
            faults[column] = blamed
            unlisted = [name for name in unlisted if name != blamed.column]
    return faults


def _blame(
    column: str, unlisted: Sequence[str], place: Fault, *, is_required: bool
) -> Fault | None:
    unit = QUANTITIES[column].unit
    wanted = "" if unit == DIMENSIONLESS else f" in {unit}"
    if not is_required:
        unlisted = [name for name in unlisted if not _is_other_quantity(name)]
    for name in unlisted:
        if _is_other_unit(name, column):
            problem = "does not name the unit it should"
            remedy = f"give it{wanted} and name the column {column}"
            return Fault(place.file, problem, remedy, place.row, name)
    best = nearest(column, unlisted, cutoff=0.7 if is_required else 0.8)
    # an unlisted column is the user's own unless it can hardly be anything but a slip
    if best is not None and (is_required or best[0].casefold() == column[0].casefold()):
        problem, remedy = "is not a known column", f"did you mean {column!r}? Rename it"
        return Fault(place.file, problem, remedy, place.row, best)
    if is_required:
        remedy = f"add it: {QUANTITIES[column].meaning}{wanted}"
        return Fault(place.file, "is missing", remedy, place.row, column)
    return None


def _is_other_quantity(name: str) -> bool:
    return name in QUANTITIES and stem(name) != name


def _is_other_unit(name: str, column: str) -> bool:
    if QUANTITIES[column].unit == DIMENSIONLESS:
        return False
    start, folded = stem(column).casefold(), name.casefold()
    if folded == start:
        return True
    return folded.startswith(f"{start}_") and folded.removeprefix(f"{start}_") in UNITS
