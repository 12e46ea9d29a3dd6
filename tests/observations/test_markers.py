"""Points along the bottom line become curvatures and bend angles, with the errors that follow."""

import numpy as np
import pandas as pd
import pytest

from bayesdeg.actuator.inputs import Inputs, Prediction
from bayesdeg.actuator.line import OPERATORS, read_line
from bayesdeg.actuator.reading import ReadByOperator, bottom_lines, evenly, operator_ratio
from bayesdeg.assembly.assemble import assemble
from bayesdeg.assembly.outline import outline
from bayesdeg.assembly.reading import read_study
from bayesdeg.data.plausibility import doubts
from bayesdeg.data.study import Why
from bayesdeg.errors import StudyError
from bayesdeg.observations.curvature import actuator_curves
from bayesdeg.observations.markers import angle_errors

COUNT = 12
COLUMNS = ["specimen_id", "degradation_pct", "pressure_kPa", "point", "x_mm", "y_mm", "sd_mm"]


def arc(curvature, *, length=43.0, count=COUNT):
    """Return a circular arc towards the paper [1/m], [mm]."""
    s, k = np.linspace(0.0, length, count), 1e-3 * curvature
    return np.column_stack([np.sin(k * s) / k, (np.cos(k * s) - 1.0) / k])


def table(curvatures, *, specimen="a", sd=0.0, count=COUNT):
    rows = [
        (specimen, 0.0, 20.0 * (i + 1), j + 1, x, y, sd)
        for i, curvature in enumerate(curvatures)
        for j, (x, y) in enumerate(arc(curvature, count=count))
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


def in_pixels(rows, scale=0.05):
    """Return the same lines in the pixels of a picture that is taken from the other side."""
    x, y = 2000.0 - rows["x_mm"] / scale, 300.0 - rows["y_mm"] / scale
    kept = rows.drop(columns=["x_mm", "y_mm"])
    return kept.assign(x_px=x, y_px=y, scale_mm_per_px=scale)


def written(folder, rows, settings="seed = 7"):
    (folder / "study.toml").write_text(settings, encoding="utf-8")
    rows.to_csv(folder / "markers.csv", index=False)
    return folder


def faults(folder):
    with pytest.raises(StudyError) as refused:
        read_study(folder)
    return [str(fault) for fault in refused.value.faults]


@pytest.mark.parametrize("change", [lambda rows: rows, in_pixels])
@pytest.mark.parametrize("operator", OPERATORS)
def test_arcs_are_read_as_what_they_are(tmp_path, change, operator):
    if operator == "base_tip" and change is in_pixels:
        pytest.skip("pixels do not say how the base lies")
    curvatures = [2.0, 5.0, 11.0]
    settings = f'seed = 7\n[reading]\noperator = "{operator}"'
    study = read_study(written(tmp_path, change(table(curvatures)), settings))
    read = study.actuator
    assert study.line_points == COUNT
    assert read["pressure_kPa"].tolist() == [20.0, 40.0, 60.0]
    np.testing.assert_allclose(read["curvature_per_m"], curvatures, rtol=2e-3)
    np.testing.assert_allclose(
        read["bend_angle_deg"], np.degrees(0.043 * np.array(curvatures)), rtol=2e-3
    )
    assert not read["curvature_sd_per_m"].any()


def test_lines_of_one_specimen_at_one_pressure_are_told_apart(tmp_path):
    up = table([3.0, 6.0]).assign(cycle=1, branch="loading", time_s=0.0)
    held = table([3.0, 6.3]).iloc[COUNT:].assign(cycle=1, branch="loading", time_s=60.0)
    down = table([3.5]).assign(cycle=1, branch="unloading", time_s=90.0)
    study = read_study(written(tmp_path, pd.concat([up, held, down])))
    np.testing.assert_allclose(study.actuator["curvature_per_m"], [3.0, 6.0, 6.3, 3.5], rtol=1e-3)
    assert study.actuator["branch"].tolist()[-1] == "unloading"
    assert {"time_s", "cycle", "branch"} <= study.recorded["actuator"]


@pytest.mark.parametrize("operator", OPERATORS)
@pytest.mark.parametrize("curvature", [1.0, 20.0])
def test_errors_are_those_of_lines_that_are_drawn_anew(operator, curvature):
    """Against 800 lines with independent errors, whose scatter is known to 2.5 %."""
    line, sd = arc(curvature), np.linspace(0.02, 0.1, COUNT)
    generator = np.random.default_rng(5)
    noise = sd[:, None] * generator.standard_normal((800, COUNT, 2))
    drawn = np.std([read_line(line + one, operator).angle for one in noise])
    stated = angle_errors([line], operator, [sd])[0]
    assert stated == pytest.approx(drawn, rel=0.08)


def test_between_lines_that_were_moved_errors_are_interpolated():
    lines = [arc(k) for k in np.linspace(1.0, 25.0, 31)]
    sd = [np.full(COUNT, 0.05)] * len(lines)
    together = angle_errors(lines, "circle", sd)
    each = [angle_errors([line], "circle", sd[:1])[0] for line in lines]
    np.testing.assert_allclose(together, each, rtol=0.01)


def test_errors_enter_curvature_and_angle_of_the_model(tmp_path):
    study = read_study(written(tmp_path, table([2.0, 6.0], sd=0.1)))
    curves = actuator_curves(study)
    length = np.radians(curves.bend_angle) / curves.curvature
    np.testing.assert_allclose(np.radians(curves.angle_sd) / curves.curvature_sd, length)
    np.testing.assert_array_equal(
        curves.readings_sd, np.concatenate([curves.curvature_sd, curves.angle_sd], axis=1)
    )
    assert curves.curvature_sd.min() > 0.1


class Mechanics:
    """The contract's reading of a line that the package holds."""

    def __init__(self, place):
        lines = bottom_lines()
        self.angle, self.length = lines.bend_angle[place], lines.arc_length[place]
        self.group = lines.paper_group[place]

    def __call__(self, inputs):
        one = np.ones(np.shape(inputs.pressure))
        curvature = 1e3 * self.angle / self.length * one
        zero = 0.0 * one
        return Prediction(
            curvature, np.degrees(self.angle) * one, one, curvature, zero, zero, zero,
            zero.astype(np.int64),
        )  # fmt: skip

    def inputs(self):
        c1 = 0.3 * np.ones(1)
        stiffness = self.group * c1 * 1e3  # E t = g C1 s, N/m of MPa and mm
        return Inputs(100.0 * c1, c1, 0 * c1, 0 * c1, np.ones(1), stiffness)


@pytest.mark.parametrize("operator", OPERATORS)
def test_the_map_reads_its_own_line_as_the_points_are_read(operator):
    """The same operator on the same finite element lines, to what the fitted ratio misses."""
    missed = {"angle": [], "curvature": []}
    for place in range(len(bottom_lines().points)):
        mechanics = Mechanics(place)
        found = ReadByOperator(mechanics, operator, COUNT, with_angle=True)(mechanics.inputs())
        read = read_line(evenly(bottom_lines().points[place], COUNT), operator)
        missed["curvature"].append(np.log(found.curvature[0] / read.curvature))
        missed["angle"].append(np.log(np.radians(found.bend_angle[0]) / read.angle))
    for name, errors in missed.items():
        sd = operator_ratio(operator, COUNT, of_angle=name == "angle").sd
        assert np.sqrt(np.mean(np.square(errors))) <= sd


def test_the_model_of_points_predicts_what_the_operator_reads(tmp_path):
    study = read_study(written(tmp_path, table([2.0, 6.0])))
    forward = assemble(study).model.world.forward
    assert isinstance(forward, ReadByOperator)
    assert (forward.operator, forward.points, forward.with_angle) == ("angle_over_arc", COUNT, True)
    assert "curvature_operator" in assemble(study).unjudged


def test_errors_of_one_line_go_together(tmp_path):
    model = assemble(read_study(written(tmp_path, table([2.0, 6.0])))).model
    law = next(p.law for p in model.table.parameters if p.name == "reading_correlation")
    assert law.quantile(np.array([0.5]))[0] > 0.8


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t[t["point"] < 4], "has 3 points"),
        (lambda t: t.assign(x_mm=10 * t["x_mm"], y_mm=10 * t["y_mm"]), "is 430 mm long"),
        (lambda t: t.assign(y_mm=None), "coordinates"),
        (lambda t: t.drop(columns="point"), "point: is missing"),
        (lambda t: t.assign(sd_mm=-0.1), "value '-0.1': is below"),
        (lambda t: t.assign(x_mm="left"), "'left': is not"),
        (lambda t: t.assign(point=1.5), "a whole number"),
        (lambda t: pd.concat([t.iloc[:3], t.iloc[2:3].assign(point=3.5e0 + 0.5), t.iloc[4:]]),
         "has point 4 at"),
        (lambda t: pd.concat([t.iloc[COUNT:], t.iloc[:COUNT]]), "in the direction"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(tmp_path, change, said):
    assert any(said in fault for fault in faults(written(tmp_path, change(table([2.0, 6.0])))))


def test_a_line_in_doubt_is_said_to_be_of_points(tmp_path):
    usual = [table([2.0, 6.0], specimen=name) for name in "abc"]
    other = table([16.0, 45.0], specimen="d")
    study = read_study(written(tmp_path, pd.concat([*usual, other])))
    found = doubts(study, outline(study).expected)
    assert any("markers.csv, specimen 'd'" in str(doubt) for doubt in found)
    assert not any("actuator.csv" in str(doubt) for doubt in found)


def test_points_of_an_unloaded_line_are_counted(tmp_path):
    lines = table([0.5, 2.0, 6.0])
    study = read_study(written(tmp_path, lines.assign(pressure_kPa=lines["pressure_kPa"] - 20.0)))
    [one] = study.unused
    assert (one.file, one.why, one.rows) == ("markers.csv", Why.UNLOADED, COUNT)


def test_points_and_curvatures_are_not_both_taken(tmp_path):
    folder = written(tmp_path, table([2.0, 6.0]))
    head = "specimen_id,degradation_pct,pressure_kPa,curvature_per_m\n"
    (folder / "actuator.csv").write_text(f"{head}a,0,20,2\n", encoding="utf-8")
    assert "together with actuator.csv" in faults(folder)[0]


def test_pixels_do_not_say_how_the_base_lies(tmp_path):
    settings = 'seed = 7\n[reading]\noperator = "base_tip"'
    assert (
        "orientation of the base" in faults(written(tmp_path, in_pixels(table([2.0])), settings))[0]
    )


def test_points_are_not_read_as_curves_of_kappa(tmp_path):
    settings = 'seed = 7\n[reading]\noperator = "kappa"\npoints = 6'
    assert "reading.operator" in faults(written(tmp_path, table([2.0]), settings))[0]


def test_points_of_another_actuator_are_refused(tmp_path):
    settings = "seed = 7\n[actuator]\nlength = 60"
    folder = written(tmp_path, table([2.0]), settings)
    assert "default actuator only" in faults(folder)[0]
