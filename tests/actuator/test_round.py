"""A round section with straight channels: its outline, its volumes, its layers."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from bayesdeg.actuator.body import boundary_faces
from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.families import geometry_of, geometry_of_record
from bayesdeg.actuator.mesh import Resolution, build_mesh, reshaped
from bayesdeg.actuator.problem import Problem, System
from bayesdeg.actuator.segment import SegmentGeometry
from bayesdeg.data.families import Constraint
from bayesdeg.errors import GeometryError
from tests.actuator.geometries import ONE_ELEMENT_A_WALL, ROUND, SOFT, cavity

TWO = replace(ROUND, channels=2, channel_width=1.2, pitch=2.4)


def meshed(dimensions=ROUND, constraint=None, resolution=ONE_ELEMENT_A_WALL, **changes):
    geometry = SegmentGeometry(dimensions, constraint=constraint or Constraint(), **changes)
    return build_mesh(geometry, resolution)


@pytest.mark.parametrize("dimensions", [ROUND, TWO, replace(ROUND, passive="solid")])
def test_volumes_are_those_of_an_ellipse_less_its_channels(dimensions):
    """Quadratic bricks meet the ellipse ever closer, with the fourth power of their size."""
    d, whole = dimensions, 0.25 * np.pi * 9.0 * 8.0 * 12.0
    channels = (1 if d.passive == "solid" else 2) * d.channels * d.channel_width * 1.5 * 8.0
    geometry = geometry_of(d)
    assert geometry.volume == pytest.approx(whole - channels, rel=1e-12)
    errors = []
    for size in (1.5, 0.75):
        mesh = meshed(d, resolution=Resolution(12.0, size, size))
        errors.append(abs(2.0 * mesh.body.volume / geometry.volume - 1.0))
        assert 2.0 * cavity(mesh.body)[0] == pytest.approx(
            d.channels * d.channel_width * 1.5 * 8.0, rel=1e-12
        )
    assert errors[0] < 2e-4
    assert errors[1] < errors[0] / 8.0


def test_the_outline_is_the_ellipse_and_the_film_lies_in_the_plane_of_the_axis():
    mesh = meshed(resolution=Resolution(6.0, 2.0, 2.0))
    body = mesh.body
    faces = boundary_faces(body)
    middles = body.nodes[faces].mean(axis=1)
    ends = np.isclose(middles[:, 0], 0.0) | np.isclose(middles[:, 0], 12.0)
    across = (middles[:, 1] / 4.5) ** 2 + ((middles[:, 2] - 4.0) / 4.0) ** 2
    outside = ~ends & (across > 0.9)
    y, z = np.moveaxis(body.nodes[faces[outside]][..., 1:], -1, 0)
    np.testing.assert_allclose((y / 4.5) ** 2 + ((z - 4.0) / 4.0) ** 2, 1.0, rtol=1e-12)
    film = body.nodes[body.paper]
    np.testing.assert_allclose(film[..., 2], 4.0, atol=1e-12)
    assert np.ptp(film[..., 1]) == pytest.approx(4.5, rel=1e-12)
    sizes = np.ptp(film, axis=1)
    assert np.sum(sizes[:, 0] * sizes[:, 1]) == pytest.approx(12.0 * 4.5, rel=1e-12)
    assert np.all(mesh.body.depth >= 0.0)
    assert mesh.body.depth.min() < 0.3


def test_a_film_and_a_slab_off_the_axis_are_plane_all_the_way_out():
    film = meshed(constraint=Constraint("film", height=4.4), resolution=Resolution(6.0, 2.0, 2.0))
    np.testing.assert_allclose(film.body.nodes[film.body.paper][..., 2], 4.4, atol=1e-12)
    slab = Constraint("elastomer", height=4.1, thickness=0.6, c1=60.0)
    body = meshed(constraint=slab, resolution=Resolution(6.0, 0.8, 0.8)).body
    heights = body.nodes[body.elements[body.layer]][..., 2]
    assert (heights.min(), heights.max()) == pytest.approx((3.8, 4.4), abs=1e-12)
    a = np.linspace(-0.2, 0.4, 20001)
    half = np.trapezoid(4.5 * np.sqrt(1.0 - (a / 4.0) ** 2), a) * 12.0
    assert body.weights[body.layer].sum() == pytest.approx(half, rel=1e-5)


def test_walls_and_erosion_move_the_same_bricks():
    mesh = meshed(TWO, resolution=Resolution(6.0, 1.0, 1.0))
    moved = reshaped(mesh, wall_factor=1.1, erosion=0.05)
    anew = build_mesh(moved.geometry, Resolution(6.0, 1.0, 1.0))
    assert 2.0 * moved.body.volume == pytest.approx(moved.geometry.volume, rel=2e-4)
    assert moved.body.volume == pytest.approx(anew.body.volume, rel=2e-5)
    assert geometry_of_record(moved.geometry.record()) == replace(
        moved.geometry, constraint=replace(moved.geometry.constraint, height=4.0)
    )


def test_erosion_to_the_core_is_refused():
    with pytest.raises(GeometryError):
        SegmentGeometry(ROUND, erosion=2.0)


@pytest.mark.parametrize(
    "wrong",
    [
        {"offset": 3.2},
        {"channels": 3, "pitch": 2.9},
        {"channel_width": 8.0},
        {"channel_height": 3.8, "offset": 2.0},
        {"passive": "none", "offset": 5.0},
        {"section": "oval"},
        {"offset": 0.5},
        {"channel_length": 12.0},
    ],
    ids=str,
)
def test_what_cannot_be_made_is_said_in_one_line(wrong):
    problems = replace(ROUND, **wrong).problems()
    assert len(problems) == 1
    assert "\n" not in problems[0]
    assert problems[0].count("; ") == 1
    with pytest.raises(GeometryError):
        geometry_of(replace(ROUND, **wrong))


def test_a_layer_outside_the_room_between_channels_is_refused():
    for passive in ("open", "solid"):
        problems = Constraint(height=1.0).problems(replace(ROUND, passive=passive))
        assert len(problems) == 1


# ---- solved


@pytest.mark.fem
def test_the_pressure_does_the_work_that_the_residual_says():
    """∂V/∂u, the force of a unit pressure, against the volume of the mesh moved a little."""
    problem = Problem(System(meshed().body), SOFT)
    rest = problem.system.rest()
    direction = np.random.default_rng(3).normal(size=rest.displacement.shape)
    volumes = [
        problem.cavity_volume(rest.moved(step * direction, 0.0 * rest.pressure))
        for step in (-1e-5, 1e-5)
    ]
    slope = (volumes[1] - volumes[0]) / 2e-5
    assert np.sum(problem.cavity_gradient(rest) * direction) == pytest.approx(slope, rel=1e-8)


@pytest.mark.long
@pytest.mark.fem
@pytest.mark.slow
def test_finer_meshes_converge_and_a_round_bar_differs_from_its_block():
    curve = Curve((0.3, 0.6), SOFT)
    angles = [
        Actuator(meshed(resolution=Resolution(3.0, size, size, 0.5))).solve(curve).bend_angle
        for size in (2.0, 1.0, 0.5)
    ]
    first, second = (np.abs(b / a - 1.0) for a, b in pairwise(angles))
    assert np.all(second < first)
    assert np.all(second < 0.05)
    block = Actuator(
        meshed(replace(ROUND, section="block"), resolution=Resolution(3.0, 1.0, 1.0, 0.5))
    ).solve(curve)
    assert np.all(np.abs(block.bend_angle / angles[1] - 1.0) > 0.05)
