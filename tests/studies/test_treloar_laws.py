"""Real rubber: which of five laws predicts a mode of tension from the two others.

Data: Treloar (1944), doi:10.1039/TF9444000059.
"""

from pathlib import Path

import pytest

from bayesdeg.analysis.material_laws import NOISE, compare_laws
from bayesdeg.assembly.outline import outline
from bayesdeg.data.study import read_study
from bayesdeg.observations.tensile import tensile_curves

STUDIES = Path(__file__).resolve().parents[2] / "studies"


@pytest.fixture(scope="module")
def found():
    study = read_study(STUDIES / "treloar")
    priors = {p.name: p.law for p in outline(study).base if p.name in NOISE}
    return compare_laws(tensile_curves(study, fitted=True), priors)


def test_yeohs_law_predicts_modes_best_but_three_curves_cannot_make_it_sure(found):
    assert found.best.name == "yeoh"
    assert found.rival.name == "gent"
    assert not found.is_clear


def test_six_constants_follow_all_modes_best_and_predict_the_longest_curve_badly(found):
    table = found.table().query("degradation_pct == 'all'").set_index("law")
    assert table["rmse_MPa"].idxmin() == "ogden"
    ogden, yeoh = found.by_name["ogden"], found.by_name["yeoh"]
    longest = 0  # uniaxial, to a stretch of 7.6
    assert ogden.elpd[longest] < yeoh.elpd[longest]
    assert (ogden.elpd[1:] > yeoh.elpd[1:]).all()


def test_a_linear_term_in_the_second_invariant_fails_in_a_mode_that_it_did_not_see(found):
    """Its stress grows with the third power of an equibiaxial stretch."""
    errors = found.by_name["mooney_rivlin"].held_out_error
    assert errors.max() > 10.0 * found.by_name["yeoh"].held_out_error.max()
