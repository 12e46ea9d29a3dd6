"""What study.toml says: the settings of a study, or every fault in them.

Each table of the file is a model with defaults; `Settings` holds them by their names in the file.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass as plain_dataclass
from dataclasses import field, fields, is_dataclass, replace
from typing import Annotated, Any, Literal, get_args

from annotated_types import Ge, Gt, Interval, Len
from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    Strict,
    StringConstraints,
    TypeAdapter,
    ValidationError,
    create_model,
)
from pydantic.dataclasses import dataclass

from bayesdeg.data.cells import LARGEST
from bayesdeg.data.families import (
    CONSTRAINTS,
    KINDS,
    LARGEST_MM,
    MOST_CHAMBERS,
    PASSIVES,
    SECTIONS,
    SMALLEST_MM,
    Constraint,
    ConstraintKind,
    CylindricalDimensions,
    Kind,
    MeshDimensions,
    Mould,
    RibbedDimensions,
    StressUnit,
)
from bayesdeg.data.foreign import ForeignTable
from bayesdeg.data.uncertain import MOST, UncertainDimension, corners, uncertain_dimension
from bayesdeg.errors import Fault, nearest
from bayesdeg.files import DEEPEST, too_deep
from bayesdeg.priors import Distribution, Parameter, law_from_mapping
from bayesdeg.quantities import EFFORTS, LARGEST_SEED, SIDES, Effort, Side

FILE = "study.toml"

Mode = Literal["uniaxial", "equibiaxial", "planar"]
RuptureCriterion = Literal["principal_stretch", "cauchy_stress", "strain_energy", "weakest_link"]
Operator = Literal["angle_over_arc", "circle", "spline", "base_tip", "kappa"]
MaterialLaw = Literal["yeoh", "neo_hookean", "mooney_rivlin", "gent", "ogden"]
LengthUnit = Literal["mm", "cm", "m", "in"]
Axis = Literal["x", "-x", "y", "-y", "z", "-z"]

#: Standard deviation of a rate uniform from 0 to 100 %, 100/√12: nothing is known of it.
LARGEST_RATE_SD = 29.0
MODES: tuple[Mode, ...] = get_args(Mode)
OPERATORS: tuple[Operator, ...] = get_args(Operator)
MATERIAL_LAWS: tuple[MaterialLaw, ...] = get_args(MaterialLaw)
CALIBRATED_LAWS: tuple[MaterialLaw, ...] = ("yeoh", "neo_hookean")
"""Laws that a model can be calibrated with; the finite element model has Yeoh's constants."""
VENDOR_SD = 0.2
"""Default relative standard deviation of a vendor's figure."""
LENGTH_UNITS: tuple[LengthUnit, ...] = get_args(LengthUnit)
FEWEST_POINTS, MOST_READ_POINTS = 4, 1000
"""Points on a line: as a cubic spline needs; from 50 on, readings change by at most 2 %."""
POINTS_OF: Mapping[Operator, tuple[int, int]] = {
    **dict.fromkeys(get_args(Operator), (FEWEST_POINTS, MOST_READ_POINTS)),
    "kappa": (5, 8),
}
"""Fewest and most points of an operator. For Kappa they are control points: with four, the reading
depends by 14 % on where they are set; with nine and more, the curve follows the waves of the floor
and differs from line to line."""
RUPTURE_CRITERIA: tuple[RuptureCriterion, ...] = get_args(RuptureCriterion)


@plain_dataclass(frozen=True)
class Dimensions:
    """Dimensions of the actuator as moulded, before shrinkage; all lengths in mm.

    Parameters
    ----------
    length, width : float
        Outer length and width [mm]; the defaults are stated by doi:10.3389/frobt.2021.760485.
    height : float
        Outer height [mm]; the default of this and of everything below is assumed.
    chambers : int
        Number of chambers in a row.
    floor, roof, side_wall, end_wall : float
        Material below, above, beside and at the ends of the chambers [mm].
    chamber_wall : float
        Wall on each side of a gap [mm]; with ``gap = 0`` the divider is twice this.
    gap : float
        Open slot between neighbouring chambers, from the top down [mm]; 0 for solid dividers.
    channel_width, channel_height : float
        The channel on the floor that joins the chambers [mm].
    channel_roof : float
        Material over the channel under a slot [mm].

    Examples
    --------
    >>> Dimensions().problems()
    ()
    """

    length: float = 50.0
    width: float = 10.0
    height: float = 10.0
    chambers: int = 5
    floor: float = 2.0
    roof: float = 2.0
    side_wall: float = 2.0
    end_wall: float = 3.0
    chamber_wall: float = 1.5
    gap: float = 2.0
    channel_width: float = 2.0
    channel_height: float = 1.5
    channel_roof: float = 1.0

    @property
    def kind(self) -> Kind:
        """The family."""
        return "pneunet"

    @property
    def usual_height(self) -> float:
        """Default height of the constraint layer: the bottom [mm]."""
        return 0.0

    @property
    def constraint_room(self) -> tuple[float, float]:
        """Heights between which a layer runs through solid material: the floor [mm]."""
        return 0.0, self.floor

    @property
    def beam_bending(self) -> float:
        r"""Bend angle over p/C1 of a beam of the section through a chamber [rad].

        .. math:: \theta = \frac{p A z_c}{6 C_1 I} L, \qquad I = \int z^2 dA

        with A and :math:`z_c` the chamber's cross-section and the height of its middle above the
        paper, which does not stretch.
        """
        wide, high = self.width - 2.0 * self.side_wall, self.height - self.floor - self.roof
        top = self.height - self.roof
        second_moment = self.width * self.height**3 / 3.0 - wide * (top**3 - self.floor**3) / 3.0
        moment = wide * high * (self.floor + 0.5 * high)
        return moment / (6.0 * second_moment) * self.length

    def problems(self) -> tuple[str, ...]:
        """Say why no actuator can have these dimensions, one sentence per reason.

        Consequences of a dimension that is itself impossible are omitted.

        Examples
        --------
        >>> Dimensions(side_wall=5.0).problems()
        ('the two side walls (10 mm) leave no chamber in the width (10 mm)',)
        """
        return self._wrong_values() or self._wrong_sums()

    def _wrong_values(self) -> tuple[str, ...]:
        wrong = [
            f"{entry.name} must be above 0, not {getattr(self, entry.name):g}"
            for entry in fields(self)
            if entry.name not in ("chambers", "gap") and not getattr(self, entry.name) > 0.0
        ]
        wrong += [
            f"{entry.name} must be between {SMALLEST_MM:g} and {LARGEST_MM:g} mm, not {value:g}"
            for entry in fields(self)
            if entry.name != "chambers"
            and (value := getattr(self, entry.name)) > 0.0
            and not SMALLEST_MM <= value <= LARGEST_MM
        ]
        if not isinstance(self.chambers, int) or not 1 <= self.chambers <= MOST_CHAMBERS:
            wrong.append(
                f"chambers must be a whole number from 1 to {MOST_CHAMBERS}, not {self.chambers}"
            )
        if not self.gap >= 0.0:
            wrong.append(f"gap must be at least 0, not {self.gap:g}")
        return tuple(wrong)

    def _wrong_sums(self) -> tuple[str, ...]:
        dividers = (self.chambers - 1) * (2.0 * self.chamber_wall + self.gap)
        along = 2.0 * self.end_wall + dividers
        across, upward = 2.0 * self.side_wall, self.floor + self.roof
        wrong = []
        if along >= self.length:
            wrong.append(
                f"end walls, chamber walls and gaps ({along:g} mm) leave no chamber in the length "
                f"({self.length:g} mm)"
            )
        if across >= self.width:
            wrong.append(
                f"the two side walls ({across:g} mm) leave no chamber in the width "
                f"({self.width:g} mm)"
            )
        if upward >= self.height:
            wrong.append(
                f"floor and roof ({upward:g} mm) leave no chamber in the height "
                f"({self.height:g} mm)"
            )
        if wrong or self.chambers == 1:
            return tuple(wrong)
        wide, high = self.width - across, self.height - self.floor - self.roof
        slot_bottom = self.floor + self.channel_height + self.channel_roof
        if self.channel_width > wide:
            wrong.append(
                f"the channel ({self.channel_width:g} mm) is wider than the chambers ({wide:g} mm)"
            )
        if self.channel_height > high:
            wrong.append(
                f"the channel ({self.channel_height:g} mm) is higher than the chambers "
                f"({high:g} mm)"
            )
        elif self.gap > 0.0 and slot_bottom >= self.height:
            wrong.append(
                f"floor, channel and channel roof ({slot_bottom:g} mm) leave no slot in the height "
                f"({self.height:g} mm)"
            )
        return tuple(wrong)


