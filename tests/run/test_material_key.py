"""``[material]`` and ``[vendor]``: what they make of a study, from its folder to its model."""

import numpy as np
import pytest

from bayesdeg.analysis.calibrate import base_without_chain
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.outline import outline, unused
from bayesdeg.assembly.reading import read_study
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.data.study import Why
from bayesdeg.errors import StudyError
from bayesdeg.material.hyperelastic import Yeoh, nominal_stress
from bayesdeg.observations.means import Means
from bayesdeg.observations.specimens import LEAST_STIFFENING, modulus_100
from bayesdeg.prediction.stored import model_document, stored_model
from bayesdeg.priors import LogNormal
from bayesdeg.run.run_record import vendor_check
from bayesdeg.surrogate.scaling import GROUPS
from tests.inference.small_study import TRUTH
from tests.run.fresh_study import SETTINGS, fresh_study
from tests.run.planted_offset import emulator
from tests.run.study_files import study_in

FILMS_ALONE = ("actuator.csv", "break.csv", "summary.csv")


def with_keys(folder, keys, *, without=()):
    """The study of which nothing degrades, with further keys."""
    fresh_study(folder, {"study.toml": SETTINGS + keys})
    for name in without:
        (folder / name).unlink()
    return read_study(folder)


def names_of(study):
    return {parameter.name for parameter in outline(study).base}


def calibrated(study, count=400):
    """Return the base model of a study and draws of its posterior."""
    model = assemble(study, emulator()).model
    base = base_without_chain(model, np.random.SeedSequence(1))
    return model, base.posterior.resample(np.random.default_rng(1), count)


# ---- the law


def test_a_neo_hookean_study_has_c1_alone(tmp_path):
    study = with_keys(tmp_path, '[material]\nlaw = "neo_hookean"\n')
    assert {n for n in names_of(study) if n.startswith(("c1", "c2", "c3"))} == {"c1_at_0"}


def test_films_alone_are_exactly_neo_hookean_and_as_likely_as_yeohs_limit(tmp_path):
    key = '[material]\nlaw = "neo_hookean"\n'
    first, second = tmp_path / "a", tmp_path / "b"
    for folder in (first, second):
        folder.mkdir()
    whole = ("actuator.csv", "break.csv")
    neo = assemble(with_keys(first, key, without=whole)).model
    yeoh = assemble(with_keys(second, "", without=whole)).model
    values = {name: np.array([TRUTH[name]]) for name in neo.table.names}
    constants = neo.world.constants(values, np.array([0.0, 10.0]))
    assert constants.tolist() == [[[TRUTH["c1_at_0"], 0.0, 0.0]] * 2]
    limit = values | {"c2_ratio_at_0": np.zeros(1), "c3_at_0": np.full(1, 1e-12)}
    found = [
        one.of_kind(type(one.observations[0]))[0].log_likelihood(one.tests(v))
        for one, v in ((neo, values), (yeoh, limit))
    ]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6)


def test_films_of_a_degrading_study_are_neo_hookean_at_every_rate(tmp_path):
    text = {"study.toml": 'seed = 7\n[material]\nlaw = "neo_hookean"\norder = 1\n'}
    study = study_in(tmp_path, text, without=FILMS_ALONE)
    model = assemble(study).model
    values = model.table.named(model.table.sample(np.random.default_rng(0), 5))
    constants = model.world.constants(values, np.array([0.0, 12.5, 25.0, 30.0]))
    assert (constants[..., 1:] == 0.0).all()
    assert model.world.allows(values, np.array([0.0, 30.0])).any()


def test_an_actuator_of_a_neo_hookean_solid_stiffens_as_little_as_emulators_know(tmp_path):
    study = with_keys(tmp_path, '[material]\nlaw = "neo_hookean"\n')
    model = assemble(study, emulator()).model
    values = model.table.named(model.table.sample(np.random.default_rng(0), 4))
    c1, c2, c3 = np.moveaxis(model.world.constants(values, np.array([0.0])), -1, 0)
    np.testing.assert_allclose(c3, LEAST_STIFFENING * c1)
    assert (c2 == 0.0).all()
    # with the largest second invariant of the prior, r = C1, M is C1 (1 + 1/(2√3))
    stiffening = next(group for group in GROUPS if group.name == "log_stiffening")
    assert np.log(LEAST_STIFFENING / (1.0 + 0.5 / np.sqrt(3.0))) > stiffening.low
    exact, nearly = (
        nominal_stress(Yeoh(1.0, 0.0, share), 2.0, mode="uniaxial")
        for share in (0.0, LEAST_STIFFENING)
    )
    assert float(nearly / exact) == pytest.approx(1.008, abs=2e-4)


