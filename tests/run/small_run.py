"""A finished run of a study with an offset of pressure, without verdict and films of its own."""

import hashlib
import json

import numpy as np

from bayesdeg.analysis.films import course_of
from bayesdeg.analysis.model_kind import ActuatorKind
from bayesdeg.assembly.assemble import assemble
from bayesdeg.inference.importance import about_mode, improved
from bayesdeg.inference.laplace import approximate
from bayesdeg.inference.sampling import EFFORTS, Chain
from bayesdeg.inference.tree import to_datatree
from bayesdeg.inference.update import drawn_evenly
from bayesdeg.pages.output import run_folder
from bayesdeg.pages.record import RunRecord, VerdictRecord
from bayesdeg.surrogate.trained import write_trained
from tests.run.planted_offset import emulator

DRAWS = 1000


def sample_of(model, seed, *, enough=1500.0):
    """An importance sample of the model's own posterior."""
    generator = np.random.default_rng(seed)
    found = about_mode(model, approximate(model, generator), generator)
    return improved(model, found, generator, enough=enough, rounds=6)


def chain_of(model, seed):
    """Draws of equal weight of the model's posterior, with their densities."""
    sample = sample_of(model, seed)
    places = drawn_evenly(sample, np.random.default_rng(seed), DRAWS)
    shape = (4, DRAWS // 4, 1)
    return Chain(
        sample.draws[places].reshape(*shape, -1),
        sample.log_densities[places].reshape(shape),
        np.ones(4),
    )


def write_run(path, study, *, causes=("pressure_offset",), course=False, chain=chain_of):
    """Write what a finished run leaves that an update needs; return its path and emulator."""
    assembly = assemble(study, emulator())
    known = {cause.name: cause for cause in assembly.causes}
    base, final = assembly.model, assembly.extended(*(known[name] for name in causes))
    file = path.parent / "emulator.npz"
    write_trained(file, emulator())
    training = {"training": json.loads(emulator().record)}
    with run_folder(path, study) as folder:
        for seed, (name, model) in enumerate({"posterior_base": base, "posterior": final}.items()):
            tree = to_datatree(model, chain(model, seed), np.random.default_rng(0))
            folder.write_posterior(name, tree)
        if course:
            found = course_of(study, EFFORTS["quick"], np.random.SeedSequence(1))
            tree = to_datatree(found.model, found.chain, np.random.default_rng(0))
            folder.write_posterior("posterior_course", tree)
        named = {"outcome": "named", "causes": causes, "predicted_with": causes}
        folder.write(VerdictRecord.model_validate(named))
        folder.write(
            RunRecord(
                title="Planted",
                study=study.name,
                seed=7,
                effort="quick",
                hashes=dict(study.hashes),
                model=ActuatorKind().tested(base, final, study),
                emulator=training,
                posteriors=folder.posterior_hashes(),
            )
        )
    return path, file


def contents(folder):
    """Hashes of all files of a folder by name."""
    return {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.iterdir()
        if path.is_file()
    }