AnyDimensions = Dimensions | RibbedDimensions | CylindricalDimensions | MeshDimensions
"""Dimensions of an actuator of any family."""
MOULDS: Mapping[Kind, type[AnyDimensions]] = {
    "pneunet": Dimensions,
    "ribbed": RibbedDimensions,
    "cylindrical": CylindricalDimensions,
    "mesh": MeshDimensions,
}


def relative_size(dimensions: Mould) -> float:
    """Return the cube root of an actuator's outer volume over that of the default one [–].

    Examples
    --------
    >>> round(relative_size(Dimensions(length=100.0, width=20.0, height=20.0)), 12)
    2.0
    """
    outer = (d.length * d.width * d.height for d in (dimensions, Dimensions()))
    this, usual = outer
    return float((this / usual) ** (1.0 / 3.0))


# ---- values


def _each_once(names: tuple[str, ...]) -> tuple[str, ...]:
    if len(set(names)) < len(names):
        raise ValueError("duplicate name")
    return names


def _law(value: Any) -> Distribution:
    """Read a law, from Python as it is."""
    if isinstance(value, Distribution):
        return value
    if not isinstance(value, dict):
        raise ValueError("is not a law")
    return law_from_mapping(value)


def _two_axes(axes: tuple[str, str]) -> tuple[str, str]:
    if axes[0][-1] == axes[1][-1]:
        raise ValueError("both axes are the same")
    return axes


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    if not 0.0 < ends[0] < ends[1]:
        raise ValueError("is not a range of stretches")
    return ends


Number = Annotated[float, Strict(), Interval(ge=-LARGEST, le=LARGEST)]
Whole = Annotated[int, Strict()]
Flag = Annotated[bool, Strict()]
Positive = Annotated[Number, Gt(0.0)]
NotNegative = Annotated[Number, Ge(0.0)]
Text = Annotated[str, StringConstraints(pattern=r"\S")]
Law = Annotated[Distribution, PlainValidator(_law)]
type Distinct[T] = Annotated[tuple[T, ...], AfterValidator(_each_once)]


def _key(default: Any, accepts: str, **renamed: str) -> Any:
    """Define a key of a table by its default and the accepted values in words."""
    return field(default=default, metadata={"accepts": accepts, **renamed})


def _one_of(words: tuple[str, ...]) -> str:
    return f"one of {', '.join(words)}"


_TABLE = ConfigDict(extra="forbid", validate_by_name=True, arbitrary_types_allowed=True)
_TEXT = "a text in quotes"
_FLAG = "true or false"
_LENGTH = "a number above 0 [mm]"
_SCALE = 'a law { law = "half_normal", sd = .. }'

# ---- tables


@dataclass(frozen=True, config=_TABLE)
class Paper:
    """The strain-limiting paper, ``[paper]``.

    Parameters
    ----------
    thickness : float
        Thickness of the strain-limiting paper, or of the layer that replaces it [mm].
    """

    thickness: Positive = _key(0.1, _LENGTH)


