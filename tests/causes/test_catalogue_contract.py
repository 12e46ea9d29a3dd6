"""The contract that every cause of the catalogue keeps."""

import dataclasses
import importlib
import pkgutil
import re

import numpy as np
import pytest

import bayesdeg.causes
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.causes.catalogue import CATALOGUE, find, in_order
from bayesdeg.causes.cause import (
    Conditions,
    Degradation,
    FilmConditions,
    Stage,
    StrengthConditions,
)
from bayesdeg.errors import BayesdegError
from bayesdeg.inference.model import JointModel
from bayesdeg.material.strength import Strength
from bayesdeg.observations.catalogue import TABLES
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.rupture import data_of_actuators
from bayesdeg.observations.specimens import FilmsAndActuators
from tests.inference.small_study import actuator_curves, base_parameters
from tests.surrogate.closed_form import trained

NAMES = (
    "degradation_misread",
    "degraded_skin",
    "erosion",
    "paper_softening",
    "paper_slack",
    "humidity_drift",
    "creep",
    "mullins",
    "pressure_offset",
    "pressure_loss",
    "gravity",
    "wall_thickness",
    "shrinkage_reading",
    "film_mismatch",
    "curvature_reading",
    "curvature_operator",
    "initial_curvature",
    "stress_measure",
    "second_invariant",
    "flaw_embrittlement",
    "dry_embrittlement",
    "uneven_degradation",
    "delamination",
    "degraded_shrinkage",
    "degradation_scale",
    "gauge_gain",
    "batch_stiffness",
    "temperature_softening",
    "hysteresis",
)
SECTIONS = ("Mechanism", "Equation", "Typical size", "Revealed by", "Refuted by", "Source")

each_cause = pytest.mark.parametrize("cause", CATALOGUE.values(), ids=lambda cause: cause.name)


def module_of(name):
    found = [
        module
        for entry in pkgutil.iter_modules(bayesdeg.causes.__path__)
        if hasattr(module := importlib.import_module(f"bayesdeg.causes.{entry.name}"), "CAUSE")
        and module.CAUSE.name == name
    ]
    assert len(found) == 1
    return found[0]


@pytest.fixture(scope="module")
def model():
    world = FilmsAndActuators((0.0, 12.5, 25.0), (0.0, 25.0), trained())
    return JointModel(base_parameters(), (), world).with_observations(
        *data_of_actuators(actuator_curves(), JointModel(base_parameters(), (), world).base)
    )


@pytest.fixture(scope="module")
def base_values(model):
    """Medians of the base parameters, one walker."""
    return {p.name: np.array([float(p.law.quantile(0.5))]) for p in model.base}


def values_of(cause, choose):
    return {cause.qualified(p.name): np.atleast_1d(choose(p)) for p in cause.parameters}


def typical(cause):
    return values_of(cause, lambda p: cause.typical[p.name])


def neutral(cause):
    return values_of(cause, lambda p: p.neutral)


def degradation_of(model):
    return Degradation(
        model.data_of(Curvature).tests.degradation, model.data_of(Curvature).tests.degradation_sd
    )


def conditions_of(model):
    """Up and down again with the clock running, hanging, in a room drier than the storage.

    Specimens are of four batches, and were tested on days of different warmth.
    """
    data = model.data_of(Curvature).tests
    return Conditions(
        np.concatenate([data.pressure, data.pressure[:, -2::-1]], axis=1),
        data.degradation,
        time=20.0 * np.arange(2 * data.pressure.shape[1] - 1),
        unloading=np.arange(2 * data.pressure.shape[1] - 1) >= data.pressure.shape[1],
        humidity=np.array(55.0),
        mount=np.array("hanging"),
        temperature=np.linspace(20.0, 28.0, len(data.degradation))[:, None],
        batch=np.arange(len(data.degradation))[:, None] % 4,
    )


def inputs_of(model):
    one = np.ones((1, 1, 1))
    return Inputs(
        conditions_of(model).pressure[None],
        0.4 * one,
        -0.01 * one,
        0.01 * one,
        0.85 * one,
        3e4 * one,
    )


