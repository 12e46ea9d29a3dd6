"""Dimensionless groups: what the forward map depends on, and the training range.

The curvature of the actuator obeys κ s = f(p/M, C2/M, C3/M, Et/(M s), …), s the linear scale and M
any modulus; so C1, α and every error of pressure need no dimension of the emulator. M is taken as
C1 + r/(2√3), half of the shear modulus at rest, so that a term r √I₂ changes the shape of the curve
and not its size. The second group is replaced by the softening C2/√(3 C3 M), which is above −1 for
every stable material; C3/M and the paper's group enter by their logarithms.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.inputs import PAPER_THICKNESS, Inputs, load_of, material_groups
from bayesdeg.actuator.material import MaterialGroups

Floats = NDArray[np.float64]

SECOND = 0.5 / np.sqrt(3.0)  # share of r in the modulus at rest
NOMINAL_SCALE = 0.853
# for an actuator without a layer, whose map does not depend on it: mid-range [mm]
NO_LAYER = 61.0
NOMINAL_THICKNESS = PAPER_THICKNESS / NOMINAL_SCALE


@dataclass(frozen=True)
class Group:
    """One dimensionless group and the range over which it is trained.

    Parameters
    ----------
    name : str
        Name of the group.
    low, high : float
        Its range.
    neutral : float
        Value of the base model.
    unit : str
        Unit after division of lengths by the linear scale.
    meaning : str
        Definition from the inputs.
    is_cause : bool
        Whether the base model leaves it at its neutral value.
    """

    name: str
    low: float
    high: float
    neutral: float
    unit: str
    meaning: str
    is_cause: bool = True


LOAD = "load"
MATERIAL = (
    Group("softening", -0.65, 0.6, 0.0, "–", "C2/√(3 C3 M)", is_cause=False),
    Group("log_stiffening", float(np.log(4e-4)), float(np.log(0.5)), 0.0, "–", "ln(C3/M)", False),
    Group(
        "log_paper", float(np.log(2.5)), float(np.log(1500.0)), 0.0, "–", "ln(Et/(M s mm))", False
    ),
)
CAUSES = (
    Group("second_invariant", 0.0, 0.2241, 0.0, "–", "r/(2√3 M)"),
    Group("skin", 0.0, 1.2, 0.0, "–", "ln of surface over mean stiffness"),
    Group("paper_thickness", 0.05, 0.25, NOMINAL_THICKNESS, "mm", "paper thickness over s"),
    Group("paper_slack", 0.0, 0.05, 0.0, "–", "strain up to which the paper is slack"),
    Group("paper_mismatch", -0.02, 0.03, 0.0, "–", "shrinkage after bonding"),
    Group("gravity_along", -6e-5, 6e-5, 0.0, "1/mm", "ρ g s/M along the actuator"),
    Group("gravity_up", -6e-5, 6e-5, 0.0, "1/mm", "ρ g s/M up from the paper"),
    Group("wall_factor", 0.8, 1.2, 1.0, "–", "wall thickness over the nominal one"),
    Group("erosion", 0.0, 0.4, 0.0, "mm", "thickness lost over s"),
)
GROUPS = (*MATERIAL, *CAUSES)
NAMES = (LOAD, *(group.name for group in GROUPS))


@dataclass(frozen=True)
class Units:
    """Units of p/M and Et/(M s) of an emulator, so that any actuator lies in the known ranges.

    A thick cover or a stiff film takes an actuator far out of the ranges of load and paper, which
    are those of the default one. An emulator trained for it has its own units for both; for the map
    this only changes two scales.

    Parameters
    ----------
    load : float
        Unit of p/M [–].
    paper : float
        Unit of Et/(M s) [mm].
    layer : float, optional
        C1 of an elastomer constraint layer, which replaces the paper: the group is then its C1 over
        M, whatever Et is. 0 for an actuator without a layer, whose group stays at ``NO_LAYER``.
        None for paper or film [MPa].

    Examples
    --------
    >>> one = np.ones(1)
    >>> inputs = Inputs(16 * one, one, one, one, one, 3e4 * one)
    >>> float(Units(load=4.0).inputs(inputs).pressure[0])
    4.0
    >>> float(np.exp(groups_of(Units(layer=8.0).inputs(inputs))["log_paper"][0]).round(9))
    8.0
    """

    load: float = 1.0
    paper: float = 1.0
    layer: float | None = None

    def inputs(self, given: Inputs) -> Inputs:
        """Return inputs converted to these units."""
        if self == ONE:
            return given
        reference, thickness = given.reference_pressure, given.paper_thickness
        stiffness = given.paper_stiffness
        if self.layer is not None:  # the layer's, instead of the paper's
            scale = np.asarray(given.linear_scale)
            modulus = self.layer if self.layer > 0.0 else NO_LAYER * modulus_of(given)
            stiffness = 1e3 * modulus * scale
            # any thickness but the paper's is part of the geometry
            thickness = None if thickness is None else NOMINAL_THICKNESS * scale
        return replace(
            given,
            pressure=given.pressure / self.load,
            paper_stiffness=stiffness / self.paper,
            paper_thickness=thickness,
            reference_pressure=None if reference is None else reference / self.load,
        )

    def by_given(self, by: Mapping[str, Floats], counted: Inputs) -> dict[str, Floats]:
        """Return derivatives by given inputs from those by the converted ones, ``counted``."""
        size = {"pressure": self.load, "paper_stiffness": self.paper}
        found = {name: value / size.get(name, 1.0) for name, value in by.items()}
        if self.layer is None:
            return found
        found["paper_stiffness"] = 0.0 * by["paper_stiffness"]
        through = by["paper_stiffness"] * counted.paper_stiffness
        found["linear_scale"] = found["linear_scale"] + through / counted.linear_scale
        if "paper_thickness" in by:
            found["paper_thickness"] = 0.0 * by["paper_thickness"]
            thickness = by["paper_thickness"] * NOMINAL_THICKNESS
            found["linear_scale"] = found["linear_scale"] + thickness
        if self.layer == 0.0:
            relative = through / modulus_of(counted)
            found["c1"] = found["c1"] + relative
            if "second_invariant" in found:
                found["second_invariant"] = found["second_invariant"] + SECOND * relative
        return found


def modulus_of(inputs: Inputs) -> Floats:
    """Return M = C1 + r/(2√3) [MPa]."""
    second = 0.0 if inputs.second_invariant is None else inputs.second_invariant
    modulus: Floats = np.asarray(inputs.c1 + SECOND * np.asarray(second), dtype=np.float64)
    return modulus


ONE = Units()


@dataclass(frozen=True)
class TrainingRange:
    """The range of loads and groups over which an emulator is trained.

    Parameters
    ----------
    load : float
        Largest p/M [–]; the smallest is 0. See ``largest_load`` for stiffening materials.
    groups : tuple of Group
        In the order of ``GROUPS``; for an emulator of one study, their ranges are parts of those
        there. Coordinates always refer to the whole ranges.
    share : float
        Share of the largest load up to which it is trained [–].
    """

    load: float = 1.25
    groups: tuple[Group, ...] = GROUPS
    share: float = 1.0

    @cached_property
    def lower(self) -> Floats:
        """Lower bounds of the groups, (12,)."""
        return np.array([group.low for group in self.groups])

    @cached_property
    def upper(self) -> Floats:
        """Upper bounds of the groups, (12,)."""
        return np.array([group.high for group in self.groups])

    def largest_load(self, unit_stiffening: Floats) -> Floats:
        """Return the largest p/M for a material with this ln(C3/M).

        Degraded material has a large C3/C1 and a large C1, hence small loads: no pressure of
        interest exceeds 0.3 at the upper end.

        Parameters
        ----------
        unit_stiffening : array
            ln(C3/M) mapped from its range to [−1, 1].

        Examples
        --------
        >>> TrainingRange().largest_load(np.array([-1.0, 1.0])).tolist()
        [1.25, 0.45]
        """
        return self.share * np.interp(unit_stiffening, [0.1, 1.0], [self.load, 0.45])


def groups_of(inputs: Inputs) -> dict[str, Floats]:
    """Return p/M and the groups given by the inputs; nan where C1 or C3 is not above 0.

    Shapes are kept, so that material groups have no pressure axis. Groups of effects not in the
    inputs are left out, except the paper's thickness.

    Examples
    --------
    >>> one = np.ones(1)
    >>> inputs = Inputs(240 * one, 0.3 * one, 0 * one, 0.03 * one, 0.8 * one, 3e4 * one)
    >>> {name: float(value[0].round(3)) for name, value in groups_of(inputs).items()}
    {'load': 0.8, 'softening': 0.0, 'log_stiffening': -2.303, 'log_paper': 4.828, \
'paper_thickness': 0.125}
    """
    return _normalised(load_of(inputs), material_groups(inputs))


def groups_of_material(load: Floats, material: MaterialGroups) -> dict[str, Floats]:
    """Return p/M and all groups of a finite element run with loads p/C1."""
    return _normalised(
        load, {k: np.asarray(v, dtype=np.float64) for k, v in vars(material).items()}
    )


def _normalised(load: Floats, given: Mapping[str, Floats]) -> dict[str, Floats]:
    """Change the unit of stress from C1 to M = C1 + r/(2√3)."""
    second = given.get("second_invariant_ratio", np.zeros(()))
    modulus = 1.0 + SECOND * second
    with np.errstate(invalid="ignore", divide="ignore"):
        stiffening = np.where(given["c3_ratio"] > 0.0, given["c3_ratio"], np.nan) / modulus
        out = {
            LOAD: load / modulus,
            "softening": given["c2_ratio"] / modulus / np.sqrt(3.0 * stiffening),
            "log_stiffening": np.log(stiffening),
            "log_paper": np.log(given["paper_group"] / modulus),
        }
    if "second_invariant_ratio" in given:
        out["second_invariant"] = SECOND * second / modulus
    for name in ("skin", "paper_thickness", "paper_slack", "paper_mismatch"):
        if name in given:
            out[name] = given[name]
    for name in ("gravity_along", "gravity_up"):
        if name in given:
            out[name] = given[name] / modulus
    return out | {name: given[name] for name in ("wall_factor", "erosion") if name in given}


@dataclass(frozen=True)
class Place:
    """A point of the training range, convertible to a finite element run.

    Parameters
    ----------
    values : tuple of float
        Values in the order of ``GROUPS``.
    """

    values: tuple[float, ...]

    @classmethod
    def of(cls, material: MaterialGroups) -> Self:
        """Return the place of a material."""
        found = groups_of_material(np.zeros(()), material)
        return cls(tuple(float(found[group.name]) for group in GROUPS))

    def material(self) -> MaterialGroups:
        """Return the material in units of C1.

        Examples
        --------
        >>> place = Place(tuple(0.5 * (g.low + g.high) for g in GROUPS))
        >>> bool(np.allclose(Place.of(place.material()).values, place.values))
        True
        """
        at = dict(zip((group.name for group in GROUPS), self.values, strict=True))
        modulus = self.modulus
        c3 = np.exp(at["log_stiffening"])
        return MaterialGroups(
            c2_ratio=float(at["softening"] * np.sqrt(3.0 * c3) * modulus),
            c3_ratio=float(c3 * modulus),
            paper_group=float(np.exp(at["log_paper"]) * modulus),
            second_invariant_ratio=float(at["second_invariant"] * modulus / SECOND),
            skin=at["skin"],
            paper_thickness=at["paper_thickness"],
            paper_slack=at["paper_slack"],
            paper_mismatch=at["paper_mismatch"],
            gravity_along=at["gravity_along"] * modulus,
            gravity_up=at["gravity_up"] * modulus,
            wall_factor=at["wall_factor"],
            erosion=at["erosion"],
        )

    @property
    def modulus(self) -> float:
        """M over C1 [–]: 1/(1 − g) with g the second-invariant group."""
        return 1.0 / (1.0 - self.values[len(MATERIAL)])
