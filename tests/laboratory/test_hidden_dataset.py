"""The public data set of hidden effects: the same bytes again, and nothing in them that tells."""

import hashlib
import json
from collections import Counter
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from bayesdeg.causes.catalogue import CATALOGUE
from bayesdeg.data.study import read_study
from bayesdeg.laboratory.hidden import Origin, read_answers, read_truths
from bayesdeg.laboratory.score import score

with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    dataset = import_module("hidden_dataset")
    methods = import_module("other_methods")
    scored = import_module("scored_methods")

RECORD = Path(__file__).parents[2] / "benchmarks" / "scored"
NAMES = {*CATALOGUE, *dataset.FORMS, *(one.name for one in dataset.OUTSIDE)}


def contents(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Two data sets of the same numbers: folder and truths of each."""
    found = []
    for name in ("one", "other"):
        folder = tmp_path_factory.mktemp(name)
        dataset.write_dataset(folder / "set", folder / "truths.jsonl", studies=4, seed=5)
        found.append((folder / "set", folder / "truths.jsonl"))
    return found


@pytest.mark.slow
def test_the_same_numbers_make_the_same_bytes(made):
    (one, truths), (other, again) = made
    assert contents(one) == contents(other)
    assert truths.read_bytes() == again.read_bytes()


@pytest.mark.slow
def test_nothing_in_the_folder_names_what_is_hidden(made):
    (folder, truths), _ = made
    hidden = read_truths(truths.read_bytes(), truths.name)
    assert any(one.hidden for one in hidden)
    for name, content in contents(folder).items():
        text = f"{name}\n{content.decode()}".casefold()
        if name == "README.md":  # whose examples are the same whatever is hidden
            assert content.decode() == dataset.README.format(studies=4)
            continue
        found = {cause for cause in NAMES if cause in text}
        # a column of all films has the name of a cause
        assert found == ({"stress_measure"} if name.endswith("tensile.csv") else set()), name
        assert "hidden effect" not in text
        assert "truth" not in text.replace("truths_sha256", "")
        if name != "manifest.json":
            assert not [origin for origin in Origin if f'"{origin}"' in text], name
    names = {path.name for path in folder.rglob("*.*")}
    allowed = {"study.toml", "moisture.csv", "shrinkage.csv", "tensile.csv", "break.csv"}
    assert names == {*allowed, "actuator.csv", "README.md", "manifest.json"}


@pytest.mark.slow
def test_studies_differ_in_no_header_but_that_of_their_design(made):
    (folder, truths), _ = made
    heads = {}
    for one in read_truths(truths.read_bytes(), truths.name):
        study = read_study(folder / one.study)  # without fault
        assert study.settings.title == f"Study {one.study}"
        assert study.settings.virtual
        first = (folder / one.study / "actuator.csv").read_text().splitlines()[1]
        heads.setdefault(one.design, set()).add(first)
    assert all(len(found) == 1 for found in heads.values())


@pytest.mark.slow
def test_the_manifest_has_the_hashes_of_all_files_and_of_the_truths(made):
    (folder, truths), _ = made
    manifest = json.loads((folder / "manifest.json").read_text())
    found = {
        name: hashlib.sha256(content).hexdigest()
        for name, content in contents(folder).items()
        if name != "manifest.json"
    }
    assert manifest["files_sha256"] == found
    assert manifest["truths_sha256"] == hashlib.sha256(truths.read_bytes()).hexdigest()
    assert manifest["studies"] == 4


def test_truths_are_never_written_into_the_folder_nor_over_another_set(tmp_path):
    with pytest.raises(ValueError, match="published"):
        dataset.write_dataset(tmp_path / "set", tmp_path / "set" / "t.jsonl", studies=1, seed=1)
    (tmp_path / "set").mkdir()
    with pytest.raises(FileExistsError):
        dataset.write_dataset(tmp_path / "set", tmp_path / "t.jsonl", studies=1, seed=1)


def test_plans_are_drawn_by_seed_in_an_order_that_tells_nothing():
    plans = dataset.plans(200, seed=1, physics=6)
    again, other = (dataset.plans(200, seed=seed, physics=6) for seed in (1, 2))
    assert [plan.study.number for plan in plans] == [plan.study.number for plan in again]
    assert sorted(plan.study.number for plan in plans) == list(range(1, 201))
    assert [plan.study.names for plan in plans] != [plan.study.names for plan in other]
    places = [place for place, plan in enumerate(plans) if plan.origin is Origin.PHYSICS]
    assert len(places) == 6
    assert places != list(range(6))
    # of numbers in a row, the place says nothing
    numbers = np.array([plan.study.number for plan in plans])
    assert abs(np.corrcoef(numbers, np.arange(200))[0, 1]) < 0.25


def test_plans_hold_every_kind_and_every_cause_that_can_show():
    plans = dataset.plans(400, seed=3, physics=0)
    kinds = Counter(plan.study.kind for plan in plans)
    for kind, share in dataset.KINDS.items():
        assert kinds[kind] / 400 == pytest.approx(share, abs=0.08)
    hidden = {name for plan in plans for name in plan.study.names}
    assert hidden & set(CATALOGUE) == set(dataset.HIDDEN)
    designs = {plan.study.design for plan in plans if plan.study.kind == "none"}
    assert designs == set(dataset.designs())


@pytest.mark.parametrize("size", dataset.PLANTED_SIZES)
def test_a_relaxing_stress_comes_to_the_creep_that_is_stated(size):
    """E(∞)/E(0) = 1 − g gives a compliance larger by g/(1 − g), later by 1/(1 − g)."""
    found = dataset.sizes_of("creep", size)
    share = dataset.SHARE * size
    assert 1.0 + found["amount"] == pytest.approx(1.0 / (1.0 - share))
    assert found["time_constant"] * (1.0 - share) == pytest.approx(dataset.RELAXATION)


# ---- the other methods


@pytest.mark.long
@pytest.mark.slow
def test_both_methods_find_a_large_effect_and_leave_nothing_alone(made, tmp_path):
    (folder, truths), _ = made
    hidden = {one.study: one for one in read_truths(truths.read_bytes(), truths.name)}
    quiet = next(name for name, one in hidden.items() if not one.hidden)
    for method in methods.METHODS.values():
        assert method(methods.fit_study(folder / quiet)).outcome == "adequate"
    large = tmp_path / "0001"
    plan = dataset.Plan(
        dataset.HiddenStudy(
            *(1, "single", "angle"),
            (dataset.HiddenEffect(CATALOGUE["pressure_offset"], {"offset": 16.0}),),
            1.8,
        ),
        Origin.RULE,
    )
    dataset.write_study(plan, "0001", large, seed=5)
    fitted = methods.fit_study(large)
    for method in methods.METHODS.values():
        answer = method(fitted)
        assert any("pressure_offset" in names for names in answer.sets), method.__name__
    size = methods.least_squares(fitted).sizes["pressure_offset.offset"]
    assert size.q05 < size.mean < size.q95


def test_least_squares_takes_the_evidence_of_pairs_and_rivals():
    """By hand: two orthogonal effects, each of ten standard deviations, one with a twin."""
    z = np.zeros(6)
    z[:2] = 10.0
    columns = {name: np.zeros((6, 1)) for name in ("a", "twin", "b", "none")}
    columns["a"][0], columns["twin"][0], columns["b"][1], columns["none"][2] = 8.0, 8.5, 8.0, 8.0
    chosen = methods._chosen(z, columns)
    assert {frozenset(methods._with_rivals(z, columns, chosen, name)) for name in chosen} == {
        *(frozenset({"a", "twin"}), frozenset({"b"})),
    }
    assert methods._chosen(np.zeros(6), columns) == []
    chances = methods._probabilities(np.zeros(6), columns)
    assert all(0.0 < chance < 0.25 for chance in chances.values())


def test_the_likelihood_of_a_discrepancy_is_that_of_its_normal_law():
    generator = np.random.default_rng(2)
    count = 12
    part = methods.Discrepancy(
        residual=generator.standard_normal(count),
        errors=np.diag(generator.uniform(0.5, 2.0, count)),
        specimens=np.kron(np.eye(4), np.ones((3, 3))),
        shared=generator.standard_normal((count, 2)),
        inputs=generator.uniform(size=(count, 2)),
        block=np.repeat([0, 1, -1], 4),
        size=np.repeat([1.0, 3.0, 1.0], 4),
        predicted=np.repeat([2.0, 5.0, 0.0], 4),
    )
    logs = np.log([0.5, 0.7, 0.2, 0.3, 0.1, 1.2, 0.6])
    process = part.process(logs)
    gaps = (part.inputs[0] - part.inputs[1]) / [0.5, 0.7]
    assert process[0, 1] == pytest.approx(0.2**2 * np.exp(-0.5 * gaps @ gaps) + 0.2**2)
    assert process[4, 4] == pytest.approx((0.3 * 3.0) ** 2 + 0.5**2)
    assert not process[8:].any()  # films have none
    # two kinds have the factor alone in common
    assert process[:4, 4:8] == pytest.approx(0.2 * 0.5)
    whole = part.without(logs) + process
    assert whole[8, 8] == pytest.approx(
        1.2**2 * part.errors[8, 8] + 0.6**2 + part.shared[8] @ part.shared[8]
    )
    sign, log_determinant = np.linalg.slogdet(whole)
    wanted = -0.5 * (log_determinant + part.residual @ np.linalg.solve(whole, part.residual))
    assert sign > 0
    assert part.log_likelihood(whole) == pytest.approx(wanted)


# ---- what is published


def test_the_published_tables_are_those_of_the_recorded_answers():
    truths, answers = scored.recorded(RECORD)
    assert set(answers) == set(scored.WORDS)
    scores = {method: score(given, truths, method) for method, given in answers.items()}
    assert scored.markdown(scores).count("###") == len(scored.WORDS)
    for path in RECORD.glob("*.jsonl"):
        if path.name != scored.TRUTHS:
            assert len(read_answers(path.read_bytes(), path.name)) == len(truths)
