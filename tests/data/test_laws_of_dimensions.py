"""Dimensions that are priors: where their laws may lie, and what is refused."""

import numpy as np
import pytest

from bayesdeg.actuator.families import geometry_of_study
from bayesdeg.data.settings import Settings, parse_settings
from bayesdeg.data.uncertain import (
    BEYOND,
    MOST,
    BoundedLaw,
    bounded,
    corners,
    dimensions_among,
    mass_below,
)
from bayesdeg.errors import GeometryError
from bayesdeg.laboratory.writing import settings_text
from bayesdeg.priors import HalfNormal, LogNormal, Normal, StudentT, TruncatedNormal, Uniform

RIBBED = 'kind = "ribbed"\n'


def parsed(text):
    return parse_settings(f"[actuator]\n{text}\n".encode())


def good(text):
    settings, faults = parsed(text)
    assert not faults, [str(fault) for fault in faults]
    return settings


def law(name, **arguments):
    given = "".join(f", {key} = {value}" for key, value in arguments.items())
    return f'{{ law = "{name}"{given} }}'


NARROW = law("normal", mean=2.0, sd=0.2)

# ---- what is read


def test_the_actuator_is_built_at_the_median_and_the_law_is_a_parameter_beside_it():
    settings = good(RIBBED + f"length = {law('normal', mean=40.4, sd=2.6)}")
    assert settings.dimensions.length == 40.4
    (length,) = settings.uncertain
    assert length.law == Normal(40.4, 2.6)
    assert (length.parameter.name, length.parameter.unit) == ("actuator.length", "mm")
    assert length.step == pytest.approx(2.6)


@pytest.mark.parametrize(
    ("text", "median", "step"),
    [
        (law("uniform", low=1.6, high=2.4), 2.0, 0.273),
        (law("lognormal", median=2.0, sigma=0.1), 2.0, 0.2),
        (law("student_t", mean=2.0, sd=0.1, dof=8), 2.0, 0.091),
        (law("truncated_normal", mean=2.0, sd=0.1, low=1.9, high=2.1), 2.0, 0.0622),
    ],
)
def test_every_law_of_priors_may_be_one_of_a_dimension(text, median, step):
    (roof,) = good(f"roof = {text}").uncertain
    assert roof.median == pytest.approx(median)
    assert roof.step == pytest.approx(step, rel=0.02)
    draws = roof.prior.sample(np.random.default_rng(1), 400)
    assert roof.low <= draws.min() < roof.median < draws.max() <= roof.high


def test_an_actuator_of_which_one_dimension_is_a_law_is_not_the_default_one():
    assert good("roof = 2.0").is_default_mould
    assert not good(f"roof = {NARROW}").is_default_mould


def test_what_is_written_is_read_again():
    settings = good(f"roof = {NARROW}\nlength = 52.0")
    again, faults = parse_settings(settings_text(settings).encode())
    assert not faults
    assert again == settings


# ---- where it may lie


def test_a_law_is_taken_within_three_standard_deviations():
    (roof,) = good(f"roof = {NARROW}").uncertain
    assert roof.range == pytest.approx((-3.0, 3.0), abs=1e-3)
    assert roof.lost == 0.0


def test_bounds_of_a_law_are_its_ends():
    (roof,) = good(f"roof = {law('uniform', low=1.6, high=2.4)}").uncertain
    assert (roof.low, roof.high) == (1.6, 2.4)


def test_where_no_actuator_can_be_made_a_little_of_the_law_is_left_out_and_said():
    (length,) = good(RIBBED + f"length = {law('normal', mean=40.4, sd=2.6)}").uncertain
    row = 12 * 2.76 + 1.0
    assert length.low > row
    assert length.lost == pytest.approx(mass_below(Normal(40.4, 2.6), row), rel=1e-6)
    assert float(length.prior.log_density(row)) == -np.inf


