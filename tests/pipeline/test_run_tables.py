from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.criticism.convergence import diagnose
from bayesdeg.criticism.residuals import CurvatureFit
from bayesdeg.inference.ensemble import EFFORTS, Chain
from bayesdeg.inference.laplace import Evidence, Laplace
from bayesdeg.material.stress import nominal_stress
from bayesdeg.pipeline import tables
from bayesdeg.pipeline.assemble import assemble
from bayesdeg.pipeline.calibrate import Fit
from bayesdeg.pipeline.comparison import comparisons, rests_on
from tests.inference.small_study import TRUTH, values_of
from tests.pipeline.study_files import study_in

DRAWN = 1200


def fit_of(model, *, width=0.0):
    """A fit whose posterior is known: independent normal laws about the truth."""
    generator = np.random.default_rng(1)
    size = len(model.table)
    centre = model.table.vectors({name: values_of()[name] for name in model.table.names})[0]
    vectors = centre + width * generator.standard_normal((2, DRAWN // 20, 10, size))
    chain = Chain(vectors, np.zeros(vectors.shape[:3]), np.full(2, 0.4))
    laplace = Laplace(centre, np.eye(size), 0.0)
    evidence = Evidence(0.0, 0.0, vectors.reshape(-1, size), np.zeros(DRAWN), float(DRAWN))
    return Fit(model, laplace, evidence, chain, diagnose(model, chain, EFFORTS["quick"]))