@dataclass(frozen=True, config=_TABLE)
class Layer:
    """The inextensible layer, ``[constraint]``.

    Parameters
    ----------
    kind : {"paper", "film", "elastomer", "none"}
        The inextensible layer: paper and film differ in name only; an elastomer has its own
        thickness and constants, which must be stated; with none, nothing limits stretch along
        the plane.
    height : float, optional
        Height of the layer's middle above the bottom [mm]; by default it lies on the bottom, or
        in the middle of an actuator with two halves.
    thickness : float, optional
        The same as `thickness` of `[paper]`, in its place.
    C1, C2, C3 : float
        Yeoh constants of a layer of elastomer, in its unit.
    unit : {"MPa", "kPa"}, optional
        Unit of these; kPa by default, for backward compatibility.
    """

    kind: ConstraintKind = _key("paper", _one_of(CONSTRAINTS))
    height: NotNegative | None = _key(None, "a number of at least 0 [mm]")
    thickness: Positive | None = _key(None, _LENGTH)
    C1: Positive | None = _key(None, "a number above 0, in its unit")
    C2: Number = _key(0.0, "a number, in its unit")
    C3: NotNegative = _key(0.0, "a number from 0, in its unit")
    unit: StressUnit | None = _key(None, "MPa or kPa, for C1, C2 and C3 (default kPa)")


@dataclass(frozen=True, config=_TABLE)
class Noise:
    """Standard errors, ``[noise]``.

    Parameters
    ----------
    degradation_sd_pct : float
        Standard error of a degradation rate where none is recorded [%].
    """

    degradation_sd_pct: Annotated[Number, Interval(ge=0.0, le=LARGEST_RATE_SD)] = _key(
        1.0, f"a number from 0 to {LARGEST_RATE_SD:g} [%]"
    )


@dataclass(frozen=True, config=_TABLE)
class CauseOptions:
    """Causes to be tried, ``[causes]``.

    Parameters
    ----------
    candidates : tuple of str, optional
        Causes to be tried; ``None`` for all.
    """

    candidates: Annotated[
        Distinct[str] | None, BeforeValidator(lambda value: None if value == "all" else value)
    ] = _key(None, '"all" or a list of distinct cause names')


@dataclass(frozen=True, config=_TABLE)
class SamplingOptions:
    """Effort of the calibrations, ``[sampling]``.

    Parameters
    ----------
    effort : {"quick", "standard", "thorough"}
        How much is spent on sampling.
    """

    effort: Effort = _key("standard", _one_of(EFFORTS))


@dataclass(frozen=True, config=_TABLE)
class TensileOptions:
    """Tensile curves, ``[tensile]``.

    Parameters
    ----------
    fit_modes : tuple of str
        Modes of loading whose tensile curves are fitted; others are held out and only predicted.
    """

    fit_modes: Annotated[Distinct[Mode], Len(1)] = _key(
        MODES, f"a non-empty list of distinct entries from {', '.join(MODES)}"
    )


@dataclass(frozen=True, config=_TABLE)
class MaterialOptions:
    """Material law of films and actuators, ``[material]``.

    Parameters
    ----------
    order : int
        Polynomial order of Yeoh's constants in the degradation rate, 0 to 3.
    law : {"yeoh", "neo_hookean"}
        Material law of the calibrated model.
    stretch_range : (float, float), optional
        Stretch range of films; readings outside are left out.
    """

    order: Annotated[Whole, Interval(ge=0, le=3)] = _key(2, "a whole number from 0 to 3")
    law: MaterialLaw = _key("yeoh", _one_of(MATERIAL_LAWS))
    stretch_range: Annotated[tuple[Number, Number], AfterValidator(_rising)] | None = _key(
        None, "two stretches above 0, the smaller first, such as [1.0, 2.0]"
    )


@plain_dataclass(frozen=True)
class Known:
    """A number with its standard uncertainty.

    Parameters
    ----------
    value : float
        The number.
    sd : float
        Its standard uncertainty, in the same unit; 0 where it is taken as exact.
    """

    value: float
    sd: float = 0.0


KNOWN = {field.name for field in fields(Known)}
_NUMBERS = TypeAdapter(dict[str, Number])


def _known(value: Any) -> Known:
    """Read a value above 0, with or without its standard uncertainty."""
    if isinstance(value, Known):
        return value
    both = _NUMBERS.validate_python(value if isinstance(value, dict) else {"value": value})
    if not (both.keys() <= KNOWN and 0.0 <= both.get("sd", 0.0) < both.get("value", 0.0)):
        raise ValueError("is not a value with an sd below it")
    return Known(**both)


def _figure(value: Any) -> Known:
    """Read a vendor's figure: a value above 0, and its sd, by default 20 % of it."""
    known = _known(value)
    if known.sd == 0.0:
        if isinstance(value, dict) and "sd" in value:
            raise ValueError("a vendor's figure needs an sd above 0")
        return Known(known.value, VENDOR_SD * known.value)
    return known


_Known = Annotated[Known, PlainValidator(_known)]
_Figure = Annotated[Known, PlainValidator(_figure)]


@plain_dataclass(frozen=True)
class Mixture:
    """The poured mixture: parts by mass and densities [g/cm³].

    The densities are assumed, since the source states none: published values are 1.27 to 1.44 for
    gelatin, 1.26 for glycerol and 1.00 for water.

    Parameters
    ----------
    gelatin, glycerol, water : float
        Parts by mass M_Gel : M_Gly : M_0w.
    gelatin_density, glycerol_density, water_density : float
        [g/cm³]
    """

    gelatin: float = 2.0
    glycerol: float = 1.0
    water: float = 8.0
    gelatin_density: float = 1.35
    glycerol_density: float = 1.26
    water_density: float = 1.00

    @property
    def total(self) -> float:
        """Sum of the parts, M_0."""
        return self.gelatin + self.glycerol + self.water

    @property
    def solids(self) -> float:
        """Mass share of gelatin and glycerol, which stay when all water is lost."""
        return (self.gelatin + self.glycerol) / self.total


def _part(usual: float, unit: str) -> Any:
    return _key(
        Known(usual),
        f"a number above 0 [{unit}], or {{ value = .., sd = .. }} with sd from 0 to below value",
    )


