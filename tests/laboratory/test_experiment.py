"""The whole experiment: its files are a study without faults, and the seed decides everything."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import bayesdeg
from bayesdeg.data.settings import (
    CALIBRATED_LAWS,
    LARGEST_RATE_SD,
    MODES,
    CauseOptions,
    Dimensions,
    Known,
    MaterialOptions,
    MixtureRecipe,
    Noise,
    Paper,
    SamplingOptions,
    Settings,
    TensileOptions,
    VendorFigures,
    parse_settings,
)
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.experiment import Design, design_of, run_experiment
from bayesdeg.laboratory.truth import Truth, parse_effects
from bayesdeg.laboratory.writing import (
    Provenance,
    settings_text,
    study_files,
    truth_record,
    virtual_settings,
)
from bayesdeg.observations.breaks import break_table
from bayesdeg.observations.curvature import actuator_curves
from bayesdeg.observations.means import statistics
from bayesdeg.observations.tensile import tensile_curves
from bayesdeg.priors import LogNormal, Normal, TruncatedNormal
from tests.laboratory.linear_actuator import LinearActuator

COMMAND = "bayesdeg simulate studies/x --cause pressure_offset=14 --seed 7"
PROVENANCE = Provenance(COMMAND, 7, {"along": 3.5, "across": 2.5, "up": 5.0})
TABLES = ("moisture", "shrinkage", "tensile", "breaks", "actuator")
#: so that some specimens burst
FRAGILE = LinearActuator(stretching=2.6)


def make(seed=7, effects=("pressure_offset=14",), design=None, forward=FRAGILE):
    return run_experiment(
        design or Design(),
        Truth(),
        effects=parse_effects(effects),
        forward=forward,
        generator=np.random.default_rng(seed),
    )


def written(folder, experiment, settings=None):
    folder.mkdir(exist_ok=True)
    files = study_files(experiment, settings or Settings(), provenance=PROVENANCE)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return read_study(folder)


def assert_same_tables(one, other):
    for name in TABLES:
        pd.testing.assert_frame_equal(one[name], other[name])


def test_the_files_are_a_study_that_holds_what_was_recorded(tmp_path):
    experiment = make()
    study = written(tmp_path, experiment)
    for name in TABLES:
        recorded = experiment.tables[name]
        read = getattr(study, name)[list(recorded)].reset_index(drop=True)
        pd.testing.assert_frame_equal(read, recorded, check_dtype=False, check_exact=True)
    assert study.settings.virtual
    assert study.settings.seed == 7
    assert study.actuator["ruptured"].sum() > 0
    curves, films = actuator_curves(study), tensile_curves(study, fitted=True)
    assert len(curves.specimens) == len(films.specimens) == len(break_table(study).specimens) == 18
    assert [s.quantity for s in statistics(study)] == ["volume_ratio"]


def test_columns_are_those_of_the_contract_and_no_more():
    tables = make().tables
    assert {name: list(table) for name, table in tables.items()} == {
        "moisture": ["film_id", "time_h", "mass_equilibrated_g", "mass_dry_g"],
        "shrinkage": ["film_id", "mass_poured_g", "mass_cured_g", "mass_conditioned_g"],
        "tensile": [
            "specimen_id",
            "degradation_pct",
            "degradation_sd_pct",
            "mode",
            "stretch",
            "stress_MPa",
            "stress_measure",
        ],
        "breaks": ["specimen_id", "degradation_pct", "degradation_sd_pct", "elongation_pct"],
        "actuator": [
            "specimen_id",
            "degradation_pct",
            "degradation_sd_pct",
            "pressure_kPa",
            "curvature_per_m",
            "bend_angle_deg",
            "ruptured",
        ],
    }


def test_every_file_begins_with_how_it_was_made():
    files = study_files(make(), Settings(), provenance=PROVENANCE)
    assert set(files) == {
        "study.toml",
        "truth.json",
        "moisture.csv",
        "shrinkage.csv",
        "tensile.csv",
        "break.csv",
        "actuator.csv",
    }
    for name, text in files.items():
        if name != "truth.json":
            first = text.splitlines()[0]
            assert first.startswith("# virtual experiment")
            assert first.endswith(f"{COMMAND} (seed 7)")
    broken = replace(PROVENANCE, command="bayesdeg \\\n  simulate x")
    assert broken.comment.count("\n") == 1


def test_what_was_hidden_and_what_is_true_stand_in_the_record():
    experiment = make()
    files = study_files(experiment, Settings(), provenance=PROVENANCE)
    record = json.loads(files["truth.json"])
    assert record == truth_record(experiment, PROVENANCE).document()
    assert record["causes"] == {"pressure_offset": {"offset": 14.0}}
    assert record["constants"]["c1_at_25"] == 1.588
    assert (record["seed"], record["command"]) == (7, COMMAND)
    assert record["mesh"] == {"along": 3.5, "across": 2.5, "up": 5.0}
    assert record["version"]["bayesdeg"] == bayesdeg.__version__
    assert set(record["actuators"]) == set(experiment.tables["actuator"]["specimen_id"])
    assert set(record["films"]) == set(experiment.tables["breaks"]["specimen_id"])
    fresh = record["actuators"]["A00-1"]
    assert fresh["degradation_pct"] == 0.0
    assert abs(fresh["ln_stiffness"]) < 0.3
    assert "pressure_offset" not in parse_settings(files["study.toml"].encode())[0].note


def test_the_seed_decides_everything():
    one, again, other = make(7), make(7), make(8)
    assert_same_tables(one.tables, again.tables)
    for name in TABLES:
        assert not one.tables[name].equals(other.tables[name])


def test_films_are_the_same_whatever_is_hidden():
    one, other = make(effects=["pressure_offset=14"]), make(effects=["curvature_reading=8"])
    for name in ("moisture", "shrinkage", "tensile", "breaks"):
        pd.testing.assert_frame_equal(one.tables[name], other.tables[name])
    assert not one.tables["actuator"].equals(other.tables["actuator"])


def test_the_forward_map_is_asked_once_for_all_actuators():
    class Counting:
        calls = 0

        def __call__(self, inputs):
            self.calls += 1
            return FRAGILE(inputs)

    counting = Counting()
    make(forward=counting)
    assert counting.calls == 1


def test_the_design_of_a_virtual_experiment_is_the_design_it_was_made_with(tmp_path):
    experiment = make()
    design, default = design_of(written(tmp_path, experiment)), Design()
    pd.testing.assert_frame_equal(
        design.actuator.drop(columns="degradation_sd_pct"),
        default.actuator.drop(columns="degradation_sd_pct"),
    )
    assert set(design.actuator["degradation_sd_pct"]) == {0.0, 0.5}
    assert design.tensile["stretch"].tolist() == experiment.tables["tensile"]["stretch"].tolist()
    for name in ("moisture", "shrinkage"):
        pd.testing.assert_frame_equal(getattr(design, name), getattr(default, name))
    # so the same command on its own outcome gives that outcome
    assert_same_tables(make(design=design).tables, experiment.tables)


def test_a_study_without_bend_angles_gets_none(tmp_path):
    experiment = make(design=replace(Design(), bend_angle=False))
    assert "bend_angle_deg" not in experiment.tables["actuator"]
    written(tmp_path, experiment)


def test_settings_of_the_study_are_kept(tmp_path):
    settings = Settings(
        title='Gelatin "thin"',
        note="real",
        dimensions=Dimensions(gap=1.5, chambers=4),
        priors={"volume_ratio": Normal(0.6, 0.05), "a.b": TruncatedNormal(0.0, 1.0, 0.0)},
        causes=CauseOptions(("pressure_offset",)),
        sampling=SamplingOptions("quick"),
        vendor=VendorFigures(Known(900.0, 90.0)),
    )
    study = written(tmp_path, make(), settings)
    assert study.settings.vendor == VendorFigures()
    made = virtual_settings(settings, seed=7)
    assert study.settings == made
    assert made.title == f"Virtual experiment: {settings.title}"
    assert made.note != "real"
    assert virtual_settings(made, seed=8) == replace(made, seed=8)


positive = st.floats(1e-6, 1e6)
texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
laws = st.one_of(
    st.builds(Normal, st.floats(-1e3, 1e3), positive),
    st.builds(LogNormal, positive, positive),
    st.builds(TruncatedNormal, st.just(0.0), positive, st.just(-1.0), st.just(np.inf)),
)


@example(settings=Settings(title='\x7f\t\n"\\', note="Größe 🙂"))
@given(
    settings=st.builds(
        Settings,
        title=texts,
        note=texts,
        seed=st.integers(0, 2**62),
        dimensions=st.builds(
            Dimensions, length=st.floats(40.0, 90.0), gap=st.just(0.0) | st.floats(0.01, 2.0)
        ),
        paper=st.builds(Paper, positive),
        priors=st.dictionaries(
            st.from_regex(r"[a-z_0-9]{1,8}(\.[a-z_]{1,8})?", fullmatch=True), laws, max_size=3
        ),
        noise=st.builds(Noise, st.floats(1e-6, LARGEST_RATE_SD)),
        shrinkage=st.builds(
            MixtureRecipe,
            glycerol=st.builds(Known, positive),
            gelatin_density=st.builds(Known, st.floats(1.0, 2.0), st.floats(0.0, 0.5)),
        ),
        causes=st.builds(
            CauseOptions,
            st.none() | st.just(()) | st.just(("pressure_loss", "pressure_offset")),
        ),
        sampling=st.builds(SamplingOptions, st.sampled_from(["quick", "standard", "thorough"])),
        tensile=st.builds(TensileOptions, st.sampled_from([("uniaxial",), MODES])),
        virtual=st.booleans(),
        material=st.builds(
            MaterialOptions,
            law=st.sampled_from(CALIBRATED_LAWS),
            stretch_range=st.none() | st.tuples(st.floats(0.1, 1.0), st.floats(1.1, 9.0)),
        ),
        vendor=st.builds(
            VendorFigures,
            modulus_100=st.none() | st.builds(Known, st.floats(2.0, 1e4), st.floats(0.1, 1.9)),
            source=st.sampled_from(["vendor", "data sheet"]),
        ),
    )
)
def test_settings_are_read_back_from_their_text(settings):
    assert parse_settings(settings_text(settings).encode()) == (settings, ())


def test_effects_act_in_the_order_of_the_catalogue_however_they_are_given():
    effects = parse_effects(["pressure_offset=14", "pressure_loss=0.1"])
    one, other = (
        run_experiment(
            Design(),
            Truth(),
            effects=order,
            forward=LinearActuator(),
            generator=np.random.default_rng(7),
        )
        for order in (effects, effects[::-1])
    )
    assert_same_tables(one.tables, other.tables)


@pytest.mark.parametrize("effects", [[], ["pressure_offset=14", "pressure_loss=0.1"]])
def test_none_or_several_effects_can_be_hidden(effects):
    record = truth_record(make(effects=effects), PROVENANCE)
    assert len(record.causes) == len(effects)


def test_volumes_are_read_where_the_design_says_so():
    """They come last of all draws: what else is read is the same with and without."""
    plain, swollen = make(), make(design=replace(Design(), cavity_volume=True))
    table = swollen.tables["actuator"]
    np.testing.assert_array_equal(
        plain.tables["actuator"]["curvature_per_m"], table["curvature_per_m"]
    )
    read = table[table["curvature_per_m"].notna()]
    expected = 0.02 * read["curvature_per_m"]
    assert np.all(np.abs(read["cavity_volume_ml"] - expected) < 0.05 + 0.15 * expected)
    assert "cavity_volume_ml" not in plain.tables["actuator"]
