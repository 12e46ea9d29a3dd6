"""Faults of units and signs are named; scatter, effects and real data are not taken for them."""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayesdeg.assembly.outline import outline
from bayesdeg.data.plausibility import (
    CURVATURE_UNITS,
    LEAST_FACTOR,
    NEAR_UNIT,
    PRESSURE_UNITS,
    STEEPEST,
    STRESS_UNITS,
    bending_of_beam,
    doubts,
    film_moduli,
    nearest_unit,
    off_neighbours,
    refuse_impossible,
    steepness,
)
from bayesdeg.data.settings import Dimensions, Layer, Paper, SuspectOptions
from bayesdeg.data.study import Study, read_study
from bayesdeg.errors import StudyError
from bayesdeg.observations.curvature import actuator_curves
from bayesdeg.priors import LogNormal

ROOT = Path(__file__).resolve().parents[2]
SHIPPED = [
    *(
        path.parent
        for path in sorted((ROOT / "studies").glob("*/study.toml"))
        # real data that bend by a fifth of what their films say, which is what the doubt is about
        if path.parent.name != "marchese_cylindrical"
    ),
    *(path.parent for path in sorted((ROOT / "tests/hidden_effects/studies").glob("*/study.toml"))),
]


@cache
def shipped(name):
    study = read_study(ROOT / "studies" / name)
    return study, outline(study).expected


def found_in(name, **tables):
    study, expected = shipped(name)
    return doubts(replace(study, **tables), expected)


def times(table, column, factor, specimens=None):
    """Return a table of the gelatin study with a column multiplied, for all or some specimens."""
    frame = getattr(shipped("gelatin_actuator")[0], table).copy()
    rows = slice(None) if specimens is None else frame["specimen_id"].isin(specimens)
    frame.loc[rows, column] = frame.loc[rows, column] * factor
    return frame


def without_angle(frame):
    return frame.assign(bend_angle_deg=np.nan)


# ---- what is sound


@pytest.mark.parametrize(
    "folder", SHIPPED, ids=lambda folder: f"{folder.parent.name}/{folder.name}"
)
def test_studies_with_effects_and_scatter_are_in_no_doubt(folder):
    study = read_study(folder)
    assert doubts(study, outline(study).expected) == ()


def test_there_are_studies_to_be_sound():
    assert len(SHIPPED) >= 25


def silicone_films(c1, factor=1.0):
    """Return a film of a neo-Hookean silicone, its stress times a factor."""
    stretch = np.linspace(1.1, 9.0, 15)
    return pd.DataFrame(
        {
            "specimen_id": "e",
            "degradation_pct": 0.0,
            "degradation_sd_pct": 1.0,
            "mode": "uniaxial",
            "stretch": stretch,
            "stress_MPa": factor * 2.0 * c1 * (stretch - stretch**-2.0),
            "stress_measure": "nominal",
            "temperature_C": np.nan,
        }
    )


def silicone_study(c1, factor=1.0, priors=None):
    """Return films of a silicone and actuators that are as soft: gelatin's, at softer pressures."""
    gelatin, _ = shipped("gelatin_actuator")
    fresh = gelatin.actuator[gelatin.actuator["degradation_pct"] == 0.0]
    soft = fresh.assign(pressure_kPa=fresh["pressure_kPa"] * c1 / 0.3)
    settings = replace(gelatin.settings, priors=priors or {})
    films = silicone_films(c1, factor)
    return Study("silicone", Path(), settings=settings, tensile=films, actuator=soft)


@pytest.mark.parametrize("c1", [0.005, 0.012, 0.06, 3.0])
@pytest.mark.parametrize("stated", [False, True])
def test_a_material_that_is_merely_another_is_in_no_doubt(c1, stated):
    study = silicone_study(c1, priors={"c1_at_0": LogNormal(c1, 0.5)} if stated else None)
    for one in (study, replace(study, actuator=None)):
        assert doubts(one, outline(one).expected) == ()


