"""What lies outside the training range, in words."""

import numpy as np
from numpy.typing import NDArray

from bayesdeg.emulator.batch import Batch
from bayesdeg.emulator.coordinates import inside
from bayesdeg.emulator.scaling import LOAD, Group, TrainingRange

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

LIMIT = "limit"


def describe(batch: Batch, span: TrainingRange, limit: Floats) -> dict[str, str]:
    """Return a sentence for each group that is out of its range somewhere, and for the load.

    Parameters
    ----------
    batch : Batch
        What was asked for.
    span : TrainingRange
        What is trained.
    limit : array, shape (n_rows,)
        p/M up to which curves are smooth [–].
    """
    out = ~inside(batch.groups[1:].T, span).T
    # values of a group are counted once for each load of its row
    columns = batch.loads.shape[1]
    found = {
        group.name: _group(group, values, refused, columns)
        for group, values, refused in zip(span.groups, batch.groups[1:], out, strict=True)
        if np.any(refused)
    }
    return found | _loads(batch, span, limit)


def _group(group: Group, values: Floats, refused: Flags, columns: int) -> str:
    unit = "" if group.unit == "–" else f" {group.unit}"
    count = f"{columns * int(refused.sum())} of {columns * len(values)} values"
    trained = f"trained from {group.low:.4g} to {group.high:.4g}{unit}; {count}"
    known = values[refused & ~np.isnan(values)]
    if group.name == "paper_slack" and np.any((known >= group.low) & (known <= group.high)):
        return f"{group.meaning} goes together with a mismatch of the paper, {trained}"
    if len(known) == 0:
        return f"{group.meaning} is not a number where the material is impossible, {trained}"
    beyond = np.maximum(group.low - known, known - group.high)
    worst = known[int(np.argmax(beyond))]
    return f"{group.meaning} reaches {worst:.4g}{unit}, {trained}"


def _loads(batch: Batch, span: TrainingRange, limit: Floats) -> dict[str, str]:
    loads, total = batch.loads, batch.loads.size
    largest = np.where(batch.within, batch.largest_load(span), np.inf)
    largest = np.broadcast_to(largest[:, None], loads.shape)
    within = batch.within[:, None]
    over = ~((loads >= 0.0) & (loads <= largest))
    found = {}
    if np.any(over):
        trained = f"{int(over.sum())} of {total} values"
        found[LOAD] = f"p/M {_worst_load(loads[over], largest[over])}; {trained}"
    beyond = within & ~over & (loads > limit[:, None])
    if np.any(beyond):
        at = np.unravel_index(int(np.argmax(np.where(beyond, loads, -1.0))), loads.shape)
        found[LIMIT] = (
            f"p/M reaches {loads[at]:.4g}, the curve of that material is smooth up to "
            f"{limit[at[0]]:.4g}; {int(beyond.sum())} of {total} values"
        )
    return found


def _worst_load(loads: Floats, largest: Floats) -> str:
    known = ~np.isnan(loads)
    if not np.any(known):
        return "is not a number"
    beyond = np.where(known, np.maximum(-loads, loads - largest), -np.inf)
    worst = int(np.argmax(beyond))
    upper = f" to {largest[worst]:.4g} for that material" if np.isfinite(largest[worst]) else ""
    return f"reaches {loads[worst]:.4g}, trained from 0{upper}"
