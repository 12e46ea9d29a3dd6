"""``bayesdeg score`` on files and on run folders."""

import json
import xml.etree.ElementTree as ET
from functools import partial

import pandas as pd
import pytest

from bayesdeg.laboratory.hidden import HiddenTruth, lines_of
from bayesdeg.laboratory.score import OUTSIDE, SAID, SEVERAL, WITH_IT, WITHOUT_IT

TRUTHS = [
    HiddenTruth(study="0001", origin="nothing"),
    HiddenTruth(study="0002", origin="rule", hidden={"creep": {"amount": 0.06}}),
    HiddenTruth(study="0003", origin="outside", hidden={"outside_lens": {"gain": 0.1}}),
]
ANSWERS = "study,outcome,causes\n0001,adequate,\n0002,ambiguous,creep|mullins\n0003,named,gravity\n"


@pytest.fixture
def ask(monkeypatch, bayesdeg, tmp_path):
    """Run ``bayesdeg score``; return exit code, standard output and standard error."""
    (tmp_path / "truths.jsonl").write_text(lines_of(TRUTHS), encoding="utf-8")
    (tmp_path / "answers.csv").write_text(ANSWERS, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return partial(bayesdeg, "score")


def test_a_score_is_printed(ask):
    code, out, _ = ask("answers.csv", "truths.jsonl")
    assert code == 0
    words = " ".join(out.replace("│", " ").split())
    assert "combinations said 3 0.50" in words
    assert f"{WITH_IT} 1" in words


def test_json_is_all_that_is_printed_and_files_hold_the_same(ask, tmp_path):
    code, out, _ = ask("answers.csv", "truths.jsonl", "--json", "--out", "scored")
    assert code == 0
    found = json.loads(out)
    assert found["credit"]["count"] == 1.5
    assert found["matrix"][OUTSIDE] == {"gravity": 1}
    folder = tmp_path / "scored"
    assert json.loads((folder / "score.json").read_text(encoding="utf-8")) == found
    matrix = pd.read_csv(folder / "isolability.csv")
    assert list(matrix) == ["hidden", "said", "count", "studies", "share", "low", "high"]
    assert len(matrix) == 3 * len(SAID)
    assert matrix["count"].sum() == 3
    assert ET.parse(folder / "isolability.svg").getroot().tag.endswith("svg")
    assert sorted(path.name for path in folder.iterdir()) == [
        *("isolability.csv", "isolability.svg", "score.json"),
    ]


VERDICTS = {
    "0001": {"outcome": "adequate", "misfit": {"p_value": 0.4}},
    "0002": {
        "outcome": "named",
        "causes": ["creep"],
        "one_of": [["gravity", "mullins"]],
        "candidates": [
            {"cause": "creep", "probability": 0.9,
             "effect": {"amount": {"mean": 0.06, "q05": 0.05, "q95": 0.07, "unit": "–"}}},
            {"cause": "erosion", "probability": None, "why": "not judged"},
        ],
    },
    "0003": {"outcome": "ambiguous", "causes": ["creep", "erosion", "gravity"]},
}  # fmt: skip


def runs(tmp_path, **changes):
    for name, verdict in VERDICTS.items():
        folder = tmp_path / "runs" / name
        folder.mkdir(parents=True)
        content = json.dumps(verdict | changes.get(f"study_{name}", {}))
        (folder / "verdict.json").write_text(content, encoding="utf-8")
    return tmp_path / "runs"


def test_run_folders_are_answers(ask, tmp_path):
    code, out, _ = ask(runs(tmp_path), "truths.jsonl", "--json")
    found = json.loads(out)
    assert code == 0
    assert found["matrix"]["creep"] == {SEVERAL: 1}
    assert found["matrix"][OUTSIDE] == {WITHOUT_IT: 1}
    assert found["probabilities"]["brier"] == pytest.approx((0.0 + 0.1**2 + 1.0) / 3 - 1 / 3)


def test_a_verdict_that_states_its_sets_is_taken_at_its_word(ask, tmp_path):
    stated = {"study_0003": {"sets": [["creep", "erosion"], ["gravity"]]}}
    code, out, _ = ask(runs(tmp_path, **stated), "truths.jsonl", "--json")
    assert code == 0
    assert json.loads(out)["matrix"][OUTSIDE] == {SEVERAL: 1}


def test_alternatives_of_a_verdict_are_combinations(ask, tmp_path):
    either = [["creep", "mullins"], ["gravity"]]
    changed = {"outcome": "ambiguous", "one_of": [], "alternatives": either}
    code, out, _ = ask(runs(tmp_path, study_0002=changed), "truths.jsonl", "--json")
    assert code == 0
    assert json.loads(out)["matrix"]["creep"] == {SEVERAL: 1}


MALFORMED = [
    (ANSWERS.replace("0002,", "0001,"), "row 3, column study, value '0001'"),
    (ANSWERS.replace("gravity", "gravty"), "row 4, column causes, value 'gravty'"),
    (ANSWERS.replace("0003,named,gravity\n", ""), "column study, value '0003'"),
    (ANSWERS + "0004,adequate,\n", "column study, value '0004'"),
    (ANSWERS.replace("named", "sure"), "row 4, column outcome, value 'sure'"),
    (ANSWERS.replace("causes", "causes,p_value").replace("\n0", ",\n0", 1), "answers.csv, row"),
]


@pytest.mark.parametrize(("change", "said"), MALFORMED)
def test_malformed_answers_are_one_line_and_exit_code_2(ask, tmp_path, change, said):
    (tmp_path / "answers.csv").write_text(change, encoding="utf-8")
    code, out, err = ask("answers.csv", "truths.jsonl", "--json", "--out", "scored")
    assert (code, out) == (2, "")
    assert said in err
    assert "Traceback" not in err
    assert err.count("answers.csv") == len(err.strip().splitlines())
    assert not (tmp_path / "scored").exists()


def test_one_fault_is_one_line(ask, tmp_path):
    (tmp_path / "answers.csv").write_text(ANSWERS.replace("gravity", "nan"), encoding="utf-8")
    _, _, err = ask("answers.csv", "truths.jsonl")
    assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    "arguments",
    [
        ("nowhere.csv", "truths.jsonl"),
        ("answers.csv", "nowhere.jsonl"),
        ("answers.csv", "answers.csv"),
        ("answers.csv", "."),
        (".", "truths.jsonl"),
    ],
)
def test_what_is_not_there_is_said(ask, arguments, tmp_path):
    (tmp_path / "empty").mkdir()
    code, out, err = ask(*arguments)
    assert (code, out) == (2, "")
    assert "Traceback" not in err


def test_faults_of_run_folders_are_told_together(ask, tmp_path):
    folder = runs(tmp_path, study_0002={"outcome": "fine"}, study_0003={"causes": ["no_such"]})
    (folder / "0001" / "verdict.json").unlink()
    code, _, err = ask(folder, "truths.jsonl")
    assert code == 2
    lines = err.strip().splitlines()
    assert len(lines) == 3
    assert all(f"{name}/verdict.json" in line for name, line in zip(VERDICTS, lines, strict=True))
