"""A cause that either is or is not: its evidence is that of the data with the label exchanged."""

import numpy as np
import pytest

from bayesdeg.assembly.assemble import assemble
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.decide.candidates import effect_sizes
from bayesdeg.criticism.fit.trials import base_trial, try_causes
from bayesdeg.data.study import read_study
from bayesdeg.inference.importance import about_mode
from bayesdeg.inference.laplace import approximate
from bayesdeg.material.hyperelastic import NeoHookean, nominal_stress

CAUSE = CATALOGUE["stress_measure"]
STRETCH = np.array([1.1, 1.3, 1.6, 2.0, 2.5])
HEADER = "specimen_id,degradation_pct,mode,stretch,stress_MPa,stress_measure"


def films(folder, *, power, label="nominal"):
    """Write films in two modes, read as λ^power times the nominal stress."""
    folder.mkdir()
    ripple = 1.0 + 0.01 * np.cos(np.arange(len(STRETCH)) * 2.4)
    rows = [
        f"{mode[0]},0,{mode},{at:g},{read:.6f},{label}"
        for mode in ("uniaxial", "equibiaxial")
        for at, read in zip(
            STRETCH,
            nominal_stress(NeoHookean(0.3), STRETCH, mode=mode) * STRETCH**power * ripple,
            strict=True,
        )
    ]
    (folder / "tensile.csv").write_text("\n".join([HEADER, *rows]) + "\n")
    (folder / "study.toml").write_text('[tensile]\nfit_modes = ["uniaxial", "equibiaxial"]\n')
    return assemble(read_study(folder)).model


def fitted(model):
    generator = np.random.default_rng(1)
    laplace = approximate(model, generator)
    return base_trial(model, laplace.mode, about_mode(model, laplace, generator, enough=500.0))


@pytest.fixture(scope="module", params=[0.0, 0.25, 1.0], ids="λ^{:g}".format)
def read(request, tmp_path_factory):
    """By how much stresses are off, the model as labelled and that of the other label."""
    folder, power = tmp_path_factory.mktemp("films"), request.param
    models = (films(folder / label, power=power, label=label) for label in ("nominal", "cauchy"))
    return power, *map(fitted, models)


def test_evidence_is_that_of_the_exchanged_label(read):
    power, base, exchanged = read
    found = try_causes(base, CAUSE, np.array([1.0]), np.random.default_rng(2)).log_evidence
    assert found == pytest.approx(exchanged.log_evidence, abs=0.3)
    assert (found - base.log_evidence > 3.0) is (power == 1.0)


@pytest.mark.parametrize("guess", [0.0, 0.4])
def test_its_size_is_one_and_nothing_between(read, guess):
    _, base, _ = read
    trial = try_causes(base, CAUSE, np.array([guess]), np.random.default_rng(2))
    size = effect_sizes(trial, CAUSE, np.random.default_rng(3))["confusion"]
    assert (size.mean, size.sd, size.q05, size.q95) == (1.0, 0.0, 1.0, 1.0)
