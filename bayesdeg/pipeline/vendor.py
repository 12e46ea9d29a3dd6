"""How far a calibrated material is from what its vendor states of it."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdeg.data.shrinkage import Known
from bayesdeg.data.study import Study
from bayesdeg.inference.model import JointModel
from bayesdeg.observations.means import MPA
from bayesdeg.observations.specimens import modulus_100, node_name

Floats = NDArray[np.float64]

DRAWS = 2000
FRESH = np.array([0.0])  # degradation rate at which vendors measure [%]


@dataclass(frozen=True)
class VendorFigure:
    """A vendor's figure beside the posterior of the same quantity.

    Parameters
    ----------
    quantity, unit : str
        What it is, and in what.
    value, sd : float
        As stated.
    use : str
        ``datum``, ``prior``, or why it is not used.
    middle, low, high : float, optional
        Median and 90 % interval of the posterior; None where it has no such quantity.
    """

    quantity: str
    unit: str
    value: float
    sd: float
    use: str
    middle: float | None = None
    low: float | None = None
    high: float | None = None

    @property
    def distance(self) -> float | None:
        """How far the posterior's median is above the figure, over the figure's sd."""
        return None if self.middle is None else (self.middle - self.value) / self.sd


@dataclass(frozen=True)
class VendorCheck:
    """All figures of a vendor.

    Parameters
    ----------
    figures : tuple of VendorFigure
        At least one.
    source : str
        Where they stand.
    """

    figures: tuple[VendorFigure, ...]
    source: str


def vendor_check(study: Study, model: JointModel, vectors: Floats) -> VendorCheck | None:
    """Return a vendor's figures beside a posterior; None if the study states none.

    Parameters
    ----------
    study : Study
        Its settings hold the figures.
    model : JointModel
        The final one.
    vectors : array, shape (n, n_parameters)
        Draws of its posterior, unconstrained.
    """
    if study.settings.forward is not None:
        return None
    found = tuple(_figures(study, model, vectors))
    return VendorCheck(found, study.settings.vendor.source) if found else None


def _figures(study: Study, model: JointModel, vectors: Floats) -> Iterator[VendorFigure]:
    vendor = study.settings.vendor
    values = model.table.named(vectors[:: max(1, len(vectors) // DRAWS)])
    if vendor.modulus_100 is not None:
        draws = modulus_100(values, model.constants(values, FRESH), model.causes)[:, 0]
        yield _beside("modulus_100", "kPa", vendor.modulus_100, "datum", draws / MPA)
    if vendor.elongation_at_break is not None:
        known = model.has_elongation
        draws = model.elongation(values, FRESH)[:, 0] if known else np.empty(0)
        use = _use_of_elongation(study, model)
        yield _beside("elongation_at_break", "%", vendor.elongation_at_break, use, draws)


def _use_of_elongation(study: Study, model: JointModel) -> str:
    """Return what is made of a vendor's elongation at break."""
    if not model.has_elongation:
        return "there is no actuator that could burst"
    measured = model.breaks is not None or any(
        one.quantity == "elongation_at_break" for one in model.statistics
    )
    if measured:
        return "the study has elongations of its own"
    stated = node_name("elongation", 0.0) in study.settings.priors
    return "the study states a prior" if stated else "prior"


def _beside(quantity: str, unit: str, stated: Known, use: str, draws: Floats) -> VendorFigure:
    figure = VendorFigure(quantity, unit, stated.value, stated.sd, use)
    if not len(draws):
        return figure
    low, middle, high = np.quantile(draws, [0.05, 0.5, 0.95]).tolist()
    return VendorFigure(quantity, unit, stated.value, stated.sd, use, middle, low, high)