@pytest.mark.parametrize("c1", [0.005, 0.012, 0.04, 0.3])
@pytest.mark.parametrize("stated", [False, True])
def test_stress_in_kpa_is_refused_whatever_the_material(c1, stated):
    study = silicone_study(c1, 1e3, {"c1_at_0": LogNormal(c1, 0.5)} if stated else None)
    if c1 < 0.01 and not stated:  # 5 MPa: a polyurethane's, were it not for the actuators
        found = doubts(study, outline(study).expected)
        assert any(doubt.impossible for doubt in found)
        return
    for one in (study, replace(study, actuator=None)):
        [doubt] = doubts(one, outline(one).expected)
        assert doubt.impossible
        assert "kPa" in doubt.fault.problem.partition("likely in ")[2]


def layered(c1, unit, body=0.3):
    """Return a study of films and actuators with a layer of elastomer."""
    study = silicone_study(body)
    layer = Layer("elastomer", C1=c1, unit=unit)
    return replace(study, settings=replace(study.settings, paper=Paper(1.0), constraint=layer))


@pytest.mark.parametrize(
    ("c1", "unit", "body", "impossible"),
    [
        (900.0, None, 0.3, None),
        (900.0, "kPa", 0.3, None),
        (0.9, "MPa", 0.3, None),
        (60.0, None, 0.012, None),
        (2.0, "MPa", 0.012, None),
        (0.9, None, 0.3, True),  # 0.9 kPa, a 333rd of the body
        (2.0, None, 0.012, False),  # a sixth of the body: odd, not impossible
        (60.0, None, 0.3, False),
        (0.9, "kPa", 0.3, False),
        (900.0, "MPa", 0.3, False),
    ],
)
def test_a_layer_a_thousandfold_off_is_seen(c1, unit, body, impossible):
    study = layered(c1, unit, body)
    found = doubts(study, outline(study).expected)
    assert [doubt.impossible for doubt in found] == ([] if impossible is None else [impossible])
    for doubt in found:
        assert doubt.fault.column == "constraint.C1"
        assert f"{c1:g} {unit or 'kPa'}" in str(doubt)
        assert (f"{c1:g} MPa" in str(doubt)) is (unit in (None, "MPa"))


def medians(study):
    return {
        p.name: float(p.law.quantile(0.5))
        for p in outline(study).base
        if p.name.startswith(("c1_", "c3_"))
    }


def test_priors_of_c3_go_as_the_c1_that_is_stated_or_that_films_have():
    gelatin = medians(silicone_study(0.3))
    stated = silicone_study(0.012, priors={"c1_at_0": LogNormal(0.012, 0.5)})
    assert medians(stated)["c3_at_0"] / 0.012 == pytest.approx(gelatin["c3_at_0"] / 0.3)
    measured = medians(silicone_study(0.012))
    assert measured["c1_at_0"] == pytest.approx(0.012, rel=1e-9)
    assert measured["c3_at_0"] / 0.012 == pytest.approx(gelatin["c3_at_0"] / 0.3)
    [said] = [cost for what, cost in outline(silicone_study(0.012)).missing if "c1_at_0" in what]
    assert "0.04 times" in said
    assert not [what for what, _ in outline(stated).missing if "c1_at_0" in what]
    own = {"c1_at_0": LogNormal(0.012, 0.5), "c3_at_0": LogNormal(1e-5, 1.0)}
    assert medians(silicone_study(0.012, priors=own))["c3_at_0"] == pytest.approx(1e-5)


def test_priors_of_gelatin_stay_where_its_c1_is_as_expected():
    assert medians(shipped("gelatin_actuator")[0]) == pytest.approx(
        {"c1_at_0": 0.3, "c1_control_12_5": 0.6, "c1_at_25": 1.5}
        | {"c3_at_0": 1.5e-3, "c3_control_12_5": 1e-2, "c3_at_25": 0.1},
        rel=1e-12,
    )


