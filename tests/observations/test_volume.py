"""Volume of the cavity: its file, its density beside curvatures, and what it tells."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.actuator.inputs import Further, Inputs, Prediction
from bayesdeg.actuator.status import Resolution
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.outline import outline, unlinked
from bayesdeg.assembly.reading import read_study
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.data.plausibility import doubts
from bayesdeg.errors import BayesdegError, StudyError
from bayesdeg.inference.model import replicate
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.rupture import Rupture, data_of_actuators
from bayesdeg.observations.volume import VOLUME, CavityVolume
from tests.inference.small_study import near_medians

FILMS = 0  # columns of deviations of films, which have none here
PRESSURES = (20.0, 40.0, 60.0, 80.0, 100.0)
HEADER = "specimen_id,degradation_pct,pressure_kPa,curvature_per_m,bend_angle_deg,cavity_volume_ml"


def swelling(inputs: Inputs) -> Prediction:
    """An actuator whose curvature and volume are p/C1, with an error of the map in each."""
    shape = np.broadcast_shapes(*(np.shape(x) for x in (inputs.pressure, inputs.c1)))
    load = np.broadcast_to(1e-3 * inputs.pressure / inputs.c1, shape)
    if inputs.reference_pressure is not None:
        load = load - 1e-3 * inputs.reference_pressure / inputs.c1
    curvature, volume = 40.0 * load, 0.9 * load * inputs.linear_scale**3
    asked = inputs.asked == "cavity_volume"
    return Prediction(
        curvature=curvature,
        bend_angle=2.4 * curvature,
        peak_stretch=1.0 + load,
        slope=curvature,
        sd=0.004 * curvature,
        bend_angle_sd=0.01 * curvature,
        peak_stretch_sd=0.01 * load,
        status=np.zeros(shape, dtype=np.int64),
        further=Further(volume, volume, 0.01 * volume) if asked else None,
    )


def rows(generator, *, gaps=True):
    """Two actuators at each of three rates; one volume was not read, one specimen has none."""
    lines = [HEADER]
    for rate, c1 in ((0, 0.3), (10, 0.6), (20, 1.1)):
        for copy in "ab":
            for pressure in PRESSURES:
                load = 1e-3 * pressure / c1
                k, v = 40.0 * load, 0.9 * 0.62 * load
                noise = 1.0 + 0.02 * generator.standard_normal(3)
                volume = f"{v * noise[2]:.5f}"
                if gaps and (
                    (rate, copy, pressure) == (10, "a", 60.0) or (rate, copy) == (20, "b")
                ):
                    volume = ""
                cells = (f"{k * noise[0]:.4f}", f"{2.4 * k * noise[1]:.3f}", volume)
                lines.append(f"t{rate}{copy},{rate},{pressure},{','.join(cells)}")
    return lines


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "volumes"
    path.mkdir()
    generator = np.random.default_rng(3)
    (path / "study.toml").write_text('title = "V"\nvirtual = true\n[sampling]\neffort="quick"\n')
    films = ["specimen_id,degradation_pct,stretch,stress_MPa"]
    for rate, c1 in ((0, 0.3), (10, 0.6), (20, 1.1)):
        for stretch in np.linspace(1.1, 1.8, 8):
            films.append(f"f{rate},{rate},{stretch:.3f},{2.0 * c1 * (stretch - stretch**-2):.5f}")
    (path / "tensile.csv").write_text("\n".join(films) + "\n")
    breaks = [f"f{rate},{rate},{90 - 2 * rate}" for rate in (0, 10, 20)]
    (path / "break.csv").write_text(
        "specimen_id,degradation_pct,elongation_pct\n" + "\n".join(breaks) + "\n"
    )
    (path / "actuator.csv").write_text("\n".join(rows(generator)) + "\n")
    return path


@pytest.fixture
def model(folder):
    return assemble(read_study(folder), swelling).model


def kinds(model):
    (volume,), (curvature,) = model.of_kind(CavityVolume), model.of_kind(Curvature)
    return volume, curvature


def test_volumes_are_read_where_there_are_some(folder, model):
    table = pd.read_csv(folder / "actuator.csv")
    volume, curvature = kinds(model)
    known = table["cavity_volume_ml"].notna()
    np.testing.assert_allclose(volume.observed, table.loc[known, "cavity_volume_ml"])
    np.testing.assert_array_equal(volume.places.along, table.loc[known, "pressure_kPa"])
    assert volume.curves is curvature.tests
    assert volume.scales[VOLUME].unit == "ml"
    assert outline(read_study(folder)).asked == ("cavity_volume",)
    assert {"volume_noise", "volume_noise_floor"} <= set(model.table.names)
    assert "emulator_error_volume" not in model.table.names  # an exact map has none


def test_both_densities_are_that_of_all_readings_of_a_specimen(model):
    """Against one normal law whose covariance is built from the slopes by hand."""
    volume, curvature = kinds(model)
    vector = near_medians(model, 1, reading_correlation=0.3)
    state = model.state(model.table.named(vector))
    total = curvature.log_likelihood(state)[0] + volume.log_likelihood(state)[0]
    mean, scatter = model.expected(vector)[0], model.scatter(vector[0])
    observed, specimen = model.observed, model.places.specimen
    for row, name in enumerate(curvature.labels):
        own = specimen == name
        law = stats.multivariate_normal(mean[own], scatter[np.ix_(own, own)])
        # both are linearised at the deviation that the readings tell of, this one at none
        assert total[row] == pytest.approx(law.logpdf(observed[own]), abs=0.15)
    alone = volume.linearised(state)
    assert np.all(volume.conditioned(state).spread <= alone.spread + 1e-15)
    assert volume.conditioned(state).spread[0, 0, 0] < 0.5 * alone.spread[0, 0, 0]


def test_scatter_has_the_deviations_that_volumes_and_curvatures_share(model):
    vector = near_medians(model, 1, reading_correlation=0.3)[0]
    scatter, own = model.scatter(vector), model.deviations(vector)
    assert own.slope.shape == (len(model.places), 6 + FILMS)
    is_volume = model.places.kind == VOLUME
    is_curved = (model.places.kind == "curvature") & (model.places.specimen == "t0a")
    shared = own.slope * own.spread @ own.slope.T
    one = np.ix_(is_curved, is_volume & (model.places.specimen == "t0a"))
    assert np.all(scatter[one] > 0.0)
    np.testing.assert_allclose(scatter[one], shared[one], rtol=0.05)
    assert np.all(np.linalg.eigvalsh(scatter) > 0.0)


def test_simulated_readings_have_mean_and_covariance_of_the_law(model):
    one = model.table.named(near_medians(model, 1, reading_correlation=0.3))
    state_of = {name: np.repeat(value, 20_000) for name, value in one.items()}
    drawn = model.simulated(model.table.vectors(state_of), np.random.default_rng(1))
    vector = model.table.vectors({name: value[0] for name, value in one.items()})
    rows = (model.places.specimen == "t0a") & (model.places.family != "film")
    law = model.scatter(vector)[np.ix_(rows, rows)]
    sd = np.sqrt(np.diag(law))
    found = np.cov(drawn[:, rows].T) / np.outer(sd, sd)
    np.testing.assert_allclose(found, law / np.outer(sd, sd), atol=0.06)


def test_specimens_are_held_out_with_their_volumes(model):
    assert model.groups == ("t0a", "t0b", "t10a", "t10b", "t20a", "t20b")
    left, vectors = model.without(np.array([0])), near_medians(model, 2, reading_correlation=0.3)
    assert len(left.places) == len(model.places) - 3 * len(PRESSURES)
    volume, curvature = kinds(left)
    assert volume.curves is curvature.tests
    np.testing.assert_allclose(
        left.log_prob(vectors), model.log_prob(vectors) - model.group_density(vectors)[:, 0]
    )


def test_factors_and_stored_densities_agree_with_the_whole(model):
    volume, _ = kinds(model)
    state = model.state(model.table.named(near_medians(model, 3, reading_correlation=0.3)))
    whole = volume.log_likelihood(state)
    ((z, log_sd),) = volume.factors(state).normal
    total = np.sum(-0.5 * z**2 - log_sd - 0.5 * np.log(2.0 * np.pi), axis=1)
    np.testing.assert_allclose(total, whole.sum(axis=1), rtol=1e-10)
    (kept,) = volume.stored(state, state, np.random.default_rng(0))
    np.testing.assert_allclose(kept.log_likelihood.sum(axis=1), whole.sum(axis=1), rtol=1e-9)
    assert kept.output == "cavity_volume"


def test_replicates_end_where_an_actuator_bursts(model):
    assert model.of_kind(Rupture)
    one = model.table.named(near_medians(model, 1, reading_correlation=0.3))
    weak = one | {n: 0.02 * v for n, v in one.items() if n.startswith("elongation_at")}
    again = replicate(model, weak, np.random.default_rng(2))
    volume, curvature = kinds(again)
    assert curvature.tests.ruptured.any()
    assert volume.tests.mask.sum() < kinds(model)[0].tests.mask.sum()
    assert np.all(volume.tests.mask <= curvature.tests.mask)
    assert volume.curves is curvature.tests


def test_other_tests_of_actuators_leave_the_volumes_out(model):
    _, curvature = kinds(model)
    some = model.with_observations(
        *data_of_actuators(curvature.tests.subset(np.array([0, 1])), model.base)
    )
    assert not some.of_kind(CavityVolume)


def test_volumes_of_other_tests_that_are_left_out_are_said(model):
    volume, curvature = kinds(model)
    assert unlinked((volume, curvature)) == ()
    of_others = CavityVolume(volume.tests.subset(np.arange(2)))
    ((what, cost),) = unlinked((of_others, curvature))
    assert str(len(of_others.observed)) in what
    assert volume.name in what
    assert cost


def test_the_shipped_emulator_predicts_volumes(folder):
    model = assemble(read_study(folder)).model
    values = near_medians(model, 1, reading_correlation=0.3)
    assert np.all(
        np.isfinite(kinds(model)[0].log_likelihood(model.state(model.table.named(values))))
    )


def test_a_map_without_volumes_says_so(folder):
    def bare(inputs):
        return replace(swelling(inputs), further=None)

    model = assemble(read_study(folder), bare).model
    with pytest.raises(BayesdegError, match="cavity volumes"):
        kinds(model)[0].log_likelihood(
            model.state(model.table.named(near_medians(model, 1, reading_correlation=0.3)))
        )


def doubted(folder, change):
    table = pd.read_csv(folder / "actuator.csv")
    change(table)
    table.to_csv(folder / "actuator.csv", index=False)
    study = read_study(folder)
    found = doubts(study, outline(study).expected)
    return [one for one in found if one.fault.column == "cavity_volume_ml"]


@pytest.mark.parametrize(
    ("factor", "said"), [(1e3, "mm³ or µl"), (1e-3, "likely in l"), (-1.0, "negative")]
)
def test_units_and_signs_of_volumes_are_doubted(folder, factor, said):
    def change(table):
        table["cavity_volume_ml"] *= factor

    found = doubted(folder, change)
    assert len(found) == 1
    assert found[0].impossible
    assert said in str(found[0])


def test_a_volume_that_is_not_counted_from_rest_is_doubted(folder):
    table = pd.read_csv(folder / "actuator.csv")
    first = table.drop_duplicates("specimen_id").assign(
        pressure_kPa=0.0, curvature_per_m=0.0, bend_angle_deg=0.0, cavity_volume_ml=0.9
    )
    table["cavity_volume_ml"] += 0.9
    whole = pd.concat([first, table]).sort_values(["specimen_id", "pressure_kPa"])
    whole.to_csv(folder / "actuator.csv", index=False)
    found = doubted(folder, lambda table: None)
    assert found
    assert all("zero pressure" in str(one) for one in found)


def test_volumes_that_can_be_are_not_doubted(folder):
    assert doubted(folder, lambda table: None) == []


def test_one_specimen_in_another_unit_stands_out(folder):
    def change(table):
        table.loc[table["specimen_id"] == "t0a", "cavity_volume_ml"] *= 1e3

    found = doubted(folder, change)
    assert [one.fault.specimen for one in found] == ["t0a"]


def test_a_word_in_the_column_is_refused(folder):
    text = (folder / "actuator.csv").read_text().splitlines()
    text[3] = text[3].rsplit(",", 1)[0] + ",much"
    (folder / "actuator.csv").write_text("\n".join(text) + "\n")
    with pytest.raises(StudyError, match="cavity_volume_ml"):
        read_study(folder)


@pytest.fixture
def small(folder):
    """The same with a small actuator that finite elements answer, read fresh only."""
    (folder / "study.toml").write_text(
        'title = "V"\nvirtual = true\n[actuator]\nlength = 20.0\nchambers = 2\n'
    )
    table = pd.read_csv(folder / "actuator.csv")
    table = table[table["degradation_pct"] == 0].assign(bend_angle_deg=np.nan)
    table["pressure_kPa"] *= 2.0
    table.to_csv(folder / "actuator.csv", index=False)
    (folder / "break.csv").unlink()
    study = read_study(folder)
    return assemble(study, ExactMap(geometry_of_study(study.settings), Resolution(9.0, 9.0, 9.0)))


def log_odds_against(assembly, hidden, rival):
    """ln odds for a hidden cause of its usual size against a rival of its best size, expected.

    By readings of curvature alone, and of curvature and volume.
    """
    found = {}
    for model in (assembly.model.without_kinds("volume"), assembly.model):
        centre = {p.name: p.law.quantile(0.5) for p in model.table.parameters}
        true = model.extended(CATALOGUE[hidden])
        other = model.extended(CATALOGUE[rival])
        named = CATALOGUE[hidden].qualified
        sizes = {named(name): size for name, size in CATALOGUE[hidden].typical.items()}
        (name,) = CATALOGUE[rival].typical
        key = CATALOGUE[rival].qualified(name)
        rows = model.places.family != "film"
        truth = true.expected(true.table.vectors(centre | sizes)[None])[0]
        grid = np.array([0.02, 0.12, 0.22])
        values = [other.table.vectors(centre | {key: size})[None] for size in grid]
        means = np.array([other.expected(one)[0] for one in values])
        precision = np.linalg.inv(model.scatter(model.table.vectors(centre))[np.ix_(rows, rows)])
        gaps = (truth - means)[:, rows]
        misfit = np.polyfit(grid, np.einsum("ki,ij,kj->k", gaps, precision, gaps), 2)
        found[len(model.places)] = 0.5 * np.polyval(misfit, -misfit[1] / (2.0 * misfit[0]))
    return list(found.values())


@pytest.mark.long
def test_volumes_tell_thicker_walls_from_stiffer_ones_and_not_a_gauge(small):
    """A gauge off by a factor acts as other material does, on every length: nothing is gained.

    Curvatures alone hardly tell thick walls from a stiff material; volumes do.
    """
    alone, both = log_odds_against(small, "wall_thickness", "film_mismatch")
    assert alone < 0.5
    assert both > 1.5
    alone, both = log_odds_against(small, "gauge_gain", "film_mismatch")
    assert alone < 0.05
    assert both < 0.05
