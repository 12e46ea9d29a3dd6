import numpy as np
import pytest

from bayesdeg.assembly.assemble import assemble, level_grid
from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.errors import BayesdegError, StudyError
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.means import Means
from bayesdeg.observations.published import RSquared
from bayesdeg.observations.specimens import has_elongation, no_map
from bayesdeg.observations.tensile import Tensile
from bayesdeg.priors import Normal, Uniform
from bayesdeg.surrogate.surrogate import Surrogate
from tests.run.study_files import ACTUATOR, SETTINGS, SUMMARY, TENSILE, study_in
from tests.surrogate.closed_form import ClosedFormMap


def prior_of(model, name):
    return next(p.law for p in model.base if p.name == name)


def test_a_full_study_has_every_kind_of_data_and_parameter(tmp_path):
    assembly = assemble(study_in(tmp_path))
    model, names = assembly.model, set(assembly.model.table.names)
    assert isinstance(model.world.forward, Surrogate)
    assert model.world.nodes == (0.0, 12.5, 25.0)
    assert {"c1_control_12_5", "tensile_noise", "curvature_noise", "paper_stiffness"} <= names
    assert {"tensile_noise_length", "curvature_noise_length", "emulator_error_level"} <= names
    assert {"elongation_at_0", "elongation_at_25", "elongation_scatter"} <= names
    assert [s.quantity for s in model.data_of(Means).statistics] == [
        "young_modulus",
        "elongation_at_break",
        "volume_ratio",
    ]
    assert set(dict(assembly.missing)) == {"shrinkage.csv", "moisture.csv"}


def test_a_model_can_be_assembled_about_another_forward_map(tmp_path):
    exact = ClosedFormMap()
    model = assemble(study_in(tmp_path), exact).model
    assert model.world.forward is exact
    # only an emulator has an error of its own to be calibrated
    assert not [name for name in model.table.names if name.startswith("emulator_error")]


def test_bend_angles_bring_their_own_noise_and_its_correlation_with_that_of_the_curvature(tmp_path):
    plain, read = tmp_path / "plain", tmp_path / "read"
    plain.mkdir()
    read.mkdir()
    head, *rows = ACTUATOR.splitlines()
    angles = "\n".join([head + ",bend_angle_deg", *(f"{row},{i}" for i, row in enumerate(rows))])
    without = set(assemble(study_in(plain)).model.table.names)
    model = assemble(study_in(read, {"actuator.csv": angles + "\n"})).model
    assert set(model.table.names) - without == {
        "bend_angle_noise",
        "bend_angle_noise_floor",
        "reading_correlation",
    }
    assert model.data_of(Curvature).tests.readings.shape == (3, 8)
    assert np.all(model.data_of(Curvature).tests.bend_angle[:, 1:] > 0.0)


def test_readings_stay_alike_over_a_share_of_the_largest_pressure(tmp_path):
    """By default; what lasts longer is an effect to be named."""
    model = assemble(study_in(tmp_path)).model
    assert model.world.largest_pressure == 120.0
    assert prior_of(model, "curvature_noise_length") == Uniform(0.6, 18.0)


def test_all_causes_are_candidates_unless_the_study_lists_some(tmp_path):
    study = study_in(tmp_path)
    assembly = assemble(study)
    judged = {c.name for c in assembly.candidates}
    conditions = assembly.model.data_of(Curvature).tests.conditions
    visible = {
        name
        for name, cause in CATALOGUE.items()
        if not cause.needs
        and cause.blind_in(study) is None
        and (cause.blind(conditions) is None or "tensile" in cause.acts_on)
    }
    assert visible == judged
    assert judged | set(assembly.unjudged) == set(CATALOGUE)
    assert not judged & set(assembly.unjudged)
    assert all(why.strip() for why in assembly.unjudged.values())
    chosen = SETTINGS + '[causes]\ncandidates = ["pressure_loss"]\n'
    some = assemble(study_in(tmp_path, {"study.toml": chosen})).candidates
    assert [c.name for c in some] == ["pressure_loss"]


FLAWS = "flaw_embrittlement"  # of rupture alone


@pytest.mark.parametrize("without", ["break.csv", "summary.csv"])
def test_ruptures_are_judged_wherever_there_is_an_elongation_at_break(tmp_path, without):
    """Torn films or a published elongation: of either the model has a limit of elongation."""
    assembly = assemble(study_in(tmp_path, without=(without,)))
    assert has_elongation(assembly.model.base)
    assert FLAWS in {c.name for c in assembly.candidates}


def test_without_any_elongation_at_break_the_reason_says_so(tmp_path):
    published = "".join(r for r in SUMMARY.splitlines(keepends=True) if "elongation" not in r)
    files = {"summary.csv": published}
    assembly = assemble(study_in(tmp_path, files, without=("break.csv",)))
    assert not has_elongation(assembly.model.base)
    assert "break.csv" in assembly.unjudged[FLAWS]


FILMS = {name for name, c in CATALOGUE.items() if "tensile" in c.acts_on and not c.needs}


NO_R_SQUARED = "".join(
    r for r in SUMMARY.splitlines(keepends=True) if not r.startswith("r_squared")
)


def films_alone(folder, tensile):
    texts = {"summary.csv": NO_R_SQUARED, "tensile.csv": tensile}
    return assemble(study_in(folder, texts, without=("actuator.csv",)))


