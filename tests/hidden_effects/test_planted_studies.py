"""Effects hidden by the fine finite element model are found from the studies' folders alone.

The folders, and the truths that no process that judges opens, are made by
benchmarks/planted_studies.py; the numbers are those of its studies.
"""

import json
from pathlib import Path

import pandas as pd
import pytest

from bayesdeg.causes.catalogue import CATALOGUE
from tests.hidden_effects.judging import Verdict, side_by_side

pytestmark = pytest.mark.slow

STUDIES, TRUTHS = Path(__file__).parent / "studies", Path(__file__).parent / "truths"
WALLS, LEAK, TWO, NOTHING, OUTSIDE = "10", "12", "16", "17", "18"
SINGLE = [f"{number:02d}" for number in range(1, 16)]
# what reads like the hidden cause in that study and may stand beside it
ALIKE = {
    "pressure_loss": {"film_mismatch"},
    "paper_softening": {"erosion"},
    "initial_curvature": {"wall_thickness", "film_mismatch"},
}
FARTHEST = 3.5  # standard deviations of a size


@pytest.fixture(scope="module")
def verdicts(tmp_path_factory):
    """Verdicts on all studies; on one without its bend angles; on each with its cause idle."""
    blind = tmp_path_factory.mktemp("without") / WALLS
    blind.mkdir()
    for path in (STUDIES / WALLS).iterdir():
        (blind / path.name).write_bytes(path.read_bytes())
    table = pd.read_csv(blind / "actuator.csv", comment="#")
    table.drop(columns="bend_angle_deg").to_csv(blind / "actuator.csv", index=False)
    idle = [(f"{n} idle", STUDIES / n, next(iter(hidden_in(n)))) for n in SINGLE]
    plain = [(path.name, path, "") for path in sorted(STUDIES.iterdir())]
    return side_by_side([*plain, ("without angle", blind, ""), *idle])


def hidden_in(number: str) -> dict[str, dict[str, float]]:
    """Return what was planted."""
    return json.loads((TRUTHS / f"{number}.json").read_text(encoding="utf-8"))["causes"]


def assert_named(found: Verdict, hidden: dict[str, dict[str, float]]) -> None:
    """Check that all is named that was hidden, on its evidence and on held-out specimens."""
    assert found.outcome == "named"
    assert set(found.causes) == set(hidden)
    assert all(found.factors[name] > 0.0 for name in hidden)
    assert all(found.confirmed[name] for name in hidden)
    assert_sizes(found, hidden)


def assert_sizes(found: Verdict, hidden: dict[str, dict[str, float]]) -> None:
    for cause, values in hidden.items():
        name = CATALOGUE[cause].parameters[0].name
        mean, sd = found.sizes[cause][name]
        assert abs(mean - values[name]) < FARTHEST * sd


def test_no_folder_that_is_read_holds_the_truth():
    assert {path.stem for path in TRUTHS.iterdir()} == {path.name for path in STUDIES.iterdir()}
    columns = {"stress_measure"}  # of tensile.csv, and a cause
    for path in STUDIES.rglob("*.*"):
        text = path.read_text(encoding="utf-8")
        assert not [name for name in CATALOGUE if name in text and name not in columns]


def test_every_cause_of_the_finite_element_model_is_hidden_once():
    hidden = {name for number in SINGLE for name in hidden_in(number)}
    elsewhere = {"pressure_offset"}  # studies/gelatin_actuator
    actuators = {name for name, cause in CATALOGUE.items() if cause.on_inputs is not None}
    assert actuators - elsewhere <= hidden


@pytest.mark.parametrize("number", SINGLE)
def test_a_single_cause_is_named_with_its_size(verdicts, number):
    """Alone; or together with what this study cannot tell it from, and nothing else."""
    found, hidden = verdicts[number].result(), hidden_in(number)
    [name] = hidden
    if found.outcome == "ambiguous":
        assert name in found.causes
        assert set(found.causes) <= {name} | ALIKE.get(name, set())
        assert_sizes(found, hidden)
    else:
        assert_named(found, hidden)


def test_a_constant_fraction_of_pressure_reads_like_stiffer_films(verdicts):
    found = verdicts[LEAK].result()
    assert found.outcome == "ambiguous"
    assert set(found.causes) == {"pressure_loss", "film_mismatch"}


def test_two_causes_are_both_named(verdicts):
    assert_named(verdicts[TWO].result(), hidden_in(TWO))


def test_the_bend_angle_separates_what_the_curvature_alone_cannot(verdicts):
    """Thicker walls bend less; a wrong scale changes the curvature as much, and no angle."""
    assert verdicts[WALLS].result().outcome == "named"
    without = verdicts["without angle"].result()
    assert without.outcome == "ambiguous"
    assert set(without.causes) == {"wall_thickness", "shrinkage_reading"}


def test_where_nothing_is_hidden_nothing_is_named(verdicts):
    assert hidden_in(NOTHING) == {}
    assert verdicts[NOTHING].result().outcome == "adequate"
    assert verdicts[NOTHING].result().causes == ()


def test_an_effect_outside_the_catalogue_is_not_named(verdicts):
    assert not set(hidden_in(OUTSIDE)) & set(CATALOGUE)
    assert verdicts[OUTSIDE].result().outcome == "unexplained"


@pytest.mark.parametrize("number", SINGLE)
def test_a_cause_that_does_nothing_is_not_named(verdicts, number):
    """The mutation check: the tests above rest on what each cause does, not on its name."""
    mutated, hidden = verdicts[f"{number} idle"].result(), hidden_in(number)
    assert not set(hidden) & set(mutated.causes)
    with pytest.raises(AssertionError):
        assert_named(mutated, hidden)
