"""Predictions averaged over causes that cannot be told apart: draws, folder, commands."""

import json
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.special import expit

from bayesdeg.analysis.averaged import DRAWS, averaged, stored_form
from bayesdeg.analysis.calibrate import Fit
from bayesdeg.assembly.assemble import assemble
from bayesdeg.causes.catalogue import find
from bayesdeg.cli import INPUT_FAULT
from bayesdeg.criticism.decide.support import INSEPARABLE, Support
from bayesdeg.criticism.posterior.convergence import diagnose
from bayesdeg.data.study import read_study
from bayesdeg.errors import BayesdegError
from bayesdeg.inference.sampling import EFFORTS
from bayesdeg.observations.curvature import Curvature
from bayesdeg.pages.folder import POSTERIOR_AVERAGED, RunFolder
from bayesdeg.pages.left_out import Guard
from bayesdeg.pages.record import MemberEntry
from bayesdeg.prediction.forecast import AVERAGE, MODEL
from bayesdeg.prediction.stored import read_stored
from bayesdeg.progress import Silent
from bayesdeg.run.record import Results
from bayesdeg.run.stages import Clock, conclude
from tests.run.planted_offset import emulator, planted_study
from tests.run.small_run import chain_of, write_run

BOTH = " or ".join(("base+pressure_offset", "base+pressure_loss"))
GAP = 1.1  # nats by which the rival is behind
LEADING, RIVAL = "pressure_offset", "pressure_loss"


def trial_of(model, seed):
    """What `averaged` needs of a fitted set of causes."""
    vectors = chain_of(model, seed).vectors
    flat = vectors.reshape(-1, vectors.shape[-1])

    def draws(generator, count):
        return flat[generator.integers(len(flat), size=count)]

    return SimpleNamespace(subject=model, draws=draws)


