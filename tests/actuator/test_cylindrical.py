"""Straight channels beside the axis: their cavity, their walls, a block they do not bend."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.actuator.curve import Actuator, Curve
from bayesdeg.actuator.families import geometry_of
from bayesdeg.actuator.mesh import Resolution, build_mesh
from bayesdeg.actuator.section import air_volume, section
from bayesdeg.actuator.segment import SegmentGeometry
from bayesdeg.data.families import Constraint, CylindricalDimensions
from tests.actuator.geometries import CHANNELS, EXACT, SOFT


def test_the_default_cavity_is_that_of_its_authors():
    """doi:10.1089/soro.2014.0022: 0.31 ml a side."""
    geometry = geometry_of(CylindricalDimensions())
    assert 1e-3 * air_volume(geometry) == pytest.approx(0.31, abs=0.005)


def test_an_even_number_of_channels_leaves_the_middle_solid():
    for count, first in ((1, 0.0), (2, 0.5), (3, 0.0), (4, 0.5)):
        d = replace(CHANNELS, channels=count, width=20.0)
        boxes = SegmentGeometry(d).upper
        assert len(boxes) == (count + 1) // 2
        assert min(across[0] for _, across, _ in boxes) == pytest.approx(first)
    drawn = section(SegmentGeometry(CHANNELS), 64).splitlines()
    assert max(row.count(" ") for row in drawn) == 48  # 12 of 16 mm


@pytest.mark.parametrize("wall_factor", [0.8, 1.2])
@pytest.mark.parametrize("passive", ["open", "none"])
def test_a_channel_gets_narrower_by_what_its_walls_gain(wall_factor, passive):
    geometry = SegmentGeometry(replace(CHANNELS, passive=passive), wall_factor, erosion=0.15)
    assert np.ptp(geometry.upper[0][1]) == pytest.approx(2.0 - 1.0 * (wall_factor - 1.0))


@pytest.mark.fem
def test_a_straight_channel_does_not_bend_an_incompressible_block_to_first_order():
    """Closed form: the moment on its ends is undone by the contraction of the walls it widens.

    With tractions -p n on the walls of the channel and the displacements (yz, (z^2 - y^2)/2), whose
    strain is z times the identity, the stresses across a section have the moment
    int z (s_yy + s_zz) dA = 2 p A z_c. A section bends by int z (s_xx - (s_yy + s_zz)/2) dA, of
    which the ends give int z s_xx dA = p A z_c: nothing is left. A longer channel bends no more.
    """
    gentle = replace(SOFT, c2_ratio=0.0, c3_ratio=0.0, bulk_ratio=1e6)
    angles, beams = [], []
    for length in (24.0, 48.0):
        d = replace(
            CHANNELS, length=length + 8.0, channel_length=length, channels=1, passive="none"
        )
        geometry = SegmentGeometry(replace(d, height=4.0), constraint=Constraint("none"))
        of = Actuator(build_mesh(geometry, Resolution(along=4.0, across=2.0, up=1.0)))
        angles.append(of.solve(Curve((1e-4,), gentle), effort=EXACT).bend_angle[0])
        beams.append(1e-4 * geometry.dimensions.beam_bending)
    longer = (angles[1] - angles[0]) / (beams[1] - beams[0])
    print(f"bending by a longer channel over that of a beam pressed at its ends: {longer:.1e}")
    assert abs(longer) < 1e-3
