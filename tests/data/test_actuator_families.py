"""Families in study.toml: what is read, and what is refused, with the value and the remedy."""

from dataclasses import replace

import pytest

from bayesdeg.data.families import (
    MOST_CHAMBERS,
    Constraint,
    CylindricalDimensions,
    RibbedDimensions,
)
from bayesdeg.data.settings import Dimensions, Settings, parse_settings
from bayesdeg.laboratory.writing import settings_text

RIBBED = '[actuator]\nkind = "ribbed"\n'
CYLINDRICAL = '[actuator]\nkind = "cylindrical"\n'
ELASTOMER = '[constraint]\n\nkind = "elastomer"\nthickness = 0.8\nC1 = 60.0\n'
LAYER = '[constraint]\nkind = "none"\nheight = 9.0\nthickness = 0.3\n'


def refused(text):
    _, faults = parse_settings(text.encode())
    assert len(faults) == 1, [str(fault) for fault in faults]
    return faults[0]


def test_a_ribbed_segment_with_a_film_is_read():
    text = RIBBED + 'channels = 4\npassive = "solid"\n[constraint]\nkind = "film"\nheight = 7.0\n'
    settings, faults = parse_settings(f"{text}thickness = 0.2\n".encode())
    assert not faults
    assert settings.dimensions == RibbedDimensions(channels=4, passive="solid")
    assert settings.layer == Constraint("film", 7.0)
    assert settings.paper.thickness == 0.2


def test_by_default_nothing_has_changed():
    settings, faults = parse_settings(b'[actuator]\nkind = "pneunet"\n')
    assert not faults
    assert settings == Settings()
    assert settings.layer.height_in(settings.dimensions) == 0.0


@pytest.mark.parametrize(
    "text",
    [
        "seed = 3\n",
        RIBBED,
        RIBBED + "pitch = 2.5\n" + LAYER,
        CYLINDRICAL,
        ELASTOMER + "C2 = -1.0\nC3 = 2.0\nheight = 0.9\n",
        CYLINDRICAL + "channels = 3\noffset = 5.0\n" + LAYER.replace("9.0", "10.5"),
        "[actuator]\nend_wall = 4.0\n[constraint]\nheight = 1.0\n",
    ],
)
def test_settings_are_written_as_they_are_read(text):
    settings, faults = parse_settings(text.encode())
    assert not faults
    again, faults = parse_settings(settings_text(settings).encode())
    assert not faults
    assert again == settings


