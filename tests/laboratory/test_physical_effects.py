"""Effects by physics of a laboratory: what they are, and how far the catalogue's rules agree."""

from dataclasses import fields, replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.catalogue import CATALOGUE, find
from bayesdeg.causes.cause import Conditions
from bayesdeg.laboratory.experiment import Design
from tests.surrogate.closed_form import ClosedFormMap

with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    physical = import_module("physical_effects")
    hidden = import_module("hidden_studies")
    benchmark = import_module("hidden_effects")

OF_RUPTURE = {"flaw_embrittlement", "dry_embrittlement", "uneven_degradation"}
EFFECTS = {name: make(1.0, np.random.default_rng(1)) for name, make in physical.HAPPENS.items()}
EXACT = [n for n, one in EFFECTS.items() if one.exact and one.met is not None]


def design_of(*names):
    effects = [EFFECTS[name] for name in names]
    [name] = {physical.DESIGN_OF.get(name, "careful") for name in names}
    whole = hidden.designs()[name]
    return physical.design_with(effects, whole, "")


def inputs_of(design):
    tests = physical.Tests(design.actuator)
    pressure = tests.column("pressure_kPa").astype(float)[None]
    one = np.ones((1, pressure.shape[1], 1))
    return Inputs(pressure, 0.3 * one, -0.01 * one, 0.003 * one, 0.85 * one, 3e4 * one), tests


def conditions_of(tests):
    batch = np.zeros(tests.column("pressure_kPa").shape, dtype=np.int64)
    if "batch" in tests.table:
        batch = (tests.column("batch") == physical.DENSE).astype(np.int64)
    path = {}
    if "branch" in tests.table:
        path["cycle"] = tests.column("cycle").astype(np.int64)
        path["unloading"] = tests.column("branch") == "unloading"
    pressure = tests.column("pressure_kPa").astype(float)
    return Conditions(pressure, tests.level, batch=batch, **path)


def test_every_entry_that_shows_in_readings_happens():
    assert set(physical.HAPPENS) == set(CATALOGUE) - OF_RUPTURE - {"curvature_operator"}
    for name, one in EFFECTS.items():
        assert one.cause == name
        known = {parameter.name for parameter in find(name).parameters}
        assert set(one.values) <= known


@pytest.mark.parametrize("name", EXACT)
def test_what_is_called_exact_is_what_the_rule_says(name):
    """The rule takes part in no study; here it is asked whether its size is the one stated."""
    effect, cause = EFFECTS[name], find(name)
    inputs, tests = inputs_of(design_of(name))
    met = effect.met(inputs, tests)
    sizes = {p.name: p.neutral for p in cause.parameters} | dict(effect.values)
    values = {cause.qualified(k): np.array([float(v)]) for k, v in sizes.items()}
    ruled = cause.on_inputs(inputs, conditions_of(tests), cause.effect(values))
    for one in fields(met):
        mine, its = getattr(met, one.name), getattr(ruled, one.name)
        if isinstance(mine, np.ndarray) and one.name != "reference_pressure":
            assert np.allclose(mine, its, rtol=1e-9, atol=1e-12), one.name


def test_a_trace_above_the_bottom_is_on_a_larger_circle():
    inputs, tests = inputs_of(design_of("curvature_reading"))
    prediction = ClosedFormMap()(inputs)
    effect, cause = EFFECTS["curvature_reading"], find("curvature_reading")
    read = effect.read(prediction, tests).curvature
    sizes = {"fibre_height": effect.values["fibre_height"], "magnification": 0.0}
    values = {cause.qualified(k): np.array([v]) for k, v in sizes.items()}
    ruled = cause.on_reading(prediction, conditions_of(tests), cause.effect(values)).curvature
    assert read == pytest.approx(ruled, rel=1e-9)


def test_a_leak_of_gas_loses_a_smaller_share_of_more_pressure():
    inputs, tests = inputs_of(design_of("pressure_loss"))
    inside = EFFECTS["pressure_loss"].met(inputs, tests).pressure
    lost = 1.0 - (inside / inputs.pressure)[0, 0]
    assert np.all(np.diff(lost) < 0.0)
    assert np.all((lost > 0.0) & (lost < 0.15))
    tiny = replace(inputs, pressure=np.full((1, 1, 1), 1e-3))
    # the resistances share what drives the flow; for small differences that is pressure itself
    assert EFFECTS["pressure_loss"].met(tiny, tests).pressure == pytest.approx(0.85e-3, rel=1e-3)


@pytest.mark.parametrize("name", ["erosion", "wall_thickness"])
@pytest.mark.parametrize("size", physical.SIZES)
def test_actuators_of_other_dimensions_can_be_made(name, size):
    for seed in range(4):
        effect = physical.HAPPENS[name](size, np.random.default_rng(seed))
        for level in (0.0, 10.0, 25.0):
            assert effect.moulded(level).problems() == ()
    eaten = physical.HAPPENS["erosion"](size, np.random.default_rng(0)).moulded(0.0)
    assert eaten == physical.Dimensions()


