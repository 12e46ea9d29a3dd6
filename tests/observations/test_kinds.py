"""What every kind of data promises, and that a further one needs nothing but its own module."""

from dataclasses import dataclass, replace
from typing import ClassVar, override

import numpy as np
import pytest
from scipy import stats

from bayesdeg.inference.model import JointModel, blocks_of, replicate, without
from bayesdeg.observations.kinds import Grouped, Places, Pointwise
from bayesdeg.observations.published import PublishedTests, of_tests
from bayesdeg.observations.readings import places_of
from tests.inference.small_study import draws_near_truth, small_model, values_of


def whole():
    """The small study with published statistics beside it."""
    tests = PublishedTests(
        degradation=np.array([0.0, 12.5]),
        degradation_sd=np.zeros(2),
        pressure=np.array([20.0, 60.0, 100.0]),
        tested=np.full(2, 3.0),
        r_squared=np.array([0.99, 0.98]),
        ruptured=np.array([0.0, 1.0]),
    )
    return small_model().with_observations(*of_tests(tests))


KINDS = {one.name: one for one in whole().observations}
each_kind = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)


@pytest.fixture(scope="module")
def state():
    model = whole()
    return model.state(model.table.named(draws_near_truth(model, 3)))


def test_all_kinds_of_films_and_actuators_are_there():
    assert list(KINDS) == [
        *("tensile", "actuator", "rupture", "breaks", "statistics"),
        *("r_squared", "ruptures"),
    ]


@each_kind
def test_rows_have_a_density_and_a_group_each(kind, state):
    density = kind.log_likelihood(state)
    assert density.shape == (3, len(kind.labels))
    if isinstance(kind, Grouped):
        assert len(kind.row_groups) == len(kind.labels)
    assert kind.specimens in ((), kind.labels)


@each_kind
def test_some_rows_have_the_densities_that_they_had_among_all(kind, state):
    rows = np.arange(len(kind.labels))[1:]
    fewer = kind.subset(rows)
    assert fewer.labels == kind.labels[1:]
    np.testing.assert_allclose(
        fewer.log_likelihood(state), kind.log_likelihood(state)[:, rows], rtol=1e-10
    )


@pytest.mark.parametrize("name", ["tensile", "actuator"])
def test_readings_are_as_many_everywhere(name, state):
    kind = KINDS[name]
    assert isinstance(kind, Pointwise)
    count = len(kind.places)
    assert kind.observed.shape == (count,)
    assert kind.expected(state).shape == (3, count)
    assert kind.simulate(state, np.random.default_rng(0)).shape == (3, count)
    assert kind.reading_groups.shape == (count,)
    if count:
        assert set(kind.places.specimen) <= set(kind.labels)


@each_kind
def test_factors_sum_to_the_density(kind, state):
    parts = kind.factors(state)
    if parts is None:
        return
    total = sum(np.sum(g, axis=1) for g, _ in parts.events)
    for z, log_sd in parts.normal:
        total = total + np.sum(-0.5 * z**2 - log_sd - 0.5 * np.log(2.0 * np.pi), axis=1)
    np.testing.assert_allclose(total, kind.log_likelihood(state).sum(axis=1), rtol=1e-9)


# ---- one more kind, known to nobody


@dataclass(frozen=True)
class Length(Pointwise, Grouped):
    """Lengths of parts, by calliper: the cube root of the volume ratio, read with 1 %."""

    name: ClassVar[str] = "length"
    priority: ClassVar[int] = 5
    is_criticised: ClassVar[bool] = True

    parts: tuple[str, ...]
    ratio: np.ndarray

    @property
    @override
    def labels(self):
        return self.parts

    @property
    @override
    def places(self) -> Places:
        return places_of(np.zeros(len(self.parts)), kind="length", specimen=list(self.parts))

    @property
    @override
    def observed(self):
        return self.ratio

    @override
    def expected(self, state):
        scale = np.cbrt(state.values["volume_ratio"])
        return np.repeat(scale[:, None], len(self.parts), axis=1)

    @override
    def covariance(self, state):
        return [np.diag(np.full(len(self.parts), 1e-4))]

    @override
    def simulate(self, state, generator):
        mean = self.expected(state)
        return mean + 0.01 * generator.standard_normal(mean.shape)

    @override
    def log_likelihood(self, state):
        return stats.norm(self.expected(state), 0.01).logpdf(self.ratio)

    @override
    def subset(self, rows):
        return Length(tuple(self.parts[r] for r in rows), self.ratio[rows])

    @override
    def replicated(self, state, generator, drawn):
        return (*drawn, replace(self, ratio=self.simulate(state, generator)[0]))


def with_lengths():
    return small_model().with_observations(Length(("p1", "p2", "p3"), np.array([0.85, 0.86, 0.9])))


def test_a_further_kind_is_fitted_held_out_and_simulated_like_all_others():
    model, vectors = with_lengths(), draws_near_truth(small_model(), 4)
    own = model.log_likelihood(model.table.named(vectors))["length"]
    np.testing.assert_allclose(
        model.log_prob(vectors), small_model().log_prob(vectors) + own.sum(axis=1), rtol=1e-11
    )
    assert model.groups == ("p1", "p2", "p3")
    np.testing.assert_allclose(model.group_density(vectors), own)
    np.testing.assert_allclose(
        model.without(np.array([1])).log_prob(vectors), model.log_prob(vectors) - own[:, 1]
    )
    assert len(model.places) == len(small_model().places) + 3
    assert model.scatter(vectors[0]).shape == 2 * (len(model.places),)
    assert "p2" in blocks_of(model)
    assert without(model, ["p1", "a2"]).groups == ("p2", "p3")
    again = replicate(model, values_of(), np.random.default_rng(0))
    assert again.of_kind(Length)[0].ratio.shape == (3,)
    assert isinstance(model, JointModel)


def test_kinds_are_in_one_order_however_they_are_given():
    kinds = small_model().observations
    turned = small_model().with_observations(*reversed(kinds))
    assert [one.name for one in turned.observations] == [one.name for one in kinds]