def test_without_an_actuator_causes_that_films_show_can_be_judged(tmp_path):
    assembly = films_alone(tmp_path, TENSILE.replace("f2,25,uniaxial", "f2,25,planar"))
    assert assembly.alike == ()
    assert {c.name for c in assembly.candidates} == FILMS == {"second_invariant", "stress_measure"}
    assert set(assembly.unjudged) == set(CATALOGUE) - FILMS
    assert not [n for n in assembly.model.table.names if n.startswith(("curvature", "emulator"))]
    assert assembly.model.world.forward is no_map
    # nothing in the model depends on the volume ratio
    assert "volume_ratio" not in {s.quantity for s in assembly.model.data_of(Means).statistics}
    assert "actuator.csv" in dict(assembly.missing)


@pytest.mark.parametrize(
    ("tensile", "seen"),
    [
        (TENSILE.replace("cauchy", "nominal"), set()),
        (TENSILE, {"stress_measure"}),  # the labels differ, and one law has to fit both
        (TENSILE.replace("cauchy", "nominal").replace("2,25,uniaxial", "2,25,planar"), FILMS),
        (TENSILE.replace("cauchy", "nominal").replace("1.1,0.90", "0.8,-0.90"), FILMS),
    ],
)
def test_films_in_one_mode_cannot_tell_a_cause_from_another_form_of_the_law(
    tmp_path, tensile, seen
):
    assembly = films_alone(tmp_path, tensile)
    assert {c.name for c in assembly.candidates} == seen
    assert {c.name for c in assembly.alike} == FILMS - seen
    for cause in assembly.alike:
        assert "only (uniaxial)" in assembly.unjudged[cause.name]


def test_beside_actuators_films_in_one_mode_are_judged(tmp_path):
    assembly = assemble(study_in(tmp_path))
    assert {c.name for c in assembly.candidates} >= FILMS
    assert assembly.alike == ()


def test_a_published_r_squared_speaks_of_actuators_that_are_not_there(tmp_path):
    """Its misfit needs the mechanics, and so all that they depend on; causes only films judge."""
    assembly = assemble(study_in(tmp_path, without=("actuator.csv",)))
    model = assembly.model
    assert not model.of_kind(Curvature)
    assert model.of_kind(RSquared)
    assert isinstance(model.world.forward, Surrogate)
    assert {"curvature_noise", "paper_stiffness", "volume_ratio"} <= set(model.table.names)
    assert "volume_ratio" in {s.quantity for s in model.data_of(Means).statistics}
    assert {c.name for c in assembly.candidates} == FILMS
    assert "actuator.csv" in dict(assembly.missing)


def test_without_actuators_and_films_no_cause_can_be_judged(tmp_path):
    assembly = assemble(study_in(tmp_path, without=("actuator.csv", "tensile.csv")))
    assert assembly.candidates == ()
    assert set(assembly.unjudged) == set(CATALOGUE)
    assert "tensile.csv" in assembly.unjudged["stress_measure"]


def test_without_films_the_constants_rest_on_priors(tmp_path):
    assembly = assemble(study_in(tmp_path, without=("tensile.csv",)))
    assert not assembly.model.of_kind(Tensile)
    assert "tensile_noise" not in assembly.model.table.names
    assert "priors" in dict(assembly.missing)["tensile.csv"]


def test_a_published_volume_ratio_does_not_count_twice(tmp_path):
    """Its default prior is the published mean: where that is data, the prior is flat."""
    measured, alone = tmp_path / "measured", tmp_path / "alone"
    measured.mkdir()
    alone.mkdir()
    assert prior_of(assemble(study_in(measured)).model, "volume_ratio") == Uniform(0.2, 1.0)
    without = assemble(study_in(alone, without=("summary.csv",)))
    assert prior_of(without.model, "volume_ratio").quantile(0.5) == pytest.approx(0.62, abs=0.01)


def test_priors_of_the_study_replace_those_of_base_and_causes(tmp_path):
    text = SETTINGS + (
        '[priors]\nvolume_ratio = { law = "normal", mean = 0.6, sd = 0.1 }\n'
        '"pressure_offset.offset" = { law = "normal", mean = 0.0, sd = 3.0 }\n'
    )
    assembly = assemble(study_in(tmp_path, {"study.toml": text}))
    assert prior_of(assembly.model, "volume_ratio") == Normal(0.6, 0.1)
    offset = next(c for c in assembly.candidates if c.name == "pressure_offset")
    assert offset.parameters[0].law == Normal(0.0, 3.0)
    assert CATALOGUE["pressure_offset"].parameters[0].law != Normal(0.0, 3.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[priors]\nvolum_ratio = { law = "normal", mean = 0.6, sd = 0.1 }', "volume_ratio"),
        ('[causes]\ncandidates = ["pressure_los"]', "pressure_loss"),
        (
            '[priors]\n"stress_measure.confusion" = { law = "uniform", low = 0.0, high = 1.0 }',
            "either 0 or 1",
        ),
        ("[actuator]\nheight = 11.0", r"height = 11 \(trained: 10\).*bayesdeg emulate"),
    ],
)
def test_what_cannot_be_assembled_is_refused_with_the_way_out(tmp_path, text, said):
    with pytest.raises((BayesdegError, StudyError), match=said):
        assemble(study_in(tmp_path, {"study.toml": SETTINGS + text + "\n"}))


def test_levels_for_predictions_go_up_in_steps_of_five(tmp_path):
    assert level_grid(assemble(study_in(tmp_path)).model).tolist() == [0, 5, 10, 15, 20, 25]


def test_a_fresh_material_has_one_level(tmp_path):
    films = "specimen_id,degradation_pct,stretch,stress_MPa\nf,0,1.2,0.3\nf,0,1.5,0.6\n"
    others = ("actuator.csv", "break.csv", "summary.csv")
    fresh = study_in(tmp_path, {"tensile.csv": films}, without=others)
    assert level_grid(assemble(fresh).model).tolist() == [0.0]