def judgement_of(base, *, gap=GAP, sampled=True, prior_tail=0.5):
    """A verdict in which the leading cause has one rival, or none if it is far behind."""
    sets = {frozenset({name}): trial_of(base.extended(find(name)), 3) for name in (LEADING, RIVAL)}
    factors = {frozenset({LEADING}): 40.0, frozenset({RIVAL}): 40.0 - gap}
    return SimpleNamespace(
        supported=(Support(LEADING, 40.0, 9.0, 2.0, {RIVAL: gap}, prior_tail),),
        chosen=frozenset({LEADING}),
        predicted_with=(LEADING,),
        search=SimpleNamespace(trials=sets, factor=factors.__getitem__),
        counted=None,
        stated=None,
        of_counts=None,
        counts_fitted=True,
        sampled=sampled,
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A finished run, its base model and emulator file."""
    folder = tmp_path_factory.mktemp("averaged")
    (folder / "study").mkdir()
    path, file = write_run(folder / "run", planted_study(folder / "study"), course=True)
    stored = read_stored(path, emulator=file)
    return path, file, stored


@pytest.fixture(scope="module")
def final(run):
    """The calibration with the leading cause, with its priors."""
    assembly = assemble(read_study(run[0].parent / "study"), emulator())
    model = assembly.model.extended(find(LEADING))
    return assembly.model, SimpleNamespace(model=model, chain=chain_of(model, 1))


@pytest.fixture(scope="module")
def found(final):
    base, fit = final
    return averaged(judgement_of(base), fit, np.random.default_rng(2))


def test_probabilities_are_those_of_the_evidence(found):
    assert [m.causes for m in found.members] == [(LEADING,), (RIVAL,)]
    weights = np.exp([0.0, -GAP])
    np.testing.assert_allclose([m.probability for m in found.members], weights / weights.sum())
    share = np.mean(found.number == 0)
    p = found.members[0].probability
    assert share == pytest.approx(p, abs=4.0 * np.sqrt(p * (1.0 - p) / DRAWS))


def test_each_draw_has_one_cause_and_predicts_as_the_model_with_it_alone(found, final):
    base, _ = final
    values = found.model.table.named(found.chain.vectors[0, :, 0])
    neutral = {name: find(name).parameters[0].neutral for name in (LEADING, RIVAL)}
    for k, (own, other) in enumerate(((LEADING, RIVAL), (RIVAL, LEADING))):
        some = {name: v[found.number == k][:20] for name, v in values.items()}
        size = find(other).parameters[0].name
        assert np.all(some[f"{other}.{size}"] == neutral[other])
        alone = base.extended(find(own))
        known = {name: some[name] for name in alone.table.names}
        np.testing.assert_array_equal(
            found.model.data_of(Curvature).predicted(found.model.tests(some)).prediction.curvature,
            alone.data_of(Curvature).predicted(alone.tests(known)).prediction.curvature,
        )


def test_nothing_is_averaged_where_one_set_is_left(final):
    base, fit = final
    generator = np.random.default_rng(0)
    assert averaged(judgement_of(base, gap=9.0), fit, generator) is None
    assert averaged(judgement_of(base, sampled=False), fit, generator) is None


@pytest.mark.parametrize("gap", [1.99 * INSEPARABLE, -800.0])
def test_odds_may_be_long_and_each_set_has_a_draw(final, gap):
    base, fit = final
    judged = judgement_of(base, gap=gap, prior_tail=0.001)
    drawn = averaged(judged, fit, np.random.default_rng(5))
    probabilities = [m.probability for m in drawn.members]
    np.testing.assert_allclose(probabilities, [expit(gap), expit(-gap)])
    assert set(drawn.number.tolist()) == {0, 1}


@pytest.fixture(scope="module")
def ambiguous(run, found):
    """The run folder with draws over both causes."""
    path, file, _ = run
    folder = RunFolder(path)
    folder.write_posterior(POSTERIOR_AVERAGED, stored_form(found))
    record = folder.read_run()
    entries = [{"causes": m.causes, "probability": m.probability} for m in found.members]
    document = json.loads((path / "run.json").read_text(encoding="utf-8"))
    document["model"]["averaged"] = entries
    document["posteriors"] = folder.posterior_hashes()
    (path / "run.json").write_text(json.dumps(document), encoding="utf-8")
    assert record.model.averaged == ()
    return path, file


def test_a_run_folder_predicts_with_the_average_and_with_each(ambiguous, found):
    path, file = ambiguous
    stored = read_stored(path, emulator=file)
    assert stored.name == BOTH
    assert stored.chain.log_prob.size == DRAWS
    assert [one.name for one in stored.each] == [f"base+{LEADING}", f"base+{RIVAL}"]
    for k, one in enumerate(stored.each):
        assert one.chain.log_prob.size == np.sum(found.number == k)
        assert [cause.name for cause in one.model.causes] == [(LEADING, RIVAL)[k]]
        kept = found.chain.vectors[0, :, 0][found.number == k]
        some = {
            n: v for n, v in found.model.table.named(kept).items() if n in one.model.table.names
        }
        known = one.model.table.named(one.chain.vectors.reshape(len(kept), -1))
        assert set(some) == set(known)
        for name, values in known.items():
            np.testing.assert_array_equal(values, some[name])
    assert read_stored(path, base=True, emulator=file).each == ()


def test_of_several_sets_with_a_cause_each_keeps_its_own_draws(ambiguous):
    path, file = ambiguous
    stored = read_stored(path, emulator=file)
    sets = (("creep",), (LEADING,), (LEADING, RIVAL))
    members = tuple(
        MemberEntry(causes=names, probability=p)
        for names, p in zip(sets, (0.2, 0.5, 0.3), strict=True)
    )
    number = np.arange(DRAWS) % 3
    three = replace(stored, members=members, number=number)
    some = three.with_cause(LEADING)
    assert [one.name for one in some.each] == [f"base+{LEADING}", f"base+{LEADING}+{RIVAL}"]
    names = stored.model.table.names
    place = names.index("volume_ratio")
    for k, one in enumerate(some.each, start=1):
        column = one.model.table.names.index("volume_ratio")
        np.testing.assert_array_equal(
            one.chain.vectors[0, :, 0, column], stored.chain.vectors[0, number == k, 0, place]
        )


def without_members(tree):
    return xr.DataTree.from_dict({"posterior": tree["posterior"].to_dataset()})


def renumbered(change):
    def altered(tree):
        stats = tree["sample_stats"].to_dataset()
        draws = {"posterior": tree["posterior"].to_dataset()}
        return xr.DataTree.from_dict({**draws, "sample_stats": change(stats)})

    return altered


@pytest.mark.parametrize(
    "alter",
    [
        without_members,
        renumbered(lambda stats: stats.rename(member="other")),
        renumbered(lambda stats: stats.isel(draw=slice(10)).rename(draw="other")),
        renumbered(lambda stats: stats + 5),
        renumbered(lambda stats: stats - 1),
        renumbered(lambda stats: stats + 0.5),
        renumbered(lambda stats: stats * np.nan),
        renumbered(lambda stats: stats * 0),
    ],
)
def test_draws_that_are_of_no_member_are_refused(ambiguous, tmp_path, alter):
    path, file = ambiguous
    shutil.copytree(path, tmp_path / "run")
    folder = RunFolder(tmp_path / "run")
    folder.write_posterior(POSTERIOR_AVERAGED, alter(folder.read_posterior(POSTERIOR_AVERAGED)))
    folder.write(folder.read_run().model_copy(update={"posteriors": folder.posterior_hashes()}))
    with pytest.raises(BayesdegError, match="damaged"):
        read_stored(folder.path, emulator=file)


@pytest.mark.parametrize(
    "members",
    [
        [((LEADING,), 1.0)],
        [((LEADING,), 0.5), (("nonsense",), 0.5)],
        [((LEADING,), 0.5), ((LEADING, RIVAL), 0.3), ((LEADING,), 0.2)],
        [((LEADING,), 0.7), ((RIVAL,), None)],
        [((LEADING,), 0.7), ((RIVAL,), 7.0)],
        [((LEADING,), -0.2), ((RIVAL,), 1.2)],
    ],
)
def test_sets_of_causes_that_are_not_of_the_draws_are_refused(ambiguous, tmp_path, members):
    path, file = ambiguous
    shutil.copytree(path, tmp_path / "run")
    document = json.loads((path / "run.json").read_text(encoding="utf-8"))
    document["model"]["averaged"] = [{"causes": c, "probability": p} for c, p in members]
    (tmp_path / "run" / "run.json").write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(BayesdegError, match="averaged"):
        read_stored(tmp_path / "run", emulator=file)


def test_an_average_that_is_gone_is_not_replaced_by_one_cause(ambiguous, tmp_path):
    path, file = ambiguous
    shutil.copytree(path, tmp_path / "run")
    (tmp_path / "run" / f"{POSTERIOR_AVERAGED}.nc").unlink()
    with pytest.raises(BayesdegError, match=POSTERIOR_AVERAGED):
        read_stored(tmp_path / "run", emulator=file)


def test_predict_shows_the_average_and_the_band_of_each(ambiguous, bayesdeg, tmp_path):
    path, file = ambiguous
    place = ("--pressure", "60,100", "--degradation", "0,25", "--emulator", file)
    code, out, said = bayesdeg("predict", path, *place, "--out", tmp_path / "bands.csv")
    assert code == 0
    assert "averaged over" in said
    assert "75 %" in said
    assert "25 %" in said
    table = pd.read_csv(tmp_path / "bands.csv")
    assert table[MODEL].unique().tolist() == [AVERAGE, f"base+{LEADING}", f"base+{RIVAL}"]
    widths = table["q95"] - table["q05"]
    median = {name: rows["q50"].to_numpy() for name, rows in table.groupby(MODEL)}
    ends = np.sort([median[f"base+{name}"] for name in (LEADING, RIVAL)], axis=0)
    slack = 0.1 * widths[table[MODEL] == AVERAGE].to_numpy()
    assert np.all(median[AVERAGE] > ends[0] - slack)
    assert np.all(median[AVERAGE] < ends[1] + slack)
    assert out.count("verdict: named") == 3


@pytest.mark.parametrize("fails", [False, True])
def test_an_average_that_cannot_be_written_is_not_recorded(run, final, found, tmp_path, fails):
    _, fit = final
    study = read_study(run[0].parent / "study")
    whole = Fit(fit.model, None, None, fit.chain, diagnose(fit.model, fit.chain, EFFORTS["quick"]))
    drawn = replace(found, number=None) if fails else found
    results = Results(assemble(study, emulator()), whole, whole, None, averaged=drawn)
    folder, guard = RunFolder(tmp_path / "run"), Guard(strict=False)
    how = {"progress": Silent(), "executor": None, "guard": guard, "full": False}
    conclude(study, folder, results, Clock(), **how)
    assert (folder.path / f"{POSTERIOR_AVERAGED}.nc").exists() != fails
    assert len(folder.read_run().model.averaged) == (0 if fails else 2)
    left_out = [one.stage for one in folder.read_verdict().left_out]
    assert (f"{POSTERIOR_AVERAGED}.nc" in left_out) == fails


def test_one_cause_can_be_asked_for(ambiguous, bayesdeg):
    path, file = ambiguous
    place = ("--pressure", "100", "--degradation", "25", "--emulator", file, "--json")
    code, out, _ = bayesdeg("predict", path, *place, "--cause", RIVAL)
    answer = json.loads(out)
    assert code == 0
    assert answer["model"] == f"base+{RIVAL}"
    assert len(answer["rows"]) == 1
    code, _, said = bayesdeg("predict", path, *place, "--cause", "creep")
    assert code == INPUT_FAULT
    assert LEADING in said
    assert RIVAL in said
    code, _, said = bayesdeg("predict", path, *place, "--cause", RIVAL, "--base")
    assert code == INPUT_FAULT


@pytest.mark.parametrize("command", ["control", "lifetime"])
def test_the_other_commands_average_too(ambiguous, bayesdeg, command):
    path, file = ambiguous
    asked = {
        "control": ("--curvature", "5", "--degradation", "0"),
        "lifetime": ("--curvature", "1", "--pressure", "80", "--hours", "0:12:6"),
    }[command]
    code, out, said = bayesdeg(command, path, *asked, "--emulator", file, "--json")
    assert code == 0, said
    answer = json.loads(out)
    assert answer["model"] == BOTH
    assert any("averaged over" in one for one in answer["messages"])
