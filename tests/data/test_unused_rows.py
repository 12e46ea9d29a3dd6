"""Rows that say nothing leave the likelihood, and every row that is not used is counted."""

import numpy as np
import pytest

from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.outline import outline, unused
from bayesdeg.assembly.reading import read_study
from bayesdeg.data.cells import least_digit
from bayesdeg.data.study import Why
from bayesdeg.errors import StudyError
from bayesdeg.observations.kinds import ROUNDING
from tests.run.study_files import ACTUATOR, TENSILE, study_in

FILMS = ("actuator.csv", "break.csv", "summary.csv")
AT_REST = "f1,0,uniaxial,1.0,0.0,nominal\nf2,25,uniaxial,1,0,cauchy\n"
FORCES = "specimen_id,degradation_pct,pressure_kPa,tip_force_N\na0,0,0,0\na0,0,40,0.21\n"
BURST = (
    "specimen_id,degradation_pct,pressure_kPa,curvature_per_m,ruptured\n"
    "a,0,0,0,0\na,0,40,4.1,0\na,0,80,,1\na,0,90,1.0,0\na,0,99,1.2,0\nb,0,40,4.0,0\n"
)


def counted(study):
    return {(one.file, one.why, one.rows, one.specimens) for one in study.unused}


def first_row_of_films(rows):
    """Return the table of films with rows before those that it has."""
    header, rest = TENSILE.split("\n", 1)
    return f"{header}\n{rows}{rest}"


def test_the_likelihood_is_that_without_undeformed_films(tmp_path):
    plain = assemble(study_in(tmp_path, without=FILMS)).model
    study = study_in(tmp_path, {"tensile.csv": first_row_of_films(AT_REST)}, without=FILMS)
    found = assemble(study).model
    vectors = plain.table.sample(np.random.default_rng(3), 20)
    np.testing.assert_array_equal(found.log_prob(vectors), plain.log_prob(vectors))
    assert len(found.observed) == len(study.tensile) - 2
    assert counted(study) == {("tensile.csv", Why.UNDEFORMED, 2, ("f1", "f2"))}


@pytest.mark.parametrize(
    "row", ["f1,0,uniaxial,1.0,0.001,nominal", "f1,0,uniaxial,1.001,0,nominal"]
)
def test_a_film_that_is_only_nearly_at_rest_is_used(tmp_path, row):
    study = study_in(tmp_path, {"tensile.csv": first_row_of_films(f"{row}\n")}, without=FILMS)
    assert study.unused == ()
    assert len(assemble(study).model.observed) == len(study.tensile)


@pytest.mark.parametrize(
    ("actuator", "expected"),
    [
        (ACTUATOR, {("actuator.csv", Why.UNLOADED, 3, ("a0", "a1", "a2"))}),
        (
            BURST,
            {
                ("actuator.csv", Why.AFTER_BURST, 2, ("a",)),
                ("actuator.csv", Why.UNLOADED, 1, ("a",)),
            },
        ),
    ],
)
def test_rows_of_actuators_that_are_not_used_are_counted(tmp_path, actuator, expected):
    study = study_in(tmp_path, {"actuator.csv": actuator})
    assert counted(study) == expected
    said = unused(study)
    for file, why, rows, specimens in expected:
        begin = f"{rows} row{'s' if rows > 1 else ''} of {file} ({', '.join(specimens)}): "
        assert sum(line.startswith(begin) for line in said) == 1, why


def test_forces_at_no_pressure_are_counted(tmp_path):
    study_in(tmp_path)
    (tmp_path / "force.csv").write_text(FORCES, encoding="utf-8")
    assert ("force.csv", Why.UNLOADED, 1, ("a0",)) in counted(read_study(tmp_path))


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("actuator.csv", ACTUATOR.replace("a1,10,0.5,40,", "a1,10,0.5,-3,")),
        ("force.csv", FORCES.replace(",0,0\n", ",-24,-0.1\n")),
    ],
)
def test_vacuum_is_refused(tmp_path, file, text):
    study_in(tmp_path)
    (tmp_path / file).write_text(text, encoding="utf-8")
    with pytest.raises(StudyError) as caught:
        read_study(tmp_path)
    faults = [fault for fault in caught.value.faults if fault.column == "pressure_kPa"]
    assert [fault.file for fault in faults] == [file]
    assert "vacuum" in faults[0].problem
    assert "remove" in faults[0].remedy


# ---- no error is below what rounding leaves


@pytest.mark.parametrize(
    ("cells", "digit"),
    [
        (["0.5", "0.250"], 1e-3),
        (["7", "", "12"], 1.0),
        (["2.5e-3", "1e1"], 1e-4),
        (["-.05"], 1e-2),
        (["5."], 1.0),
        (["n/a"], 1.0),
    ],
)
def test_the_least_digit_is_that_of_the_finest_cell(cells, digit):
    assert least_digit(cells) == digit


def test_errors_are_bounded_below_by_the_last_digit_also_with_a_stated_prior(tmp_path):
    stated = '[priors]\ntensile_noise_floor = { law = "half_normal", sd = 0.001 }\n'
    for study in (study_in(tmp_path), study_in(tmp_path, {"study.toml": stated})):
        least = {one.name: one.least for one in outline(study).base if one.least}
        assert least == pytest.approx(
            {
                "tensile_noise_floor": 0.01 / np.sqrt(12.0),
                "curvature_noise_floor": 1e-4 / np.sqrt(12.0),
                "elongation_scatter": 1.0 / np.sqrt(12.0) / 215.0,
            }
        )


def test_the_density_of_readings_that_are_met_exactly_is_bounded(tmp_path):
    """A film along a Yeoh curve, to the last bit that is written."""
    stretch = np.linspace(1.1, 2.0, 12)
    stress = 2.0 * 0.3 * (stretch - stretch**-2.0)
    rows = (f"f,0,uniaxial,{x:.10g},{y:.4f},nominal" for x, y in zip(stretch, stress, strict=True))
    text = TENSILE.splitlines()[0] + "\n" + "\n".join(rows) + "\n"
    model = assemble(study_in(tmp_path, {"tensile.csv": text}, without=FILMS)).model
    exact = {one.name: float(one.law.quantile(0.5)) for one in model.table.parameters}
    exact |= {"c1_at_0": 0.3, "c2_ratio_at_0": 0.0, "c3_at_0": 1e-12, "tensile_noise": 1e-12}
    exact |= {"stiffness_scatter": 1e-12}

    def likelihood(floor):
        vector = model.table.vectors({k: np.array([v]) for k, v in exact.items()})
        vector[:, model.table.names.index("tensile_noise_floor")] = np.log(floor)
        return float(sum(map(np.sum, model.log_likelihood(model.table.named(vector)).values())))

    rounding = ROUNDING * 1e-4
    assert likelihood(10.0 * rounding) < likelihood(rounding)
    assert likelihood(1e-12) == pytest.approx(likelihood(1e-3 * rounding), abs=1e-6)
