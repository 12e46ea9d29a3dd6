"""``next`` on run folders of every outcome."""

import json
from functools import partial

import pytest

from bayesdeg.pages.folder import RunFolder
from tests.pages.synthetic_run import write_bare, write_full

UNLOADING = {
    "design": "unloading branch 240 → 20 kPa after loading [timed], on 3 new specimens at 0 %",
    "separates": ["creep", "humidity_drift"],
    "expected_log_bayes_factor": 6.3,
    "monte_carlo_error": 0.1,
    "specimens": 3,
    "readings": 69,
    "per_specimen": 2.1,
    "pairs": [
        {"causes": ["creep", "humidity_drift"], "expected_log_bayes_factor": 6.3},
        {"causes": ["pressure_loss", "film_mismatch"], "expected_log_bayes_factor": 0.02},
    ],
}
WEIGHED = {
    "design": "a piece of the actuator, weighed",
    "separates": ["creep", "pressure_loss"],
    "expected_log_bayes_factor": 40.0,
    "pairs": [{"causes": ["film_mismatch", "pressure_loss"], "expected_log_bayes_factor": 0.4}],
}


@pytest.fixture
def ask(bayesdeg):
    return partial(bayesdeg, "next")


def folder_of(path, outcome, experiments, **changes):
    folder = write_full(path, outcome)
    content = folder.read_json("verdict") | {"next_experiments": experiments} | changes
    folder.write_json("verdict", content)
    return path


def test_the_ranking_is_printed_with_cost_and_odds(ask, tmp_path):
    path = folder_of(tmp_path / "run", "ambiguous", [UNLOADING, WEIGHED])
    code, out, _ = ask(path)
    assert code == 0
    words = " ".join(out.replace("│", " ").split())
    for part in ("creep and humidity drift", "6.3", "545 : 1", "> 10⁶ : 1", "69", "2.1", "[timed]"):
        assert part in words
    assert words.index("unloading") < words.index("weighed")


def test_pairs_that_nothing_tells_apart_are_said(ask, tmp_path):
    path = folder_of(tmp_path / "run", "ambiguous", [UNLOADING, WEIGHED])
    _, out, err = ask(path)
    said = " ".join(err.split())
    assert "and pressure loss" in said
    assert "creep" not in said
    assert ask(path, "--quiet") == (0, out, "")


def test_json_is_what_the_run_stored(ask, tmp_path):
    path = folder_of(tmp_path / "run", "ambiguous", [UNLOADING, WEIGHED])
    code, out, err = ask(path, "--json")
    answer = json.loads(out)
    assert code == 0
    assert err == ""
    assert answer["next_experiments"] == [UNLOADING, WEIGHED]
    assert answer["outcome"] == "ambiguous"
    assert answer["causes"] == ["erosion", "degradation_misread"]
    assert len(answer["messages"]) == 1


@pytest.mark.parametrize(
    ("outcome", "words"),
    [
        ("adequate", "nothing to tell"),
        ("named", "degraded skin is"),
        ("ambiguous", "and degradation misread"),
        ("unexplained", "unexplained: causes"),
    ],
)
def test_it_is_said_why_nothing_is_proposed(ask, tmp_path, outcome, words):
    path = folder_of(tmp_path / "run", outcome, [])
    code, out, _ = ask(path)
    assert code == 0
    assert words in " ".join(out.split())
    assert words in json.loads(ask(path, "--json")[1])["messages"][0]


def test_several_named_causes_are_named_in_the_plural(ask, tmp_path):
    path = folder_of(tmp_path / "run", "named", [], causes=["creep", "gravity"])
    assert "gravity are" in " ".join(ask(path)[1].split())


def test_a_study_without_actuators_is_told_what_to_measure(ask, tmp_path):
    write_bare(tmp_path / "run")
    code, out, _ = ask(tmp_path / "run")
    assert code == 0
    assert "Measure curvature" in " ".join(out.split())


def test_a_minimal_entry_of_the_contract_is_enough(ask, tmp_path):
    entry = {"design": "do it", "separates": ["a", "b"], "expected_log_bayes_factor": 0.5}
    code, out, _ = ask(folder_of(tmp_path / "run", "ambiguous", [entry]))
    assert code == 0
    assert "do it" in out
    assert "1.6 : 1" in out


def test_what_is_no_finished_run_ends_with_2(ask, tmp_path):
    code, out, err = ask(tmp_path / "nowhere")
    assert (code, out) == (2, "")
    assert "no such folder" in err
    (tmp_path / "empty").mkdir()
    assert ask(tmp_path / "empty")[0] == 2
    path = folder_of(tmp_path / "run", "ambiguous", [UNLOADING])
    (path / "verdict.json").unlink()
    code, out, err = ask(path)
    assert (code, out) == (2, "")
    assert "verdict.json is missing" in err
    assert "Traceback" not in err


@pytest.mark.parametrize("entry", [{"pairs": 3}, {"specimens": "three"}, {"separates": "a"}, 4])
def test_a_damaged_verdict_ends_with_2(ask, tmp_path, entry):
    path = folder_of(tmp_path / "run", "ambiguous", [])
    content = RunFolder(path).read_json("verdict")
    damaged = UNLOADING | entry if isinstance(entry, dict) else entry
    RunFolder(path).write_json("verdict", content | {"next_experiments": [damaged]})
    code, out, err = ask(path)
    assert (code, out) == (2, "")
    assert "Traceback" not in err


def test_a_ranking_that_was_left_out_is_not_taken_for_none_needed(ask, tmp_path):
    path = folder_of(tmp_path / "run", "named", [])
    folder = RunFolder(path)
    left_out = [{"stage": "next experiments", "why": "No experiment is proposed."}]
    folder.write_json("verdict", folder.read_json("verdict") | {"left_out": left_out})
    said = " ".join(ask(path)[1].split())
    assert left_out[0]["why"] in said
    assert "nothing to tell" not in said
    left_out[0]["stage"] = "verdict"
    changes = {"outcome": "not_judged", "left_out": left_out, "explanation": "It broke."}
    folder.write_json("verdict", folder.read_json("verdict") | changes)
    assert " ".join(ask(path)[1].split()).endswith(changes["explanation"])


def test_a_single_reading_is_not_taken_for_none(ask, tmp_path):
    path = folder_of(tmp_path / "run", "not_judged", [])
    folder = RunFolder(path)
    verdict = folder.read_json("verdict") | {"outcome": "not_judged", "explanation": "One reading."}
    folder.write_json("verdict", verdict | {"misfit": {"p_value": 0.4}, "left_out": []})
    assert " ".join(ask(path)[1].split()).endswith(verdict["explanation"])
