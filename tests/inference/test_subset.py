from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.inference.model import blocks_of, without
from bayesdeg.observations.breaks import Breaks
from bayesdeg.observations.curvature import Curvature
from bayesdeg.observations.tensile import Tensile
from tests.inference.small_study import altered, draws_near_truth, small_model


@pytest.fixture(scope="module")
def model():
    return small_model()


@pytest.fixture(scope="module")
def values(model):
    return model.table.named(draws_near_truth(model, 3))


def test_the_likelihood_of_those_that_stay_is_unchanged(model, values):
    fewer = without(model, ["f2", "a1", "a5", "b3"])
    kept = {"tensile": [0, 2, 3], "actuator": [1, 2, 3], "breaks": [0, 1]}
    before, after = model.log_likelihood(values), fewer.log_likelihood(values)
    for kind, rows in kept.items():
        np.testing.assert_allclose(after[kind], before[kind][:, rows], rtol=1e-12)
    np.testing.assert_array_equal(after["statistics"], before["statistics"])
    assert fewer.table.names == model.table.names


def test_a_table_without_specimens_is_gone(model, values):
    fewer = without(model, ["b1", "b2", "b3"])
    assert not fewer.of_kind(Breaks)
    assert "breaks" not in fewer.log_likelihood(values)


def test_leaving_out_nothing_changes_nothing(model, values):
    vectors = model.table.vectors(values)
    np.testing.assert_array_equal(without(model, []).log_prob(vectors), model.log_prob(vectors))


def test_the_order_of_names_does_not_matter(model, values):
    vectors = model.table.vectors(values)
    np.testing.assert_array_equal(
        without(model, ["a1", "f1"]).log_prob(vectors),
        without(model, ["f1", "a1"]).log_prob(vectors),
    )


def test_an_unknown_name_is_refused(model):
    with pytest.raises(ValueError, match="no specimen zz"):
        without(model, ["f1", "zz"])


def test_one_name_in_two_tables_or_two_modes_is_one_block(model):
    tensile = replace(model.data_of(Tensile).tests, specimens=("f1", "f1", "f3", "f4"))
    breaks = replace(model.data_of(Breaks).table, specimens=("f3", "b2", "b3"))
    shared = altered(model, tensile=tensile, breaks=breaks)
    blocks = blocks_of(shared, ("tensile", "breaks"))
    assert list(blocks) == ["f1", "f3", "f4", "b2", "b3"]
    assert {kind: rows.tolist() for kind, rows in blocks["f3"].items()} == {
        "tensile": [2],
        "breaks": [0],
    }
    assert blocks["f1"]["tensile"].tolist() == [0, 1]
    assert without(shared, ["f3"]).data_of(Breaks).table.specimens == ("b2", "b3")
    assert without(shared, ["f1"]).data_of(Tensile).tests.specimens == ("f3", "f4")


def test_statistics_are_of_no_specimen(model):
    of = {one.name: one.specimens for one in model.observations}
    assert of["statistics"] == ()
    assert of["rupture"] == model.data_of(Curvature).tests.specimens
