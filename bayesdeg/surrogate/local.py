"""An emulator for one study: trained where its films, priors and conditions place the inputs.

The shipped emulator is of a different actuator. The map of a pneunet with paper on its bottom has
the same form, so only the departure from it is fitted, in ln of curvature, bend angle and strains.
The departure is smooth, so a few dozen curves with derivatives determine it. For any other actuator
the map itself is fitted, over the part that the study needs, and in units of load and film that put
this part within the ranges of the groups.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayesdeg.actuator.curve import Curve
from bayesdeg.actuator.moulded import Moulded
from bayesdeg.data.uncertain import UncertainDimension
from bayesdeg.surrogate.coordinates import coordinates
from bayesdeg.surrogate.departure_training import (
    MORE_DEPARTING,
    MORE_DEPARTING_FINE,
    MovedCurve,
    moved_curves,
)
from bayesdeg.surrogate.design import LOAD_SHARES
from bayesdeg.surrogate.kept import DEPARTING, DEPARTING_FINE, Recipe, has_ground
from bayesdeg.surrogate.scaling import GROUPS, NAMES, ONE, Group, Place, TrainingRange, Units

Floats = NDArray[np.float64]

WIDER = 0.1  # margin of the drawn range, on either side, and of the largest load
TAIL = 0.005  # share of draws of a material's group ignored on either side
STEPS = 1000  # of a range: curves are identical when draws differ by rounding
MORE_COARSE, MORE_FINE, ROUNDS = 8, 3, 2
"""Number of curves added where the posterior lies, and maximum number of rounds."""
TARGET_PCT = 0.15
"""Standard error of curvature where the posterior lies that is small relative to readings [%]:
nineteen in twenty errors are then below 0.3 %."""
REFINABLE_PCT = 1.0
"""The same when fine curves at the posterior finally refine the emulator [%]: it then only needs to
lead there."""
TARGET_OUTSIDE = 0.02  # share of the posterior allowed outside the range: one draw of sixty
_STIFFENING = NAMES.index("log_stiffening")
_PAPER = [group.name for group in GROUPS].index("log_paper")


@dataclass(frozen=True)
class InputDraws:
    """Draws of the inputs that a study's models may need.

    Parameters
    ----------
    groups : array, shape (n, 12)
        Groups in the order of ``GROUPS``.
    load : array, shape (n,)
        Largest p/M of each [–].
    """

    groups: Floats
    load: Floats

    @classmethod
    def joined(cls, parts: Sequence["InputDraws"]) -> "InputDraws":
        """Concatenate all draws."""
        groups = np.vstack([part.groups for part in parts])
        return cls(groups, np.concatenate([part.load for part in parts]))

    def in_units(self, units: Units) -> "InputDraws":
        """Return the draws with loads and paper in different units.

        Examples
        --------
        >>> asked = InputDraws(np.zeros((2, 12)), np.array([1.0, 2.0]))
        >>> asked.in_units(Units(load=4.0)).load.tolist()
        [0.25, 0.5]
        """
        groups = self.groups.copy()
        groups[:, _PAPER] -= np.log(units.paper)
        return InputDraws(groups, self.load / units.load)


@dataclass(frozen=True)
class LocalDesign:
    """Curves for one study, and the range of its emulator.

    Parameters
    ----------
    span : TrainingRange
        Part of the whole range.
    coarse, fine : tuple of Curve
        Curves for either mesh; the fine ones are among the coarse.
    usual : tuple of Curve
        Coarse curves at which the error must be most accurate.
    units : Units
        Units of load and paper in the range, not in the curves.
    with_forces : bool
        Whether the same curves are also solved with the tip held.
    dimensions : tuple of UncertainDimension
        Dimensions that are moved.
    departing, departing_fine : tuple of Curve
        Curves with moved dimensions, on either mesh.
    only_departure : bool
        Whether the emulator of the whole range exists already, so that only the departing curves
        are solved.
    """

    span: TrainingRange
    coarse: tuple[Curve, ...]
    fine: tuple[Curve, ...]
    usual: tuple[Curve, ...]
    units: Units = ONE
    with_forces: bool = False
    dimensions: tuple[UncertainDimension, ...] = ()
    departing: tuple[Curve, ...] = ()
    departing_fine: tuple[Curve, ...] = ()
    only_departure: bool = False

    @property
    def nominal(self) -> tuple[tuple[Curve, ...], tuple[Curve, ...]]:
        """The curves of the nominal actuator, on either mesh."""
        if self.only_departure:
            return self.departing, self.departing_fine
        return self.coarse, self.fine

    @property
    def moved(self) -> list[MovedCurve]:
        """The curves with moved dimensions."""
        return moved_curves(self.dimensions, self.departing, self.departing_fine)

    def departing_with(
        self, dimensions: tuple[UncertainDimension, ...], *, alone: bool
    ) -> "LocalDesign":
        """Return the design with some curves solved with moved dimensions.

        Without dimensions it is unchanged. If ``alone``, no other curves are needed.
        """
        if not dimensions:
            return self
        return replace(
            self,
            dimensions=dimensions,
            departing=self.coarse[:DEPARTING],
            departing_fine=self.fine[:DEPARTING_FINE],
            only_departure=alone,
        )

    def further(self, asked: InputDraws, recipe: Recipe) -> "LocalDesign":
        """Return the design with added curves at new draws, over a range that covers both.

        The recipe gives the number of added curves, and the seed that chooses them.
        """
        counted = asked.in_units(self.units)
        new = span_of(counted)
        groups = tuple(
            replace(a, low=min(a.low, b.low), high=max(a.high, b.high))
            for a, b in zip(self.span.groups, new.groups, strict=True)
        )
        span = replace(self.span, groups=groups, share=max(self.span.share, new.share))
        more = _curves(counted, span, recipe, self.units)
        fine = (*self.fine, *more[: recipe.fine_runs])
        design = replace(self, span=span, coarse=(*self.coarse, *more), fine=fine, usual=more)
        if not self.dimensions:
            return design
        return replace(
            design,
            departing=(*self.departing, *more[:MORE_DEPARTING]),
            departing_fine=(*self.departing_fine, *more[:MORE_DEPARTING_FINE]),
        )


def local_design(
    asked: InputDraws,
    recipe: Recipe,
    units: Units = ONE,
) -> LocalDesign:
    """Return a design for a study; a larger one begins with the curves of a smaller one."""
    counted = asked.in_units(units)
    span = span_of(counted)
    curves = _curves(counted, span, recipe, units)
    return LocalDesign(span, curves, curves[: recipe.fine_runs], curves, units)


def _curves(
    counted: InputDraws, span: TrainingRange, recipe: Recipe, units: Units
) -> tuple[Curve, ...]:
    chosen = curves_of(counted, span, recipe.coarse_runs, seed=recipe.seed)
    return tuple(counted_in(curve, Units(1.0 / units.load, 1.0 / units.paper)) for curve in chosen)


def counted_in(curve: Curve, units: Units) -> Curve:
    """Return a curve with load and paper in different units.

    Examples
    --------
    >>> from bayesdeg.actuator.material import MaterialGroups
    >>> curve = Curve((1.0, 2.0), MaterialGroups(0.0, 0.01, 800.0))
    >>> counted_in(curve, Units(load=4.0, paper=8.0)).material.paper_group
    100.0
    """
    if units == ONE:
        return curve
    material = replace(curve.material, paper_group=curve.material.paper_group / units.paper)
    return Curve(tuple(load / units.load for load in curve.loads), material)


def units_for(geometry: Moulded, asked: InputDraws) -> Units:
    """Return units in which all inputs of a study lie within the known ranges.

    They are powers of two, so that similar studies share them, and nothing is rounded. For a
    pneunet with paper on its bottom they are 1, as for ``asked``.
    """
    if has_ground(geometry):
        return ONE
    share = span_share(asked)
    paper = np.quantile(asked.groups[:, _PAPER], [TAIL, 1.0 - TAIL])
    middle = 0.5 * (GROUPS[_PAPER].low + GROUPS[_PAPER].high)
    return replace(
        layer_units(geometry),
        load=float(2.0 ** np.ceil(np.log2(share))),
        paper=float(np.exp2(np.round((np.mean(paper) - middle) / np.log(2.0)))),
    )


def layer_units(geometry: Moulded) -> Units:
    """Return units of 1, with the paper's group being that of the actual layer.

    Examples
    --------
    >>> from bayesdeg.actuator.families import geometry_of
    >>> from bayesdeg.data.families import Constraint, RibbedDimensions
    >>> [
    ...     layer_units(geometry_of(RibbedDimensions(), layer)).layer
    ...     for layer in (Constraint(), Constraint("none"))
    ... ]
    [None, 0.0]
    """
    layer = geometry.constraint
    if layer.is_membrane:
        return ONE
    return Units(layer=layer.constants[0] if layer.is_slab else 0.0)


def span_share(asked: InputDraws, wider: float = WIDER) -> float:
    """Return the largest load to be trained, over the largest known one [–]."""
    largest = TrainingRange().largest_load(_unit_stiffening(asked.groups))
    return (1.0 + wider) * float(np.quantile(asked.load / largest, 1.0 - 2.0 * TAIL))


def covers(span: TrainingRange, wanted: TrainingRange) -> bool:
    """Return whether the range of an emulator covers a second range.

    Examples
    --------
    >>> whole, part = TrainingRange(), TrainingRange(share=0.5)
    >>> covers(whole, part), covers(part, whole)
    (True, False)
    """
    within = (span.lower <= wanted.lower) & (span.upper >= wanted.upper)
    return bool(np.all(within)) and span.share >= wanted.share


def span_of(asked: InputDraws, *, wider: float = WIDER) -> TrainingRange:
    """Return the range over which an emulator covers all draws, if possible.

    A group that no draw moves stays at its neutral value; all others get the range of the draws
    that move them, without tails, widened by a share ``wider`` of its width on either side, within
    the training range of the shipped emulator. The largest load is widened likewise.
    """
    groups: list[Group] = []
    for group, values in zip(GROUPS, asked.groups.T, strict=True):
        moved = values[values != group.neutral]
        if len(moved) == 0:
            groups.append(replace(group, low=group.neutral, high=group.neutral))
            continue
        if group.is_cause:  # few sets of causes move it, and none by much
            ends = np.array([min(moved.min(), group.neutral), max(moved.max(), group.neutral)])
        else:
            ends = np.quantile(moved, [TAIL, 1.0 - TAIL])
        room = wider * (ends[1] - ends[0])
        low, high = np.clip([ends[0] - room, ends[1] + room], group.low, group.high)
        groups.append(replace(group, low=float(low), high=float(high)))
    share = min(1.0, span_share(asked, wider))
    return replace(TrainingRange(), groups=tuple(groups), share=share)


def _unit_stiffening(groups: Floats) -> Floats:
    at = np.column_stack([np.zeros(len(groups)), groups])
    return coordinates(at).points[:, _STIFFENING]


def curves_of(asked: InputDraws, span: TrainingRange, count: int, *, seed: int) -> list[Curve]:
    """Return curves at random draws clipped to a range; the first do not depend on their number.

    Examples
    --------
    >>> draws = np.random.default_rng(1).uniform(0.3, 0.6, (60, 12))
    >>> low, high = TrainingRange().lower, TrainingRange().upper
    >>> asked = InputDraws(low + (high - low) * draws, np.full(60, 0.2))
    >>> asked.groups[:, 5:9] = [0.1172, 0.0, 0.0, 0.0]  # thickness, slack, mismatch, gravity
    >>> span = span_of(asked)
    >>> curves_of(asked, span, 4, seed=1)[:2] == curves_of(asked, span, 2, seed=1)
    True
    """
    chosen = np.random.default_rng(seed).permutation(len(asked.load))[:count]
    places, loads = _inside(InputDraws(asked.groups[chosen], asked.load[chosen]), span)
    return [_curve(place, load) for place, load in zip(places, loads, strict=True)]


def curves_along(asked: InputDraws, span: TrainingRange, count: int, *, seed: int) -> list[Curve]:
    """Return curves at draws spread along the direction of largest variation.

    That is the direction of degradation. Along it, draws are divided into as many shares as curves,
    of equal sums of their largest loads, and one is chosen from each with probability proportional
    to its load: large bending is known least (errors of held-out curves were 0.01 to 0.1 %, and
    grow with the load). Every second curve ends earlier, at a share of its load that varies: a path
    stops at few loads, nearly the same in every curve except its last, and an emulator's error
    oscillates between them. Draws outside the range are clipped.
    """
    groups, generator = asked.groups, np.random.default_rng(seed)
    width = groups.std(axis=0)
    moved = (groups - groups.mean(axis=0)) / np.where(width > 0.0, width, 1.0)
    _, vectors = np.linalg.eigh(moved.T @ moved)
    order = np.argsort(moved @ vectors[:, -1], kind="stable")
    below = np.cumsum(asked.load[order])
    at = (np.arange(count) + generator.uniform(size=count)) / count
    chosen = order[np.searchsorted(below / below[-1], at)]
    places, loads = _inside(InputDraws(groups[chosen], asked.load[chosen]), span)
    # shares by the golden ratio leave no gaps for any number
    begun, number = generator.uniform(), np.arange(count)
    short = SHORTEST + (1.0 - SHORTEST) * ((begun + GOLDEN * number) % 1.0)
    loads = loads * np.where(number % 2 == 0, 1.0, short)
    return [_curve(place, load) for place, load in zip(places, loads, strict=True)]


SHORTEST = 0.06  # share of the largest load: below it curves follow their initial slope
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)


def _inside(asked: InputDraws, span: TrainingRange) -> tuple[Floats, Floats]:
    """Return draws clipped to the range, and the loads to solve up to."""
    width = span.upper - span.lower
    unit = (np.clip(asked.groups, span.lower, span.upper) - span.lower) / np.where(width, width, 1)
    places = span.lower + width * np.round(STEPS * unit) / STEPS
    largest = span.largest_load(_unit_stiffening(places))
    share = np.ceil(STEPS * (1.0 + WIDER) * asked.load / largest) / STEPS
    return places, np.minimum(share, 1.0) * largest


def _curve(values: Floats, load: float) -> Curve:
    place = Place(tuple(float(v) for v in values))
    largest = load * place.modulus
    return Curve(tuple(float(largest * share) for share in LOAD_SHARES), place.material())
