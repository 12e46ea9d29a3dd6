"""One finite element run that a campaign wants, and its name by content."""

import hashlib
import json
from dataclasses import asdict, dataclass
from enum import StrEnum
from numbers import Real
from typing import Any

from bayesdeg.actuator.curve import Curve, CurveSolution, PathSamples
from bayesdeg.actuator.geometry import Geometry
from bayesdeg.actuator.material import Material
from bayesdeg.actuator.resolution import Resolution
from bayesdeg.actuator.version import MODEL_VERSION
from bayesdeg.measure.settings import Dimensions

Solution = CurveSolution | PathSamples


class Kind(StrEnum):
    """What is wanted of a run."""

    CURVE = "curve"
    SAMPLES = "samples"


@dataclass(frozen=True)
class Run:
    """One finite element run.

    Parameters
    ----------
    geometry : Geometry
        As moulded.
    resolution : Resolution
        Of the mesh.
    curve : Curve
        Loads and material in dimensionless groups.
    kind : Kind
        Readings at the curve's loads, or readings and derivatives where the path stopped.

    Examples
    --------
    >>> material = Material(c2_ratio=-0.014, c3_ratio=0.004, paper_group=120.0)
    >>> run = Run(Geometry(Dimensions()), Resolution(3.5, 2.5, 5.0), Curve((0.2, 0.4), material))
    >>> len(run.key())
    64
    """

    geometry: Geometry
    resolution: Resolution
    curve: Curve
    kind: Kind = Kind.CURVE

    def parameters(self) -> dict[str, object]:
        """Return all that the solution depends on, the model's version included, as plain JSON."""
        return {"model_version": MODEL_VERSION, **{k: _plain(v) for k, v in asdict(self).items()}}

    def key(self) -> str:
        """Return the content's name: version of the model, geometry, mesh, inputs, kind, hashed."""
        return key_of(self.parameters())

    def __str__(self) -> str:
        """Return the parameters as a user reads them, but for those that are 0."""
        groups = [asdict(part) for part in (self.resolution, self.curve.material)]
        shape = asdict(self.geometry)
        values = shape.pop("dimensions") | shape | groups[0] | groups[1]
        named = ", ".join(f"{name}={value:g}" for name, value in values.items() if value)
        loads = self.curve.loads
        upto = f"{len(loads)} loads up to {loads[-1]:g}" if loads else "no load"
        return f"{self.kind} run {self.key()[:12]} ({upto}, {named})"


def key_of(parameters: dict[str, object]) -> str:
    """Return the name of a run with these parameters."""
    return hashlib.sha256(json.dumps(parameters, sort_keys=True).encode()).hexdigest()


def run_of(parameters: dict[str, Any]) -> Run:
    """Return the run with these parameters, the inverse of ``Run.parameters``.

    Raises
    ------
    KeyError, TypeError, ValueError
        If they are of another version of the package.
    """
    shape, curve = parameters["geometry"], parameters["curve"]
    sizes = shape["dimensions"]
    dimensions = Dimensions(**sizes | {"chambers": int(sizes["chambers"])})
    rest = {name: value for name, value in shape.items() if name != "dimensions"}
    return Run(
        Geometry(dimensions, **rest),
        Resolution(**parameters["resolution"]),
        Curve(tuple(curve["loads"]), Material(**curve["material"])),
        Kind(parameters["kind"]),
    )


def _plain(value: object) -> object:
    """Write equal numbers alike: 14 and 14.0 are the same length."""
    if isinstance(value, dict):
        return {name: _plain(part) for name, part in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(part) for part in value]
    return float(value) if isinstance(value, Real) else str(value)
