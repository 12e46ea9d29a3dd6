"""A campaign of real finite element runs of small actuators; as a script, one that is killed.

    python -m tests.emulator.real_campaign STORE KILLS SEED

forks a process that works on the campaign and kills it at a random moment, as often as wanted;
the last one may finish. Prints what it did as JSON.
"""

import json
import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

from bayesdeg.emulator.campaign import complete
from bayesdeg.emulator.solutions import SolutionStore
from tests.emulator.small_runs import contents, real_runs

COUNT = 32


def fork_campaign(store, runs):
    pid = os.fork()
    if pid == 0:
        try:
            complete(runs, store)
            os._exit(0)
        finally:
            os._exit(1)
    return pid


def killed_campaign(store, runs, kills, seed, longest):
    """Kill the campaign at random moments, then let it finish."""
    rng = np.random.default_rng(seed)
    hits, progress = 0, []
    while hits < kills:
        pid = fork_campaign(store, runs)
        time.sleep(rng.uniform(0.0, longest))
        os.kill(pid, signal.SIGKILL)
        _, status = os.waitpid(pid, 0)
        if not os.WIFSIGNALED(status):
            break  # it was done before
        hits += 1
        progress.append(len(contents(store.folder)))
    _, status = os.waitpid(fork_campaign(store, runs), 0)
    return {"kills": hits, "progress": progress, "exit": os.waitstatus_to_exitcode(status)}


if __name__ == "__main__":
    chosen = SolutionStore(Path(sys.argv[1]))
    # compiled code and meshes are loaded once, so that the kills hit the campaign itself
    warm = SolutionStore(Path(sys.argv[1] + "-warm"))
    complete(real_runs(4), warm)
    pause = 6.0 * float(np.median(list(warm.seconds().values())))
    kills, chance = int(sys.argv[2]), int(sys.argv[3])
    print(json.dumps(killed_campaign(chosen, real_runs(COUNT), kills, chance, pause)))