def test_studies_are_drawn_alike_again_and_every_entry_in_turn():
    names = [name for name in physical.HAPPENS if name not in physical.LATER]
    first = physical.SINGLE_DRAW
    drawn = [physical.drawn_by_physics(first + k, seed=3) for k in range(len(names))]
    assert [one.physics[0].cause for one in drawn] == names
    again = physical.drawn_by_physics(first + 5, seed=3)
    assert (again.design, again.size) == (drawn[5].design, drawn[5].size)
    for k in range(12):
        pair = physical.drawn_by_physics(physical.PAIR_DRAW + k, seed=3)
        assert len({one.cause for one in pair.physics}) == 2
        assert not any(one.is_solved for one in pair.physics)
    later = physical.drawn_by_physics(physical.LATER_DRAW + len(physical.LATER), seed=3)
    assert later.physics[0].cause == physical.LATER[0]


def test_a_valve_that_rubs_holds_back_what_is_less_than_its_friction():
    """Within the dead band nothing moves, and without friction chambers follow the knob."""
    inside = physical.behind_valve(np.array([5.0, 50.0, 45.0, 30.0, 0.0]), 9.0)
    np.testing.assert_allclose(inside, [0.0, 41.0, 41.0, 39.0, 9.0], atol=1e-9)
    np.testing.assert_allclose(physical.behind_valve(np.array([50.0, 10.0]), 0.0), [50.0, 10.0])


@pytest.mark.parametrize(("cause", "designs"), hidden.IMITATIONS, ids=lambda one: str(one)[:9])
def test_an_imitation_changes_readings_of_its_designs_and_is_no_entry(cause, designs):
    [(name, size)] = cause.typical.items()
    assert cause.name not in CATALOGUE
    for design in designs:
        tests = physical.Tests(hidden.designs()[design].actuator)
        conditions = conditions_of(tests)
        if "time_s" in tests.table:
            conditions = replace(conditions, time=tests.column("time_s").astype(float))
        one = np.ones((1, *conditions.pressure.shape[:1], 1))
        plain = Inputs(
            conditions.pressure[None], 0.3 * one, -0.01 * one, 0.003 * one, one, 3e4 * one
        )

        def read(value, plain=plain, conditions=conditions):
            effect = {name: np.full((1, 1, 1), value)}
            inputs = cause.on_inputs(plain, conditions, effect) if cause.on_inputs else plain
            prediction = ClosedFormMap()(inputs)
            if cause.on_reading:
                prediction = cause.on_reading(prediction, conditions, effect)
            return prediction.curvature

        np.testing.assert_allclose(read(0.0), ClosedFormMap()(plain).curvature, rtol=1e-12)
        changed = read(size) / read(0.0) - 1.0
        assert np.all(np.isfinite(changed))
        assert np.max(np.abs(changed)) > 0.02


def test_imitations_are_drawn_in_turn_beyond_all_other_numbers():
    first = hidden.IMITATING_DRAW
    assert first > physical.LATER_DRAW
    drawn = [hidden.drawn_study(first + k, seed=3) for k in range(len(hidden.IMITATIONS))]
    assert [one.names for one in drawn] == [(cause.name,) for cause, _ in hidden.IMITATIONS]
    assert {one.kind for one in drawn} == {"outside"}


def test_films_of_the_reference_design_are_what_cameras_of_the_area_make_of_them():
    tables = {"tensile": Design().tensile.assign(stretch=1.5, stress_MPa=2.0)}
    effect = EFFECTS["stress_measure"]
    stress = effect.recorded(tables, np.random.default_rng(0))["tensile"]["stress_MPa"]
    assert stress.to_numpy() == pytest.approx(2.0 * 1.5, rel=1e-6)


@pytest.mark.slow
def test_a_study_is_planted_without_any_rule(tmp_path, monkeypatch):
    """No function of a cause is called while it is made; the twin differs by the effect alone."""
    study = physical.drawn_by_physics(physical.SINGLE_DRAW, seed=6)
    how = {"forward": benchmark.library(), "seed": 6, "command": "a test"}

    def forbidden(*arguments, **more):
        raise AssertionError("a rule was asked")

    for cause in CATALOGUE.values():
        for hook in ("on_inputs", "on_reading", "on_stress", "on_degradation"):
            if getattr(cause, hook) is not None:
                monkeypatch.setitem(cause.__dict__, hook, forbidden)
    _, changes = physical.made_by_physics(study, tmp_path / "study", **how)
    # a gauge that shows 8 kPa too much at 20 kPa takes two fifths of the curvature away
    assert np.min(changes["pressure_offset"]) < -0.5
    assert not (tmp_path / "study" / "truth.json").exists()