def films():
    """One film of each mode, one of them labelled as Cauchy stress."""
    stretch = np.broadcast_to([1.1, 1.4, 1.9], (3, 3))
    cauchy = np.zeros((3, 3), bool)
    cauchy[1] = True
    modes = np.array(["uniaxial", "equibiaxial", "planar"])
    rates, rooms = np.array([0.0, 10.0, 24.0]), np.array([22.0, 22.0, np.nan])
    return FilmConditions(stretch, modes, cauchy, rates, rooms, np.array([1, 2, 3]))


STRESS = np.arange(1.0, 10.0).reshape(1, 3, 3)
CONSTANTS = np.array([[[0.3, -0.01, 0.002], [0.6, -0.02, 0.01], [1.4, -0.1, 0.1]]])
STRENGTH = Strength(np.array([[2.1, 2.0, 1.5, 0.9, 0.5]]), np.full((1, 5), 0.1))


@dataclasses.dataclass(frozen=True)
class Stresses:
    stress: np.ndarray


def acted_on(cause, values, model):
    """Every record that a cause has a hook for, before and after it."""
    effect, conditions = cause.effect(values), conditions_of(model)
    pairs = []
    if cause.on_degradation is not None:
        before = degradation_of(model)
        pairs.append((before, cause.on_degradation(before, conditions, effect)))
    if cause.on_inputs is not None:
        before = inputs_of(model)
        after = cause.on_inputs(before, conditions, effect)
        pairs += [
            (before, after),
            (
                model.world.forward(before),
                model.world.forward(after),
            ),
        ]
    if cause.on_reading is not None:
        before = model.world.forward(inputs_of(model))
        pairs.append((before, cause.on_reading(before, conditions, effect)))
    if cause.on_stress is not None:
        after = cause.on_stress(STRESS, films(), effect, CONSTANTS)
        pairs.append((Stresses(STRESS), Stresses(after)))
    if cause.on_strength is not None:
        flat = {name: value[..., 0] for name, value in effect.items()}
        level = model.data_of(Curvature).tests.degradation[None, :, 0]
        slope = np.full(level.shape, -0.056)
        state = StrengthConditions(level, conditions.room_humidity, slope)
        after = cause.on_strength(STRENGTH, state, flat)
        pairs.append((STRENGTH, after))
    return pairs


def assert_same_record(left, right):
    for field in dataclasses.fields(left):
        a, b = getattr(left, field.name), getattr(right, field.name)
        if a is None or b is None:
            given = a if b is None else b
            # a reading relative to zero pressure is the reading itself
            assert given is None or np.all(given == (field.name == "wall_factor")), field.name
        else:
            np.testing.assert_array_equal(*np.broadcast_arrays(a, b), err_msg=field.name)


def differs(pairs):
    for before, after in pairs:
        try:
            assert_same_record(before, after)
        except AssertionError:
            return True
    return False


@each_cause
def test_neutral_values_leave_every_record_exactly_as_it_was(cause, model):
    pairs = acted_on(cause, neutral(cause), model)
    assert pairs
    for before, after in pairs:
        assert_same_record(before, after)


@each_cause
def test_neutral_values_leave_prediction_and_likelihood_exactly_as_they_were(
    cause, model, base_values
):
    extended, values = model.extended(cause), base_values | neutral(cause)
    assert_same_record(
        extended.data_of(Curvature).predicted(extended.tests(values)).prediction,
        model.data_of(Curvature).predicted(model.tests(base_values)).prediction,
    )
    for kind, block in model.log_likelihood(base_values).items():
        np.testing.assert_array_equal(extended.log_likelihood(values)[kind], block)


@each_cause
def test_neutral_values_pass_on_what_other_causes_did(cause, model, base_values):
    """A neutral cause may not undo one that was applied before, as by resetting a reference."""
    for other in CATALOGUE.values():
        if other.name == cause.name:
            continue
        alone = (
            model.extended(other)
            .data_of(Curvature)
            .predicted(model.extended(other).tests(base_values | typical(other)))
            .prediction
        )
        both = (
            model.extended(other, cause)
            .data_of(Curvature)
            .predicted(
                model.extended(other, cause).tests(base_values | typical(other) | neutral(cause))
            )
            .prediction
        )
        assert_same_record(both, alone)


@each_cause
def test_a_prior_draw_changes_something(cause, model):
    draws = values_of(cause, lambda p: p.law.sample(np.random.default_rng(1)))
    assert differs(acted_on(cause, draws, model))


