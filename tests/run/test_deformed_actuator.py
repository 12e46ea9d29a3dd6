from dataclasses import replace

import meshio
import numpy as np
import pytest

from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.mesh import Resolution
from bayesdeg.analysis.calibrate import Fit
from bayesdeg.causes.catalogue import find
from bayesdeg.data.settings import Dimensions
from bayesdeg.inference.sampling import Chain
from bayesdeg.observations.curvature import Curvature
from bayesdeg.pages.figures.actuator import deformed_figure
from bayesdeg.pages.folder import RunFolder
from bayesdeg.pages.surface import SURFACE, read_surface
from bayesdeg.run.deformed import STEPS, fitted_cases, write_deformed
from tests.actuator.geometries import geometry_of_file
from tests.actuator.parts import half, tetrahedral, whole, write
from tests.inference.small_study import TRUTH, altered, draws_near_truth, small_model

pytestmark = pytest.mark.fem

TWO_CHAMBERS = Geometry(Dimensions(length=20.0, chambers=2))
COARSEST = Resolution(along=9.0, across=9.0, up=9.0)
SCALE = np.cbrt(TRUTH["volume_ratio"])


def fit_of(model, vectors):
    chain = Chain(vectors[None, :, None], np.zeros((1, len(vectors), 1)), np.ones(1))
    return Fit(model=model, laplace=None, evidence=None, chain=chain, diagnosis=None)


@pytest.fixture(scope="module")
def fit():
    """Draws whose median is the truth."""
    model = small_model()
    draws = draws_near_truth(model, 6)
    centre = draws_near_truth(model, 1, spread=0.0)
    return fit_of(model, np.concatenate([draws, 2.0 * centre - draws, centre]))


@pytest.fixture(scope="module")
def run(fit, tmp_path_factory):
    folder = RunFolder(tmp_path_factory.mktemp("run"))
    (folder.path / "actuator_7pct.vtu").write_text("of an earlier run", encoding="utf-8")
    write_deformed(folder, fit, TWO_CHAMBERS, resolution=COARSEST)
    return folder.path


def test_the_groups_are_those_of_the_posterior_medians(fit):
    fresh, degraded = fitted_cases(fit)
    assert (fresh.degradation, degraded.degradation) == (0.0, 25.0)
    for case, name in ((fresh, "0"), (degraded, "25")):
        c1, c3 = TRUTH[f"c1_at_{name}"], TRUTH[f"c3_at_{name}"]
        assert case.c1 == pytest.approx(c1)
        assert case.linear_scale == pytest.approx(SCALE)
        np.testing.assert_allclose(case.curve.loads, case.pressures * 1e-3 / c1)
        np.testing.assert_allclose(case.pressures, np.linspace(0.0, 140.0, STEPS + 1)[1:])
        assert case.curve.material.c3_ratio == pytest.approx(c3 / c1)
        paper = TRUTH["paper_stiffness"] * 1e-3 / (c1 * SCALE)
        assert case.curve.material.paper_group == pytest.approx(paper)


def test_a_cause_in_the_fitted_model_is_at_work(fit):
    cause = find("pressure_loss")
    model = small_model().extended(cause)
    named = [cause.qualified(p.name) for p in cause.parameters]
    values = {name: np.array([value]) for name, value in TRUTH.items()}
    with_loss = fit_of(model, model.table.vectors(values | {n: np.array([0.2]) for n in named}))
    for case, without in zip(fitted_cases(with_loss), fitted_cases(fit), strict=True):
        np.testing.assert_array_equal(case.pressures, without.pressures)
        assert case.curve.loads[-1] < 0.95 * without.curve.loads[-1]


def test_the_run_folder_gets_every_state_and_nothing_of_an_earlier_run(run):
    names = sorted(path.name for path in run.iterdir())
    assert names == ["actuator_0pct.vtu", "actuator_25pct.vtu", SURFACE]
    surface = read_surface(run)
    assert [shape.degradation for shape in surface.shapes] == [0.0, 25.0]
    assert [shape.pressure for shape in surface.shapes] == [140.0, 140.0]


@pytest.mark.parametrize(
    ("made", "is_half"),
    [(half, True), (whole, False), (lambda: tetrahedral(whole()), False)],
    ids=["half", "whole", "whole of tetrahedra"],
)
def test_a_meshed_part_is_solved_and_drawn(fit, tmp_path, made, is_half):
    geometry = geometry_of_file(write(tmp_path / "part.msh", made()))
    write_deformed(RunFolder(tmp_path), fit, geometry)
    surface = read_surface(tmp_path)
    assert surface.is_half is is_half
    assert [shape.pressure for shape in surface.shapes] == [140.0, 140.0]
    across = np.array([[s.rest[:, 1].min(), s.rest[:, 1].max()] for s in surface.shapes])
    np.testing.assert_allclose(across, SCALE * np.array([[0.0 if is_half else -5.0, 5.0]] * 2))
    *panels, _ = deformed_figure(surface).axes
    assert len(panels) == (4 if is_half else 2)


def test_the_solved_actuators_are_at_true_size_and_bend_towards_the_paper(run):
    drops = []
    for shape in read_surface(run).shapes:
        assert shape.rest[:, 0].max() == pytest.approx(20.0 * SCALE, rel=1e-6)
        clamped = np.isclose(shape.rest[:, 0], 0.0)
        np.testing.assert_allclose(shape.placed[clamped], shape.rest[clamped], atol=1e-6)
        end = np.isclose(shape.rest[:, 0], shape.rest[:, 0].max())
        drops.append(np.mean(shape.rest[end, 2] - shape.placed[end, 2]))
        assert shape.stretch.min() >= 1.0
    assert drops[0] > 3.0 * drops[1] > 0.0


def test_the_export_and_the_picture_show_the_same_state(run):
    for shape in read_surface(run).shapes:
        mesh = meshio.read(run / f"actuator_{shape.degradation:g}pct.vtu")
        tip = np.argmax(mesh.points.sum(axis=1))
        same = np.argmax(shape.rest.sum(axis=1))
        placed = mesh.points[tip] + mesh.point_data["displacement_mm"][tip]
        np.testing.assert_allclose(shape.placed[same], placed, atol=1e-5)
        largest = mesh.point_data["largest_principal_stretch"][tip]
        assert shape.stretch[same] == pytest.approx(largest, rel=1e-6)


def test_beyond_the_last_equilibrium_the_state_before_it_is_shown(fit, tmp_path):
    model = fit.model
    pressed = altered(
        model, actuator=replace(model.data_of(Curvature).tests, pressure=np.full((5, 7), 3000.0))
    )
    write_deformed(
        RunFolder(tmp_path), replace(fit, model=pressed), TWO_CHAMBERS, resolution=COARSEST
    )
    fresh, degraded = read_surface(tmp_path).shapes
    assert (fresh.degradation, degraded.degradation) == (0.0, 25.0)
    assert fresh.pressure in np.linspace(0.0, 3000.0, STEPS + 1)[1:-1]
    assert degraded.pressure == 3000.0


def test_an_actuator_without_any_equilibrium_is_left_out(fit, tmp_path):
    values = {name: np.array([value]) for name, value in TRUTH.items()}
    balloon = {"c1_at_0": np.array([1e-3]), "c3_at_0": np.array([1e-6])}
    soft = fit_of(fit.model, fit.model.table.vectors(values | balloon))
    write_deformed(RunFolder(tmp_path), soft, TWO_CHAMBERS, resolution=COARSEST)
    (shape,) = read_surface(tmp_path).shapes
    assert shape.degradation == 25.0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["actuator_25pct.vtu", SURFACE]
