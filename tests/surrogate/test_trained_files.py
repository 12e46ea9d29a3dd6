"""Trained emulators on disk: found, refused, damaged, outdated."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg import files
from bayesdeg.actuator.curve import MODEL_VERSION
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.data.settings import Dimensions
from bayesdeg.errors import BayesdegError
from bayesdeg.surrogate import kept as kept_emulators
from bayesdeg.surrogate.kept import Recipe, cached_path
from bayesdeg.surrogate.trained import (
    default_surrogate,
    find,
    read_trained,
    surrogate_for,
    to_bytes,
    write_trained,
)
from tests.run.tiny_campaign import GEOMETRY, RECIPE, emulator

PAPER = Geometry(Dimensions())


@pytest.fixture
def kept(tmp_path):
    """An emulator where the search looks for it."""
    path = cached_path(GEOMETRY, RECIPE, tmp_path)
    write_trained(path, emulator())
    return path


def search(kept):
    return find(GEOMETRY, recipe=RECIPE, cache=kept.parent)


def test_what_is_written_is_read_and_nothing_else_is_left(kept):
    surrogate = read_trained(kept)
    for name, array in emulator().to_arrays().items():
        np.testing.assert_array_equal(surrogate.to_arrays()[name], array)
    assert [path.name for path in kept.parent.iterdir()] == [kept.name]
    assert to_bytes(search(kept).surrogate) == to_bytes(emulator())


def test_a_cached_emulator_is_named_by_dimensions_and_recipe():
    longer = Geometry(Dimensions(length=60))
    assert cached_path(longer, RECIPE) == cached_path(Geometry(Dimensions(length=60.0)), RECIPE)
    paths = {
        cached_path(PAPER, RECIPE),
        cached_path(longer, RECIPE),
        cached_path(PAPER, replace(RECIPE, seed=9)),
        cached_path(PAPER, Recipe()),
    }
    assert len(paths) == 4


def test_an_emulator_that_is_not_there_is_to_be_trained(tmp_path):
    found = find(GEOMETRY, cache=tmp_path)
    assert found.surrogate is None
    assert "length = 14 (trained: 50)" in found.reason
    assert "chambers = 1 (trained: 5)" in found.reason
    assert found.path == cached_path(GEOMETRY, Recipe(), tmp_path)


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[: len(content) // 2],
        lambda content: b"",
        lambda content: b"not an archive",
        lambda content: content[:900] + bytes(64) + content[964:],
    ],
    ids=["cut", "empty", "text", "zeros"],
)
def test_a_damaged_file_is_named_and_not_used(kept, damage):
    kept.write_bytes(damage(kept.read_bytes()))
    found = search(kept)
    assert found.surrogate is None
    assert kept.name in found.reason
    assert "damaged" in found.reason
    with pytest.raises(BayesdegError, match="train it again"):
        read_trained(kept)


def test_a_file_that_is_no_emulator_is_refused(kept):
    np.savez(kept, allow_pickle=False, curvature=np.ones(3))
    with pytest.raises(BayesdegError, match="'bayesdeg emulate'"):
        read_trained(kept)


def test_an_emulator_of_another_version_of_the_model_is_refused_with_both_versions(kept):
    write_trained(kept, emulator(version="0"))
    found = search(kept)
    assert found.surrogate is None
    assert "version 0 " in found.reason
    assert found.reason.count(MODEL_VERSION)
    with pytest.raises(BayesdegError, match=r"version 0 .* train it"):
        read_trained(kept)


def test_an_emulator_under_the_name_of_another_geometry_is_not_used(kept):
    write_trained(kept, emulator(PAPER))
    assert "length = 14 (trained: 50)" in search(kept).reason


def test_an_emulator_that_does_not_say_its_geometry_is_of_none():
    silent = replace(emulator(), record="{}")
    with pytest.raises(BayesdegError, match="length = 14"):
        surrogate_for(GEOMETRY, silent)


def test_the_package_has_the_emulator_of_the_paper(tmp_path, monkeypatch):
    version = "the package's"
    shipped = replace(default_surrogate(), record=emulator(PAPER, version=version).record)
    write_trained(tmp_path / "shipped.npz", shipped)
    monkeypatch.setattr(kept_emulators, "SHIPPED", tmp_path / "shipped.npz")
    monkeypatch.setattr(kept_emulators, "MODEL_VERSION", version)
    found = find(PAPER, cache=tmp_path).surrogate
    assert found is not None
    assert found.record == shipped.record
    # another recipe is another emulator
    assert find(PAPER, recipe=RECIPE, cache=tmp_path).surrogate is None
    monkeypatch.setattr(kept_emulators, "MODEL_VERSION", "later")
    assert f"version {version}" in find(PAPER, cache=tmp_path).reason


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("in the way", encoding="utf-8")
    with pytest.raises(BayesdegError, match=r"file/emulator\.npz .*not lost"):
        write_trained(tmp_path / "file" / "emulator.npz", emulator())


def test_a_full_disk_leaves_what_was_there(kept, monkeypatch):
    before = kept.read_bytes()

    def full(_file):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
    with pytest.raises(BayesdegError, match="No space left"):
        write_trained(kept, emulator(PAPER))
    assert kept.read_bytes() == before
    assert [path.name for path in kept.parent.iterdir()] == [kept.name]


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(BayesdegError, match=r"missing\.npz cannot"):
        read_trained(tmp_path / "missing.npz")