@dataclass(frozen=True, config=_TABLE)
class MixtureRecipe:
    """Composition of a `Mixture` with uncertainties, ``[shrinkage]``.

    The defaults are taken as exact. All films of a study share it, so its errors are common to them
    and no average removes them.

    Parameters
    ----------
    gelatin, glycerol, water : Known
        Parts by mass.
    gelatin_density, glycerol_density, water_density : Known
        [g/cm³]

    Examples
    --------
    >>> MixtureRecipe(gelatin_density=Known(1.35, 0.05)).mixture == Mixture()
    True
    """

    gelatin: _Known = _part(Mixture.gelatin, "parts by mass")
    glycerol: _Known = _part(Mixture.glycerol, "parts by mass")
    water: _Known = _part(Mixture.water, "parts by mass")
    gelatin_density: _Known = _part(Mixture.gelatin_density, "g/cm³")
    glycerol_density: _Known = _part(Mixture.glycerol_density, "g/cm³")
    water_density: _Known = _part(Mixture.water_density, "g/cm³")

    @property
    def mixture(self) -> Mixture:
        """The mixture at the given values."""
        return Mixture(**{entry.name: getattr(self, entry.name).value for entry in fields(self)})


def _of_vendor(unit: str) -> Any:
    return _key(
        None,
        f"a number above 0 [{unit}], or {{ value = .., sd = .. }} with sd above 0, below value",
    )


@dataclass(frozen=True, config=_TABLE)
class VendorFigures:
    """A vendor's figures of the fresh material, ``[vendor]``; 20 % cover batch and method.

    Parameters
    ----------
    modulus_100 : Known, optional
        Nominal stress at a stretch of 2 in uniaxial tension, "100 % modulus" [kPa].
    elongation_at_break : Known, optional
        100 (λ_break − 1) [%].
    source : str
        Source of the figures.
    """

    modulus_100: _Figure | None = _of_vendor("kPa")
    elongation_at_break: _Figure | None = _of_vendor("%")
    source: Text = _key("vendor", _TEXT)


@dataclass(frozen=True, config=_TABLE)
class RuptureOptions:
    """How rupture is predicted, ``[rupture]``.

    Parameters
    ----------
    criterion : str
        Measure of a wall's state compared with the films' elongation at break.
    film_volume : float
        Volume of a film stretched in a break test, for the weakest link; by default the narrow
        part of ISO 37 type 1A, 20 mm × 5 mm, of a film of 0.5 mm [mm³].
    """

    criterion: RuptureCriterion = _key("principal_stretch", _one_of(RUPTURE_CRITERIA))
    film_volume: Positive = _key(50.0, "a number above 0 [mm³]")


@dataclass(frozen=True, config=_TABLE)
class SuspectOptions:
    """Outlying specimens and readings, ``[suspects]``.

    Parameters
    ----------
    set_aside : bool
        Whether to calibrate and judge without specimens and readings that the others contradict
        beyond doubt. They are looked for in any case.
    """

    set_aside: Flag = _key(True, _FLAG)


@dataclass(frozen=True, config=_TABLE)
class UserForward:
    """A user's own forward map, ``[forward]``.

    Parameters
    ----------
    function : str
        File in the study and function in it, ``model.py:predict``.
    inputs : tuple of str, optional
        Columns of ``readings.csv`` given to the function; by default all numeric ones except the
        reading itself.
    """

    function: Annotated[str, StringConstraints(pattern=r"^[^:/\\]+\.py:[A-Za-z_]\w*$")] = field(
        metadata={"accepts": 'a file in the study and a function in it, "model.py:predict"'}
    )
    inputs: Annotated[Distinct[str], Len(1)] | None = _key(
        None, "a list of distinct columns of readings.csv"
    )


@dataclass(frozen=True, config=_TABLE)
class ReadingOptions:
    """How curvature was read, or the reading of a user's own forward map, ``[reading]``.

    Parameters
    ----------
    operator : str, optional
        How curvature was read; by default as bend angle over arc length.
    points : int
        Number of points along the bottom line given to any other operator; for ``kappa`` the
        number of control points.
    name : str
        Column of the reading.
    unit : str
        Unit of the reading.
    error : float or Distribution, optional
        Standard deviation of a reading, or its prior.
    scatter : bool or Distribution
        Whether specimens differ, or the prior of their scatter.
    """

    operator: Operator | None = _key(None, _one_of(OPERATORS))
    points: Annotated[Whole, Interval(ge=FEWEST_POINTS, le=MOST_READ_POINTS)] = _key(
        50, f"a whole number from {FEWEST_POINTS} to {MOST_READ_POINTS}"
    )
    name: Text = _key("reading", "the column of readings.csv with the reading, in quotes")
    unit: Text = _key("–", _TEXT)
    error: Law | Positive | None = _key(None, f"a number above 0, or {_SCALE}")
    scatter: Law | Flag = _key(False, f"true, false, or {_SCALE}")


@dataclass(frozen=True, config=_TABLE)
class PhotographOptions:
    """How the photographs of a study are traced, from ``[photographs]``.

    Parameters
    ----------
    grid : float, optional
        Side of a square of a checkerboard in view [mm].
    ruler : float, optional
        Tick spacing of a ruler in view [mm].
    length : float, optional
        Length of the bottom line [mm]; a check if there is another scale.
    scale : float, optional
        Size of a pixel in a perpendicular view [mm].
    base : {"left", "right", "top", "bottom"}, optional
        Side of the clamp.
    hint : str, optional
        File in the study with points near the lines.
    line : str, optional
        File in the study with lines used unchanged where tracing fails.
    """

    grid: Positive | None = _key(None, _LENGTH)
    ruler: Positive | None = _key(None, _LENGTH)
    length: Positive | None = _key(None, _LENGTH)
    scale: Positive | None = _key(None, "a number above 0 [mm/px]")
    base: Side | None = _key(None, _one_of(SIDES))
    hint: Text | None = _key(None, "a file in the study, in quotes")
    line: Text | None = _key(None, "a file in the study, in quotes")

    @property
    def has_scale(self) -> bool:
        """Whether a scale is given."""
        return any(one is not None for one in (self.grid, self.ruler, self.length, self.scale))


