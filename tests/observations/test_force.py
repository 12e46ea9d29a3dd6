"""Blocked tip force: its beam, its density, its file, and that nothing else need know of it."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.reading import read_study
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.data.settings import Dimensions
from bayesdeg.errors import StudyError
from bayesdeg.inference.model import replicate
from bayesdeg.observations.force import TIP_FORCE, TipForce, blocked_force
from bayesdeg.observations.noise import INDEPENDENT
from tests.inference.small_study import near_medians

PRESSURES = (20.0, 40.0, 60.0, 80.0, 100.0)
HEADER = "specimen_id,degradation_pct,pressure_kPa,tip_force_N\n"


def inputs(**changed):
    one = np.ones(1)
    plain = {"c1": 0.3, "c2": 0.0, "c3": 0.0, "linear_scale": 0.85, "paper_stiffness": 3e4}
    return Inputs(**{n: v * one for n, v in ({"pressure": 100.0} | plain | changed).items()})


def force(**changed):
    return blocked_force(inputs(**changed), Dimensions())[0][0]


def by_strips(*, pressure, modulus, stiffness, scale, strips=20_000):
    """The force that holds the tip of a beam of thin strips, by solving for strain and curvature.

    Curvature along the beam is that of the moment left, (M − F (L − x)); the tip stays where it is
    if the integral of curvature times distance to the tip is zero.
    """
    d, mm = Dimensions(), scale
    height, width, length = d.height * mm, d.width * mm, d.length * mm
    z = (np.arange(strips) + 0.5) * height / strips
    hollow = (z > d.floor * mm) & (z < height - d.roof * mm)
    opening = np.where(hollow, (d.width - 2.0 * d.side_wall) * mm, 0.0)
    area, gap = (width - opening) * height / strips, opening * height / strips
    paper = stiffness * 1e-3 * width
    matrix = np.zeros((2, 2))
    for power, place in ((0, (0, 0)), (1, (0, 1)), (1, (1, 0)), (2, (1, 1))):
        matrix[place] = np.sum(modulus * area * z**power)
    matrix[0, 0] += paper
    load = pressure * 1e-3 * np.array([np.sum(gap), np.sum(gap * z)])
    free = np.linalg.solve(matrix, load)[1]
    by_moment = np.linalg.solve(matrix, [0.0, 1.0])[1]
    x = (np.arange(2000) + 0.5) * length / 2000
    return np.sum(free * (length - x)) / np.sum(by_moment * (length - x) ** 2)


@pytest.mark.parametrize("c1", [0.3, 1.5])
def test_the_force_holds_the_tip_of_a_beam_of_strips(c1):
    expected = by_strips(pressure=100.0, modulus=6.0 * c1, stiffness=3e4, scale=0.85)
    assert force(c1=c1) == pytest.approx(expected, rel=1e-5)


def test_the_neutral_axis_lies_in_a_stiff_paper_and_in_the_middle_without_one():
    d = Dimensions()
    opening = (d.width - 2 * d.side_wall) * (d.height - d.floor - d.roof)
    centre = d.floor + 0.5 * (d.height - d.floor - d.roof)
    stiff = 1.5 * 0.1 * opening * centre * 0.85**2 / d.length
    assert force(paper_stiffness=1e9) == pytest.approx(stiff, rel=1e-3)
    assert abs(force(paper_stiffness=1e-3)) < 1e-6  # floor and roof are alike


def test_the_derivative_is_that_by_the_logarithm_of_stiffness():
    _, slope = blocked_force(inputs(), Dimensions())
    ends = [force(c1=0.3 * np.exp(step)) for step in (-1e-5, 1e-5)]
    assert slope[0] == pytest.approx((ends[1] - ends[0]) / 2e-5, rel=1e-6)


def test_thicker_walls_and_a_pressure_at_zero_reading_lower_the_force():
    assert force(wall_factor=1.2) < force()
    assert force(reference_pressure=20.0) == pytest.approx(0.8 * force())


@pytest.fixture
def folder(tmp_path):
    """A study with films and tip forces of a beam, two actuators at each of three rates."""
    path = tmp_path / "forces"
    path.mkdir()
    generator = np.random.default_rng(3)
    (path / "study.toml").write_text(
        'title = "Forces"\nvirtual = true\n[sampling]\neffort="quick"\n'
    )
    films, rows = ["specimen_id,degradation_pct,stretch,stress_MPa"], [HEADER.strip()]
    for rate, c1 in ((0, 0.3), (10, 0.6), (20, 1.1)):
        for stretch in np.linspace(1.1, 1.8, 8):
            stress = 2.0 * c1 * (stretch - stretch**-2) * (1.0 + 0.01 * generator.normal())
            films.append(f"f{rate},{rate},{stretch:.3f},{stress:.5f}")
        for copy in "ab":
            for pressure in PRESSURES:
                read = force(pressure=pressure - 8.0, c1=c1) + 0.004 * generator.normal()
                rows.append(f"t{rate}{copy},{rate},{pressure},{read:.5f}")
    (path / "tensile.csv").write_text("\n".join(films) + "\n")
    (path / "force.csv").write_text("\n".join(rows) + "\n")
    return path


@pytest.fixture
def model(folder):
    return assemble(read_study(folder)).model


def of_model(model) -> TipForce:
    (found,) = model.of_kind(TipForce)
    return found


def test_a_study_folder_is_read_with_all_its_tests(folder):
    study = read_study(folder)
    table = pd.read_csv(folder / "force.csv")
    kind = of_model(assemble(study).model)
    assert study.table("force")["tip_force_N"].tolist() == table["tip_force_N"].tolist()
    np.testing.assert_array_equal(kind.observed, table["tip_force_N"])
    np.testing.assert_array_equal(kind.places.along, table["pressure_kPa"])
    np.testing.assert_array_equal(kind.places.specimen, table["specimen_id"])
    assert repr(study).endswith("force.csv 30 rows")


def test_the_density_is_that_of_a_normal_law_with_the_stated_covariance(model):
    kind, values = of_model(model), model.table.named(near_medians(model, 1))
    state = model.state(values)
    mean, found = kind.expected(state)[0], kind.log_likelihood(state)[0]
    spread = values["stiffness_scatter"][0] ** 2
    slope = values["force_gain"][0] * blocked_force(_met(model, values), Dimensions())[1][0]
    for row, name in enumerate(kind.labels):
        rows = kind.places.specimen == name
        size = int(rows.sum())
        tau = model.world.material(values, kind.levels).sensitivity[0, row] ** 2 + spread
        sd = np.hypot(values["force_noise_floor"][0], values["force_noise"][0] * mean[rows])
        covariance = np.zeros((size, size))
        for i in range(size):
            for j in range(size):
                apart = abs(PRESSURES[i] - PRESSURES[j]) / values["force_noise_length"][0]
                alike = 1.0 if i == j else (1.0 - INDEPENDENT) * np.exp(-apart)
                covariance[i, j] = sd[i] * sd[j] * alike + tau * slope[row, i] * slope[row, j]
        law = stats.multivariate_normal(mean[rows], covariance)
        assert found[row] == pytest.approx(law.logpdf(kind.observed[rows]), rel=1e-9)
        np.testing.assert_allclose(kind.covariance(state)[row], covariance, rtol=1e-9)


def _met(model, values):
    kind = of_model(model)
    c1, c2, c3 = np.moveaxis(model.world.constants(values, kind.levels), -1, 0)[..., None]
    scale = np.cbrt(values["volume_ratio"])[:, None, None]
    paper = values["paper_stiffness"][:, None, None]
    return Inputs(kind.tests.conditions.pressure, c1, c2, c3, scale, paper)


def test_factors_some_rows_and_stored_densities_agree_with_the_whole(model):
    kind, state = of_model(model), model.state(model.table.named(near_medians(model, 3)))
    whole = kind.log_likelihood(state)
    ((z, log_sd),) = kind.factors(state).normal
    total = np.sum(-0.5 * z**2 - log_sd - 0.5 * np.log(2.0 * np.pi), axis=1)
    np.testing.assert_allclose(total, whole.sum(axis=1), rtol=1e-10)
    np.testing.assert_allclose(
        kind.subset(np.array([1, 4])).log_likelihood(state), whole[:, [1, 4]], rtol=1e-10
    )
    (kept,) = kind.stored(state, state, np.random.default_rng(0))
    np.testing.assert_allclose(kept.log_likelihood.sum(axis=1), whole.sum(axis=1), rtol=1e-9)


def test_simulated_forces_have_the_mean_and_covariance_of_the_law(model):
    kind = of_model(model)
    one = model.table.named(near_medians(model, 1))
    state = model.state({name: np.repeat(value, 20_000) for name, value in one.items()})
    drawn = kind.simulate(state, np.random.default_rng(1))
    rows = kind.places.specimen == kind.labels[0]
    law = kind.covariance(model.state(one))[0]
    error = np.sqrt(np.diag(law) / len(drawn))
    assert np.all(np.abs(drawn.mean(axis=0) - kind.expected(state)[0])[rows] < 5.0 * error)
    np.testing.assert_allclose(np.cov(drawn[:, rows].T), law, atol=0.05 * law.max())
    again = replicate(model, one, np.random.default_rng(2))
    assert of_model(again).observed.shape == kind.observed.shape
    assert not np.array_equal(of_model(again).observed, kind.observed)


def test_specimens_of_forces_are_held_out(model):
    assert model.groups == ("t0a", "t0b", "t10a", "t10b", "t20a", "t20b")
    vectors = near_medians(model, 2)
    left = model.without(np.array([0]))
    assert len(left.places) == len(model.places) - len(PRESSURES)
    np.testing.assert_allclose(
        left.log_prob(vectors), model.log_prob(vectors) - model.group_density(vectors)[:, 0]
    )


def test_causes_that_forces_show_can_be_judged_without_curvatures(folder):
    found = assemble(read_study(folder))
    shown = {cause.name for cause in found.candidates}
    assert {"pressure_offset", "pressure_loss", "wall_thickness", "degradation_misread"} <= shown
    assert {"paper_slack", "gravity", "creep", "initial_curvature"} <= set(found.unjudged)
    kind = of_model(found.model)
    assert kind.reveals(CATALOGUE["pressure_offset"])
    assert not kind.reveals(CATALOGUE["curvature_reading"])
    assert kind.scales[TIP_FORCE].unit == "N"


@pytest.mark.parametrize(
    ("rows", "column", "row"),
    [
        ("a,0,20,0.1\na,0,40,much\n", "tip_force_N", 3),
        ("a,0,20,0.1\na,0,10,0.2\n", "pressure_kPa", 3),
        ("a,0,20,0.1\na,5,40,0.2\n", "degradation_pct", 3),
        ("a,0,20,\n", "tip_force_N", 2),
    ],
)
def test_bad_rows_are_refused_with_their_place(folder, rows, column, row):
    (folder / "force.csv").write_text(HEADER + rows)
    with pytest.raises(StudyError) as caught:
        read_study(folder)
    assert [(f.file, f.row, f.column) for f in caught.value.faults] == [("force.csv", row, column)]


def test_a_force_in_another_unit_is_refused(folder):
    (folder / "force.csv").write_text(HEADER.replace("_N", "_mN") + "a,0,20,100\n")
    with pytest.raises(StudyError, match="tip_force_N"):
        read_study(folder)