@each_cause
def test_its_size_alone_changes_something(cause, model):
    """With all else neutral."""
    size = cause.parameters[0]
    alone = {cause.qualified(size.name): np.atleast_1d(size.law.quantile(0.8))}
    assert differs(acted_on(cause, neutral(cause) | alone, model))


@each_cause
def test_every_parameter_of_it_matters(cause, model):
    """About its typical size: a time constant means nothing of an effect that is not there."""
    (*_, (_, before)) = acted_on(cause, typical(cause), model)
    for p in cause.parameters:
        moved = {cause.qualified(p.name): np.atleast_1d(p.law.quantile(0.3))}
        (*_, (_, after)) = acted_on(cause, typical(cause) | moved, model)
        assert differs([(before, after)]), p.name


@each_cause
def test_a_draw_changes_the_likelihood_if_and_only_if_the_tests_can_reveal_it(
    cause, model, base_values
):
    """The small study has actuators alone, inflated once, and no clock."""
    seen = {"actuator", "rupture"} & cause.acts_on
    revealed = bool(seen) and cause.blind(model.data_of(Curvature).tests.conditions) is None
    draws = values_of(cause, lambda p: p.law.sample(np.random.default_rng(1)))
    before = model.log_likelihood(base_values)
    after = model.extended(cause).log_likelihood(base_values | draws)
    changed = any(not np.array_equal(before[kind], after[kind]) for kind in before)
    # dry air acts whether its humidity was recorded or not, and friction without unloading too, but
    # they are judged only where it was, and where there is some
    assert changed == (revealed or cause.name in {"dry_embrittlement", "hysteresis"})


@each_cause
def test_prior_draws_give_a_finite_log_density(cause, model, base_values):
    """With the base parameters at their medians, where the actuator is well inside its range."""
    extended = model.extended(cause)
    generator = np.random.default_rng(2)
    draws = {cause.qualified(p.name): p.law.sample(generator, 64) for p in cause.parameters}
    values = {name: np.repeat(v, 64) for name, v in base_values.items()} | draws
    log_prob = extended.log_prob(extended.table.vectors(values))
    assert not np.any(np.isnan(log_prob))
    # a draw may be so large that the actuator would balloon
    assert np.mean(np.isfinite(log_prob)) > 0.9


@each_cause
def test_a_batch_of_effects_is_one_effect_at_a_time(cause, model, base_values):
    generator = np.random.default_rng(3)
    draws = {cause.qualified(p.name): p.law.sample(generator, 5) for p in cause.parameters}
    extended = model.extended(cause)
    together = (
        extended.data_of(Curvature)
        .predicted(extended.tests({k: np.repeat(v, 5) for k, v in base_values.items()} | draws))
        .prediction
    )
    for i in range(5):
        alone = (
            extended.data_of(Curvature)
            .predicted(extended.tests(base_values | {k: v[i : i + 1] for k, v in draws.items()}))
            .prediction
        )
        np.testing.assert_allclose(together.curvature[i], alone.curvature[0], rtol=1e-12)
        np.testing.assert_array_equal(together.status[i], alone.status[0])


@each_cause
def test_the_slope_stays_the_derivative_by_a_loss_of_stiffness(cause, model, base_values):
    """Of gel and paper alike; the specimens' scatter is integrated out along this slope."""
    extended, values = model.extended(cause), base_values | typical(cause)
    h, stiffnesses = 1e-5, ("c1_", "c3_", "paper_stiffness")
    soft, stiff = (
        extended.data_of(Curvature)
        .predicted(
            extended.tests(
                {k: v * np.exp(d) if k.startswith(stiffnesses) else v for k, v in values.items()}
            )
        )
        .prediction.curvature
        for d in (-h, h)
    )
    here, mask = (
        extended.data_of(Curvature).predicted(extended.tests(values)).prediction,
        model.data_of(Curvature).tests.mask[None],
    )
    np.testing.assert_allclose(
        here.slope[mask], ((soft - stiff) / (2.0 * h))[mask], rtol=1e-6, atol=1e-6
    )


