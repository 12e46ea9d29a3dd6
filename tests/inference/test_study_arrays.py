"""A study folder becomes padded arrays."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from bayesdeg.data.study import read_study
from bayesdeg.errors import StudyError
from bayesdeg.observations.breaks import break_table
from bayesdeg.observations.curvature import actuator_curves
from bayesdeg.observations.means import statistics
from bayesdeg.observations.tensile import tensile_curves

FILES = {
    "study.toml": """
[noise]
degradation_sd_pct = 0.7
""",
    "tensile.csv": """specimen_id,degradation_pct,degradation_sd_pct,mode,\
stretch,stress_MPa,stress_measure
t2,25,,uniaxial,1.1,0.9,nominal
t2,25,,uniaxial,1.3,2.9,nominal
t1,0,0.2,uniaxial,1.5,0.6,cauchy
t1,0,0.2,uniaxial,2.0,1.3,cauchy
t1,0,0.2,uniaxial,2.5,2.4,nominal
e1,0,0.2,equibiaxial,1.4,0.8,
""",
    "break.csv": """specimen_id,degradation_pct,elongation_pct
b1,0,209.8
b2,25,52
""",
    "actuator.csv": """specimen_id,degradation_pct,pressure_kPa,curvature_per_m,curvature_sd_per_m,\
ruptured,cycle,branch
second,25,0,0,,0,1,loading
second,25,40,0.5,,0,1,loading
second,25,80,,,1,1,loading
first,0,0,0,0.1,0,1,loading
first,0,20,2.1,0.1,0,1,loading
first,0,40,4.4,0.2,0,1,loading
first,0,20,2.3,,0,1,unloading
first,0,20,2.2,0.1,0,2,loading
""",
    "summary.csv": """quantity,degradation_pct,value,sd,n,unit,source
young_modulus,0,1.73,0.15,3,MPa,text
elongation_at_break,0,209.8,6.3,,%,text
young_modulus,25,9.5,,3,MPa,no sd
r_squared,0,0.984,,,–,text
volume_ratio,,0.62,0.07,4,–,text
ruptured_count,25,2,0.5,,–,not fitted
""",
    "shrinkage.csv": """film_id,mass_poured_g,mass_cured_g,mass_conditioned_g
