"""A posterior of several modes is said to be one, and sampled about all of them."""

from dataclasses import replace

import numpy as np
import pytest

from bayesdeg.analysis.calibrate import calibrate
from bayesdeg.inference.sampling import EFFORTS
from bayesdeg.pages.checkpoints import Checkpoints
from bayesdeg.progress import Silent
from tests.inference.bimodal import two_normals


def fitted(tmp_path, starts):
    return calibrate(
        two_normals(3),
        "base",
        effort=replace(EFFORTS["standard"], starts=starts),
        seed=np.random.SeedSequence(1),
        checkpoints=Checkpoints(tmp_path, "this study"),
        progress=Silent(),
    )


def test_two_modes_are_told_of_and_both_sampled_again_after_an_interruption(tmp_path):
    for _ in range(2):  # the second reads what the first has kept
        fit = fitted(tmp_path, starts=4)
        assert fit.diagnosis.shares == pytest.approx((0.7, 0.3), abs=0.05)
        upper = float(np.mean(fit.chain.vectors[..., 0] > 0.0))
        assert min(upper, 1.0 - upper) == pytest.approx(0.3, abs=0.05)
