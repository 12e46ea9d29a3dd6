"""Names of stored solutions and emulators: those of pneunets stay, others have their own."""

from dataclasses import replace

import pytest

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.families import geometry_of, geometry_of_record
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import LayerGroups, MaterialGroups
from bayesdeg.actuator.mesh import COARSE
from bayesdeg.data.families import Constraint, RibbedDimensions
from bayesdeg.data.settings import Dimensions
from bayesdeg.errors import BayesdegError
from bayesdeg.surrogate import solutions
from bayesdeg.surrogate.campaign import build
from bayesdeg.surrogate.kept import Recipe, cached_path, search
from bayesdeg.surrogate.solutions import Kind, Run, SolutionStore, run_of
from bayesdeg.surrogate.trained import surrogate_for

CURVE = Curve((0.2, 0.4), MaterialGroups(-0.014, 0.004, 120.0, paper_thickness=0.1))
OTHERS = (
    geometry_of(RibbedDimensions()),
    geometry_of(RibbedDimensions(channels=5)),
    geometry_of(RibbedDimensions(passive="solid")),
    geometry_of(RibbedDimensions(), Constraint("film", 9.0)),
    geometry_of(RibbedDimensions(), Constraint("none")),
    geometry_of(Dimensions(), Constraint("none")),
    geometry_of(Dimensions(), Constraint("film", 1.0)),
)


def test_solutions_and_emulators_of_pneunets_are_found_under_their_old_names(monkeypatch):
    """Others' caches hold files named by these hashes.

    Those of solutions are of a version that knew one family alone, but for the model's version.
    """
    monkeypatch.setattr(solutions, "MODEL_VERSION", "3")
    geometry = Geometry(Dimensions())
    keys = [Run(geometry, COARSE, CURVE, kind).key()[:16] for kind in Kind]
    assert keys == ["2df5197341c90f3e", "9bbc718e9a7a4c29"]
    assert cached_path(geometry, Recipe()).stem == "c9c9515b536abdb6"
    film = geometry_of(Dimensions(), Constraint("film"))
    assert Run(film, COARSE, CURVE).key() == Run(geometry, COARSE, CURVE).key()
    assert search(film).source is not None


def test_every_other_actuator_has_a_name_of_its_own():
    runs = [Run(g, COARSE, CURVE) for g in (Geometry(Dimensions()), *OTHERS)]
    assert len({run.key() for run in runs}) == len(runs)
    assert len({cached_path(run.geometry, Recipe()) for run in runs}) == len(runs)


def test_a_run_with_a_layer_is_read_with_it():
    layer = Constraint("elastomer", thickness=1.0, c1=60.0)
    curve = replace(CURVE, layer=LayerGroups(8.0, 0.5, 0.1))
    run = Run(geometry_of(Dimensions(), layer), COARSE, curve)
    again = run_of(run.parameters())
    assert again.curve.layer == curve.layer
    assert again.key() == run.key() != Run(run.geometry, COARSE, CURVE).key()


@pytest.mark.parametrize("geometry", OTHERS)
def test_a_run_is_read_from_its_parameters(geometry):
    run = Run(geometry.changed(wall_factor=1.1, erosion=0.05), COARSE, CURVE)
    again = run_of(run.parameters())
    assert again.key() == run.key()
    assert again.geometry.dimensions == geometry.dimensions
    assert geometry_of_record(geometry.record()).record() == geometry.record()
    assert str(run).startswith("curve run")


@pytest.mark.parametrize("geometry", OTHERS)
def test_none_of_the_whole_range_is_trained_or_taken_for_them(geometry, tmp_path):
    found = search(geometry)
    assert found.source is None
    assert found.reasons
    with pytest.raises(BayesdegError):
        surrogate_for(geometry)
    with pytest.raises(BayesdegError):
        build(geometry, SolutionStore(tmp_path))
    assert not list(tmp_path.iterdir())


def test_a_solution_does_not_depend_on_what_a_layer_is_called():
    film, paper = (geometry_of(RibbedDimensions(), Constraint(kind)) for kind in ("film", "paper"))
    assert Run(film, COARSE, CURVE).key() == Run(paper, COARSE, CURVE).key()
    stated = replace(film, constraint=Constraint("film", 9.25))
    assert Run(stated, COARSE, CURVE).key() == Run(film, COARSE, CURVE).key()