s1,30,15,10
s2,30,16,10.5
s3,30,15.5,10.2
""",
}


@pytest.fixture
def study_of(tmp_path):
    def make(**changed):
        texts = FILES | {f"{name}.csv": text for name, text in changed.items() if name != "toml"}
        if "toml" in changed:
            texts["study.toml"] = changed["toml"]
        for name, text in texts.items():
            if text is not None:
                (tmp_path / name).write_text(text, encoding="utf-8")
        return read_study(tmp_path)

    return make


def test_tensile_curves_are_padded_and_masked(study_of):
    curves = tensile_curves(study_of(), fitted=True)
    assert curves.specimens == ("t2", "t1", "e1")
    assert curves.modes == ("uniaxial", "uniaxial", "equibiaxial")
    np.testing.assert_array_equal(curves.mask.sum(axis=1), [2, 3, 1])
    np.testing.assert_array_equal(curves.mask, [[1, 1, 0], [1, 1, 1], [1, 0, 0]])
    np.testing.assert_array_equal(curves.degradation, [25.0, 0.0, 0.0])
    np.testing.assert_array_equal(curves.degradation_sd, [0.7, 0.2, 0.2])
    np.testing.assert_array_equal(curves.stress[curves.mask], [0.9, 2.9, 0.6, 1.3, 2.4, 0.8])
    np.testing.assert_array_equal(curves.cauchy, [[0, 0, 0], [1, 1, 0], [0, 0, 0]])


def test_the_design_matrix_is_that_of_each_rows_mode_and_measure(study_of):
    curves = tensile_curves(study_of(), fitted=True)
    for s, j in zip(*np.nonzero(curves.mask), strict=True):
        stretch = curves.stretch[s, j]
        if curves.modes[s] == "uniaxial":
            i1, first = stretch**2 + 2.0 / stretch, 2.0 * (stretch - stretch**-2)
        else:
            i1, first = 2.0 * stretch**2 + stretch**-4, 2.0 * (stretch - stretch**-5)
        factor = stretch if curves.cauchy[s, j] else 1.0
        want = factor * first * np.array([1.0, 2.0 * (i1 - 3.0), 3.0 * (i1 - 3.0) ** 2])
        np.testing.assert_allclose(curves.basis[s, j], want, rtol=1e-12)
    np.testing.assert_array_equal(curves.basis[~curves.mask], 0.0)


def test_modes_that_are_held_out_are_kept_apart(study_of):
    every = study_of()
    assert tensile_curves(every, fitted=False) is None
    study = study_of(toml='[tensile]\nfit_modes = ["uniaxial"]\n')
    fitted, held_out = (tensile_curves(study, fitted=flag) for flag in (True, False))
    assert fitted.specimens == ("t2", "t1")
    assert held_out.specimens == ("e1",)
    assert held_out.modes == ("equibiaxial",)
    assert held_out.stress.tolist() == [[0.8]]


def test_actuator_curves_keep_their_order_and_leave_out_zero_pressure(study_of):
    curves = actuator_curves(study_of())
    assert curves.specimens == ("second", "first")
    np.testing.assert_array_equal(curves.degradation, [[25.0], [0.0]])
    np.testing.assert_array_equal(curves.degradation_sd, [[0.7], [0.7]])
    np.testing.assert_array_equal(
        curves.mask, [[0, 1, 0, 0, 0], [0, 1, 1, 1, 1]]
    )  # the reading at rupture is empty
    assert not np.any(curves.mask & (curves.pressure == 0.0))
    np.testing.assert_array_equal(curves.curvature[curves.mask], [0.5, 2.1, 4.4, 2.3, 2.2])
    np.testing.assert_array_equal(curves.curvature[~curves.mask], 0.0)
    np.testing.assert_array_equal(curves.curvature_sd[curves.mask], [0.0, 0.1, 0.2, 0.0, 0.1])
    np.testing.assert_array_equal(curves.cycle[1], [1, 1, 1, 1, 2])
    assert curves.branch[1].tolist() == ["loading", "loading", "loading", "unloading", "loading"]
    assert curves.branch.shape == curves.cycle.shape == curves.mask.shape


def test_a_subset_takes_whole_specimens(study_of):
    curves = actuator_curves(study_of())
    alone = curves.subset(np.array([1]))
    assert alone.specimens == ("first",)
    for name in ("degradation", "pressure", "curvature", "curvature_sd", "mask", "cycle", "branch"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(curves, name)[1:], err_msg=name)
    again = curves.subset(np.array([0, 1, 0]))
    assert again.specimens == ("second", "first", "second")


def test_batches_have_their_names_beside_their_numbers(study_of):
    header, *rows = FILES["actuator.csv"].splitlines()
    rows = [f"{row},{'B 7' if row.startswith('second') else ''}" for row in rows]
    curves = actuator_curves(study_of(actuator="\n".join([f"{header},batch", *rows]) + "\n"))
    assert curves.batch_name.tolist() == [["B 7"], [""]]
    assert curves.batch.tolist() == [[0], [0]]
    assert curves.subset(np.array([1])).batch_name.tolist() == [[""]]


def test_bend_angles_are_read_beside_the_curvature(study_of):
    header, *rows = FILES["actuator.csv"].splitlines()
    angles = ("0", "11", "", "0", "", "52", "", "54")
    rows = [f"{row},{angle}" for row, angle in zip(rows, angles, strict=True)]
    rows = [f"{header},bend_angle_deg", *rows]
    curves = actuator_curves(study_of(actuator="\n".join(rows) + "\n"))
    assert curves.with_angle
    np.testing.assert_array_equal(curves.angle_mask[0], [0, 1, 0, 0, 0])
    np.testing.assert_array_equal(curves.bend_angle[1], [0.0, 0.0, 52.0, 0.0, 54.0])
    assert curves.readings.shape == curves.paths.mask.shape == (2, 10)
    np.testing.assert_array_equal(curves.paths.mask[0], [0, 1, 0, 0, 0, 0, 1, 0, 0, 0])
    without = actuator_curves(study_of())
    assert not without.with_angle
    assert without.readings.shape == (2, 5)


def test_a_path_goes_up_and_down_in_pressure(study_of):
    """Pressure travelled between readings, not the difference of their pressures."""
    paths = actuator_curves(study_of()).paths
    np.testing.assert_array_equal(paths.place[1], [0.0, 20.0, 40.0, 60.0, 60.0])
    np.testing.assert_array_equal(paths.gap[1, 1:], [np.inf, 20.0, 20.0, 0.0])


def test_ruptures_lie_between_the_last_pressure_survived_and_that_at_which_it_burst(study_of):
    ruptures = actuator_curves(study_of()).ruptures
    assert ruptures.survived.tolist() == [1, 2]  # 40 kPa both
    assert ruptures.burst.tolist() == [2, -1]
    data = actuator_curves(study_of())
    early = replace(data, ruptured=np.eye(5, dtype=bool)[[1, 3]])
    assert early.ruptures.survived.tolist() == [-1, -1]  # nothing below that was survived
    assert early.ruptures.burst.tolist() == [1, 3]


def test_the_order_of_a_tensile_files_rows_does_not_matter(study_of):
    header, *rows = FILES["tensile.csv"].splitlines()
    mixed = "\n".join([header, rows[1], rows[4], rows[0], rows[2], rows[5], rows[3]]) + "\n"
    first, second = (
        tensile_curves(study_of(tensile=text), fitted=True)
        for text in (FILES["tensile.csv"], mixed)
    )
    assert set(first.specimens) == set(second.specimens)
    order = [second.specimens.index(name) for name in first.specimens]
    for name in ("stretch", "stress", "mask", "basis", "cauchy", "degradation"):
        np.testing.assert_array_equal(
            getattr(second.subset(np.array(order)), name), getattr(first, name), err_msg=name
        )


def test_films_can_be_left_out(study_of):
    films = tensile_curves(study_of(), fitted=True)
    alone = films.subset(np.array([2, 0]))
    assert alone.specimens == ("e1", "t2")
    assert alone.modes == ("equibiaxial", "uniaxial")
    np.testing.assert_array_equal(alone.stress, films.stress[[2, 0]])
    np.testing.assert_array_equal(alone.paths.mask, films.mask[[2, 0]])
    torn = break_table(study_of()).subset(np.array([1]))
    assert torn.specimens == ("b2",)
    assert torn.elongation.tolist() == [52.0]


def test_breaks(study_of):
    found = break_table(study_of())
    assert found.specimens == ("b1", "b2")
    np.testing.assert_array_equal(found.degradation, [0.0, 25.0])
    np.testing.assert_array_equal(found.degradation_sd, [0.7, 0.7])
    np.testing.assert_array_equal(found.elongation, [209.8, 52.0])


def test_statistics_take_the_standard_error_of_the_mean(study_of):
    modulus, elongation, ratio, films = statistics(study_of())
    assert (modulus.quantity, modulus.degradation, modulus.value) == ("young_modulus", 0.0, 1.73)
    assert modulus.se == pytest.approx(0.15 / np.sqrt(3.0))
    assert modulus.source == "text"
    assert (elongation.quantity, elongation.se) == ("elongation_at_break", 6.3)  # n not given
    assert (ratio.quantity, ratio.se) == ("volume_ratio", 0.07 / 2.0)
    assert (modulus.dof, elongation.dof, ratio.dof) == (2.0, np.inf, 3.0)
    assert films.quantity == "volume_ratio"
    assert "3 films" in films.source


def test_the_volume_ratio_of_the_films_is_their_mean(study_of):
    """V = m_gelatin/ρ + m_glycerol/ρ + m_water/ρ by hand; solids are those of 2 : 1 : 8 of 30 g."""
    films = statistics(study_of())[-1]
    gelatin, glycerol = 30.0 * 2.0 / 11.0, 30.0 / 11.0
    ratios = []
    for cured, conditioned in ((15.0, 10.0), (16.0, 10.5), (15.5, 10.2)):
        dry = gelatin / 1.35 + glycerol / 1.26
        water = [m - gelatin - glycerol for m in (cured, conditioned)]
        ratios.append((dry + water[1]) / (dry + water[0]))
    assert films.value == pytest.approx(np.mean(ratios), rel=5e-3)
    assert films.se == pytest.approx(stats.sem(ratios), rel=0.02)


def test_the_recipe_and_its_error_are_those_of_the_study(study_of):
    exact = statistics(study_of())[-1]
    lines = "gelatin_density = { value = 1.35, sd = 0.08 }\nwater = { value = 8, sd = 0.5 }\n"
    wide = statistics(study_of(toml=f"[shrinkage]\n{lines}"))[-1]
    assert (wide.value, exact.dof) == (exact.value, 2.0)
    assert wide.se > 1.1 * exact.se
    assert wide.dof > 2.0
    drier = statistics(study_of(toml="[shrinkage]\nwater = 9\n"))[-1]
    assert drier.value - exact.value == pytest.approx(0.004689, abs=1e-6)


def test_films_lighter_than_their_recipe_are_a_fault_of_the_study(study_of):
    with pytest.raises(StudyError) as raised:
        study_of(toml="[shrinkage]\nglycerol = 3\n")  # solids are 5/13 of what was poured
    assert {fault.file for fault in raised.value.faults} == {"shrinkage.csv"}
    assert len(raised.value.faults) == 3


def test_one_film_alone_has_no_standard_error_and_is_not_used(study_of):
    text = "film_id,mass_poured_g,mass_cured_g,mass_conditioned_g\ns1,30,15,10\n"
    found = statistics(study_of(shrinkage=text))
    assert [s.source for s in found if s.quantity == "volume_ratio"] == ["text"]
    assert all(np.isfinite(s.se) and s.se > 0.0 for s in found)


def test_files_that_are_not_there_give_nothing(study_of):
    gone = dict.fromkeys(("tensile", "actuator", "summary", "shrinkage"))
    study = study_of(**gone)
    assert tensile_curves(study, fitted=True) is None
    assert actuator_curves(study) is None
    assert statistics(study) == ()
    assert break_table(study) is not None
