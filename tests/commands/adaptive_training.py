"""Training in rounds on real finite element curves of a small actuator; as a script, one killed.

    python -m tests.commands.adaptive_training FOLDER KILLS SEED

forks a process that trains where the study lies and kills it at a random moment, as often as
wanted; the last one may finish. Prints what it did as JSON.
"""

import json
import os
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

from bayesdeg import training
from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.analysis import calibrate
from bayesdeg.analysis.region import asked_of
from bayesdeg.data.study import read_study
from bayesdeg.inference.sampling import EFFORTS
from bayesdeg.surrogate.kept import local_recipe
from bayesdeg.surrogate.local import local_design
from tests.killing import forked, killed
from tests.run.study_files import SETTINGS, study_in
from tests.run.tiny_campaign import COARSE, FINE, TABLE

# of a chain, which is sampled where so rough an emulator leaves no other draws
SHORT = replace(EFFORTS["quick"], effective=1.0, r_hat=10.0, longest=75)
MANNER = training.TrainingOptions(yes=True, quiet=True)
LONGEST = 0.75  # of the time that an undisturbed training takes


def recipe(dimensions):
    """As a study's own, on meshes of a second."""
    return replace(local_recipe(dimensions), coarse_mesh=COARSE, fine_mesh=FINE)


def study_of(folder):
    folder.mkdir(parents=True)
    study_in(folder, {"study.toml": SETTINGS + TABLE})
    return read_study(folder)


def train(study, folder):
    """Train in all rounds, in a working folder."""
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    training.LOCAL = recipe
    training.TARGET_PCT = training.REFINABLE_PCT = 0.0  # never good: all rounds are worked
    training.LAST_ROUNDS = 1  # the next would be the same once more
    calibrate.EFFORTS = EFFORTS | {"quick": SHORT}
    asked = asked_of(study, study.settings.seed)
    first = local_design(asked, recipe(geometry_of_study(study.settings).dimensions))
    training.train_for_study(study, first, None, MANNER)


def left(folder):
    """Everything that stays: solutions and the emulator, by name."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*.npz"))
        if not path.name.startswith(".")
    }


if __name__ == "__main__":
    chosen, count, chance = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    of = study_of(chosen / "study")
    begun = time.monotonic()
    _, state = os.waitpid(forked(partial(train, of, chosen / "undisturbed")), 0)
    assert state == 0
    pause = LONGEST * (time.monotonic() - begun)
    whole = left(chosen / "undisturbed")
    told = {"kills": 0, "exits": [], "progress": [], "files": [], "same": True}
    while told["kills"] < count:  # a training that ends before its last kill is begun anew
        folder = chosen / f"killed {len(told['exits'])}"
        work, done = partial(train, of, folder), partial(left, folder)
        more = count - told["kills"]
        found = killed(work, lambda done=done: len(done()), more, chance + more, pause)
        told["kills"] += found["kills"]
        told["exits"].append(found["exit"])
        told["progress"].append(found["progress"])
        told["files"].append(len(left(folder)))
        told["same"] &= left(folder) == whole
    print(json.dumps(told))