@pytest.mark.parametrize(
    ("text", "row", "column", "value", "says"),
    [
        (RIBBED + "chambers = 4\n", 3, "actuator.chambers", "4", '"pneunet"'),
        (RIBBED + "end_wall = 3.0\n", 3, "actuator.end_wall", "3.0", '"pneunet"'),
        (CYLINDRICAL + "cover = 3.0\n", 3, "actuator.cover", "3.0", '"ribbed"'),
        (CYLINDRICAL + "ofset = 3.0\n", 3, "actuator.ofset", "3.0", "'offset'"),
        (CYLINDRICAL + "channels = 0\n", 1, "actuator", None, "1 to 200"),
        (CYLINDRICAL + "channels = 10000\n", 1, "actuator", None, "10000"),
        (CYLINDRICAL + "width = 0.0\n", 1, "actuator", None, "width is 0 mm"),
        (CYLINDRICAL + "channel_length = 61.2\n", 1, "actuator", None, "61.2 mm"),
        (CYLINDRICAL + "channel_width = 33.5\n", 1, "actuator", None, "larger width"),
        (CYLINDRICAL + "channels = 7\n", 1, "actuator", None, "36.4 mm across"),
        (CYLINDRICAL + "channels = 2\npitch = 2.0\n", 1, "actuator", None, "larger pitch"),
        (CYLINDRICAL + "offset = 8.5\n", 1, "actuator", None, "9.8 mm above"),
        (CYLINDRICAL + "offset = 1.0\n", 1, "actuator", None, "above 1.4 mm"),
        (CYLINDRICAL + "channel_height = 30.0\noffset = 16.0\n", 1, "actuator", None, "16 mm"),
        (CYLINDRICAL + "[constraint]\nheight = 14.0\n", 3, "constraint", None, "6.3 to 13.3"),
        ("[actuator]\nchannels = 4\n", 2, "actuator.channels", "4", '"ribbed"'),
        (RIBBED + "covre = 4.0\n", 3, "actuator.covre", "4.0", "'cover'"),
        ('[actuator]\nkind = "ribed"\n', 2, "actuator.kind", '"ribed"', "ribbed, cylindrical"),
        (RIBBED + 'passive = "shut"\n', 3, "actuator.passive", '"shut"', "open, pressurised"),
        (RIBBED + "channels = 0\n", 1, "actuator", None, "1 to 200"),
        (RIBBED + "channels = 10000\n", 1, "actuator", None, "10000"),
        (RIBBED + "channels = 3.0\n", 3, "actuator.channels", "3.0", "whole number"),
        (RIBBED + "cover = -1.0\n", 1, "actuator", None, "-1 mm"),
        (RIBBED + "width = 5e3\n", 1, "actuator", None, "5000 mm"),
        (RIBBED + "cover = 7.0\n", 1, "actuator", None, "channel_height"),
        (RIBBED + "channel_width = 40.0\n", 1, "actuator", None, "(32 mm)"),
        (RIBBED + "length = 20.0\n", 1, "actuator", None, "34.12 mm"),
        (RIBBED + "pitch = 0.8\n", 1, "actuator", None, "0.8 mm"),
        (RIBBED + "passage_width = 26.0\n", 1, "actuator", None, "26 mm"),
        (RIBBED + "passage_height = 4.0\n", 1, "actuator", None, "3.1 mm"),
        (RIBBED + "[constraint]\nheight = 30.0\n", 3, "constraint", None, "8.75 to 9.75"),
        (RIBBED + "[constraint]\nheight = 10.0\n", 3, "constraint", None, "10 mm"),
        (ELASTOMER.replace("0.8", "3.0"), 1, "constraint", None, "and 2 mm"),
        (ELASTOMER.replace("0.8", "2e-4"), 1, "constraint", None, "0.0002 mm"),
        (ELASTOMER + "height = 1.8\n", 1, "constraint", None, "1.4 to 2.2"),
        (ELASTOMER + "C2 = -4.0\n", 1, "constraint", None, "C2 above"),
        (ELASTOMER + "C3 = -4.0\n", 6, "constraint.C3", "-4.0", "from 0"),
        (ELASTOMER + "C4 = 1.0\n", 6, "constraint.C4", "1.0", "known key"),
        (ELASTOMER.replace("60.0", "0.0"), 5, "constraint.C1", "0.0", "above 0"),
        ("[constraint]\nC1 = 3.0\n", 2, "constraint.C1", "3.0", "elastomer"),
        ('[constraint]\nunit = "MPa"\n', 2, "constraint.unit", '"MPa"', "elastomer"),
        (f'{ELASTOMER}unit = "Pa"\n', 6, "constraint.unit", '"Pa"', "MPa or kPa"),
        (ELASTOMER.replace("C1 = 60.0", ""), 3, "constraint.kind", '"elastomer"', "C1"),
        (
            ELASTOMER.replace("thickness = 0.8", ""),
            3,
            "constraint.kind",
            '"elastomer"',
            "thickness",
        ),
        ("[constraint]\nheight = 2.5\n", 1, "constraint", None, "0 to 2 mm"),
        ("[constraint]\nheight = -1.0\n", 2, "constraint.height", "-1.0", "at least 0"),
        ('[constraint]\nkind = "steel"\n', 2, "constraint.kind", '"steel"', "paper, film"),
        (
            "[paper]\nthickness = 0.1\n[constraint]\nthickness = 0.2\n",
            4,
            "constraint.thickness",
            "0.2",
            "remove one",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(text, row, column, value, says):
    fault = refused(text)
    assert (fault.row, fault.column, fault.value) == (row, column, value)
    assert says in str(fault)
    assert fault.remedy
    assert "\n" not in str(fault)


def test_several_impossible_dimensions_are_all_named():
    d = RibbedDimensions(width=20.0, cover=9.0, channels=40)
    assert len(d.problems()) == 3
    assert RibbedDimensions(channels=MOST_CHAMBERS, length=560.0).problems() == ()
    assert len(RibbedDimensions(channels=MOST_CHAMBERS + 1, length=560.0).problems()) == 1


def test_channels_across_the_plane_of_the_layer_and_beside_the_block_are_both_named():
    d = CylindricalDimensions(width=2.0, offset=0.5, channel_length=80.0)
    assert len(d.problems()) == 3


def test_a_single_slit_needs_neither_pitch_nor_passage():
    d = RibbedDimensions(channels=1, channel_length=5.0, passage_width=30.0)
    assert d.problems() == ()
    assert d.end_wall == pytest.approx(16.4)


@pytest.mark.parametrize("passive", ["open", "pressurised", "solid"])
@pytest.mark.parametrize("family", [RibbedDimensions, CylindricalDimensions])
def test_a_layer_lies_in_the_middle_of_two_halves(passive, family):
    d = family(passive=passive)
    middle = 0.5 * d.height
    assert Constraint().height_in(d) == middle
    low, high = d.constraint_room
    assert low <= middle <= high
    assert Constraint().height_in(replace(d, passive="none")) == 0.0


def test_beams_of_either_family_do_not_depend_on_the_size():
    for d in (Dimensions(), RibbedDimensions(), CylindricalDimensions()):
        lengths = {n: v for n, v in vars(d).items() if isinstance(v, float)}
        larger = replace(d, **{name: 3.0 * value for name, value in lengths.items()})
        assert larger.beam_bending == pytest.approx(d.beam_bending, rel=1e-12)
