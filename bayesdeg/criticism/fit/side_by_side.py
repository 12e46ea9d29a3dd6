"""Parallel work on many items in parts."""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from functools import partial

PARTS = 4  # items per part: the same whatever the number of workers


def apply[T, Result](
    work: Callable[[T], Result], items: Sequence[T], executor: Executor | None = None
) -> list[Result]:
    """Return the work on each item, in order.

    Parameters
    ----------
    work : callable
        Of a module, or a partial of one: what it holds goes to a process once a part.
    items : sequence
        One after another they are dealt out to the parts.
    executor : Executor, optional
        Does the parts side by side; by default they are done here.

    Examples
    --------
    >>> apply(abs, [-3, 2, -1, 0, 5])
    [3, 2, 1, 0, 5]
    """
    parts = [list(items[k::PARTS]) for k in range(min(PARTS, len(items)))]
    run = map if executor is None else executor.map
    done = list(run(partial(_each, work), parts))
    return [done[k % PARTS][k // PARTS] for k in range(len(items))]


def later[Result](
    work: Callable[[], Result], executor: Executor | None = None
) -> Callable[[], Result]:
    """Start work in another process; return a function that waits for its result."""
    return work if executor is None else executor.submit(work).result


def _each[T, Result](work: Callable[[T], Result], part: list[T]) -> list[Result]:
    return [work(item) for item in part]