def test_compression_is_no_wrong_sign():
    study, expected = shipped("treloar")
    stretch = np.array([0.5, 0.7, 0.9, 1.2])
    squeezed = pd.DataFrame(
        {
            "specimen_id": "squeezed",
            "degradation_pct": 0.0,
            "degradation_sd_pct": 1.0,
            "mode": "uniaxial",
            "stretch": stretch,
            "stress_MPa": 0.4 * (stretch - stretch**-2.0),
            "stress_measure": "nominal",
        }
    )
    assert doubts(replace(study, tensile=squeezed), expected) == ()


# ---- what is wrong


@dataclass(frozen=True)
class Wrong:
    """One mistake, and what is said of it."""

    tables: dict
    file: str
    column: str
    says: str
    impossible: bool = True
    specimen: str | None = None


def of_films(column, factor, specimens=None):
    return {"tensile": times("tensile", column, factor, specimens)}


def of_actuators(column, factor, specimens=None, *, angle=False):
    frame = times("actuator", column, factor, specimens)
    return {"actuator": frame if angle else without_angle(frame)}


def as_strain(factor, shift):
    frame = shipped("gelatin_actuator")[0].tensile
    return {"tensile": frame.assign(stretch=factor * (frame["stretch"] + shift))}


def at_rest(curvature):
    frame = without_angle(shipped("gelatin_actuator")[0].actuator)
    first = frame.drop_duplicates("specimen_id").assign(pressure_kPa=0.0, curvature_per_m=0.0)
    whole = pd.concat([first, frame]).sort_values(["specimen_id", "pressure_kPa"], kind="stable")
    whole["curvature_per_m"] += curvature
    return {"actuator": whole.reset_index(drop=True)}


def published(quantity, factor):
    frame = shipped("gelatin_actuator")[0].summary.copy()
    rows = frame["quantity"] == quantity
    frame.loc[rows, "value"] = factor * frame.loc[rows, "value"]
    return {"summary": frame}


STRESS, STRETCH = ("tensile.csv", "stress_MPa"), ("tensile.csv", "stretch")
PRESSURE, CURVATURE = ("actuator.csv", "pressure_kPa"), ("actuator.csv", "curvature_per_m")
ANGLE, ELONGATION = ("actuator.csv", "bend_angle_deg"), ("break.csv", "elongation_pct")

