"""How many worker processes are opened."""

import pytest

from bayesdeg.surrogate import workers
from bayesdeg.surrogate.workers import WorkerProcesses


@pytest.mark.parametrize(("asked", "opened"), [(1, 1), (2, 2), (64, 2)])
def test_no_more_processes_than_cores_are_opened(monkeypatch, asked, opened):
    made = []

    def pool(count, **_):
        made.append(count)

    monkeypatch.setattr(workers, "_cores", lambda: 2)
    monkeypatch.setattr(workers, "ProcessPoolExecutor", pool)
    assert WorkerProcesses(asked).workers == opened
    assert made == [opened]
