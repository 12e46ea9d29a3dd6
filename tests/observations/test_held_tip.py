"""Tip forces that finite elements answer beside curvatures: density, scatter, what they tell."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from bayesdeg.actuator.inputs import Further
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.outline import outline
from bayesdeg.assembly.reading import read_study
from bayesdeg.errors import BayesdegError
from bayesdeg.inference.model import replicate
from bayesdeg.observations.force import HeldTip, TipForce
from tests.inference.small_study import near_medians
from tests.observations.test_volume import swelling

RATES, PRESSURES = (0, 10, 20), (20.0, 40.0, 60.0, 80.0)


def pressing(inputs):
    """The actuator of curvatures p/C1, whose tip presses with C1 (p/C1 + (p/C1)²)."""
    found = swelling(replace(inputs, asked=""))
    if inputs.asked != "tip_force":
        return found
    load = found.curvature / 40.0
    force, slope = (inputs.c1 * f for f in (load + load**2, load + 2.0 * load**2))
    return replace(found, further=Further(force, slope, 0.01 * force))


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "held"
    path.mkdir()
    generator = np.random.default_rng(3)
    (path / "study.toml").write_text('title = "F"\nvirtual = true\n', encoding="utf-8")
    films = ["specimen_id,degradation_pct,stretch,stress_MPa"]
    curves = ["specimen_id,degradation_pct,pressure_kPa,curvature_per_m"]
    forces = ["specimen_id,degradation_pct,pressure_kPa,tip_force_N"]
    for rate, c1 in zip(RATES, (0.3, 0.6, 1.1), strict=True):
        for stretch in np.linspace(1.1, 1.8, 8):
            films.append(f"f{rate},{rate},{stretch:.3f},{2.0 * c1 * (stretch - stretch**-2):.5f}")
        for pressure in PRESSURES:
            load = 1e-3 * pressure / c1
            noise = 1.0 + 0.02 * generator.standard_normal(2)
            curves.append(f"a{rate},{rate},{pressure},{40.0 * load * noise[0]:.4f}")
            forces.append(f"t{rate},{rate},{pressure},{c1 * (load + load**2) * noise[1]:.5f}")
    for name, lines in (("tensile", films), ("actuator", curves), ("force", forces)):
        (path / f"{name}.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def model(folder):
    return assemble(read_study(folder), pressing).model


def of_model(model) -> HeldTip:
    (found,) = model.of_kind(HeldTip)
    return found


def test_finite_elements_answer_where_there_are_curvatures_and_a_beam_where_not(folder):
    assert outline(read_study(folder)).asked == ("tip_force",)
    (folder / "actuator.csv").unlink()
    alone = outline(read_study(folder))
    assert alone.asked == ()
    assert any(isinstance(one, TipForce) for one in alone.observations)


def test_the_density_is_that_of_a_normal_law_with_the_stated_covariance(model):
    kind, state = of_model(model), model.state(model.table.named(near_medians(model, 1)))
    mean, found = kind.expected(state)[0], kind.log_likelihood(state)[0]
    for row, covariance in enumerate(kind.covariance(state)):
        rows = kind.places.specimen == kind.labels[row]
        law = stats.multivariate_normal(mean[rows], covariance)
        assert found[row] == pytest.approx(law.logpdf(kind.observed[rows]), rel=1e-9)


def test_the_slope_is_that_by_the_logarithm_of_stiffness(model):
    kind, values = of_model(model), model.table.named(near_medians(model, 1))
    slope = kind.linearised(model.state(values)).slope[0, 0, :, 0]
    ends = []
    for step in (-1e-5, 1e-5):
        stiffer = {
            n: v * np.exp(step) if n.startswith(("c1", "c3")) else v for n, v in values.items()
        }
        ends.append(kind.expected(model.state(stiffer))[0, : len(PRESSURES)])
    np.testing.assert_allclose(slope, (ends[1] - ends[0]) / 2e-5, rtol=1e-4)


def test_a_leak_lowers_forces_where_a_stiffer_casting_does_not(model):
    """Of loads so small that forces are as pressure: p alone counts, whatever C1 is."""
    kind, values = of_model(model), model.table.named(near_medians(model, 1))
    slope = kind.linearised(model.state(values)).slope[0, :, 0, 0]
    force = kind.expected(model.state(values)).reshape(3, -1)[:, 0]
    assert np.all(np.abs(slope) < 0.15 * force)


def test_specimens_replicates_and_stored_readings(model):
    kind, state = of_model(model), model.state(model.table.named(near_medians(model, 2)))
    whole = kind.log_likelihood(state)
    np.testing.assert_allclose(
        kind.subset(np.array([2])).log_likelihood(state), whole[:, [2]], rtol=1e-10
    )
    (kept,) = kind.stored(state, state, np.random.default_rng(0))
    np.testing.assert_allclose(kept.log_likelihood.sum(axis=1), whole.sum(axis=1), rtol=1e-9)
    one = model.table.named(near_medians(model, 1))
    again = of_model(replicate(model, one, np.random.default_rng(2)))
    assert again.observed.shape == kind.observed.shape
    assert not np.array_equal(again.observed, kind.observed)
    assert "force" in [one.held for one in model.beside]


def test_an_emulator_without_forces_is_refused(folder):
    with pytest.raises(BayesdegError, match="tip force"):
        assemble(read_study(folder))