@dataclass(frozen=True, config=_TABLE)
class CaptureOptions:
    """How motion capture recordings are read, from ``[captures]``.

    Parameters
    ----------
    markers : tuple of str
        Names of the markers along the bottom line, from the clamp to the tip; the part before a
        colon may be left out.
    unit : {"mm", "cm", "m", "in"}, optional
        Unit of length, where the recordings lack it or state it wrongly.
    plane : (str, str), optional
        Axes of the laboratory along the clamped end, towards the tip, and away from the paper,
        such as ``["x", "-z"]``; by default the plane in which the markers of a specimen move, with
        the paper on the side to which it bends.
    offset : float
        Distance of markers' centres from the bottom line, on the side of the paper [mm].
    sd : float
        Standard error of a marker's place that averaging does not reduce: of the system, and of
        its attachment [mm].
    pressure : str, optional
        Analog channel of the pressure, for rows of ``captures.csv`` that state none.
    kpa_per_unit : float, optional
        Pressure per unit of the channel [kPa]; not needed where the channel states a unit of
        pressure.
    zero : float
        Channel reading at zero pressure, in its unit.
    """

    markers: Annotated[Distinct[Text], Len(FEWEST_POINTS)] = _key(
        (), f"a list of at least {FEWEST_POINTS} distinct marker names"
    )
    unit: LengthUnit | None = _key(None, _one_of(LENGTH_UNITS))
    plane: Annotated[tuple[Axis, Axis], AfterValidator(_two_axes)] | None = _key(
        None,
        'two different axes, along the clamped end and away from the paper, such as ["x", "-z"]',
    )
    offset: Number = _key(0.0, "a number [mm]")
    sd: NotNegative = _key(0.0, "a number of at least 0 [mm]")
    pressure: Text | None = _key(None, "the name of an analog channel, in quotes")
    kpa_per_unit: Annotated[Positive | None, Field(validation_alias="kPa_per_unit")] = _key(
        None, "a number above 0 [kPa]", key="kPa_per_unit"
    )
    zero: Number = _key(0.0, "a number, in the unit of the channel")


@dataclass(frozen=True, config=_TABLE)
class Settings:
    """The contents of ``study.toml``, defaults filled in.

    Parameters
    ----------
    title : str
        Heading of the report; empty if not given.
    note : str
        Free text shown in the report.
    virtual : bool
        Whether the data come from a virtual experiment.
    seed : int
        Seed of all random numbers of the study.
    dimensions : Dimensions, RibbedDimensions, CylindricalDimensions or MeshDimensions
        The actuator as moulded, ``[actuator]``; a dimension given by a prior has its median here.
    uncertain : tuple of UncertainDimension
        Dimensions given by priors.
    priors : mapping of str to Distribution
        Only priors stated by the study; all other parameters keep theirs.
    parameters : tuple of Parameter
        Unknowns of a user's own forward map, with their priors.
    forward : UserForward, optional
        A user's own forward map, instead of actuators and films.
    paper, constraint, shrinkage, noise, causes, sampling, tensile, material, vendor, rupture,
    suspects, reading, photographs, markers, captures
        The tables of these names.

    Examples
    --------
    >>> Settings().dimensions == Dimensions()
    True
    """

    title: str = _key("", _TEXT)
    note: str = _key("", _TEXT)
    virtual: Flag = _key(False, _FLAG)
    seed: Annotated[Whole, Interval(ge=0, le=LARGEST_SEED)] = _key(
        20211124, f"a whole number from 0 to {LARGEST_SEED}"
    )
    dimensions: AnyDimensions = field(default_factory=Dimensions)
    uncertain: tuple[UncertainDimension, ...] = ()
    priors: Mapping[str, Law] = field(default_factory=dict)
    parameters: tuple[Parameter, ...] = ()
    forward: UserForward | None = None
    paper: Paper = field(default_factory=Paper)
    constraint: Layer = field(default_factory=Layer)
    shrinkage: MixtureRecipe = field(default_factory=MixtureRecipe)
    noise: Noise = field(default_factory=Noise)
    causes: CauseOptions = field(default_factory=CauseOptions)
    sampling: SamplingOptions = field(default_factory=SamplingOptions)
    tensile: TensileOptions = field(default_factory=TensileOptions)
    material: MaterialOptions = field(default_factory=MaterialOptions)
    vendor: VendorFigures = field(default_factory=VendorFigures)
    rupture: RuptureOptions = field(default_factory=RuptureOptions)
    suspects: SuspectOptions = field(default_factory=SuspectOptions)
    reading: ReadingOptions = field(default_factory=ReadingOptions)
    photographs: PhotographOptions = field(default_factory=PhotographOptions)
    markers: ForeignTable = field(default_factory=ForeignTable)
    captures: CaptureOptions = field(default_factory=CaptureOptions)

    @property
    def is_default_mould(self) -> bool:
        """Whether this is the default actuator with paper or film on its bottom."""
        on_bottom = self.layer.is_membrane and not self.layer.height
        return self.dimensions == Dimensions() and on_bottom and not self.uncertain

    @property
    def layer(self) -> Constraint:
        """The inextensible layer."""
        stated = self.constraint
        if stated.kind != "elastomer":
            return Constraint(stated.kind, stated.height)
        kpa = 1e3 if stated.unit == "MPa" else 1.0
        return Constraint(
            stated.kind,
            stated.height,
            self.paper.thickness,
            kpa * (stated.C1 or 0.0),
            kpa * stated.C2,
            kpa * stated.C3,
        )


# ---- keys of the file


def _size(value: Any) -> float | Distribution:
    """Read a length, or the law of one."""
    return law_from_mapping(value) if isinstance(value, dict) else _NUMBER.validate_python(value)


_NUMBER: TypeAdapter[float] = TypeAdapter(Number)
_Size = Annotated[Any, PlainValidator(_size)]


def _dimension(name: str, kind: Any) -> tuple[Any, str]:
    """Return the accepted values of a dimension, as a type and in words."""
    special: dict[str, tuple[Any, str]] = {
        "passive": (kind, _one_of(PASSIVES)),
        "section": (kind, _one_of(SECTIONS)),
        "file": (Text, "the name of a mesh next to study.toml, in quotes"),
        "mesh_error": (Number, "a fraction between 0 and 1"),
    }
    if kind is int:
        return Whole, "a whole number of at least 1"
    law = 'a law { law = "normal", mean = .., sd = .. }'
    return special.get(name, (_Size, f"a number up to {LARGEST_MM:g} [mm], or {law}"))


