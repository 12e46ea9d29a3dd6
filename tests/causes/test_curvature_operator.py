"""A circle that was fitted though curvatures are stated as bend angle over arc length."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.actuator.reading import operator_ratio
from bayesdeg.assembly.outline import outline
from bayesdeg.assembly.reading import read_study
from bayesdeg.causes.catalogue import find
from bayesdeg.causes.curvature_operator import ARC
from bayesdeg.data.settings import Dimensions, Layer, ReadingOptions, Settings
from bayesdeg.data.study import Study
from tests.causes.default_actuator import conditions_of, effect, inputs_of, surrogate

GELATIN = Path(__file__).parents[2] / "studies" / "gelatin_actuator"
CAUSE = find("curvature_operator")
STATED = ReadingOptions("angle_over_arc")


@pytest.mark.parametrize("share", [0.5, 1.0, -1.0])
def test_curvature_is_multiplied_by_the_ratio_to_its_share_and_nothing_else_moves(share):
    before = surrogate()(inputs_of())
    after = CAUSE.on_reading(before, conditions_of(), effect(circle_share=share))
    ratio_at, group = operator_ratio("circle", 50), np.array(50.0)
    ratio, _ = ratio_at(ARC * before.curvature, group)
    # the usual arc in place of each part's own hardly matters
    np.testing.assert_allclose(ratio, ratio_at(np.radians(before.bend_angle), group)[0], rtol=1e-3)
    np.testing.assert_allclose(after.curvature, ratio**share * before.curvature, rtol=1e-12)
    for name in ("bend_angle", "peak_stretch", "status", "bend_angle_sd"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))


def test_a_circle_reads_a_sixth_more_at_any_pressure():
    before = surrogate()(inputs_of())
    after = CAUSE.on_reading(before, conditions_of(), effect(circle_share=1.0))
    factor = after.curvature / before.curvature
    assert np.all((factor > 1.165) & (factor < 1.2))


def test_without_a_statement_the_candidates_are_those_of_before():
    study = read_study(GELATIN)
    assert study.settings.reading.operator is None
    plan = outline(study)
    assert CAUSE.name in plan.unjudged
    assert CAUSE.name not in {cause.name for cause in plan.candidates}
    stated = outline(replace(study, settings=replace(study.settings, reading=STATED)))
    assert stated.base == plan.base
    assert {c.name for c in stated.candidates} == {c.name for c in plan.candidates} | {CAUSE.name}
    assert set(plan.unjudged) - set(stated.unjudged) == {CAUSE.name}


@pytest.mark.parametrize(
    ("settings", "judged"),
    [
        (Settings(), False),
        (Settings(reading=STATED), True),
        (Settings(reading=ReadingOptions("circle")), False),
        (Settings(reading=STATED, dimensions=Dimensions(length=60.0)), False),
        (Settings(reading=STATED, constraint=Layer("elastomer")), False),
    ],
)
def test_it_is_judged_where_a_statement_may_be_wrong(settings, judged):
    assert (CAUSE.blind_in(Study("s", Path("s"), settings)) is None) == judged


def test_points_of_the_line_leave_nothing_to_state():
    settings = Settings(reading=STATED)
    assert CAUSE.blind_in(Study("s", Path("s"), settings, line_points=12)) is not None
