"""The volume that the cavity takes up: a reference pressure, a hole in an infinite plane."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import Actuator, Curve, ExactMap
from bayesdeg.actuator.families import geometry_of
from bayesdeg.actuator.inputs import Inputs, material_groups
from bayesdeg.actuator.material import MaterialGroups
from bayesdeg.actuator.mesh import Resolution, build_mesh
from bayesdeg.data.families import Constraint, CylindricalDimensions
from tests.actuator.geometries import EXACT, GEOMETRIES, ONE_ELEMENT_A_WALL, RIBBED

ONE = np.ones((1, 1))
C1 = 0.01  # MPa


def inputs(pressure, scale=1.0):
    stiffness = 2e3 * scale * ONE
    return Inputs(
        np.array([pressure]), C1 * ONE, 0 * ONE, 0 * ONE, scale * ONE, stiffness, None, None
    )


def volume_of(forward, inputs):
    """Return the increase of the cavity's volume [ml]."""
    return forward(replace(inputs, asked="cavity_volume")).further.value


@pytest.mark.fem
@pytest.mark.parametrize("name", ["pneunet", "ribbed", "channels"])
def test_the_map_interpolates_volumes_of_equilibria(name):
    """Between the ends of steps, to 1e-3 here."""
    geometry, pressure = GEOMETRIES[name], np.linspace(0.0, 4.0, 17)
    one = inputs(pressure)
    mapped = volume_of(ExactMap(geometry, ONE_ELEMENT_A_WALL), one)[0]
    groups = {key: float(np.ravel(value)[0]) for key, value in material_groups(one).items()}
    curve = Curve(tuple(1e-3 * pressure[1:] / C1), MaterialGroups(**groups))
    of = Actuator(build_mesh(geometry, ONE_ELEMENT_A_WALL))
    solved = of.solve(curve, effort=EXACT)
    volume = 2e-3 * np.array([0.0, *(solved.readings[:, 2] - solved.rest[2])])
    np.testing.assert_allclose(mapped, volume, rtol=1e-3)


@pytest.mark.fem
def test_what_it_takes_up_at_a_reference_pressure_is_taken_off():
    forward = ExactMap(geometry_of(RIBBED), ONE_ELEMENT_A_WALL)
    paper = {"paper_thickness": 0.1 * ONE}
    whole = volume_of(forward, replace(inputs([1.0, 2.0]), **paper))
    off = replace(inputs([1.0, 2.0]), reference_pressure=ONE, **paper)
    np.testing.assert_allclose(
        volume_of(forward, off), [[0.0, whole[0, 1] - whole[0, 0]]], rtol=2e-4, atol=1e-6
    )


@pytest.mark.fem
def test_a_small_channel_in_a_large_block_opens_like_a_hole_in_an_infinite_one():
    """A round hole of radius r in an infinite incompressible plane opens by pi r^2 p/(2 C1).

    That of a square lies between those of the circles that it holds and that hold it, because
    taking material away never stiffens a body.
    """
    d = CylindricalDimensions(
        *(60.0, 20.0, 20.0, 1), channel_length=50.0, channel_width=2.0, channel_height=2.0
    )
    d = replace(d, offset=10.0, height=20.0, passive="none")
    geometry = geometry_of(d, Constraint("none", 5.0))
    forward = ExactMap(geometry, Resolution(along=10.0, across=1.5, up=1.5, grading=0.6))
    pressure = 0.01
    opened = volume_of(forward, inputs([pressure]))[0, 0] * 1e3 / 50.0  # mm² of the section
    shear = 2.0 * C1 * 1e3  # kPa
    inner, outer = (np.pi * r**2 * pressure / shear for r in (1.0, 2.0**0.5))
    print(f"opening over that of the inscribed circle: {opened / inner:.2f}")
    assert inner < opened < outer
