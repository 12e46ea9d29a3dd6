"""Colours of the page, read from its style: contrast, and what colour-blind readers see."""

import itertools
import re
from importlib.resources import files

import numpy as np
import pytest
from matplotlib.colors import to_rgb

STYLE = files("bayesdeg.pages").joinpath("templates", "page.css").read_text(encoding="utf-8")
LEVELS = [f"level-{index}" for index in range(8)]
GRAPHIC, TEXT = 3.0, 4.5  # WCAG 2.2, 1.4.11 and 1.4.3

# Machado, Oliveira and Fernandes (2009), doi:10.1109/TVCG.2009.113, of linear RGB, severity 1
SEEN_BY = {
    "all cones": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)


def colours(scheme):
    light, dark = re.findall(r":root \{(.*?)\}", STYLE, flags=re.DOTALL)[:2]
    found = re.findall(r"--([\w-]+): (#[0-9a-f]{6});", light + (dark if scheme == "dark" else ""))
    return dict(found)


def linear(colour):
    value = np.array(to_rgb(colour))
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def contrast(one, other):
    dark, bright = sorted(TO_XYZ[1] @ linear(colour) for colour in (one, other))
    return (bright + 0.05) / (dark + 0.05)


def lab(colour, seen_by):
    """CIE L*a*b* under D65, as seen by eyes that lack a kind of cones."""
    rgb = np.clip(np.array(SEEN_BY[seen_by]) @ linear(colour), 0.0, 1.0)
    x, y, z = np.cbrt(np.maximum(TO_XYZ @ rgb / (TO_XYZ @ np.ones(3)), 0.008856))
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


def test_contrast_is_that_of_its_definition():
    assert contrast("#ffffff", "#000000") == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.005)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_curves_stand_out_from_the_page(scheme):
    known = colours(scheme)
    for name in (*LEVELS, "base", "final", "muted"):
        assert contrast(known[name], known["paper"]) >= GRAPHIC, name


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_words_can_be_read_on_what_they_stand_on(scheme):
    known = colours(scheme)
    pairs = [(name, "paper") for name in ("ink", "muted", "final", "base")]
    pairs += [(name, f"{name}-tint") for name in ("good", "warn", "bad", "final")]
    pairs += [("ink", "warn-tint"), ("ink", "final-tint"), ("muted", "panel")]
    for text, ground in pairs:
        assert contrast(known[text], known[ground]) >= TEXT, (text, ground)


@pytest.mark.parametrize("seen_by", SEEN_BY)
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_levels_rise_in_lightness_and_differ_to_all_eyes(scheme, seen_by):
    known = colours(scheme)
    seen = [lab(known[name], seen_by) for name in LEVELS]
    for one, other in itertools.pairwise(seen):
        assert other[0] - one[0] > 3.0
        assert np.linalg.norm(other - one) > 5.5  # a difference of 2.3 is just seen