#: Dimensions of each family that study.toml sets: those not read from a file.
_DIMENSIONS = {
    kind: {one.name: one.type for one in fields(mould) if not one.metadata}
    for kind, mould in MOULDS.items()
}
_ACTUATOR: dict[str, tuple[Any, str]] = {"kind": (Kind, _one_of(KINDS))} | {
    name: _dimension(name, kind) for of in _DIMENSIONS.values() for name, kind in of.items()
}
TOML_TABLES = (
    *("actuator", "paper", "constraint", "shrinkage", "priors", "noise", "causes", "sampling"),
    *("tensile", "material", "vendor", "rupture", "suspects", "forward", "parameters", "reading"),
    *("photographs", "markers", "captures"),
)
"""Tables of study.toml."""
MODELS: Mapping[str, Any] = {
    one.name: one.type for one in fields(Settings) if is_dataclass(one.type)
} | {"forward": UserForward}
"""Models of the tables, but for the actuator, priors and parameters."""


def _keys(model: Any) -> dict[str, str]:
    return {
        one.metadata.get("key", one.name): one.metadata["accepts"]
        for one in fields(model)
        if "accepts" in one.metadata
    }


KEYS: Mapping[str, Mapping[str, str]] = {
    "": _keys(Settings),
    "actuator": {name: accepts for name, (_, accepts) in _ACTUATOR.items()},
    **{name: _keys(MODELS[name]) for name in TOML_TABLES if name in MODELS},
}
"""Accepted values in words, by table and key; keys outside of tables have the table ""."""


# ---- reading


_TOO_DEEP = Fault(FILE, "is nested too deeply", "write tables and lists as the documentation shows")


def parse_settings(content: bytes) -> tuple[Settings, tuple[Fault, ...]]:
    r"""Read the settings of a study.

    Parameters
    ----------
    content : bytes
        The file as stored.

    Returns
    -------
    settings : Settings
        What could be read, with the defaults for the rest.
    faults : tuple of Fault
        All faults with their lines; empty for a valid file.

    Examples
    --------
    >>> settings, faults = parse_settings(b"seed = 7\n[actuator]\nlenght = 60.0\n")
    >>> settings.seed
    7
    >>> print(faults[0])
    study.toml, row 3, column actuator.lenght, value '60.0': is not a known key; did you mean 'length'?
    """  # noqa: E501
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        row = content.count(b"\n", 0, error.start) + 1
        return Settings(), (Fault(FILE, "is not UTF-8 text", "save it as UTF-8", row),)
    # tomllib takes minutes for a key of thousands of parts
    keys = (line.partition("=")[0] for line in text.splitlines() if "=" in line or line[:1] == "[")
    if any(key.count(".") > DEEPEST for key in keys):
        return Settings(), (_TOO_DEEP,)
    try:
        document = tomllib.loads(text)
    except RecursionError:
        return Settings(), (_TOO_DEEP,)
    except ValueError as error:
        message, lines = str(error), text.splitlines()
        found = re.search(r"at line (\d+)", message)
        row = int(found[1]) if found else max(1, len(lines))
        shown = lines[row - 1].strip() if row <= len(lines) else None
        why = re.sub(r" \(at .*\)$", "", message)
        problem = f"is not valid TOML: {why[:1].lower()}{why[1:]}"
        remedy = "write key = value, texts in quotes"
        return Settings(), (Fault(FILE, problem, remedy, row, value=shown),)
    if too_deep(document):
        return Settings(), (_TOO_DEEP,)
    return _from_document(document, _Source(text))


@plain_dataclass(frozen=True)
class _Source:
    """The text of study.toml, in which faults have their lines."""

    text: str

    def fault(
        self, table: str, key: str | None, problem: str, remedy: str, value: object = None
    ) -> Fault:
        """Word a fault of a key, or of a whole table."""
        shown = None if value is None else _as_written(value)
        return Fault(FILE, problem, remedy, self.row(table, key), _dotted(table, key), shown)

    def row(self, table: str, key: str | None) -> int | None:
        """Find the line of a key or table header, which `tomllib` does not report."""
        here = ""
        for row, line in enumerate(self.text.splitlines(), start=1):
            header = re.match(r"\s*\[\s*([\w.\-\"']+)\s*\]", line)
            if header:
                here = header[1].replace('"', "").replace("'", "")
                if here == _dotted(table, key):
                    return row
            elif key is not None and here == table:
                name = line.partition("=")[0].strip().strip("\"'")
                if name == key or name.startswith(f"{key}."):
                    return row
        return None


def _dotted(table: str, key: str | None) -> str:
    return f"{table}.{key}" if table and key is not None else table or key or ""