@each_cause
def test_its_text_says_what_a_reader_must_know(cause):
    text = module_of(cause.name).__doc__
    places = [re.search(rf"^{section}\n    \S", text, re.MULTILINE) for section in SECTIONS]
    missing = [s for s, place in zip(SECTIONS, places, strict=True) if place is None]
    assert not missing
    assert [p.start() for p in places] == sorted(p.start() for p in places)
    source = text[places[-1].start() :]
    assert re.search(r"doi:10\.\d{4,}/|arXiv:\d", source), "no source that can be looked up"
    assert cause.mechanism
    assert cause.revealed_by


@each_cause
def test_its_parameters_have_units_meanings_neutral_and_typical_values(cause):
    assert cause.parameters
    for p in cause.parameters:
        assert p.unit.strip()
        assert p.meaning
        assert p.neutral is not None
        assert np.isfinite(p.law.log_density(cause.typical[p.name]))
    assert set(cause.typical) == {p.name for p in cause.parameters}
    size = cause.parameters[0]
    assert cause.typical[size.name] != size.neutral


@each_cause
def test_it_can_be_confused_only_with_causes_that_have_a_name(cause):
    assert set(cause.confusable_with) <= set(NAMES) - {cause.name}
    assert set(cause.twins) <= set(cause.confusable_with)
    assert all(cause.name in CATALOGUE[twin].twins for twin in cause.twins)


@each_cause
def test_its_stage_is_that_of_its_hooks(cause):
    assert cause.acts_on
    if cause.on_degradation is not None:
        assert cause.stage is Stage.DEGRADATION
    if cause.on_reading is not None and cause.on_inputs is None:
        assert cause.stage is Stage.READING


@each_cause
def test_what_it_needs_are_columns_of_the_actuators_table(cause):
    assert set(cause.needs) <= TABLES["actuator"].columns.keys()


@each_cause
def test_it_is_blind_to_nothing_where_every_column_was_recorded(cause, model):
    assert cause.blind(conditions_of(model)) is None


@each_cause
def test_a_cause_that_needs_columns_says_why_tests_without_them_are_blind(cause, model):
    data = model.data_of(Curvature).tests
    why = cause.blind(Conditions(data.pressure, data.degradation))
    assert why is None or why == why.strip() != ""
    if cause.needs:
        assert why


def test_the_catalogue_holds_every_file_that_defines_a_cause():
    names = set()
    for entry in pkgutil.iter_modules(bayesdeg.causes.__path__):
        module = importlib.import_module(f"bayesdeg.causes.{entry.name}")
        if hasattr(module, "CAUSE"):
            assert module.CAUSE.name == entry.name
            names.add(entry.name)
    assert names == set(CATALOGUE)


def test_names_are_those_that_were_promised():
    assert set(CATALOGUE) == set(NAMES)
    assert all(name == cause.name for name, cause in CATALOGUE.items())


def test_causes_are_applied_by_stage_and_then_by_name():
    causes = list(CATALOGUE.values())
    assert [(c.stage, c.name) for c in causes] == sorted((c.stage, c.name) for c in causes)
    assert in_order(reversed(causes)) == tuple(causes)
    assert list(Stage) == sorted(Stage)
    in_words = ["DEGRADATION", "MATERIAL", "GEOMETRY", "LOAD", "RESPONSE", "READING"]
    assert [s.name for s in Stage] == in_words


def test_a_model_applies_causes_in_that_order_however_they_are_added(model, base_values):
    causes = list(CATALOGUE.values())
    values = base_values
    for cause in causes:
        values = values | typical(cause)
    forwards, backwards = model.extended(*causes), model.extended(*causes[::-1])
    one_by_one = model
    for cause in causes[::-1]:
        one_by_one = one_by_one.extended(cause)
    assert forwards.causes == backwards.causes == one_by_one.causes == tuple(causes)
    assert forwards.table.names == backwards.table.names
    assert_same_record(
        forwards.data_of(Curvature).predicted(forwards.tests(values)).prediction,
        backwards.data_of(Curvature).predicted(backwards.tests(values)).prediction,
    )


def test_an_unknown_cause_is_refused_with_the_nearest_name():
    with pytest.raises(BayesdegError, match="did you mean 'pressure_offset'"):
        find("presure_offset")
    with pytest.raises(BayesdegError, match=r"known: .*curvature_reading"):
        find("witchcraft")
