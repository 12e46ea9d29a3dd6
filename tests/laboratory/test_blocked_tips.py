"""Virtual tip forces: the law of the likelihood, nothing else moved, recovered from the files."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from bayesdeg.assembly.assemble import assemble
from bayesdeg.data.settings import parse_settings
from bayesdeg.data.study import read_study
from bayesdeg.errors import BayesdegError
from bayesdeg.inference.laplace import approximate
from bayesdeg.laboratory.experiment import Design, design_of, press_tips, run_experiment
from bayesdeg.laboratory.truth import Truth, parse_effects
from bayesdeg.laboratory.writing import Provenance, study_files
from bayesdeg.observations.catalogue import TABLES
from bayesdeg.observations.force import HeldTip
from tests.laboratory.test_actuators import many
from tests.observations.test_held_tip import pressing
from tests.observations.test_volume import swelling

PROVENANCE = Provenance("bayesdeg simulate x --out y --seed 5", 5, {"along": 2.0})
PRESSURES = (30.0, 60.0, 90.0)
TOUGH = replace(Truth(), elongation=(900.0, 900.0, 900.0))
COUNT = 1500


def design(count=3, levels=(0.0, 25.0), pressures=PRESSURES):
    """Actuators whose tip is held, with names of their own, of known degradation rates."""
    tests = [
        many(level, count, pressures, sd=0.0).assign(
            specimen_id=lambda t, level=level: "t" + t["specimen_id"] + f"-{level:g}"
        )
        for level in levels
    ]
    force = pd.concat(tests, ignore_index=True)
    few = Design()
    keep = few.actuator["degradation_pct"].isin(levels) & (few.actuator["pressure_kPa"] <= 100.0)
    return replace(few, actuator=few.actuator[keep].reset_index(drop=True), force=force)


def make(plan=None, truth=TOUGH, seed=5, effects=()):
    return run_experiment(
        plan or design(),
        truth,
        forward=pressing,
        generator=np.random.default_rng(seed),
        effects=parse_effects(effects),
    )


def written(folder, experiment):
    folder.mkdir(exist_ok=True)
    settings = parse_settings(b"")[0]
    for name, text in study_files(experiment, settings, provenance=PROVENANCE).items():
        (folder / name).write_text(text, encoding="utf-8")
    return read_study(folder, TABLES)


def test_the_file_is_read_and_has_the_columns_of_the_contract(tmp_path):
    experiment = make()
    study = written(tmp_path / "made", experiment)
    assert list(experiment.tables["force"]) == [
        *("specimen_id", "degradation_pct", "degradation_sd_pct", "pressure_kPa", "tip_force_N"),
    ]
    read = study.table("force")[list(experiment.tables["force"])].reset_index(drop=True)
    pd.testing.assert_frame_equal(read, experiment.tables["force"], check_dtype=False)
    again = design_of(study).force
    assert again["pressure_kPa"].tolist() == list(PRESSURES) * 6
    truth = json.loads((tmp_path / "made" / "truth.json").read_text("utf-8"))
    assert set(truth["blocked"]) == set(read["specimen_id"])
    assert {one["status"] for one in truth["blocked"].values()} == {"converged"}
    assert truth["constants"]["force_gain"] == 1.0


def test_all_else_is_the_same_with_forces_and_without():
    plain, pressed = make(replace(design(), force=None)), make()
    assert plain.blocked is None
    assert "force" not in plain.tables
    for name, table in plain.tables.items():
        pd.testing.assert_frame_equal(table, pressed.tables[name])


def test_the_seed_decides_the_forces():
    one, again, other = make(seed=5), make(seed=5), make(seed=6)
    pd.testing.assert_frame_equal(one.tables["force"], again.tables["force"])
    assert not one.tables["force"]["tip_force_N"].equals(other.tables["force"]["tip_force_N"])


def values_of(model, truth):
    """Return the truth by the names of the parameters; control values between are any."""
    known = truth.named() | {"force_noise_length": truth.curvature_noise_length}
    known |= {f"{name}_control_12_5": known[f"{name}_at_12_5"] for name in ("c1", "c2_ratio", "c3")}
    missing = {p.name for p in model.table.parameters} - set(known)
    assert not missing
    return {p.name: np.array([known[p.name]]) for p in model.table.parameters}


@pytest.mark.parametrize("length", [1e-9, 40.0])
def test_readings_have_the_law_of_the_likelihood(tmp_path, length):
    """Mahalanobis' distance of each specimen's readings is χ² of three degrees of freedom."""
    truth = replace(TOUGH, curvature_noise_length=length, force_gain=1.06)
    experiment = make(design(COUNT), truth)
    model = assemble(written(tmp_path / "made", experiment), pressing).model
    (kind,) = model.of_kind(HeldTip)
    state = model.state(values_of(model, truth))
    off = (kind.observed - kind.expected(state)[0]).reshape(2 * COUNT, len(PRESSURES))
    covariances = [block[0] if block.ndim == 3 else block for block in kind.covariance(state)]
    for level in range(2):
        rows = slice(level * COUNT, (level + 1) * COUNT)
        law = covariances[level * COUNT]
        np.testing.assert_allclose(law, covariances[(level + 1) * COUNT - 1], rtol=1e-9)
        distance = np.einsum("ni,ij,nj->n", off[rows], np.linalg.inv(law), off[rows])
        assert stats.kstest(distance, stats.chi2(len(PRESSURES)).cdf).pvalue > 1e-3
        z = off[rows] / np.sqrt(np.diag(law))
        for column in z.T:
            assert stats.kstest(column, "norm").pvalue > 1e-3
        expected = law / np.sqrt(np.outer(np.diag(law), np.diag(law)))
        np.testing.assert_allclose(np.corrcoef(z.T), expected, atol=5.0 / np.sqrt(COUNT))


def test_nothing_is_read_from_where_a_free_specimen_would_burst():
    """Its stretch is 1 + p/C1, so that the fresh ones are over at λ_b = 1.25: 72 kPa."""
    weak = replace(
        TOUGH, elongation=(25.0, 900.0, 900.0), elongation_scatter=0.0, stiffness_scatter=0.0
    )
    experiment = make(truth=weak)
    count = experiment.tables["force"].groupby("specimen_id").size()
    assert count[count.index.str.endswith("-0")].unique().tolist() == [2]
    assert count[count.index.str.endswith("-25")].unique().tolist() == [3]


def test_readings_end_where_the_held_tip_was_not_solved():
    def lost(inputs):
        found = pressing(inputs)
        there = np.where(inputs.pressure > 70.0, np.nan, 1.0)
        return replace(found, further=replace(found.further, value=there * found.further.value))

    table, real = press_tips(
        design().force,
        TOUGH,
        effects=(),
        forward=lost,
        generator=np.random.default_rng(1),
    )
    assert table["pressure_kPa"].max() == 60.0
    assert set(real["status"]) == {"held_tip_not_reached"}


def test_a_map_without_forces_is_refused():
    with pytest.raises(BayesdegError, match="tip forces"):
        press_tips(
            design().force, TOUGH, effects=(), forward=swelling, generator=np.random.default_rng(1)
        )


def test_hidden_causes_act_on_forces():
    """A gauge that shows too much, without reading errors: the force of 0.8 times the pressure."""
    quiet = replace(TOUGH, force_noise=0.0, force_noise_floor=0.0, stiffness_scatter=0.0)
    quiet = replace(quiet, c1=(0.4, 0.4, 0.4))
    experiment = make(truth=quiet, effects=("gauge_gain=-0.2",))
    load = 0.8e-3 * experiment.tables["force"]["pressure_kPa"] / 0.4
    np.testing.assert_allclose(
        experiment.tables["force"]["tip_force_N"], 0.4 * (load + load**2), atol=6e-6
    )


def test_a_fit_to_the_files_recovers_what_the_load_cell_was_off_by(tmp_path):
    """Off by 12 %, against a prior of 5 %: the closed form calibrates on what it made itself."""
    truth = replace(TOUGH, force_gain=1.12)
    model = assemble(written(tmp_path / "made", make(design(8), truth)), pressing).model
    medians = {p.name: p.law.quantile(0.5) for p in model.table.parameters}
    start = model.table.vectors(medians)
    found = approximate(model, np.random.default_rng(1), start=start)
    for name in ("force_gain", "force_noise", "c1_at_0"):
        place = model.table.names.index(name)
        law = model.table.parameters[place].law
        true = float(law.to_unconstrained(truth.named()[name]))
        sd = np.sqrt(found.covariance[place, place])
        assert abs(found.mode[place] - true) < 3.0 * sd
        assert sd < 0.5 if name == "force_noise" else sd < 0.05
    gain = model.table.names.index("force_gain")
    none = float(model.table.parameters[gain].law.to_unconstrained(1.0))
    assert found.mode[gain] - none > 3.0 * np.sqrt(found.covariance[gain, gain])
