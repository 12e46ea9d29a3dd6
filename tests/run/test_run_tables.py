from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm

from bayesdeg.analysis.calibrate import Fit
from bayesdeg.analysis.model_kind import ActuatorKind, bases
from bayesdeg.assembly.assemble import assemble
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.criticism.checks.residuals import CurvatureFit
from bayesdeg.criticism.posterior.convergence import diagnose
from bayesdeg.inference.laplace import Evidence, Laplace
from bayesdeg.inference.sampling import EFFORTS, Chain
from bayesdeg.observations.curvature import Curvature
from bayesdeg.pages.tables import TABLES
from bayesdeg.run import writing
from bayesdeg.run.run_record import comparisons
from tests.inference.small_study import TRUTH, values_of
from tests.run.study_files import FILES, SETTINGS, SUMMARY, study_in

DRAWN = 1200


def fit_of(model, *, width=1e-6, truth=TRUTH):
    """A fit whose posterior is known: independent normal laws about the truth."""
    generator = np.random.default_rng(1)
    size = len(model.table)
    values = values_of(truth)
    centre = model.table.vectors({name: values[name] for name in model.table.names})[0]
    vectors = centre + width * generator.standard_normal((2, DRAWN // 20, 10, size))
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.full(2, 0.4))
    laplace = Laplace(centre, np.eye(size), 0.0)
    evidence = Evidence(0.0, 0.0, vectors.reshape(-1, size), np.zeros(DRAWN), float(DRAWN))
    return Fit(model, laplace, evidence, chain, diagnose(model, chain, EFFORTS["quick"]))


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return study_in(tmp_path_factory.mktemp("study"))


@pytest.fixture(scope="module")
def model(study):
    return assemble(study).model


@pytest.fixture
def generator():
    return np.random.default_rng(2)


def columns_of(name):
    return set(TABLES[name].headings)


def test_observations_are_every_reading_beside_its_prediction(model):
    mean = model.data_of(Curvature).predicted(model.tests(values_of())).prediction.curvature[0]
    table = writing.observations(model, "base", CurvatureFit(mean, mean - 1.0, mean + 1.0))
    assert set(table.columns) >= columns_of("observations")
    assert len(table) == 9  # 3 specimens, 3 pressures above zero
    row = table[(table["specimen_id"] == "a1") & (table["pressure_kPa"] == 80.0)].iloc[0]
    assert row["degradation_pct"] == 10.0
    assert row["curvature_per_m"] == pytest.approx(6.4)
    assert row["residual_per_m"] == pytest.approx(6.4 - row["mean_per_m"])
    assert row["q95_per_m"] - row["q05_per_m"] == pytest.approx(2.0)


def test_stresses_are_shown_as_nominal_whatever_was_recorded(study, model, generator):
    table = writing.tensile(study, fit_of(model), "base", generator)
    assert set(table.columns) >= columns_of("tensile")
    f2 = table[table["specimen_id"] == "f2"].set_index("stretch")
    assert f2.loc[1.3, "stress_MPa"] == pytest.approx(2.60 / 1.3)
    # uniaxial Yeoh: P = 2 (λ − λ⁻²)(C1 + 2 C2 (I1 − 3) + 3 C3 (I1 − 3)²)
    stretch = 1.6
    excess = stretch**2 + 2.0 / stretch - 3.0
    c1, c3 = TRUTH["c1_at_0"], TRUTH["c3_at_0"]
    c2 = TRUTH["c2_ratio_at_0"] * np.sqrt(3.0 * c1 * c3)
    law = 2.0 * (stretch - stretch**-2) * (c1 + 2.0 * c2 * excess + 3.0 * c3 * excess**2)
    f1 = table[table["specimen_id"] == "f1"].set_index("stretch")
    assert f1.loc[stretch, "mean_MPa"] == pytest.approx(law, rel=1e-5)
    assert np.all(table["q05_MPa"] < table["mean_MPa"])
    assert np.all(table["mean_MPa"] < table["q95_MPa"])


def test_modes_that_are_not_fitted_are_predicted_and_marked(tmp_path, generator):
    films = FILES["tensile.csv"] + "f3,0,equibiaxial,1.2,0.5,nominal\n"
    settings = SETTINGS + '[tensile]\nfit_modes = ["uniaxial"]\n'
    study = study_in(tmp_path, {"tensile.csv": films, "study.toml": settings})
    table = writing.tensile(study, fit_of(assemble(study).model), "base", generator)
    assert dict(zip(table["specimen_id"], table["fitted"], strict=True)) == {
        "f1": 1,
        "f2": 1,
        "f3": 0,
    }


def test_constants_of_a_narrow_posterior_are_the_truth(model, generator):
    table = writing.constants(fit_of(model), "base", generator)
    assert set(table.columns) >= columns_of("constants")
    at_25 = table[table["degradation_pct"] == 25.0].set_index("constant")
    assert at_25.loc["c1", "q50"] == pytest.approx(TRUTH["c1_at_25"], rel=1e-4)
    assert at_25.loc["young_modulus", "q05"] == pytest.approx(6.0 * TRUTH["c1_at_25"], rel=1e-4)
    assert at_25.loc["c3", "q95"] == pytest.approx(TRUTH["c3_at_25"], rel=1e-4)


def test_young_modulus_has_the_share_of_a_named_second_invariant(study, model, generator):
    stiffer = model.extended(CATALOGUE["second_invariant"])
    fit = fit_of(stiffer, truth=TRUTH | {"second_invariant.ratio": 0.5})
    expected = 6.0 * (1.0 + 0.5 / (2.0 * np.sqrt(3.0))) * np.array([0.3, TRUTH["c1_at_25"]])
    table = writing.constants(fit, "final", generator).set_index(["constant", "degradation_pct"])
    found = [table.loc[("young_modulus", level), "q50"] for level in (0.0, 25.0)]
    assert found == pytest.approx(expected, rel=1e-4)
    (row,) = (r for r in comparisons(study, fit) if r.quantity == "young_modulus")
    assert row.predicted.startswith(f"{expected[0]:.3g} (")


def test_parameters_are_summarised_beside_their_priors(model):
    table = writing.parameters(fit_of(model, width=0.1), "base").set_index("parameter")
    assert {*table.columns, "parameter"} >= columns_of("parameters")
    assert list(table.index) == list(model.table.names)
    c1 = table.loc["c1_at_0"]
    z = norm.ppf(0.95)
    assert c1["q50"] == pytest.approx(0.3, rel=0.02)
    assert c1["q95"] == pytest.approx(0.3 * np.exp(0.1 * z), rel=0.03)
    assert c1["prior_q95"] == pytest.approx(0.3 * np.exp(0.4 * z), rel=1e-6)
    assert c1["unit"] == "MPa"


def test_elongation_limit_is_a_band_of_specimens_beside_the_measured(model, generator):
    table = writing.elongation(fit_of(model), generator)
    assert set(table.columns) >= columns_of("elongation")
    measured = table[table["kind"] == "measured"]
    assert measured["value"].tolist() == [208.0, 215.0, 55.0]
    band = table[table["kind"] == "band"].set_index("degradation_pct")
    assert band.loc[0.0, "q50"] == pytest.approx(210.0, rel=0.02)
    ratio = band.loc[0.0, "q95"] / band.loc[0.0, "q05"]
    assert np.log(ratio) == pytest.approx(2.0 * norm.ppf(0.95) * 0.1, rel=0.1)


def test_without_breaks_there_is_no_elongation_limit(tmp_path, generator):
    without = ("break.csv", "summary.csv")
    model = assemble(study_in(tmp_path, without=without)).model
    assert writing.elongation(fit_of(model), generator) is None


def test_what_was_measured_says_what_it_rests_on(study):
    table = writing.measured(study).set_index("quantity")
    assert table.loc["young_modulus", "value"] == 1.73
    assert table.loc["young_modulus", "sd"] == pytest.approx(0.15 / np.sqrt(3.0))
    assert table.loc["volume_ratio", "unit"] == "–"
    assert np.isnan(table.loc["volume_ratio", "degradation_pct"])
    assert set(table["rests_on"]) == {"the paper"}


def test_films_in_the_soil_give_degradation_rates(tmp_path):
    moisture = "film_id,time_h,mass_equilibrated_g,mass_dry_g\n" + "".join(
        f"m{i},{time},{10.0 + 0.01 * (i % 2)},{10.0 * (1.0 - content)}\n"
        for i, (time, content) in enumerate([(0, 0.2), (0, 0.2), (24, 0.1), (24, 0.1)])
    )
    table = writing.measured(study_in(tmp_path, {"moisture.csv": moisture}))
    rates = table.set_index("quantity")["value"]
    [late] = [name for name in rates.index if name.endswith("24 h")]
    assert rates[late] == pytest.approx(50.0, abs=1.0)


def test_published_values_stand_beside_those_of_the_posterior(study, model):
    rows = {row.quantity: row.document() for row in comparisons(study, fit_of(model))}
    assert set(rows) == {"young_modulus", "elongation_at_break", "volume_ratio", "r_squared"}
    assert rows["r_squared"]["predicted"] == "–"
    assert rows["young_modulus"]["predicted"] == "1.8 (1.8 to 1.8) MPa"
    assert rows["young_modulus"]["published"] == "1.73 ± 0.15 MPa"
    assert rows["elongation_at_break"]["predicted"].startswith("210 (")
    assert rows["volume_ratio"]["predicted"] == "0.62 (0.62 to 0.62)"
    assert rows["volume_ratio"]["degradation_pct"] is None
    assert rows["young_modulus"]["source"] == "the paper"


CONTROL = (
    "specimen_id,time_min,mass_dry_before_g,mass_dry_after_g,mass_equilibrated_before_g,"
    "mass_equilibrated_after_g\nb1,10,0.60,0.45,0.75,0.54\n"
)


def test_what_is_measured_has_both_ways_to_the_volume_ratio_and_the_control(tmp_path):
    folder = Path(__file__).resolve().parents[2] / "studies" / "gelatin_actuator"
    films = (folder / "shrinkage.csv").read_text(encoding="utf-8")
    texts = {"mass_loss.csv": CONTROL, "shrinkage.csv": films}
    study = study_in(tmp_path, texts, without=("summary.csv",))
    rows = writing.measured(study).set_index("quantity")
    both = rows.loc[["volume_ratio", "volume ratio by Eqs 15 and 16"]]
    assert both["n"].to_list()[1] == 4.0
    assert both["value"].diff().iloc[1] == pytest.approx(-0.008, abs=0.004)
    slopes = rows[rows["rests_on"].str.startswith("mass_loss.csv")]
    dry, wet = slopes["value"]
    assert dry == pytest.approx(25.0 / 20.0)
    assert wet == pytest.approx(25.0 / (100.0 * (1.0 - (0.09 / 0.54) / 0.2)))
    assert "0.8574" in slopes["rests_on"].iloc[0]


def published(study, use):
    found = bases(study, assemble(study).model)
    return {q for basis in found if basis.use == use for q in basis.quantities}


def shown_only(study):
    return published(study, "shown")


def test_what_is_said_to_be_shown_and_not_fitted_is_shown(tmp_path):
    counts = "ruptured_count,25,2,,3,–,the paper\nmass_loss_slope,,0.8574,,,–,the paper\n"
    study = study_in(tmp_path, {"summary.csv": SUMMARY + counts})
    model = assemble(study).model
    named = shown_only(study)
    assert named == {"mass_loss_slope", "r_squared"}
    assert published(study, "held against the model") == {"ruptured_count"}
    rows = {row.quantity: row.document() for row in comparisons(study, fit_of(model))}
    assert named < set(rows)
    assert (rows["ruptured_count"]["predicted"], rows["ruptured_count"]["published"]) == ("–", "2")
    assert rows["mass_loss_slope"]["published"] == "0.8574"


def test_a_published_mean_without_an_error_is_shown_and_not_fitted(tmp_path):
    study = study_in(tmp_path, {"summary.csv": SUMMARY.replace("209.8,6.3,3", "209.8,,3")})
    assert shown_only(study) == {"elongation_at_break", "r_squared"}
    assert published(study, "fitted") == {"volume_ratio", "young_modulus"}


def test_without_a_summary_nothing_is_compared(tmp_path):
    study = study_in(tmp_path, without=("summary.csv",))
    assert comparisons(study, fit_of(assemble(study).model)) == []


def test_statements_name_the_data_that_they_rest_on(study, tmp_path):
    found = list(bases(study, assemble(study).model))
    counts = {basis.file: basis.count for basis in found if basis.count}
    assert counts == {"tensile.csv": 2, "actuator.csv": 3, "break.csv": 3}
    assert {"r_squared"} == shown_only(study)
    assert not any(basis.virtual for basis in found)
    virtual = study_in(tmp_path, {"study.toml": SETTINGS + "virtual = true\n"})
    found = list(bases(virtual, assemble(virtual).model))
    assert [basis.virtual for basis in found] == [bool(basis.count) for basis in found]
    said = ActuatorKind().basis(virtual, assemble(virtual).model)
    rows = {row.statement: row.rests_on for row in said}
    assert len(rows) == len(found)
    for basis, (statement, data) in zip(found, rows.items(), strict=True):
        assert data.startswith(basis.file)
        assert all(quantity in statement for quantity in basis.quantities)
