"""Studies whose actuators have dimensions that are priors: checked, simulated, trained for."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from bayesdeg import training
from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.families import geometry_of_study, with_dimensions
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.status import Resolution
from bayesdeg.assembly.assemble import assemble
from bayesdeg.commands import run as run_command
from bayesdeg.commands import simulate
from bayesdeg.data.study import read_study
from bayesdeg.errors import BayesdegError
from bayesdeg.pages.record import VerdictRecord
from bayesdeg.surrogate import local
from bayesdeg.surrogate.kept import Recipe, rough_seconds
from bayesdeg.surrogate.solutions import SolutionStore
from bayesdeg.surrogate.trained import default_surrogate, read_trained
from tests.commands.test_ribbed_study import ACTUATOR, SEGMENT, STIFF, TINY
from tests.run.study_files import SETTINGS, study_in
from tests.run.tiny_campaign import COARSE, FINE

COVER = '{ law = "normal", mean = 1.0, sd = 0.05 }'
LENGTH = '{ law = "uniform", low = 8.5, high = 9.5 }'
UNCERTAIN = SEGMENT.replace("cover = 1.0", f"cover = {COVER}")
BOTH = UNCERTAIN.replace("length = 9.0\nwidth", f"length = {LENGTH}\nwidth")
ROOF = '[actuator]\nroof = { law = "normal", mean = 2.0, sd = 0.1 }\n'


@pytest.fixture
def command(command):
    """Run a command on a study of stated settings."""

    def write(text):
        study_in(command.study, {"study.toml": SETTINGS + text, "actuator.csv": ACTUATOR})

    command.write = write
    return command


# ---- check


def test_check_shows_a_dimension_with_its_uncertainty_and_the_time_of_training(command):
    command.write(BOTH)
    code, said = command("check")
    assert code == 0
    (cover,) = (line for line in said.splitlines() if line.startswith("cover"))
    assert re.findall(r"[\d.]+", cover) == ["1", "0.05", "0.85", "1.15"]
    (length,) = (line for line in said.splitlines() if line.startswith("length"))
    assert re.findall(r"[\d.]+", length)[:2] == ["9", "0.34"]
    study = read_study(command.study)
    known = rough_seconds(study.settings.dimensions, study.settings.layer)
    moved = rough_seconds(
        study.settings.dimensions, study.settings.layer, moved=study.settings.uncertain
    )
    assert 2.5 < moved / known < 4.0


def test_of_the_default_actuator_nothing_but_its_departure_is_trained(command):
    command.write(ROOF)
    assert command("check")[0] == 0
    study = read_study(command.study)
    mould, moved = study.settings.dimensions, study.settings.uncertain
    assert rough_seconds(mould, moved=moved, alone=True) < rough_seconds(mould, moved=moved)


WIDE, MISSPELT = (
    '{ law = "normal", mean = 1.0, sd = 0.9 }',
    '{ law = "nrmal", mean = 1.0 }',
)
MESH = f'[actuator]\nkind = "mesh"\nfile = "part.msh"\nlength = {LENGTH}\n'
LEVEL = "[actuator]\nchannel_roof = 4.5\nfloor = " + ROOF.partition(" = ")[2]
IMPOSSIBLE = {
    "wall": (SEGMENT.replace("cover = 1.0", f"cover = {WIDE}"), "cover"),
    "law": (SEGMENT.replace("cover = 1.0", f"cover = {MISSPELT}"), "'normal'"),
    "count": (SEGMENT.replace("channels = 2", f"channels = {COVER}"), "whole number"),
    "kind": (SEGMENT.replace("cover = 1.0", f"cover = 1.0\nroof = {COVER}"), "ribbed"),
    "mesh": (MESH, "mesh"),
    "twice": (f"[priors]\n'actuator.roof' = {COVER}\n{ROOF}", "actuator.roof"),
    "operator": (f"[reading]\noperator = 'circle'\n{ROOF}", "operator"),
    "together": (LEVEL, "merge"),
}


@pytest.mark.parametrize(("text", "said"), IMPOSSIBLE.values(), ids=IMPOSSIBLE)
@pytest.mark.parametrize("name", ["check", "run"])
def test_what_is_impossible_is_one_line_and_ends_with_2(command, name, text, said):
    (command.study / "study.toml").write_text(SETTINGS + text, encoding="utf-8")
    (command.study / "actuator.csv").write_text(ACTUATOR, encoding="utf-8")
    code, told = command(name)
    assert code == 2
    assert said in told
    assert "Traceback" not in told
    assert len([line for line in told.splitlines() if said in line]) == 1


def test_emulate_refuses(command):
    command.write(ROOF)
    code, said = command("emulate")
    assert code == 2
    assert "roof" in said


# ---- the model


def test_a_dimension_is_a_parameter_where_actuators_are_predicted(command):
    command.write(ROOF)
    study = read_study(command.study)
    with pytest.raises(BayesdegError, match="roof"):
        assemble(study, default_surrogate())
    model = assemble(study, ExactMap(geometry_of_study(study.settings), COARSE)).model
    (found,) = (one for one in model.base if one.name.startswith("actuator."))
    assert (found.name, found.unit) == ("actuator.roof", "mm")
    values = {"actuator.roof": np.array([1.9, 2.1])}
    assert model.world.sizes(values)["roof"].shape == (2, 1, 1)
    (command.study / "actuator.csv").unlink()
    alone = assemble(read_study(command.study)).model
    assert not any(one.name.startswith("actuator.") for one in alone.base)


# ---- simulate


@pytest.mark.fem
def test_simulated_actuators_have_the_median_or_a_drawn_dimension(command, monkeypatch):
    monkeypatch.setattr(simulate, "FINE", Resolution(9.0, 9.0, 9.0))
    command.write("[actuator]\nlength = 14.0\nchambers = 1\n" + ROOF.partition("\n")[2])
    true = {}
    for name, options in {"median": (), "drawn": ("--draw-material",)}.items():
        code, said = command("simulate", "--out", name, "--workers", "1", "--quiet", *options)
        assert code == 0, said
        folder = command.study.parent / name
        true[name] = json.loads((folder / "truth.json").read_text("utf-8"))["constants"]
        assert read_study(folder).settings.uncertain == read_study(command.study).settings.uncertain
    assert true["median"]["actuator.roof"] == 2.0
    drawn = true["drawn"]["actuator.roof"]
    assert drawn != 2.0
    assert 1.7 <= drawn <= 2.3


# ---- training


@pytest.fixture
def trains(command, monkeypatch):
    """Let 'run' train on tiny meshes, and go no further than to the emulator."""
    found = []

    def run_study(_study, _folder, _checkpoints, *, forward, **_):
        found.append(forward)
        return VerdictRecord(outcome="adequate", explanation="nothing was calibrated")

    command.write(BOTH + STIFF)
    for name in ("tensile.csv", "break.csv", "summary.csv"):
        (command.study / name).unlink()
    monkeypatch.setattr(training, "LOCAL", lambda _dimensions: TINY)
    monkeypatch.setattr(training, "ROUNDS", 0)
    monkeypatch.setattr(training, "LAST_ROUNDS", 0)
    monkeypatch.setattr(local, "DEPARTING", 6)
    monkeypatch.setattr(local, "DEPARTING_FINE", 1)
    monkeypatch.setattr(run_command, "run_study", run_study)
    monkeypatch.setattr(run_command, "add_page", lambda _folder, page, _guard: (page, None))
    command.found = found
    return command


def inputs_of(shape=(1, 1, 1), **dimensions):
    one = np.ones(shape)
    return Inputs(
        np.array([10.0, 25.0, 40.0]),
        0.06 * one,
        0.0 * one,
        6e-4 * one,
        0.85 * one,
        2e5 * one,
        dimensions={name: np.full(shape, value) for name, value in dimensions.items()},
    )


@pytest.mark.long
@pytest.mark.fem
@pytest.mark.slow
def test_run_trains_the_departure_and_goes_on_where_it_stopped(trains):
    """It meets exact curves at dimensions that were not solved, and finds its emulator again."""
    assert trains("run", "--workers", "1", "--yes", "--quiet")[0] == 0
    store = SolutionStore(trains.study.parent / ".cache/campaign")
    first = {path.name: path.read_bytes() for path in sorted(store.folder.glob("*.npz"))}
    (kept,) = (trains.study.parent / ".cache/emulators").glob("*.npz")
    whole = kept.read_bytes()
    kept.unlink()
    for name in list(first)[::5]:
        (store.folder / name).unlink()
    assert trains("run", "--workers", "1", "--yes", "--quiet")[0] == 0
    again = {path.name: path.read_bytes() for path in sorted(store.folder.glob("*.npz"))}
    assert again == first
    assert kept.read_bytes() == whole
    assert trains("run", "--workers", "1", "--yes", "--quiet")[0] == 0
    assert kept.read_bytes() == whole

    surrogate = read_trained(kept)
    assert surrogate.departure is not None
    assert set(surrogate.departure.names) == {"cover", "length"}
    record = json.loads(surrogate.record)["dimensions_moved"]
    assert record["cover"]["accuracy"]["curvature"]["p95_pct"] < 1.0
    geometry = geometry_of_study(read_study(trains.study).settings)
    exact = ExactMap(geometry, TINY.fine_mesh)
    still = inputs_of(cover=1.0, length=9.0)
    for values in ({"cover": 1.07, "length": 9.0}, {"cover": 0.96, "length": 8.8}):
        moved = inputs_of(**values)
        wanted = np.log(exact(moved).curvature / exact(still).curvature)
        got = np.log(surrogate(moved).curvature / surrogate(still).curvature)
        known = np.isfinite(got)
        assert known.sum() >= 2
        away = surrogate.departure.away(moved.dimensions, (1, 1, 1))
        sd = np.hypot(*(surrogate.departure.error[:2, 0] * surrogate.departure.sizes(away)[:2, 0]))
        assert sd < 5e-3
        # a wall is one brick, and the coarse bricks are twice as long: a tenth of the change
        assert np.max(np.abs(got - wanted)[known]) < 0.1 * np.max(np.abs(wanted))
    own = ExactMap(with_dimensions(geometry, {"cover": 1.07}), TINY.fine_mesh)
    plain = replace(still, dimensions=None)
    np.testing.assert_allclose(
        own(plain).curvature, exact(inputs_of(cover=1.07)).curvature, rtol=2e-2
    )


TINY_PNEUNET = Recipe(COARSE, FINE, coarse_runs=8, fine_runs=2)


@pytest.mark.long
@pytest.mark.fem
def test_of_the_default_actuator_only_moved_curves_and_their_twins_are_solved(trains, monkeypatch):
    monkeypatch.setattr(training, "LOCAL", lambda _dimensions: TINY_PNEUNET)
    trains.write(ROOF)
    code, said = trains("run", "--workers", "1", "--yes", "--quiet")
    assert code == 0, said
    solved = list((trains.study.parent / ".cache/campaign").glob("*.npz"))
    assert len(solved) == (6 + 1) * (1 + 2)
    (found,) = trains.found
    default = default_surrogate()
    np.testing.assert_array_equal(found.terms.coefficients, default.terms.coefficients)
    assert found.departure is not None
    assert found.departure.covers("roof", 1.701, 2.299)
    assert found.span.share < 1.0
