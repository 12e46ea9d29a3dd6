"""Named parameters, vectors and priors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.errors import StudyError
from bayesdeg.inference.model import with_causes
from bayesdeg.material.degradation import NODES
from bayesdeg.observations.curvature import actuator_parameters
from bayesdeg.observations.specimens import elongation_parameters, material_parameters, node_name
from bayesdeg.priors import (
    Choice,
    HalfNormal,
    LogNormal,
    Normal,
    Parameter,
    ParameterTable,
    TruncatedNormal,
    Uniform,
    check_priors,
    with_priors,
)
from tests.inference.small_study import TRUTH, base_parameters, values_of

TABLE = with_causes(base_parameters(), CATALOGUE.values())
MIXED = ParameterTable(
    (
        Parameter("a", Normal(1.0, 2.0), "–", "a"),
        Parameter("b", LogNormal(0.3, 0.5), "MPa", "b"),
        Parameter("c", Uniform(-1.0, 4.0), "–", "c"),
        Parameter("d", HalfNormal(0.1), "–", "d"),
        Parameter("e", TruncatedNormal(0.0, 1.0, 0.0, 3.0), "–", "e"),
    )
)


@settings(max_examples=50)
@given(seed=st.integers(0, 2**32 - 1), shape=st.sampled_from([(), (3,), (2, 4)]))
def test_vectors_to_names_and_back(seed, shape):
    vectors = 2.0 * np.random.default_rng(seed).standard_normal((*shape, len(MIXED)))
    vectors[..., 4] = np.abs(vectors[..., 4])
    values = MIXED.named(vectors)
    assert list(values) == list(MIXED.names) == ["a", "b", "c", "d", "e"]
    assert all(v.shape == shape for v in values.values())
    np.testing.assert_allclose(MIXED.vectors(values), vectors, rtol=1e-9, atol=1e-9)
    assert np.all(values["b"] > 0.0)
    assert np.all((values["c"] > -1.0) & (values["c"] < 4.0))


def test_values_to_a_vector_and_back():
    table = ParameterTable(base_parameters())
    back = table.named(table.vectors(values_of()))
    for name, value in TRUTH.items():
        assert back[name][0] == pytest.approx(value, rel=1e-12), name
    assert set(table.names) == set(TRUTH)


@pytest.mark.parametrize("parameter", MIXED.parameters, ids=lambda p: p.name)
def test_the_prior_of_a_vector_integrates_to_one(parameter):
    table = ParameterTable((parameter,))
    z = np.linspace(-40.0, 40.0, 400001)
    density = np.exp(table.log_prior(z[:, None]))
    assert integrate.trapezoid(density, z) == pytest.approx(1.0, abs=2e-4)


def test_the_prior_is_a_sum_over_parameters():
    vectors = TABLE.sample(np.random.default_rng(1), 5)
    parts = [
        ParameterTable((p,)).log_prior(vectors[:, i : i + 1])
        for i, p in enumerate(TABLE.parameters)
    ]
    np.testing.assert_allclose(TABLE.log_prior(vectors), np.sum(parts, axis=0), rtol=1e-12)


def test_bounds_can_be_left_out_and_only_they_are():
    inside = MIXED.vectors({"a": 1.0, "b": 0.3, "c": 0.0, "d": 0.1, "e": 0.2})
    outside = inside.copy()
    outside[4] = -0.2
    assert MIXED.log_prior(outside) == -np.inf
    np.testing.assert_allclose(
        MIXED.log_prior(outside, truncate=False), MIXED.log_prior(inside, truncate=False)
    )
    assert MIXED.log_prior(inside) == MIXED.log_prior(inside, truncate=False)


def test_prior_draws_follow_the_laws_and_the_seed():
    vectors = TABLE.sample(np.random.default_rng(4), 4000)
    np.testing.assert_array_equal(vectors, TABLE.sample(np.random.default_rng(4), 4000))
    values = TABLE.named(vectors)
    assert np.all(np.isfinite(TABLE.log_prior(vectors)))
    for p in TABLE.parameters:
        if isinstance(p.law, Choice):
            assert np.all(values[p.name] == p.law.state)
            continue
        below = np.mean(values[p.name] < p.law.quantile(0.3))
        assert below == pytest.approx(0.3, abs=4.5 * np.sqrt(0.21 / 4000)), p.name


def test_parameters_of_causes_follow_and_carry_their_names():
    names = TABLE.names
    base = [p.name for p in base_parameters()]
    assert list(names[: len(base)]) == base
    assert list(names[len(base) :]) == [
        f"{cause.name}.{p.name}" for cause in CATALOGUE.values() for p in cause.parameters
    ]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("quantity", "node", "name"),
    [
        ("c1", 0.0, "c1_at_0"),
        ("c1", 12.5, "c1_at_12_5"),
        ("c2_ratio", 25.0, "c2_ratio_at_25"),
        ("c3", 14.9, "c3_at_14_9"),
    ],
)
def test_node_name(quantity, node, name):
    assert node_name(quantity, node) == name
    assert name.isidentifier()


def test_material_parameters_take_the_prior_of_the_nearest_published_level():
    by_name = {
        p.name: p for p in (*material_parameters((2.0, 23.0)), *elongation_parameters((24.0,)))
    }
    assert by_name["c1_at_2"].law.median == 0.3
    assert by_name["c1_at_23"].law.median == 1.5
    assert by_name["elongation_at_24"].law.median == 50.0
    assert all(p.law.low > -1.0 for n, p in by_name.items() if n.startswith("c2_ratio"))


@pytest.mark.parametrize("order", [1, 2, 3])
def test_control_values_of_every_order_have_names_and_priors(order):
    nodes = NODES[order]
    names = [p.name for p in material_parameters(nodes)]
    assert len(set(names)) == 3 * (order + 1)
    assert names[0] == "c1_at_0"
    assert names[-1] == "c3_at_25"
    assert all("_control_" in name for name in names[3:-3])
    assert all(name.isidentifier() for name in names)


def test_noise_is_alike_over_less_than_a_sixth_of_the_pressure_range():
    law = {p.name: p.law for p in actuator_parameters(40.0)}["curvature_noise_length"]
    assert law.support == (0.2, 6.0)


def test_priors_of_a_study_replace_only_those_it_names():
    law = Normal(0.6, 0.01)
    changed = with_priors(base_parameters(), {"volume_ratio": law})
    for before, after in zip(base_parameters(), changed, strict=True):
        assert after.name == before.name
        assert after.unit == before.unit
        assert after.law == (law if before.name == "volume_ratio" else before.law)


def test_priors_of_unknown_parameters_are_all_named_with_what_was_meant():
    known = [p.name for p in base_parameters()]
    check_priors({"volume_ratio": Normal(0.6, 0.1)}, known)
    with pytest.raises(StudyError) as raised:
        check_priors({"volume_ration": Normal(0, 1), "zzz": Normal(0, 1)}, known)
    first, second = raised.value.faults
    assert first.file == second.file == "study.toml"
    assert first.column == "priors.volume_ration"
    assert "did you mean 'volume_ratio'?" in first.remedy
    assert "known: " in second.remedy
    assert "c1_at_0" in second.remedy