REFUSED = [
    pytest.param(
        RIBBED + f"cover = {law('normal', mean=5.65, sd=0.6)}", "actuator.cover", "20 %", id="wall"
    ),
    pytest.param(
        RIBBED + f"length = {law('normal', mean=20.0, sd=1.0)}",
        "actuator",
        "end walls",
        id="median",
    ),
    pytest.param(
        f"roof = {law('normal', mean=-2.0, sd=0.1)}", "actuator", "above 0", id="negative"
    ),
    pytest.param(f"chambers = {NARROW}", "actuator.chambers", "whole number", id="count"),
    pytest.param(RIBBED + f"roof = {NARROW}", "actuator.roof", "ribbed", id="other kind"),
    pytest.param(
        f'kind = "mesh"\nfile = "part.msh"\nlength = {NARROW}', "actuator.length", "mesh", id="mesh"
    ),
    pytest.param(
        f'kind = "mesh"\nfile = "part.msh"\nmesh_error = {NARROW}',
        "actuator.mesh_error",
        "between 0 and 1",
        id="mesh error",
    ),
    pytest.param('roof = { law = "norml", mean = 2.0 }', "actuator.roof", "'normal'", id="law"),
    pytest.param('roof = { law = "normal", mean = 2.0 }', "actuator.roof", "'sd'", id="lacking"),
    pytest.param("roof = { mean = 2.0, sd = 0.1 }", "actuator.roof", "'law'", id="none"),
    pytest.param(
        "\n".join(f"{name} = {NARROW}" for name in ("roof", "floor", "side_wall", "end_wall")),
        "actuator.end_wall",
        str(MOST),
        id="too many",
    ),
    pytest.param(
        RIBBED
        + f"pitch = {law('uniform', low=2.7, high=3.0)}\n"
        + f"length = {law('uniform', low=35.4, high=39.0)}",
        "actuator.pitch",
        "conflicts",
        id="together",
    ),
]


@pytest.mark.parametrize(("text", "column", "said"), REFUSED)
def test_what_is_impossible_is_one_fault_at_its_key(text, column, said):
    settings, faults = parsed(text)
    assert len(faults) == 1, [str(fault) for fault in faults]
    assert faults[0].column == column
    assert said in str(faults[0])
    assert not settings.uncertain


def test_faces_that_fall_together_within_the_range_are_refused():
    text = f"channel_width = {law('normal', mean=5.6, sd=0.2)}\n"
    settings, faults = parsed(text)
    assert faults or _refused(settings)
    assert not _refused(good(f"channel_width = {law('normal', mean=3.0, sd=0.2)}"))


def _refused(settings: Settings) -> bool:
    try:
        geometry_of_study(settings)
    except GeometryError:
        return True
    return False


def test_walls_that_are_as_high_as_others_cannot_move():
    # the slots end as high as the roof begins: bricks of both would part
    text = f"channel_roof = 4.5\nfloor = {NARROW}"
    assert _refused(good(text))


# ---- laws between bounds


@pytest.mark.parametrize(
    "given", [Normal(2.0, 0.3), LogNormal(2.0, 0.2), StudentT(2.0, 0.3, 5.0), HalfNormal(3.0)]
)
def test_a_law_between_bounds_has_a_mass_of_one_and_its_own_shape(given):
    one = bounded(given, 1.7, 2.6)
    x = np.linspace(1.7, 2.6, 20001)
    assert np.trapezoid(np.exp(one.log_density(x)), x) == pytest.approx(1.0, rel=1e-5)
    change = one.log_density(2.2) - one.log_density(1.8)
    assert float(change) == pytest.approx(float(given.log_density(2.2) - given.log_density(1.8)))
    assert one.quantile([0.0, 1.0]) == pytest.approx([1.7, 2.6])
    half = float(one.quantile(0.5))
    below = x <= half
    assert np.trapezoid(np.exp(one.log_density(x[below])), x[below]) == pytest.approx(0.5, abs=1e-3)


def test_laws_that_have_bounds_stay_what_they_are():
    assert bounded(Uniform(0.0, 4.0), 1.0, 9.0) == Uniform(1.0, 4.0)
    assert bounded(TruncatedNormal(2.0, 1.0, 0.0, 3.0), 1.0, 9.0) == TruncatedNormal(
        2.0, 1.0, 1.0, 3.0
    )
    with pytest.raises(ValueError, match="below"):
        BoundedLaw(LogNormal(2.0, 0.1), 3.0, 2.0)
    with pytest.raises(ValueError, match="probability"):
        BoundedLaw(LogNormal(2.0, 0.1), 90.0, 91.0)


def test_the_mass_beyond_is_that_of_three_standard_deviations():
    assert mass_below(Normal(0.0, 1.0), -3.0) == pytest.approx(BEYOND, rel=1e-3)


def test_corners_are_all_dimensions_a_step_off():
    settings = good(f"roof = {NARROW}\nside_wall = {NARROW}")
    found = [
        tuple(round(value, 6) for value in one.values()) for one in corners(settings.uncertain)
    ]
    assert sorted(found) == [(1.8, 1.8), (1.8, 2.2), (2.2, 1.8), (2.2, 2.2)]


def test_names_of_parameters_say_which_are_dimensions():
    assert dimensions_among(["c1_at_0", "actuator.roof", "erosion.depth"]) == ("roof",)
