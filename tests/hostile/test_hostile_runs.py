"""Every run folder of the table is refused by every command that reads it."""

import numpy as np
import pytest

from bayesdeg.inference.course import CourseModel
from bayesdeg.inference.sampling import Chain
from bayesdeg.inference.tree import to_datatree
from bayesdeg.pages.folder import RunFolder
from tests.hostile.inputs import hostile_inputs
from tests.hostile.redrawn import redraw
from tests.run.planted_offset import planted_study
from tests.run.small_run import write_run

CASES = [case for case in hostile_inputs() if case.subject == "run"]
ROWS = "specimen_id,degradation_pct,pressure_kPa,curvature_per_m\nn,0,40,3\n"


def about_prior(model, seed):
    """Draws about the medians of the priors: sound numbers, of no posterior."""
    generator = np.random.default_rng(seed)
    medians = {one.name: one.law.quantile(np.array([0.5])) for one in model.table.parameters}
    centre = model.table.vectors(medians)[0]
    vectors = centre + 0.03 * generator.standard_normal((2, 20, 5, len(centre)))
    return Chain(vectors, np.zeros(vectors.shape[:3]), np.full(2, 0.4))


def write_course(run):
    """Add the course of degradation in the soil."""
    generator = np.random.default_rng(8)
    model = CourseModel(("a", "b"), np.array([0.0, 24.0]), np.array([20.0, 15.0]))
    folder = RunFolder(run)
    folder.write_posterior("posterior_course", to_datatree(model, about_prior(model, 8), generator))
    content = folder.read_json("run")
    content["model"]["measured"]["time_h"] = [0.0, 24.0]
    content["posteriors"] = folder.posterior_hashes()
    folder.write_json("run", content)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    top = tmp_path_factory.mktemp("run")
    (top / "study").mkdir()
    write_run(top / "run", planted_study(top / "study"), chain=about_prior)
    write_course(top / "run")
    (top / "run" / "rows.csv").write_text(ROWS, encoding="utf-8")
    return top


@pytest.mark.parametrize("case", CASES, ids=str)
def test_a_hostile_run_is_refused(case, sound, refused):
    refused(case, sound, redraw)
