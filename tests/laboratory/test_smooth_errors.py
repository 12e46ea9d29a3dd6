"""Studies of two benchmarks: read to the edge, or missed by a smooth error."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bayesdeg.laboratory.truth import drawn_truth

with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    edge = import_module("edge_studies")
    smooth = import_module("smooth_errors")
    hidden = import_module("hidden_studies")


def test_fresh_actuators_reach_the_wanted_share_of_their_last_pressure():
    generator = np.random.default_rng(1)
    soft = [t.c1[0] for t in (drawn_truth(generator) for _ in range(60)) if edge.is_near(t)]
    assert 10 < len(soft) < 50
    assert 0.2 < min(soft) < max(soft) < 0.36
    assert edge.to_edge(hidden.designs()["history"]).actuator["pressure_kPa"].max() == edge.TOP


def test_of_four_edge_studies_one_is_empty_one_has_a_mishap_and_two_a_cause():
    drawn = [edge.drawn(number, seed=edge.SEED) for number in range(80)]
    assert sum(not study.effects and not mishap for study, mishap in drawn) == 20
    assert sum(bool(mishap) for _, mishap in drawn) == 20
    assert {name for study, _ in drawn for name in study.names} == set(edge.CAUSES)
    assert {mishap for _, mishap in drawn} == {"", *edge.UNTOLD}


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("spoil", [smooth.bent, smooth.scaled])
def test_curvature_is_off_by_a_tenth_of_the_largest(tmp_path, spoil, seed):
    pressure = np.arange(20.0, 241.0, 20.0)
    sound = pd.DataFrame({"pressure_kPa": pressure, "curvature_per_m": 0.13 * pressure})
    sound.to_csv(tmp_path / "actuator.csv", index=False)
    spoil(tmp_path, np.random.default_rng(seed))
    off = pd.read_csv(tmp_path / "actuator.csv")["curvature_per_m"] - sound["curvature_per_m"]
    assert np.abs(off).max() > 0.099 * sound["curvature_per_m"].max()
    assert np.all(np.abs(np.diff(off, 2)) < 0.1 * np.abs(off).max())


@pytest.mark.parametrize(("seed", "is_sorted"), [(0, True), (1, False), (2, True)])
def test_a_film_let_back_reads_less_at_the_same_stretches(tmp_path, seed, is_sorted):
    stretch = np.linspace(1.1, 2.0, 10)
    sound = pd.DataFrame({"specimen_id": "F", "stretch": stretch, "stress_MPa": stretch - 1.0})
    sound.to_csv(tmp_path / "tensile.csv", index=False)
    smooth.let_back(tmp_path, np.random.default_rng(seed))
    both = pd.read_csv(tmp_path / "tensile.csv")
    assert both["stretch"].is_monotonic_increasing == is_sorted
    lowest, highest = (getattr(both.groupby("stretch")["stress_MPa"], f)() for f in ("min", "max"))
    assert len(both) == 19
    assert np.all(lowest.to_numpy()[1:-1] < highest.to_numpy()[1:-1])
    assert np.min(lowest / highest) < 0.75
