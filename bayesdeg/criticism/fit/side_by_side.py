"""Parallel work on many items in parts."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from functools import partial

PARTS = 4  # items per part: the same whatever the number of workers


def apply[T, Result](
    work: Callable[[T], Result], items: Sequence[T], executor: Executor | None = None
) -> list[Result]:
    """Return the work on each item, in order.

    The work is a function of a module, or a partial of one: what that holds goes to a process once
    a part. Items are dealt out to the parts one after another. Without an executor the parts are
    done here.

    Examples
    --------
    >>> apply(abs, [-3, 2, -1, 0, 5])
    [3, 2, 1, 0, 5]
    """
    parts = [list(items[k::PARTS]) for k in range(min(PARTS, len(items)))]
    done = list(in_order(partial(_each, work), parts, executor))
    return [done[k % PARTS][k // PARTS] for k in range(len(items))]


def in_order[T, Result](
    work: Callable[[T], Result], items: Iterable[T], executor: Executor | None = None
) -> Iterator[Result]:
    """Yield the work on each item, in order; an executor begins with all of them at once."""
    return map(work, items) if executor is None else executor.map(work, items)


def later[Result](
    work: Callable[[], Result], executor: Executor | None = None
) -> Callable[[], Result]:
    """Start work in another process; return a function that waits for its result."""
    return work if executor is None else executor.submit(work).result


def _each[T, Result](work: Callable[[T], Result], part: list[T]) -> list[Result]:
    return [work(item) for item in part]
