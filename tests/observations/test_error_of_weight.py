"""The emulator's error of what weight does: of studies with mounts, and of bodies with weight."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.emulator.scaling import GROUPS, groups_of
from bayesdeg.observations.curvature import EMULATOR, Curvature, error_of_weight
from tests.inference.small_study import small_model

ALONG, UP = "emulator_error_weight_along", "emulator_error_weight_up"


def met(**weights):
    one = np.ones((1, 1, 1))
    pressure = np.array([[[4.0, 80.0]]])
    inputs = Inputs(pressure, 0.3 * one, 0.0 * one, 0.003 * one, one, 3e4 * one)
    return replace(inputs, **{name: weight * one for name, weight in weights.items()})


@pytest.mark.parametrize(
    ("mounts", "names"),
    [
        (("horizontal",), ()),
        (("horizontal", "hanging"), (ALONG,)),
        (("bending_down",), (UP,)),
        (("hanging", "bending_up"), (ALONG, UP)),
    ],
)
def test_only_ways_in_which_weight_acts_have_a_parameter(mounts, names):
    [own] = small_model().of_kind(Curvature)
    mount = np.resize(np.array(mounts), own.curves.mount.shape)
    found = replace(own, curves=replace(own.curves, mount=mount)).error_parameters
    assert tuple(one.name for one in found) == (*(one.name for one in EMULATOR), *names)


def test_without_weight_there_is_no_error_of_it():
    values = {ALONG: np.array([1.0, -2.0])}
    assert error_of_weight(values, met()) == 0.0
    assert error_of_weight(values, met(weight_up=11.0)) == 0.0
    assert error_of_weight({}, met(weight_along=11.0)) == 0.0
    np.testing.assert_array_equal(error_of_weight(values, met(weight_along=0.0)), 0.0)


def test_it_grows_linearly_to_one_standard_error_at_the_end_of_the_range():
    values = {ALONG: np.array([1.0, -2.0]), UP: np.array([0.5, 0.5])}
    largest = {group.name: group.high for group in GROUPS}
    group = groups_of(met(weight_along=11.0))["gravity_along"].item()
    end = 11.0 * largest["gravity_along"] / group
    found = error_of_weight(values, met(weight_along=end))
    np.testing.assert_allclose(found, np.array([1.0, -2.0])[:, None, None])
    half = error_of_weight(values, met(weight_along=0.5 * end, weight_up=-end))
    np.testing.assert_allclose(half, np.array([0.0, -1.5])[:, None, None], atol=1e-12)
