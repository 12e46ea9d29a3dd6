"""A campaign of real finite element runs of small actuators; as a script, one that is killed.

    python -m tests.surrogate.real_campaign STORE KILLS SEED

forks a process that works on the campaign and kills it at a random moment, as often as wanted;
the last one may finish. Prints what it did as JSON.
"""

import json
import sys
from functools import partial
from pathlib import Path

import numpy as np

from bayesdeg.surrogate.campaign import complete
from bayesdeg.surrogate.solutions import SolutionStore
from tests.killing import killed
from tests.surrogate.small_runs import contents, real_runs

COUNT = 32


if __name__ == "__main__":
    chosen = SolutionStore(Path(sys.argv[1]))
    # compiled code and meshes are loaded once, so that the kills hit the campaign itself
    warm = SolutionStore(Path(sys.argv[1] + "-warm"))
    complete(real_runs(4), warm)
    pause = 6.0 * float(np.median(list(warm.seconds().values())))
    kills, chance = int(sys.argv[2]), int(sys.argv[3])
    work = partial(complete, real_runs(COUNT), chosen)
    told = killed(work, lambda: len(contents(chosen.folder)), kills, chance, pause)
    print(json.dumps(told))
