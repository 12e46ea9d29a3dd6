"""Work in a process of its own that is killed at random moments, as often as wanted."""

import os
import signal
import time
import traceback

import numpy as np


def forked(work):
    """Begin work in a child of this process, which has its compiled code; gives its number."""
    pid = os.fork()
    if pid == 0:
        try:
            work()
            os._exit(0)
        except BaseException:
            traceback.print_exc()
            os._exit(1)
    return pid


def killed(work, done, kills, seed, longest):
    """Kill work at random moments, then let it finish; ``done`` counts what stays of it."""
    rng, hits, progress = np.random.default_rng(seed), 0, []
    while hits < kills:
        pid = forked(work)
        time.sleep(rng.uniform(0.0, longest))
        os.kill(pid, signal.SIGKILL)
        _, status = os.waitpid(pid, 0)
        if not os.WIFSIGNALED(status):
            break  # it was done before
        hits += 1
        progress.append(done())
    _, status = os.waitpid(forked(work), 0)
    return {"kills": hits, "progress": progress, "exit": os.waitstatus_to_exitcode(status)}
