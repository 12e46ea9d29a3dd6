"""The trained map against the closed form that it was trained on."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.status import Status
from bayesdeg.emulator.store import from_bytes, to_bytes
from bayesdeg.emulator.surrogate import Surrogate, chebyshev_features, total_degree_orders
from tests.emulator.closed_form import BOX, ClosedFormMap, limit_load, trained

C1, SCALE = 0.4, 0.85


def inputs_at(load, softening, stiffening, paper, *, c1=C1, scale=SCALE):
    """Inputs from p/C1, C2/√(3 C1 C3), ln(C3/C1) and ln(Et/(C1 s))."""
    load, softening, stiffening, paper = (
        np.asarray(v, float) for v in (load, softening, stiffening, paper)
    )
    c3 = c1 * np.exp(stiffening)
    return Inputs(
        pressure=1e3 * c1 * load,
        c1=np.full(np.shape(softening), c1),
        c2=softening * np.sqrt(3.0 * c1 * c3),
        c3=c3,
        linear_scale=np.array(scale),
        paper_stiffness=1e3 * c1 * scale * np.exp(paper),
    )


def random_inputs(count, *, seed=0, shape=(1,), largest=1.0):
    """One material a row, loads of any shape along the columns."""
    generator = np.random.default_rng(seed)
    z = generator.uniform(-1.0, 1.0, (3, count, 1))
    low, high = (np.reshape(bound, (3, 1, 1)) for bound in (BOX.lower, BOX.upper))
    raw = low + (high - low) * (z + 1.0) / 2.0
    load = generator.uniform(0.0, largest, (count, *shape)) * BOX.largest_load(z[1])
    return inputs_at(load, *raw), z[..., 0]


def test_it_recovers_the_analytic_function(surrogate):
    inputs, _ = random_inputs(1000)
    got, want = surrogate(inputs), ClosedFormMap()(inputs)
    ok = got.status == 0
    assert 0.8 < ok.mean() < 1.0  # the closed form balloons in part of the box
    for name in ("curvature", "slope", "peak_stretch", "bend_angle"):
        np.testing.assert_allclose(
            getattr(got, name)[ok], getattr(want, name)[ok], rtol=2e-6, atol=1e-9, err_msg=name
        )


def test_its_own_error_is_of_the_size_of_its_errors(surrogate):
    """The closed form is in the span, so only the ridge is left: parts in 10 million."""
    inputs, _ = random_inputs(1000, seed=4)
    got, want = surrogate(inputs), ClosedFormMap()(inputs)
    ok = got.status == 0
    z = (got.curvature - want.curvature)[ok] / got.sd[ok]
    assert np.all(got.sd[ok] >= 0.0)
    assert 0.2 < np.sqrt(np.mean(z**2)) < 5.0


def test_an_error_of_the_mesh_adds_to_its_own():
    surrogate = trained(mesh_error=0.01)
    inputs, _ = random_inputs(50, seed=4)
    got = surrogate(inputs)
    assert np.mean(got.status == 0) > 0.8
    np.testing.assert_allclose(got.sd, 0.01 * got.curvature, rtol=1e-6)
    assert json.loads(surrogate.record)["mesh_error_pct"] == pytest.approx(1.0)


def test_slope_is_the_derivative_by_pressure_and_by_a_loss_of_stiffness(surrogate):
    inputs, _ = random_inputs(200, seed=1, largest=0.6)
    h = 1e-4
    here = surrogate(inputs)
    up, down = (
        surrogate(dataclasses.replace(inputs, pressure=inputs.pressure * np.exp(d)))
        for d in (h, -h)
    )
    ok = (here.status == 0) & (up.status == 0)
    assert ok.mean() > 0.5
    np.testing.assert_allclose(
        here.slope[ok], ((up.curvature - down.curvature) / (2 * h))[ok], rtol=1e-6
    )
    soft, stiff = (
        surrogate(
            dataclasses.replace(
                inputs,
                c1=inputs.c1 * np.exp(d),
                c2=inputs.c2 * np.exp(d),
                c3=inputs.c3 * np.exp(d),
                paper_stiffness=inputs.paper_stiffness * np.exp(d),
            )
        )
        for d in (-h, h)
    )
    np.testing.assert_allclose(
        here.slope[ok], ((soft.curvature - stiff.curvature) / (2 * h))[ok], rtol=1e-6
    )


def test_nothing_happens_at_zero_pressure(surrogate):
    inputs, _ = random_inputs(50, largest=0.0)
    at_rest = surrogate(inputs)
    np.testing.assert_array_equal(at_rest.status, 0)
    for name in ("curvature", "bend_angle", "slope", "sd"):
        np.testing.assert_array_equal(getattr(at_rest, name), 0.0, err_msg=name)
    np.testing.assert_array_equal(at_rest.peak_stretch, 1.0)


MIDDLE = (0.2, 0.0, float(np.log(0.05)), float(np.log(100.0)))


@pytest.mark.parametrize(
    "point",
    [
        (BOX.load * 1.001, MIDDLE[1], MIDDLE[2], MIDDLE[3]),
        (-1e-6, *MIDDLE[1:]),
        (np.nan, *MIDDLE[1:]),
        (np.inf, *MIDDLE[1:]),
        *(
            (*MIDDLE[: i + 1], bound + sign * 1e-3, *MIDDLE[i + 2 :])
            for i in range(3)
            for bound, sign in ((BOX.lower[i], -1), (BOX.upper[i], 1))
        ),
    ],
)
def test_it_refuses_outside_its_training(surrogate, point):
    assert surrogate(inputs_at(*(np.array([v]) for v in MIDDLE))).status[0] == 0
    refused = surrogate(inputs_at(*(np.array([v]) for v in point)))
    assert Status(int(refused.status[0])) is Status.OUTSIDE_TRAINING
    for name in ("curvature", "slope", "sd", "bend_angle", "peak_stretch"):
        assert np.isnan(getattr(refused, name)[0]), name


@pytest.mark.parametrize(
    ("c1", "c2", "c3"), [(-0.3, 0.0, 0.01), (0.0, 0.0, 0.01), (0.3, 0.0, -0.01), (0.3, 0.0, 0.0)]
)
def test_it_refuses_impossible_materials(surrogate, c1, c2, c3):
    one = np.ones(1)
    inputs = Inputs(50.0 * one, c1 * one, c2 * one, c3 * one, 0.85 * one, 3e4 * one)
    refused = surrogate(inputs)
    assert Status(int(refused.status[0])) is Status.OUTSIDE_TRAINING
    assert np.isnan(refused.curvature[0])


def test_it_refuses_loads_beyond_the_limit_point(surrogate):
    inputs, z = random_inputs(2000, seed=2)
    limits = np.array([limit_load(a, b) for a, b in z[:2].T])
    load = inputs.pressure[:, 0] / (1e3 * C1)
    accepted = surrogate(inputs).status[:, 0] == 0
    assert not np.any(accepted & (load > limits))
    assert np.mean(~accepted[load < 0.8 * limits]) < 0.02


def test_one_material_along_the_loads_gives_what_separate_points_give(surrogate):
    inputs, _ = random_inputs(60, seed=3, shape=(9,))
    spread = Inputs(
        *(
            np.broadcast_to(getattr(inputs, name), (60, 9)).copy()
            for name in ("pressure", "c1", "c2", "c3", "linear_scale", "paper_stiffness")
        )
    )
    together, apart = surrogate(inputs), surrogate(spread)
    for field in dataclasses.fields(together):
        np.testing.assert_allclose(
            getattr(together, field.name),
            getattr(apart, field.name),
            rtol=1e-12,
            err_msg=field.name,
        )
    assert 0.2 < np.mean(together.status == 0) < 1.0


def test_walkers_by_specimens_by_pressures_are_the_same_one_at_a_time(surrogate):
    generator = np.random.default_rng(8)
    pressure = np.linspace(0.0, 90.0, 5)
    c1 = generator.uniform(0.25, 0.4, (4, 3, 1))
    scale = generator.uniform(0.8, 0.9, (4, 1, 1))
    block = surrogate(Inputs(pressure, c1, 0.01 * c1, 0.02 * c1, scale, np.array(3e4)))
    assert block.curvature.shape == block.status.shape == (4, 3, 5)
    for index in np.ndindex(4, 3, 5):
        w, s, p = index
        scalar = surrogate(
            Inputs(
                *(
                    np.array([v])
                    for v in (
                        pressure[p],
                        c1[w, s, 0],
                        0.01 * c1[w, s, 0],
                        0.02 * c1[w, s, 0],
                        scale[w, 0, 0],
                        3e4,
                    )
                )
            )
        )
        assert block.curvature[index] == pytest.approx(scalar.curvature[0], rel=1e-12)


@settings(max_examples=40, deadline=None)
@given(
    load=st.floats(0.01, 0.3),
    stiffer=st.floats(0.2, 6.0),
    scale=st.floats(0.3, 1.5),
    softening=st.floats(-0.6, 0.5),
)
def test_scaling_law(load, stiffer, scale, softening):
    """κ s depends on p/C1, C2/C1, C3/C1 and Et/(C1 s) alone; the bend angle does so without s."""
    surrogate = trained()
    point = (np.array([load]), np.array([softening]), *(np.array([v]) for v in MIDDLE[2:]))
    unit = surrogate(inputs_at(*point, c1=1.0, scale=1.0))
    other = surrogate(inputs_at(*point, c1=stiffer, scale=scale))
    assert other.status[0] == unit.status[0] == 0
    assert other.curvature[0] * scale == pytest.approx(unit.curvature[0], rel=1e-9)
    assert other.bend_angle[0] == pytest.approx(unit.bend_angle[0], rel=1e-9)
    assert other.peak_stretch[0] == pytest.approx(unit.peak_stretch[0], rel=1e-9)


def test_a_reference_pressure_takes_off_what_it_bends(surrogate):
    inputs = inputs_at(np.linspace(0.05, 0.3, 6), *MIDDLE[1:])
    reference = dataclasses.replace(inputs, reference_pressure=np.array([1e3 * C1 * 0.1]))
    plain, relative = surrogate(inputs), surrogate(reference)
    zero = surrogate(inputs_at(np.array([0.1]), *MIDDLE[1:]))
    np.testing.assert_allclose(relative.curvature, plain.curvature - zero.curvature)
    np.testing.assert_allclose(relative.bend_angle, plain.bend_angle - zero.bend_angle)
    np.testing.assert_allclose(relative.slope, plain.slope - zero.slope)
    np.testing.assert_array_equal(relative.peak_stretch, plain.peak_stretch)
    beyond = dataclasses.replace(inputs, reference_pressure=np.array([1e3 * C1 * 2.0]))
    assert np.all(surrogate(beyond).status == Status.OUTSIDE_TRAINING)
    assert np.all(np.isnan(surrogate(beyond).curvature))


def assert_equal_surrogates(left, right):
    for field in dataclasses.fields(Surrogate):
        a, b = getattr(left, field.name), getattr(right, field.name)
        if isinstance(a, np.ndarray):
            assert a.dtype == b.dtype
            np.testing.assert_array_equal(a, b)
        else:
            assert a == b, field.name


def test_arrays_and_bytes_bring_it_back(surrogate):
    assert_equal_surrogates(Surrogate.from_arrays(surrogate.to_arrays()), surrogate)
    assert_equal_surrogates(from_bytes(to_bytes(surrogate)), surrogate)


def test_its_file_holds_no_pickled_object(surrogate):
    assert all(np.asarray(v).dtype.hasobject is False for v in surrogate.to_arrays().values())


def test_its_record_states_how_accurate_it_is(surrogate):
    record = json.loads(surrogate.record)
    assert (record["coarse_curves"], record["fine_curves"]) == (64, 24)
    assert record["terms"] == len(surrogate.orders)
    assert record["left_out_rms_pct"] <= record["left_out_largest_pct"] < 1e-3


@given(degrees=st.lists(st.integers(1, 5), min_size=1, max_size=4))
def test_orders_are_all_those_of_bounded_total_degree(degrees):
    orders = {tuple(row) for row in total_degree_orders(tuple(degrees)).tolist()}
    every = np.ndindex(*(d + 1 for d in degrees))
    product = np.prod(degrees)
    inside = {
        n
        for n in every
        if sum(k * (product // d) for k, d in zip(n, degrees, strict=True)) <= product
    }
    assert orders == inside


def test_features_are_products_of_cosines():
    """T_n(cos t) = cos(n t)."""
    generator = np.random.default_rng(0)
    orders = total_degree_orders((4, 3, 2, 2))
    angles = generator.uniform(0.0, np.pi, (20, 4))
    want = np.prod(np.cos(angles[:, None, :] * orders), axis=-1)
    np.testing.assert_allclose(chebyshev_features(orders, np.cos(angles)), want, atol=1e-12)
