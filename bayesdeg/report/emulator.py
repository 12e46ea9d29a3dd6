"""What a run folder says of the emulator that stood in for the finite element model."""

from collections.abc import Mapping
from dataclasses import dataclass

from bayesdeg.report.fields import Json, each_of, number_of, text_of

_FACTS = {
    "design": "design",
    "model_version": "version of the finite element model",
    "coarse_curves": "curves of the coarse mesh",
    "fine_curves": "curves of the fine mesh",
}


@dataclass(frozen=True)
class Accuracy:
    """How well a quantity is predicted on curves that were not trained on; None if not known."""

    quantity: str
    rms_pct: float | None
    p95_pct: float | None
    max_pct: float | None
    coverage_90: float | None


@dataclass(frozen=True)
class Emulator:
    """The record of an emulator.

    Parameters
    ----------
    error_pct : float, optional
        Its standard error in curvature, that of the mesh included [%].
    record : str
        How it was trained, in words.
    refusals : str
        How many proposals of the sampler it refused, in words.
    facts : mapping of str to str
        Design, code version, number of curves.
    accuracy : tuple of Accuracy
        One a quantity.
    """

    error_pct: float | None
    record: str
    refusals: str
    facts: Mapping[str, str]
    accuracy: tuple[Accuracy, ...]


def emulator_of(content: Json) -> Emulator:
    """Check the object ``emulator`` of ``run.json``; every key may be missing.

    Examples
    --------
    >>> emulator_of({"error_pct": 0.8, "fine_curves": 32}).facts
    {'curves of the fine mesh': '32'}
    """
    facts = {label: text_of(content, key) for key, label in _FACTS.items()}
    return Emulator(
        number_of(content, "error_pct"),
        text_of(content, "record"),
        text_of(content, "refusals"),
        {label: text for label, text in facts.items() if text},
        each_of(content, "accuracy", _accuracy),
    )


def _accuracy(entry: Json) -> Accuracy:
    names = ("rms_pct", "p95_pct", "max_pct", "coverage_90")
    return Accuracy(text_of(entry, "quantity"), *(number_of(entry, name) for name in names))