def _as_written(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        pairs = (f"{key} = {_as_written(entry)}" for key, entry in value.items())
        return f"{{ {', '.join(pairs)} }}"
    if isinstance(value, list):
        return f"[{', '.join(_as_written(entry) for entry in value)}]"
    return f'"{value}"' if isinstance(value, str) else str(value)


_DEFINED: dict[str, Any] = {name: (accepted, None) for name, (accepted, _) in _ACTUATOR.items()}
_ACTUATOR_FILE: TypeAdapter[Any] = TypeAdapter(
    create_model(
        "ActuatorFile",
        actuator=(
            create_model("Actuator", __config__=ConfigDict(extra="forbid"), **_DEFINED),
            ...,
        ),
    )
)
_SETTINGS_FILE = TypeAdapter(Settings)


def _accepted[T](
    model: TypeAdapter[T], content: Mapping[str, Any]
) -> tuple[T, list[tuple[str, str]]]:
    """Return the model of the valid content, and table and key of the rest."""
    wrong: list[tuple[str, str]] = []
    while True:
        try:
            return model.validate_python(content, by_alias=True, by_name=False), wrong
        except ValidationError as error:
            refused = error.errors(include_url=False, include_context=False, include_input=False)
        places = [tuple(map(str, one["loc"][:2])) for one in refused]
        wrong += [
            (name, keys[0]) if name in KEYS else ("", name)
            for (name, *keys), one in zip(places, refused, strict=True)
            if one["type"] != "missing" or len(one["loc"]) > 2
        ]
        # a table without a key that it needs is left out
        needed = {name for (name, *keys) in places if keys and keys[0] not in content[name]}
        content = {
            name: {key: value for key, value in entry.items() if (name, key) not in wrong}
            if name in KEYS
            else entry
            for name, entry in content.items()
            if name not in needed and ("", name) not in wrong
        }


def _from_document(document: dict[str, Any], source: _Source) -> tuple[Settings, tuple[Fault, ...]]:
    faults = [
        source.fault(
            "",
            name,
            "is not a table",
            f"write [{name}] on a line of its own and its keys below",
            document[name],
        )
        for name in TOML_TABLES
        if name in document and not isinstance(document[name], dict)
    ]
    tables = {name: document[name] for name in TOML_TABLES if isinstance(document.get(name), dict)}
    priors, wrong_priors = _read_priors(tables.pop("priors", {}), source)
    parameters, wrong_parameters = _read_parameters(tables.pop("parameters", {}), source)
    tables[""] = {key: value for key, value in document.items() if key not in TOML_TABLES}
    known = {
        table: {k: v for k, v in of.items() if k in KEYS[table]} for table, of in tables.items()
    }
    faults += [
        source.fault(
            table,
            key,
            "is not a known key",
            _suggestion(table, key),
            None if isinstance(value, dict) else value,
        )
        for table, entries in tables.items()
        for key, value in entries.items()
        if key not in known[table]
    ]
    faults += [*wrong_priors, *wrong_parameters]
    stated, refused = _accepted(_ACTUATOR_FILE, {"actuator": known.pop("actuator", {})})
    given = stated.actuator.model_fields_set
    sizes = {name: getattr(stated.actuator, name) for name in _ACTUATOR if name in given}
    settings, others = _accepted(_SETTINGS_FILE, known.pop("") | known)
    order = [(table, key) for table, keys in KEYS.items() for key in keys]
    wrong = sorted({*refused, *others}, key=order.index)
    faults += [_wrong_value(*place, tables[place[0]][place[1]], source) for place in wrong]
    kind: Kind = sizes.pop("kind", "pneunet")
    if ("actuator", "kind") not in wrong:
        faults += _of_other_kinds(kind, tables.get("actuator", {}), source)
    faults += _wrong_layer(tables, source)
    laws = {name: size for name, size in sizes.items() if isinstance(size, Distribution)}
    sizes |= {name: float(law.quantile(0.5)) for name, law in laws.items()}
    dimensions = MOULDS[kind](**{n: size for n, size in sizes.items() if n in _DIMENSIONS[kind]})
    layer, law = settings.constraint, settings.material.law
    settings = replace(
        settings,
        dimensions=dimensions,
        priors=priors,
        parameters=parameters,
        paper=Paper(layer.thickness or settings.paper.thickness),
        constraint=replace(layer, thickness=None),
    )
    if law not in CALIBRATED_LAWS:
        settings = replace(settings, material=replace(settings.material, law="yeoh"))
        words = " or ".join(_as_written(name) for name in CALIBRATED_LAWS)
        problem = (
            "is compared with the films, but cannot be calibrated: the finite element model uses "
            "Yeoh's constants"
        )
        remedy = (
            f"write {words}, or remove the key; material_laws.csv of a run shows how well {law} "
            "predicts the films"
        )
        faults.append(source.fault("material", "law", problem, remedy, law))
    # do not blame the defaults that replace refused keys
    if not any((fault.column or "").startswith(("actuator", "constraint")) for fault in faults):
        uncertain, impossible = _uncertain(laws, dimensions, settings.layer, source)
        settings = replace(settings, uncertain=uncertain)
        faults += impossible
    if settings.forward is None and not faults:
        remedy = '[forward] function = "model.py:predict" must name the function that uses them'
        of_operator = document.get("reading", {}).keys() <= {"operator", "points"}
        faults += [
            source.fault(name, None, "has no effect without [forward]", remedy)
            for name in ("forward", "parameters", "reading")
            if name in document and not (name == "reading" and of_operator)
        ]
    if not faults:
        faults += _wrong_operator(settings, document.get("reading", {}), source)
    return settings, tuple(faults)


def _suggestion(table: str, key: str) -> str:
    elsewhere = [name for name, keys in KEYS.items() if key in keys]
    if elsewhere:
        place = f"under [{elsewhere[0]}]" if elsewhere[0] else "above the first [table]"
        return f"it belongs {place}"
    known = [*KEYS[table], *(() if table else TOML_TABLES)]
    best = nearest(key, known, cutoff=0.5)
    return f"did you mean {best!r}?" if best else f"known here: {', '.join(known)}"


def _wrong_value(table: str, key: str, value: object, source: _Source) -> Fault:
    remedy = f"give {KEYS[table][key]}"
    words: Mapping[str, tuple[str, ...]] = {"effort": EFFORTS, "law": MATERIAL_LAWS}
    best = nearest(value, words.get(key, ())) if isinstance(value, str) else None
    if isinstance(value, dict):
        if table == "actuator" and _ACTUATOR[key][0] is _Size:
            try:
                law_from_mapping(value)
            except ValueError as error:
                remedy = str(error)
        unknown = [key for key in value if key not in KNOWN]
        best = nearest(unknown[0], KNOWN, cutoff=0.5) if unknown else None
    remedy += f"; did you mean {best!r}?" if best else ""
    return source.fault(table, key, "is not a valid value", remedy, value)


def _read_priors(
    table: Mapping[str, Any], source: _Source
) -> tuple[dict[str, Distribution], list[Fault]]:
    priors, faults = {}, []
    for name, value in _flattened(table).items():
        remedy = 'write for example { law = "normal", mean = 0.6, sd = 0.1 }'
        if isinstance(value, dict):
            try:
                priors[name] = law_from_mapping(value)
                continue
            except ValueError as error:
                remedy = str(error)
        faults.append(source.fault("priors", name, "is not a law", remedy, value))
    return priors, faults


def _flattened(table: Mapping[str, Any]) -> dict[str, Any]:
    """Undo the nesting of an unquoted ``cause.parameter = ...``."""
    flat: dict[str, Any] = {}
    for name, value in table.items():
        nested = isinstance(value, dict) and "law" not in value
        if nested and value and all(isinstance(entry, dict) for entry in value.values()):
            flat |= {f"{name}.{key}": entry for key, entry in _flattened(value).items()}
        else:
            flat[name] = value
    return flat


def _read_parameters(
    table: Mapping[str, Any], source: _Source
) -> tuple[tuple[Parameter, ...], list[Fault]]:
    """Read ``[parameters]``: laws with unit and meaning."""
    found, faults = [], []
    for name, value in table.items():
        problem, remedy = "is not a law", ""
        if not isinstance(value, dict):
            remedy = 'write for example { law = "normal", mean = 9.8, sd = 0.5, unit = "m/s²" }'
        else:
            words = {key: value[key] for key in ("unit", "meaning") if key in value}
            if not all(isinstance(word, str) for word in words.values()):
                problem, remedy = "has a unit or meaning that is not text", "quote it"
            elif not name.strip():
                problem, remedy = "has no name", "write for example [parameters.g]"
            else:
                try:
                    law = law_from_mapping({k: v for k, v in value.items() if k not in words})
                    found.append(Parameter(name, law, **words))
                except ValueError as error:
                    remedy = str(error)
        if remedy:
            faults.append(source.fault("parameters", name, problem, remedy, value))
    return tuple(found), faults


def _of_other_kinds(kind: Kind, table: Mapping[str, Any], source: _Source) -> Iterator[Fault]:
    """Refuse dimensions that actuators of this family do not have."""
    for key, value in table.items():
        owners = [_as_written(name) for name, known in _DIMENSIONS.items() if key in known]
        if owners and key not in _DIMENSIONS[kind]:
            problem = f"is not a dimension of a {kind} actuator"
            remedy = f"remove it, or write kind = {' or '.join(owners)}"
            yield source.fault("actuator", key, problem, remedy, value)


def _wrong_layer(tables: Mapping[str, Any], source: _Source) -> Iterator[Fault]:
    """Refuse two thicknesses, an elastomer without what it needs, and its constants elsewhere."""
    layer, paper = tables.get("constraint", {}), tables.get("paper", {})
    if "thickness" in layer and "thickness" in paper:
        problem = "repeats paper.thickness, which is of the same layer"
        yield source.fault(
            "constraint", "thickness", problem, "remove one of them", layer["thickness"]
        )
    if layer.get("kind") == "elastomer":
        for name, unit in {"thickness": "mm", "C1": 'MPa, with unit = "MPa"'}.items():
            if name not in layer.keys() | paper.keys():
                problem = f"is an elastomer without {name}"
                remedy = f"give [constraint] {name} in {unit}"
                yield source.fault("constraint", "kind", problem, remedy, "elastomer")
        return
    for key in ("C1", "C2", "C3", "unit"):
        if key in layer:
            problem = "is for an elastomer layer, but kind is not elastomer"
            remedy = 'remove it, or write kind = "elastomer"'
            yield source.fault("constraint", key, problem, remedy, layer[key])


def _uncertain(
    laws: Mapping[str, Distribution], dimensions: AnyDimensions, layer: Constraint, source: _Source
) -> tuple[tuple[UncertainDimension, ...], list[Fault]]:
    """Return the ranges of uncertain dimensions; refuse impossible ones."""
    impossible = [("actuator", one) for one in dimensions.problems()]
    impossible = impossible or [("constraint", one) for one in layer.problems(dimensions)]
    if impossible:
        usual = "change the dimensions so that an actuator can be made"
        parts = ((table, *one.partition("; ")) for table, one in impossible)
        return (), [source.fault(t, None, what, remedy or usual) for t, what, _, remedy in parts]
    if not laws:
        return (), []

    def problems(values: Mapping[str, float]) -> tuple[str, ...]:
        made = type(dimensions)(**(vars(dimensions) | dict(values)))
        return made.problems() or layer.problems(made)

    found, faults = list[UncertainDimension](), list[Fault]()
    for name, law in laws.items():
        try:
            found.append(uncertain_dimension(name, law, problems))
        except ValueError as error:
            remedy = "give a narrower law, or bounds"
            faults.append(source.fault("actuator", name, str(error), remedy))
    if len(laws) > MOST:
        remedy = "give numbers for the least important dimensions"
        problem = f"is one of more than {MOST} uncertain dimensions"
        faults.append(source.fault("actuator", list(laws)[MOST], problem, remedy))
    if not faults:
        for wrong in next(filter(None, map(problems, corners(tuple(found)))), ())[:1]:
            problem = f"conflicts with the other dimensions: {wrong}"
            faults.append(source.fault("actuator", found[-1].name, problem, "give narrower laws"))
    return () if faults else tuple(found), faults


def _wrong_operator(
    settings: Settings, stated: Mapping[str, Any], source: _Source
) -> Iterator[Fault]:
    """Refuse an operator that is unknown for this actuator, or without its control points."""
    operator, points = settings.reading.operator, settings.reading.points
    is_known = settings.forward is None and settings.is_default_mould
    if operator not in (None, "angle_over_arc") and not is_known:
        problem = "is available for the default actuator only"
        remedy = "read the end face's rotation over the arc length and write angle_over_arc"
        yield source.fault("reading", "operator", problem, remedy, operator)
    least, most = POINTS_OF["kappa"]
    if operator == "kappa" and not ("points" in stated and least <= points <= most):
        problem = f"must be {least} to {most} with kappa, whose reading depends on it"
        remedy = "give the curves' number of control points, or export their points as markers.csv"
        if "points" in stated:
            yield source.fault("reading", "points", problem, remedy, points)
        else:
            row, value = source.row("reading", "operator"), "not stated"
            yield Fault(FILE, problem, remedy, row, "reading.points", value)