def test_a_stored_neo_hookean_run_is_rebuilt_with_its_constants(tmp_path):
    study = with_keys(tmp_path, '[material]\nlaw = "neo_hookean"\n')
    model = assemble(study, emulator()).model
    entry = model_document(model, study)
    assert (entry.material_law, entry.stiffening) == ("neo_hookean", LEAST_STIFFENING)
    values = model.table.named(model.table.sample(np.random.default_rng(0), 4))
    again = stored_model(entry, {name: v[None] for name, v in values.items()}, emulator())
    level = np.array([0.0])
    np.testing.assert_allclose(
        again.world.constants(values, level),
        model.world.constants(values, level),
        rtol=0.0,
    )


def test_runs_of_yeohs_law_say_nothing_of_it(tmp_path):
    written = model_document(assemble(fresh_study(tmp_path), emulator()).model).model_dump()
    assert "material_law" not in written
    assert "stiffening" not in written


def test_films_suggest_a_start_for_c1_alone(tmp_path):
    study = with_keys(
        tmp_path, '[material]\nlaw = "neo_hookean"\n', without=("actuator.csv", "break.csv")
    )
    model = assemble(study).model
    (films,) = model.observations
    start = films.start(model.world)
    assert set(start) == {"c1_at_0"}
    assert 0.5 * TRUTH["c1_at_0"] < start["c1_at_0"] < 2.0 * TRUTH["c1_at_0"]


# ---- the range of stretch


def test_readings_outside_the_range_are_left_out_and_counted(tmp_path):
    keys = "[material]\nstretch_range = [1.2, 1.6]\n"
    text = {"study.toml": keys}
    study = study_in(tmp_path, text)
    assert study.tensile["stretch"].tolist() == [1.2, 1.6, 1.3]
    (one,) = (one for one in study.unused if one.why is Why.OUTSIDE_RANGE)
    assert (one.file, one.rows) == ("tensile.csv", 1)
    (said,) = (line for line in unused(study) if "tensile.csv" in line)
    assert [words for words in ("1 row ", "stretch_range") if words not in said] == []


def test_without_the_key_nothing_is_left_out(tmp_path):
    study = study_in(tmp_path)
    assert {one.file for one in study.unused} == {"actuator.csv"}


@pytest.mark.parametrize(
    ("without", "ends", "says"),
    [((), "[3, 4]", "1.1 to 1.6"), (("tensile.csv",), "[1, 2]", "tensile.csv")],
)
def test_a_range_that_leaves_nothing_is_refused(tmp_path, without, ends, says):
    with pytest.raises(StudyError) as caught:
        study_in(tmp_path, {"study.toml": f"[material]\nstretch_range = {ends}\n"}, without=without)
    (fault,) = caught.value.faults
    assert fault.column == "material.stretch_range"
    assert says in str(fault)


# ---- a vendor's figures


def test_the_modulus_at_100_pct_is_the_nominal_stress_at_a_stretch_of_2():
    constants = np.array([[[0.3, -0.02, 0.004], [0.5, 0.01, 0.001]]])
    expected = [
        float(nominal_stress(Yeoh(*one), 2.0, mode="uniaxial")) for one in constants[0].tolist()
    ]
    np.testing.assert_allclose(modulus_100({}, constants)[0], expected)


def test_a_second_invariant_changes_it_and_a_misread_measure_does_not():
    constants = np.array([[[0.3, -0.02, 0.004]]])
    plain = modulus_100({}, constants)
    values = {"second_invariant.ratio": np.array([0.5]), "stress_measure.share": np.array([1.0])}
    found = modulus_100(values, constants, (CATALOGUE["second_invariant"],))
    # r (1 − λ⁻³)/√I₂ with r = 0.15, I₂ = 4.25
    assert float((found - plain)[0, 0]) == pytest.approx(0.15 * (1.0 - 0.125) / np.sqrt(4.25))
    assert modulus_100(values, constants, (CATALOGUE["stress_measure"],)) == plain