WRONG = {
    "stress in kPa": lambda: Wrong(of_films("stress_MPa", 1e3), *STRESS, "likely in kPa"),
    "stress in Pa": lambda: Wrong(of_films("stress_MPa", 1e6), *STRESS, "likely in Pa"),
    "stress in psi": lambda: Wrong(of_films("stress_MPa", 145.04), *STRESS, "likely in psi"),
    "stress in bar": lambda: Wrong(of_films("stress_MPa", 10.0), *STRESS, "likely in bar", False),
    "negative stress": lambda: Wrong(of_films("stress_MPa", -1.0), *STRESS, "the wrong sign"),
    "a film ten times too stiff": lambda: Wrong(
        of_films("stress_MPa", 10.0, ["F10-2"]), *STRESS, "slipped decimal", False, "F10-2"
    ),
    "strain": lambda: Wrong(as_strain(1.0, -1.0), *STRETCH, "likely strain instead of stretch"),
    "strain in percent": lambda: Wrong(as_strain(100.0, -1.0), *STRETCH, "likely strain in perc"),
    "stretch in percent": lambda: Wrong(as_strain(100.0, 0.0), *STRETCH, "likely stretch in perc"),
    "pressure in Pa": lambda: Wrong(of_actuators("pressure_kPa", 1e3), *PRESSURE, "likely in Pa"),
    "pressure in MPa": lambda: Wrong(of_actuators("pressure_kPa", 1e-3), *PRESSURE, "in MPa"),
    "pressure in bar": lambda: Wrong(
        of_actuators("pressure_kPa", 1e-2), *PRESSURE, "likely in bar"
    ),
    "pressure in psi": lambda: Wrong(
        of_actuators("pressure_kPa", 0.145), *PRESSURE, "likely in psi", False
    ),
    "an actuator at ten times the pressure": lambda: Wrong(
        of_actuators("pressure_kPa", 10.0, ["A10-2"], angle=True),
        *PRESSURE,
        "10.1 times that of the actuators nearest in D_R for the same curvature (A10-1, A10-3); "
        "likely in mbar, or with a slipped decimal point",
        False,
        "A10-2",
    ),
    "an actuator in psi": lambda: Wrong(
        of_actuators("pressure_kPa", 0.145, ["A25-1"]), *PRESSURE, "likely in psi", False, "A25-1"
    ),
    "curvature in 1/mm": lambda: Wrong(
        of_actuators("curvature_per_m", 1e-3), *CURVATURE, "likely in 1/mm"
    ),
    "curvature in 1/cm beside its angle": lambda: Wrong(
        of_actuators("curvature_per_m", 1e-2, angle=True), *CURVATURE, "likely in 1/cm"
    ),
    "curvature in degrees a metre": lambda: Wrong(
        of_actuators("curvature_per_m", 57.296), *CURVATURE, "likely in °/m"
    ),
    "an actuator bent ten times as far": lambda: Wrong(
        of_actuators("curvature_per_m", 10.0, ["A10-2"]), *CURVATURE, "9.85 times", False, "A10-2"
    ),
    "an actuator in 1/mm": lambda: Wrong(
        of_actuators("curvature_per_m", 1e-3, ["A10-2"]),
        *CURVATURE,
        "likely in 1/mm",
        specimen="A10-2",
    ),
    "curvature of the wrong sign": lambda: Wrong(
        of_actuators("curvature_per_m", -1.0), *CURVATURE, "is negative"
    ),
    "angle 57 times too large": lambda: Wrong(
        of_actuators("bend_angle_deg", 57.296, angle=True), *ANGLE, "180/π once too often"
    ),
    "angle in radians": lambda: Wrong(
        of_actuators("bend_angle_deg", 1 / 57.296, angle=True), *ANGLE, "likely in radians"
    ),
    "angle of the other sign": lambda: Wrong(
        of_actuators("bend_angle_deg", -1.0, angle=True), *ANGLE, "opposite sign of the curvature"
    ),
    "curvature without pressure": lambda: Wrong(
        at_rest(5.0), *CURVATURE, "at zero pressure", False
    ),
    "humidity as a fraction": lambda: Wrong(
        {"actuator": shipped("gelatin_actuator")[0].actuator.assign(humidity_pct=0.6)},
        "actuator.csv",
        "humidity_pct",
        "fraction",
        False,
    ),
    "absolute pressure": lambda: Wrong(
        {
            "actuator": shipped("gelatin_actuator")[0].actuator.assign(
                pressure_kPa=lambda rows: rows["pressure_kPa"] + 101.3
            )
        },
        *PRESSURE,
        "absolute instead of",
        False,
    ),
    "rates of actuators as fractions": lambda: Wrong(
        of_actuators("degradation_pct", 0.01), "actuator.csv", "degradation_pct", "fraction"
    ),
    "rates of films as fractions": lambda: Wrong(
        of_films("degradation_pct", 0.01), "tensile.csv", "degradation_pct", "fraction"
    ),
    "elongation as a fraction": lambda: Wrong(
        {"breaks": times("breaks", "elongation_pct", 0.01)}, *ELONGATION, "fraction"
    ),
    "one elongation ten times too small": lambda: Wrong(
        {"breaks": times("breaks", "elongation_pct", 0.1, ["F10-2"])},
        *ELONGATION,
        "nearest in D_R",
        False,
        "F10-2",
    ),
    "published modulus in kPa": lambda: Wrong(
        published("young_modulus", 1e3), "summary.csv", "value", "likely in kPa"
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_fault_of_units_is_named_with_its_place_and_what_to_do(name):
    wrong = WRONG[name]()
    found = found_in("gelatin_actuator", **wrong.tables)
    first = found[0].fault
    assert (first.file, first.column) == (wrong.file, wrong.column)
    assert wrong.says in str(found[0])
    assert found[0].impossible is wrong.impossible
    assert first.value
    assert first.remedy
    if wrong.specimen is not None:
        assert [doubt.fault.specimen for doubt in found] == [wrong.specimen]


@pytest.mark.parametrize("name", ["treloar", "treloar_uniaxial"])
@pytest.mark.parametrize("unit", ["kPa", "Pa", "psi"])
def test_real_rubber_in_another_unit_is_refused_by_its_name(name, unit):
    films = shipped(name)[0].tensile
    films = films.assign(stress_MPa=films["stress_MPa"] * STRESS_UNITS[unit])
    [doubt] = found_in(name, tensile=films)
    assert doubt.impossible
    assert f"likely in {unit}" in str(doubt)


@pytest.mark.parametrize("name", ["treloar", "treloar_uniaxial"])
def test_real_rubber_given_as_strain_is_refused(name):
    films = shipped(name)[0].tensile
    found = found_in(name, tensile=films.assign(stretch=films["stretch"] - 1.0 + 1e-9))
    assert "likely strain" in str(found[0])
    with pytest.raises(StudyError, match="likely strain"):
        refuse_impossible(found)


def test_what_all_specimens_share_is_said_once():
    found = found_in("gelatin_actuator", **of_actuators("bend_angle_deg", 57.296, angle=True))
    assert len(found) == 1
    assert "17 of the other 17" in str(found[0])


def test_only_what_is_impossible_is_refused():
    unlikely = found_in("gelatin_actuator", **of_films("stress_MPa", 10.0, ["F10-2"]))
    assert refuse_impossible(unlikely) == unlikely
    wrong = found_in("gelatin_actuator", **of_films("stress_MPa", -1.0))
    with pytest.raises(StudyError) as caught:
        refuse_impossible((*unlikely, *wrong))
    assert caught.value.faults == tuple(doubt.fault for doubt in wrong)


def test_angle_and_curvature_within_the_error_of_reading_are_not_compared():
    """An actuator that burst at the first step: 0.03 1/m and 0.6° are both nothing."""
    frame = shipped("gelatin_actuator")[0].actuator
    burst = frame[(frame["specimen_id"] != "A25-3") | (frame["pressure_kPa"] == 20.0)].copy()
    rows = burst["specimen_id"] == "A25-3"
    burst.loc[rows, ["curvature_per_m", "bend_angle_deg"]] = [0.033, 0.56]
    assert found_in("gelatin_actuator", actuator=burst) == ()


# ---- laws of the parts


@given(st.integers(3, 12), st.integers(0, 2**32), st.floats(-5.0, 5.0))
def test_what_all_specimens_have_in_common_puts_none_off(count, seed, common):
    generator = np.random.default_rng(seed)
    rates = generator.choice([0.0, 5.0, 10.0, 25.0], count)
    # 15 % from specimen to specimen, and twice the usual effect of degradation
    logs = common + 0.15 * np.clip(generator.standard_normal(count), -3, 3) + 0.09 * rates
    assert not off_neighbours(logs[:, None] - logs, rates).any()


@given(
    st.integers(3, 10),
    st.integers(0, 2**32),
    st.floats(1.6 * LEAST_FACTOR, 1e6),
    st.booleans(),
)
def test_one_specimen_that_is_off_is_found_and_no_other(count, seed, factor, too_large):
    generator = np.random.default_rng(seed)
    logs = 0.1 * np.clip(generator.standard_normal(count), -2, 2)
    wrong = int(generator.integers(count))
    logs[wrong] += np.log(factor) if too_large else -np.log(factor)
    off = off_neighbours(logs[:, None] - logs, np.zeros(count))
    assert np.flatnonzero(off).tolist() == [wrong]
    assert np.exp(abs(off[wrong])) == pytest.approx(factor, rel=0.6)


@given(st.floats(0.0, 25.0), st.floats(0.0, 3.0))
def test_a_difference_that_degradation_explains_is_none(apart, share):
    """Two levels of three: as steep as is known, whatever their distance."""
    rates = np.repeat([0.0, apart], 3)
    logs = min(share, 1.0) * STEEPEST * rates
    assert not off_neighbours(logs[:, None] - logs, rates).any()


@pytest.mark.parametrize("units", [STRESS_UNITS, PRESSURE_UNITS, CURVATURE_UNITS])
def test_units_are_told_apart_by_their_factors(units):
    for name, factor in units.items():
        assert nearest_unit(factor, units, NEAR_UNIT) == name
        assert nearest_unit(1.1 * factor, units, NEAR_UNIT) == name
        assert not 1.0 / LEAST_FACTOR < factor < LEAST_FACTOR
    assert nearest_unit(1.0, units, NEAR_UNIT) is None


@given(st.floats(-1.0, 1.0), st.integers(5, 20), st.integers(0, 2**32))
def test_the_steepness_is_that_of_most_specimens(slope, count, seed):
    rates = np.linspace(0.0, 25.0, count)
    logs = slope * rates
    logs[np.random.default_rng(seed).integers(count)] += 50.0
    assert steepness(rates, logs) == pytest.approx(slope, abs=1e-9)


@pytest.mark.parametrize("mode", ["uniaxial", "planar", "equibiaxial"])
@pytest.mark.parametrize("measure", ["nominal", "cauchy"])
def test_the_modulus_of_a_neo_hookean_film_is_exact(mode, measure):
    stretch = np.array([0.8, 1.0, 1.3, 2.0])
    power = {"uniaxial": 2.0, "planar": 3.0, "equibiaxial": 5.0}[mode]
    stress = 2.0 * 0.37 * (stretch - stretch**-power) * (stretch if measure == "cauchy" else 1.0)
    film = pd.DataFrame({"stretch": stretch, "stress_MPa": stress})
    film = film.assign(specimen_id="f", degradation_pct=5.0, mode=mode, stress_measure=measure)
    assert film_moduli(film).loc["f", "c1"] == pytest.approx(0.37)


@given(st.floats(0.3, 3.0))
def test_the_bending_of_a_beam_depends_on_its_shape_alone(scale):
    lengths = {
        name: scale * getattr(Dimensions(), name)
        for name in Dimensions.__dataclass_fields__
        if name != "chambers"
    }
    assert bending_of_beam(Dimensions(**lengths)) == pytest.approx(bending_of_beam(Dimensions()))


def test_a_block_without_slots_is_not_doubted_for_bending_little():
    folder = Path(__file__).parents[2] / "benchmarks" / "geometries_studies" / "inner_channels"
    study = read_study(folder)
    assert study.settings.dimensions.gap == 0.0
    assert doubts(study, outline(study).expected) == ()


VALUES = st.one_of(
    st.floats(-10.0, 1e3),
    st.sampled_from([0.0, 1.0, -1.0, 1e-300, 1e300, -1e300, 0.25]),
)
POSITIVE = VALUES.map(lambda value: abs(value) + 1e-3)


@settings(max_examples=40, deadline=None)
@given(st.data())
def test_whatever_numbers_a_study_holds_the_answer_is_a_list_of_doubts(data):
    def column(values, count):
        return data.draw(st.lists(values, min_size=count, max_size=count))

    count = data.draw(st.integers(1, 5))
    names = column(st.sampled_from(["a", "b", "c"]), count)
    rate = {name: data.draw(st.floats(-5.0, 100.0)) for name in names}
    rates = [rate[name] for name in names]
    films = pd.DataFrame(
        {
            "specimen_id": names,
            "degradation_pct": rates,
            "mode": "uniaxial",
            "stretch": column(POSITIVE, count),
            "stress_MPa": column(VALUES, count),
            "stress_measure": "nominal",
        }
    )
    broken = pd.DataFrame({"specimen_id": [*rate], "degradation_pct": [*rate.values()]})
    broken["elongation_pct"] = column(POSITIVE, len(broken))
    bent = pd.DataFrame(
        {
            "specimen_id": names,
            "degradation_pct": rates,
            "pressure_kPa": column(VALUES, count),
            "curvature_per_m": column(VALUES | st.just(np.nan), count),
            "bend_angle_deg": column(VALUES | st.just(np.nan), count),
            "humidity_pct": np.nan,
            "cycle": 1,
            "branch": column(st.sampled_from(["loading", "unloading"]), count),
        }
    )
    study = Study("any", Path(), tensile=films, breaks=broken, actuator=bent)
    for doubt in doubts(study, shipped("gelatin_actuator")[1]):
        assert str(doubt)


def keeping_all(study):
    return replace(
        study, settings=replace(study.settings, suspects=SuspectOptions(set_aside=False))
    )


def test_a_copied_curve_is_told_with_both_names():
    study, expected = shipped("gelatin_actuator")
    table = study.actuator.copy()
    first, second = (table.index[table["specimen_id"] == name] for name in ("A10-1", "A10-3"))
    table.loc[second, "curvature_per_m"] = table.loc[first, "curvature_per_m"].to_numpy()
    [doubt] = doubts(replace(study, actuator=table), expected)
    [kept] = doubts(replace(keeping_all(study), actuator=table), expected)
    assert str(kept) == str(doubt)
    assert doubt.fault.specimen == "A10-3"
    assert "'A10-1'" in str(doubt)
    assert not doubt.impossible


def test_survivors_alone_are_told_unless_ruptures_are_recorded():
    study, expected = shipped("gelatin_actuator")
    table = study.actuator
    last = table["specimen_id"][table["degradation_pct"] > 22.0].unique()[1:]
    left = table[~table["specimen_id"].isin(last)].reset_index(drop=True)
    [doubt] = doubts(replace(study, actuator=left), expected)
    assert doubt.fault.column == "degradation_pct"
    assert "ruptured" in doubt.fault.remedy
    burst = left.copy()
    burst.loc[burst.index[burst["degradation_pct"] > 22.0][-1], "ruptured"] = 1
    assert doubts(replace(study, actuator=burst), expected) == ()


def many(table, times):
    return pd.concat(
        [table.assign(specimen_id=table["specimen_id"] + f" {k}") for k in range(times)]
    )


def test_one_of_many_specimens_that_is_off_is_found_and_no_other():
    """More than are compared each with each: work and memory must not grow as their square."""
    study, _ = shipped("gelatin_actuator")
    found = {}
    for name, column, copies in (
        ("actuator", "curvature_per_m", 20),
        ("breaks", "elongation_pct", 800),
    ):
        table = many(getattr(study, name), copies)
        table[column] *= 1.0 + 1e-6 * np.arange(len(table))  # no curve is a copy of another
        wrong = table["specimen_id"].iloc[len(table) // 2]
        rows = table["specimen_id"] == wrong
        table.loc[rows, [c for c in (column, "bend_angle_deg") if c in table]] *= 10.0
        found[wrong] = [
            doubt.fault.specimen for doubt in found_in("gelatin_actuator", **{name: table})
        ]
    assert len(found) == 2
    assert all({*named} == {wrong} for wrong, named in found.items())


# ---- angles that were computed, actuators that do not bend, names that look alike


def with_angle_of(length, digits=2, *, rows=slice(None), error=0.0):
    """Return the actuators of the gelatin study with the angle of a length [mm] on some rows."""
    frame = shipped("gelatin_actuator")[0].actuator.copy()
    angle = np.rad2deg(1e-3 * length * frame["curvature_per_m"])
    noise = np.random.default_rng(5).normal(0.0, error, len(frame))
    frame.loc[rows, "bend_angle_deg"] = (angle + noise).round(digits)[rows]
    return frame


@pytest.mark.parametrize("digits", [1, 2, 12])
@pytest.mark.parametrize(("length", "says"), [(60.0, "has 50 mm"), (50.0, "as in study.toml")])
def test_an_angle_computed_from_the_curvature_is_told_with_its_length(length, says, digits):
    [doubt] = found_in("gelatin_actuator", actuator=with_angle_of(length, digits))
    assert (doubt.fault.column, doubt.impossible) == ("bend_angle_deg", False)
    assert f"({length:.1f} mm, " in str(doubt)
    assert says in str(doubt)
    assert "only the curvature" in str(doubt)


def test_computed_angles_of_some_specimens_are_counted():
    frame = shipped("gelatin_actuator")[0].actuator
    rows = frame["specimen_id"] == frame["specimen_id"].iloc[0]
    [doubt] = found_in("gelatin_actuator", actuator=with_angle_of(60.0, rows=rows))
    read = frame["bend_angle_deg"].notna() & frame["curvature_per_m"].notna()
    assert f"on {(rows & read).sum()} of {read.sum()} rows" in str(doubt)


def test_angles_read_with_an_error_beyond_their_digits_are_not_taken_for_computed():
    assert found_in("gelatin_actuator", actuator=with_angle_of(50.0, error=0.05)) == ()


def test_a_computed_angle_carries_nothing_in_the_likelihood():
    study, _ = shipped("gelatin_actuator")
    angles = actuator_curves(study).angle_mask
    computed = actuator_curves(replace(study, actuator=with_angle_of(60.0)))
    assert angles.any()
    assert not computed.with_angle
    assert computed.mask.sum() == actuator_curves(study).mask.sum()


def test_an_angle_of_the_other_sign_within_the_error_of_reading_is_no_fault():
    frame = shipped("gelatin_actuator")[0].actuator
    first = frame[frame["pressure_kPa"] == 20.0].assign(bend_angle_deg=-0.3)
    found = found_in("gelatin_actuator", actuator=first)
    assert not [one for one in found if one.fault.column == "bend_angle_deg"]


@pytest.mark.parametrize("count", [1, 2, 12, 17])
def test_actuators_that_read_nothing_are_named_and_no_other(count):
    frame = without_angle(shipped("gelatin_actuator")[0].actuator)
    dead = frame["specimen_id"].unique()[:count]
    frame.loc[frame["specimen_id"].isin(dead), "curvature_per_m"] = 0.0
    found = found_in("gelatin_actuator", actuator=frame)
    assert [one.fault.specimen for one in found] == [*dead]
    assert all("0 at every pressure" in str(one) for one in found)
    assert all(one.is_alone and not one.impossible for one in found)


def test_where_no_actuator_bends_nothing_is_computed():
    frame = without_angle(shipped("gelatin_actuator")[0].actuator).assign(curvature_per_m=0.0)
    with pytest.raises(StudyError, match="0 at every pressure"):
        refuse_impossible(found_in("gelatin_actuator", actuator=frame))


@pytest.mark.parametrize(
    "other", ["a00-1", "A0-1", "A-00 -1", "\N{FULLWIDTH LATIN CAPITAL LETTER A}00-1"]
)
def test_names_that_look_alike_are_told(other):
    frame = shipped("gelatin_actuator")[0].actuator.copy()
    half = (frame["specimen_id"] == "A00-1") & (frame["pressure_kPa"] > 120.0)
    assert half.any()
    frame.loc[half, "specimen_id"] = other
    [doubt] = [one for one in found_in("gelatin_actuator", actuator=frame) if "nearly" in str(one)]
    assert (doubt.fault.value, doubt.impossible) == ("A00-1", False)
    assert repr(other) in str(doubt)