def test_a_vendors_modulus_is_a_datum_of_the_fresh_material(tmp_path):
    keys = "[vendor]\nmodulus_100 = { value = 900, sd = 90 }\nsource = 'data sheet'\n"
    study = with_keys(tmp_path, keys)
    (means,) = (one for one in outline(study).observations if isinstance(one, Means))
    (one,) = means.statistics
    assert (one.quantity, one.degradation, one.dof) == ("modulus_100", 0.0, np.inf)
    assert (one.value, one.se) == pytest.approx((0.9, 0.09))
    model = assemble(study, emulator()).model
    values = model.table.named(model.table.sample(np.random.default_rng(0), 3))
    expected = modulus_100(values, model.world.constants(values, np.array([0.0])))[:, 0]
    log_density = means.log_likelihood(model.tests(values))[:, 0]
    normal = -0.5 * ((0.9 - expected) / 0.09) ** 2 - np.log(0.09 * np.sqrt(2.0 * np.pi))
    np.testing.assert_allclose(log_density, normal)


def test_a_vendors_modulus_alone_makes_a_material(tmp_path):
    """Without films it is what the constants rest on, beside their priors."""
    keys = "[vendor]\nmodulus_100 = { value = 2000, sd = 20 }\n"
    study = with_keys(tmp_path, keys, without=("tensile.csv", "break.csv"))
    (tmp_path / "actuator.csv").unlink()
    (tmp_path / "break.csv").write_text("specimen_id,degradation_pct,elongation_pct\nb,0,208\n")
    study = read_study(tmp_path)
    model, draws = calibrated(study)
    values = model.table.named(draws)
    found = modulus_100(values, model.world.constants(values, np.array([0.0])))
    assert float(np.mean(found)) == pytest.approx(2.0, abs=0.02)


def test_a_vendors_elongation_is_a_prior_where_no_film_was_broken(tmp_path):
    keys = "[vendor]\nelongation_at_break = { value = 900, sd = 90 }\n"
    study = with_keys(tmp_path, keys, without=("break.csv",))
    laws = {parameter.name: parameter.law for parameter in outline(study).base}
    assert laws["elongation_at_0"] == LogNormal(900.0, 0.1)
    assert "elongation_scatter" in laws
    assert [name for name in laws if name.startswith("elongation_at")] == ["elongation_at_0"]


def test_elongations_of_the_study_and_stated_priors_come_before_a_vendors(tmp_path):
    keys = "[vendor]\nelongation_at_break = 900\n"
    measured = {p.name: p.law for p in outline(with_keys(tmp_path, keys)).base}
    assert measured["elongation_at_0"] != LogNormal(900.0, 0.2)
    prior = '[priors]\nelongation_at_0 = { law = "lognormal", median = 500, sigma = 0.3 }\n'
    stated = with_keys(tmp_path, keys + prior, without=("break.csv",))
    laws = {parameter.name: parameter.law for parameter in outline(stated).base}
    assert laws["elongation_at_0"] == LogNormal(500.0, 0.3)


def test_without_actuators_nothing_could_burst_and_the_elongation_is_not_used(tmp_path):
    keys = "[vendor]\nelongation_at_break = 900\n"
    study = with_keys(tmp_path, keys, without=("break.csv", "actuator.csv"))
    assert not any(name.startswith("elongation") for name in names_of(study))
    (figure,) = vendor_check(study, *calibrated(study)).figures
    assert figure.middle is None
    assert figure.distance is None


def test_the_check_says_how_far_the_posterior_is_off(tmp_path):
    keys = "[vendor]\nmodulus_100 = { value = 900, sd = 400 }\n"
    study = with_keys(tmp_path, keys, without=("break.csv", "actuator.csv"))
    (figure,) = vendor_check(study, *calibrated(study)).figures
    assert (figure.value, figure.sd, figure.use) == (900.0, 400.0, "datum")
    stress = study.tensile.groupby("specimen_id")[["stretch", "stress_MPa"]].apply(
        lambda film: np.interp(2.0, film["stretch"], film["stress_MPa"])
    )
    assert figure.middle == pytest.approx(1e3 * float(stress.mean()), rel=0.05)
    assert figure.low < figure.middle < figure.high
    assert figure.distance == pytest.approx((figure.middle - 900.0) / 400.0)


def test_a_study_without_such_figures_has_no_check(tmp_path):
    study = fresh_study(tmp_path)
    assert vendor_check(study, *calibrated(study)) is None
