"""Read the settings in study.toml, or report every fault in them."""

import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Annotated, Any, Literal, get_args

from annotated_types import Ge, Gt, Interval, Len
from pydantic import (
    AfterValidator,
    PlainValidator,
    StringConstraints,
    TypeAdapter,
    ValidationError,
)

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
    Passive,
    RibbedDimensions,
    Section,
    StressUnit,
)
from bayesdeg.data.foreign import DECIMALS, DELIMITERS, ForeignTable
from bayesdeg.data.shrinkage import Known, MixtureRecipe
from bayesdeg.data.uncertain import MOST, UncertainDimension, corners, uncertain_dimension
from bayesdeg.errors import Fault, nearest
from bayesdeg.files import DEEPEST, too_deep
from bayesdeg.priors import Distribution, Parameter, law_from_mapping
from bayesdeg.quantities import EFFORTS, LARGEST_SEED, SIDES, Effort, Side

Mode = Literal["uniaxial", "equibiaxial", "planar"]

RuptureCriterion = Literal["principal_stretch", "cauchy_stress", "strain_energy", "weakest_link"]

Operator = Literal["angle_over_arc", "circle", "spline", "base_tip", "kappa"]

MaterialLaw = Literal["yeoh", "neo_hookean", "mooney_rivlin", "gent", "ogden"]
LengthUnit = Literal["mm", "cm", "m", "in"]
Axis = Literal["x", "-x", "y", "-y", "z", "-z"]

#: Standard deviation of a rate uniform from 0 to 100 %, 100/√12: nothing is known of it.
LARGEST_RATE_SD = 29.0
MODES: tuple[str, ...] = get_args(Mode)
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


@dataclass(frozen=True)
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
        """Say why no actuator can have these dimensions.

        Returns
        -------
        tuple of str
            One sentence per reason; empty if the dimensions are possible. Consequences of a
            dimension that is itself impossible are omitted.

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
        return tuple(wrong) or self._wrong_channel()

    def _wrong_channel(self) -> tuple[str, ...]:
        if self.chambers == 1:
            return ()
        wide, high = self.width - 2.0 * self.side_wall, self.height - self.floor - self.roof
        slot_bottom = self.floor + self.channel_height + self.channel_roof
        wrong = []
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


@dataclass(frozen=True)
class UserForward:
    """A user's own forward map, as stated in ``study.toml``.

    Parameters
    ----------
    function : str
        File in the study and function in it, ``model.py:predict``.
    inputs : tuple of str, optional
        Columns of ``readings.csv`` given to the function; by default all numeric ones except the
        reading itself.
    parameters : tuple of Parameter
        Unknowns of the function, with their priors.
    reading, unit : str
        Column of the reading, and its unit.
    error : float or Distribution, optional
        Standard deviation of a reading, or its prior.
    scatter : bool or Distribution
        Whether specimens differ, or the prior of their scatter.
    """

    function: str
    inputs: tuple[str, ...] | None = None
    parameters: tuple[Parameter, ...] = ()
    reading: str = "reading"
    unit: str = "–"
    error: float | Distribution | None = None
    scatter: bool | Distribution = False


@dataclass(frozen=True)
class VendorFigures:
    """A vendor's figures of the fresh material; the default 20 % cover batch and method.

    Parameters
    ----------
    modulus_100 : Known, optional
        Nominal stress at a stretch of 2 in uniaxial tension, "100 % modulus" [kPa].
    elongation_at_break : Known, optional
        100 (λ_break − 1) [%].
    source : str
        Source of the figures.
    """

    modulus_100: Known | None = None
    elongation_at_break: Known | None = None
    source: str = "vendor"


@dataclass(frozen=True)
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

    grid: float | None = None
    ruler: float | None = None
    length: float | None = None
    scale: float | None = None
    base: Side | None = None
    hint: str | None = None
    line: str | None = None

    @property
    def has_scale(self) -> bool:
        """Whether a scale is given."""
        return any(one is not None for one in (self.grid, self.ruler, self.length, self.scale))


@dataclass(frozen=True)
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

    markers: tuple[str, ...] = ()
    unit: LengthUnit | None = None
    plane: tuple[str, str] | None = None
    offset: float = 0.0
    sd: float = 0.0
    pressure: str | None = None
    kpa_per_unit: float | None = None
    zero: float = 0.0


@dataclass(frozen=True)
class Settings:
    """The contents of ``study.toml``, defaults filled in.

    Parameters
    ----------
    title : str
        Heading of the report; empty if not given.
    seed : int
        Seed of all random numbers of the study.
    dimensions : Dimensions, RibbedDimensions, CylindricalDimensions or MeshDimensions
        The actuator as moulded; a dimension given by a prior has its median here.
    uncertain : tuple of UncertainDimension
        Dimensions given by priors.
    paper_thickness_mm : float
        Thickness of the strain-limiting paper, or of the layer that replaces it [mm].
    constraint_kind : {"paper", "film", "elastomer", "none"}
        The inextensible layer: paper and film differ in name only; an elastomer has its own
        thickness and constants, which must be stated; with none, nothing limits stretch along
        the plane.
    constraint_height_mm : float, optional
        Height of the layer's middle above the bottom [mm]; by default it lies on the bottom, or
        in the middle of an actuator with two halves.
    constraint_c1, constraint_c2, constraint_c3 : float
        Yeoh constants of a layer of elastomer, in its unit.
    constraint_unit : {"MPa", "kPa"}, optional
        Unit of these; kPa by default, for backward compatibility.
    recipe : MixtureRecipe
        Parts by mass and densities of the film mixture.
    priors : mapping of str to Distribution
        Only priors stated by the study; all other parameters keep theirs.
    degradation_sd_pct : float
        Standard error of a degradation rate where none is recorded [%].
    candidates : tuple of str, optional
        Causes to be tried; ``None`` for all.
    effort : {"quick", "standard", "thorough"}
        How much is spent on sampling.
    fit_modes : tuple of str
        Modes of loading whose tensile curves are fitted; others are held out and only predicted.
    order : int
        Polynomial order of Yeoh's constants in the degradation rate, 0 to 3.
    virtual : bool
        Whether the data come from a virtual experiment.
    note : str
        Free text shown in the report.
    forward : UserForward, optional
        A user's own forward map, instead of actuators and films.
    rupture_criterion : str
        Measure of a wall's state compared with the films' elongation at break.
    film_volume_mm3 : float
        Volume of a film stretched in a break test, for the weakest link; by default the narrow
        part of ISO 37 type 1A, 20 mm × 5 mm, of a film of 0.5 mm.
    set_aside : bool
        Whether to look for specimens and readings that the others contradict, and to calibrate
        and judge without them.
    operator : str, optional
        How curvature was read; by default as bend angle over arc length.
    reading_points : int
        Number of points along the bottom line given to any other operator; for ``kappa`` the
        number of control points.
    law : {"yeoh", "neo_hookean"}
        Material law of the calibrated model.
    stretch_range : (float, float), optional
        Stretch range of films; readings outside are left out.
    vendor : VendorFigures
        Vendor's figures of the fresh material.
    photographs : PhotographOptions
        How photographs are traced.
    markers : ForeignTable
        Format of ``markers.csv``, if exported by a different program.
    captures : CaptureOptions
        How motion capture recordings are read.

    Examples
    --------
    >>> Settings().dimensions == Dimensions()
    True
    """

    title: str = ""
    seed: int = 20211124
    dimensions: AnyDimensions = field(default_factory=Dimensions)
    uncertain: tuple[UncertainDimension, ...] = ()
    paper_thickness_mm: float = 0.1
    constraint_kind: ConstraintKind = "paper"
    constraint_height_mm: float | None = None
    constraint_c1: float = 0.0
    constraint_c2: float = 0.0
    constraint_c3: float = 0.0
    constraint_unit: StressUnit | None = None
    recipe: MixtureRecipe = field(default_factory=MixtureRecipe)
    priors: Mapping[str, Distribution] = field(default_factory=dict)
    degradation_sd_pct: float = 1.0
    candidates: tuple[str, ...] | None = None
    effort: Effort = "standard"
    fit_modes: tuple[str, ...] = MODES
    order: int = 2
    virtual: bool = False
    note: str = ""
    forward: UserForward | None = None
    rupture_criterion: RuptureCriterion = "principal_stretch"
    film_volume_mm3: float = 50.0
    set_aside: bool = False
    operator: Operator | None = None
    reading_points: int = 50
    law: MaterialLaw = "yeoh"
    stretch_range: tuple[float, float] | None = None
    vendor: VendorFigures = field(default_factory=VendorFigures)
    photographs: PhotographOptions = field(default_factory=PhotographOptions)
    markers: ForeignTable = field(default_factory=ForeignTable)
    captures: CaptureOptions = field(default_factory=CaptureOptions)

    @property
    def kind(self) -> Kind:
        """The family of the actuator."""
        return self.dimensions.kind

    @property
    def is_default_mould(self) -> bool:
        """Whether this is the default actuator with paper or film on its bottom."""
        on_bottom = self.constraint_kind in ("paper", "film") and not self.constraint_height_mm
        return self.dimensions == Dimensions() and on_bottom and not self.uncertain

    @property
    def constraint(self) -> Constraint:
        """The inextensible layer."""
        if self.constraint_kind != "elastomer":
            return Constraint(self.constraint_kind, self.constraint_height_mm)
        kpa = 1e3 if self.constraint_unit == "MPa" else 1.0
        return Constraint(
            self.constraint_kind,
            self.constraint_height_mm,
            self.paper_thickness_mm,
            kpa * self.constraint_c1,
            kpa * self.constraint_c2,
            kpa * self.constraint_c3,
        )


FILE = "study.toml"
KNOWN = {field.name for field in fields(Known)}


@dataclass(frozen=True)
class _Entry:
    """One key: its table, accepted values in words and as a type, and its field."""

    table: str
    key: str
    wanted: str
    accepted: Any
    renamed: str = ""

    @property
    def field(self) -> str:
        """Name of the field of `Settings`, or of a part of it."""
        return self.renamed or self.key

    def read(self, value: object) -> Any:
        """Return the value of the field; raise ValidationError for an invalid one."""
        return TypeAdapter(self.accepted).validate_python(value, strict=True)


def _each_once(names: list[str]) -> tuple[str, ...]:
    if len(set(names)) < len(names):
        raise ValueError("duplicate name")
    return tuple(names)


def _of_other_names(columns: dict[str, str]) -> dict[str, str]:
    if not columns or len(set(columns.values())) < len(columns) or not all(columns.values()):
        raise ValueError("duplicate or empty column name")
    return columns


def _two_axes(axes: list[str]) -> tuple[str, ...]:
    if len({axis[-1] for axis in axes}) < len(axes):
        raise ValueError("both axes are the same")
    return tuple(axes)


def _known(value: Any) -> Known:
    """Read a value above 0, with or without its standard uncertainty."""
    both = TypeAdapter(dict[str, Number]).validate_python(
        value if isinstance(value, dict) else {"value": value}, strict=True
    )
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


def _range(ends: list[float]) -> tuple[float, float]:
    low, high = ends
    if not 0.0 < low < high:
        raise ValueError("is not a range of stretches")
    return low, high


Number = Annotated[float, Interval(ge=-LARGEST, le=LARGEST)]
type _Names[T] = Annotated[list[T], AfterValidator(_each_once)]


def _dimension(name: str) -> _Entry:
    if name in ("chambers", "channels"):
        return _Entry("actuator", name, "a whole number of at least 1", int)
    if name == "passive":
        return _Entry("actuator", name, f"one of {', '.join(PASSIVES)}", Passive)
    if name == "file":
        return _Entry("actuator", name, "the name of a mesh next to study.toml, in quotes", _Text)
    if name == "mesh_error":
        return _Entry("actuator", name, "a fraction between 0 and 1", Number)
    if name == "section":
        return _Entry("actuator", name, f"one of {', '.join(SECTIONS)}", Section)
    wanted = (
        f'a number up to {LARGEST_MM:g} [mm], or a law {{ law = "normal", mean = .., sd = .. }}'
    )
    return _Entry("actuator", name, wanted, _Size)


def _size(value: Any) -> float | Distribution:
    """Read a length, or the law of one."""
    if isinstance(value, dict):
        return law_from_mapping(value)
    return float(TypeAdapter(Number).validate_python(value, strict=True))


def _law(value: Any) -> Distribution:
    if not isinstance(value, dict):
        raise ValueError("is not a law")
    return law_from_mapping(value)


def _recipe(name: str) -> _Entry:
    unit = "[g/cm³]" if name.endswith("density") else "[parts by mass]"
    wanted = f"a number above 0 {unit}, or {{ value = .., sd = .. }} with sd from 0 to below value"
    return _Entry("shrinkage", name, wanted, Annotated[Known, PlainValidator(_known)])


def _vendor(name: str, unit: str) -> _Entry:
    wanted = f"a number above 0 [{unit}], or {{ value = .., sd = .. }} with sd above 0, below value"
    return _Entry("vendor", name, wanted, Annotated[Known, PlainValidator(_figure)])


def _photographs(name: str) -> _Entry:
    wanted = f"a number above 0 [{'mm/px' if name == 'scale' else 'mm'}]"
    return _Entry("photographs", name, wanted, _POSITIVE, f"photographs_{name}")


_SEED = f"a whole number from 0 to {LARGEST_SEED}"
_CAUSES = '"all" or a list of distinct cause names'
_MODES = f"a non-empty list of distinct entries from {', '.join(MODES)}"
_POSITIVE, _DEGRADATION = Annotated[Number, Gt(0.0)], Annotated[Number, Ge(0.0)]
_KNOWN_RATE = Annotated[Number, Interval(ge=0.0, le=LARGEST_RATE_SD)]
_RATE_SD = f"a number from 0 to {LARGEST_RATE_SD:g} [%]"
_FUNCTION = 'a file in the study and a function in it, "model.py:predict"'
_INPUTS = "a list of distinct columns of readings.csv"
_READING = "the column of readings.csv with the reading, in quotes"
_SCALE = 'a law { law = "half_normal", sd = .. }'
_Law = Annotated[Any, PlainValidator(_law)]
_Size = Annotated[Any, PlainValidator(_size)]
_Text = Annotated[str, StringConstraints(pattern=r"\S")]
_Function = Annotated[str, StringConstraints(pattern=r"^[^:/\\]+\.py:[A-Za-z_]\w*$")]

MOULDS: Mapping[Kind, type[AnyDimensions]] = {
    "pneunet": Dimensions,
    "ribbed": RibbedDimensions,
    "cylindrical": CylindricalDimensions,
    "mesh": MeshDimensions,
}


def _keys(mould: type[AnyDimensions]) -> list[str]:
    """Return the dimensions set in study.toml: those not read from a file."""
    return [one.name for one in fields(mould) if not one.metadata]


DIMENSIONS = tuple(dict.fromkeys(name for mould in MOULDS.values() for name in _keys(mould)))
"""Names of dimensions of all families, without duplicates."""


def _captures(name: str, wanted: str, accepted: Any) -> _Entry:
    return _Entry("captures", name, wanted, accepted, f"captures_{name.lower()}")


_CAPTURES = (
    _captures(
        "markers",
        f"a list of at least {FEWEST_POINTS} distinct marker names",
        Annotated[_Names[_Text], Len(FEWEST_POINTS)],
    ),
    _captures("unit", f"one of {', '.join(LENGTH_UNITS)}", LengthUnit),
    _captures(
        "plane",
        'two different axes, along the clamped end and away from the paper, such as ["x", "-z"]',
        Annotated[list[Axis], Len(2, 2), AfterValidator(_two_axes)],
    ),
    _captures("offset", "a number [mm]", Number),
    _captures("sd", "a number of at least 0 [mm]", Annotated[Number, Ge(0.0)]),
    _captures("pressure", "the name of an analog channel, in quotes", _Text),
    _captures("kPa_per_unit", "a number above 0 [kPa]", _POSITIVE),
    _captures("zero", "a number, in the unit of the channel", Number),
)

ENTRIES: tuple[_Entry, ...] = (
    _Entry("", "title", "a text in quotes", str),
    _Entry("", "note", "a text in quotes", str),
    _Entry("", "virtual", "true or false", bool),
    _Entry("", "seed", _SEED, Annotated[int, Interval(ge=0, le=LARGEST_SEED)]),
    _Entry("actuator", "kind", f"one of {', '.join(KINDS)}", Kind),
    *(_dimension(name) for name in DIMENSIONS),
    _Entry("paper", "thickness", "a number above 0 [mm]", _POSITIVE, "paper_thickness_mm"),
    _Entry(
        "constraint",
        "kind",
        f"one of {', '.join(CONSTRAINTS)}",
        ConstraintKind,
        "constraint_kind",
    ),
    _Entry(
        "constraint",
        "height",
        "a number of at least 0 [mm]",
        Annotated[Number, Ge(0.0)],
        "constraint_height_mm",
    ),
    _Entry(
        "constraint",
        "thickness",
        "a number above 0 [mm]",
        _POSITIVE,
        "constraint_thickness_mm",
    ),
    _Entry("constraint", "C1", "a number above 0, in its unit", _POSITIVE, "constraint_c1"),
    _Entry("constraint", "C2", "a number, in its unit", Number, "constraint_c2"),
    _Entry("constraint", "C3", "a number from 0, in its unit", _DEGRADATION, "constraint_c3"),
    _Entry(
        "constraint",
        "unit",
        "MPa or kPa, for C1, C2 and C3 (default kPa)",
        StressUnit,
        "constraint_unit",
    ),
    *(_recipe(entry.name) for entry in fields(MixtureRecipe)),
    _Entry(
        "noise",
        "degradation_sd_pct",
        _RATE_SD,
        Annotated[Number, Interval(ge=0.0, le=LARGEST_RATE_SD)],
    ),
    _Entry("causes", "candidates", _CAUSES, Literal["all"] | _Names[str]),
    _Entry("sampling", "effort", f"one of {', '.join(EFFORTS)}", Effort),
    _Entry("tensile", "fit_modes", _MODES, Annotated[_Names[Mode], Len(1)]),
    _Entry("material", "order", "a whole number from 0 to 3", Annotated[int, Interval(ge=0, le=3)]),
    _Entry("material", "law", f"one of {', '.join(MATERIAL_LAWS)}", MaterialLaw),
    _Entry(
        "material",
        "stretch_range",
        "two stretches above 0, the smaller first, such as [1.0, 2.0]",
        Annotated[list[Number], Len(2, 2), AfterValidator(_range)],
    ),
    _vendor("modulus_100", "kPa"),
    _vendor("elongation_at_break", "%"),
    _Entry("vendor", "source", "a text in quotes", _Text),
    _Entry(
        "rupture",
        "criterion",
        f"one of {', '.join(RUPTURE_CRITERIA)}",
        RuptureCriterion,
        "rupture_criterion",
    ),
    _Entry("rupture", "film_volume", "a number above 0 [mm³]", _POSITIVE, "film_volume_mm3"),
    _Entry("suspects", "set_aside", "true or false", bool),
    _Entry("forward", "function", _FUNCTION, _Function, "own_function"),
    _Entry("forward", "inputs", _INPUTS, Annotated[_Names[str], Len(1)], "own_inputs"),
    _Entry("reading", "operator", f"one of {', '.join(OPERATORS)}", Operator),
    _Entry(
        "reading",
        "points",
        f"a whole number from {FEWEST_POINTS} to {MOST_READ_POINTS}",
        Annotated[int, Interval(ge=FEWEST_POINTS, le=MOST_READ_POINTS)],
        "reading_points",
    ),
    *(_photographs(name) for name in ("grid", "ruler", "length", "scale")),
    _Entry("photographs", "base", f"one of {', '.join(SIDES)}", Side, "photographs_base"),
    *(
        _Entry("photographs", name, "a file in the study, in quotes", _Text, f"photographs_{name}")
        for name in ("hint", "line")
    ),
    _Entry(
        "markers",
        "columns",
        'a table of names, { x_mm = "X", y_mm = "Y" }',
        Annotated[dict[str, str], AfterValidator(_of_other_names)],
        "markers_columns",
    ),
    _Entry(
        "markers",
        "constants",
        "a table of values, { scale_mm_per_px = 0.001 }",
        Annotated[dict[str, float | str], Len(1)],
        "markers_constants",
    ),
    _Entry(
        "markers",
        "delimiter",
        "one of " + ", ".join(f'"{one}"' for one in DELIMITERS if one != "\t"),
        Literal[",", ";", "tab", "\t", "space"],
        "markers_delimiter",
    ),
    _Entry(
        "markers",
        "decimal",
        "one of " + " or ".join(f'"{one}"' for one in DECIMALS),
        Literal[".", ","],
        "markers_decimal",
    ),
    _Entry(
        "markers",
        "skip",
        "a whole number from 0 to 100",
        Annotated[int, Interval(ge=0, le=100)],
        "markers_skip",
    ),
    *_CAPTURES,
    _Entry("reading", "name", _READING, _Text, "own_reading"),
    _Entry("reading", "unit", "a text in quotes", _Text, "own_unit"),
    _Entry("reading", "error", f"a number above 0, or {_SCALE}", _Law | _POSITIVE, "own_error"),
    _Entry("reading", "scatter", f"true, false, or {_SCALE}", _Law | bool, "own_scatter"),
)
TABLES = (
    *("actuator", "paper", "constraint", "shrinkage", "priors", "noise", "causes", "sampling"),
    *("tensile", "material", "vendor", "rupture", "suspects", "forward", "parameters", "reading"),
    *("photographs", "markers", "captures"),
)


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
    if _has_long_key(text):
        return Settings(), (_TOO_DEEP,)
    try:
        document = tomllib.loads(text)
    except RecursionError:
        return Settings(), (_TOO_DEEP,)
    except ValueError as error:
        return Settings(), (_invalid(str(error), text),)
    if too_deep(document):
        return Settings(), (_TOO_DEEP,)
    return _from_document(document, text)


def _has_long_key(text: str) -> bool:
    """Return whether a key has very many parts; `tomllib` takes minutes for thousands."""
    keys = (line.partition("=")[0] for line in text.splitlines() if "=" in line or line[:1] == "[")
    return any(key.count(".") > DEEPEST for key in keys)


def _invalid(message: str, text: str) -> Fault:
    found = re.search(r"at line (\d+)", message)
    row = int(found[1]) if found else max(1, len(text.splitlines()))
    lines = text.splitlines()
    value = lines[row - 1].strip() if row <= len(lines) else None
    reason = re.sub(r" \(at .*\)$", "", message)
    problem = f"is not valid TOML: {reason[:1].lower()}{reason[1:]}"
    return Fault(FILE, problem, "write key = value, texts in quotes", row, value=value)


def _from_document(document: dict[str, Any], text: str) -> tuple[Settings, tuple[Fault, ...]]:
    faults = list(_wrong_tables(document, text))
    tables = {name: document[name] for name in TABLES if isinstance(document.get(name), dict)}
    tables[""] = {key: value for key, value in document.items() if key not in TABLES}
    priors, wrong_priors = _read_priors(tables.pop("priors", {}), text)
    unknowns, wrong_unknowns = _read_parameters(tables.pop("parameters", {}), text)
    faults += [*_unknown_keys(tables, text), *wrong_priors, *wrong_unknowns]
    accepted: dict[str, Any] = {}
    for entry in ENTRIES:
        if entry.key not in tables.get(entry.table, {}):
            continue
        value = tables[entry.table][entry.key]
        try:
            accepted[entry.field] = entry.read(value)
        except ValidationError:
            faults.append(_wrong_value(entry, value, text))
    if accepted.get("candidates") == "all":
        accepted["candidates"] = None
    table = tables.get("actuator", {})
    if ("kind" in table) == ("kind" in accepted):
        faults += _of_other_kinds(accepted.get("kind", "pneunet"), table, text)
    faults += _two_thicknesses(tables, text)
    faults += _of_elastomers(tables, text)
    if "constraint_thickness_mm" in accepted:
        accepted["paper_thickness_mm"] = accepted.pop("constraint_thickness_mm")
    laws, dimensions = _taken_laws(accepted), _mould(accepted)
    accepted["recipe"] = MixtureRecipe(**_of(MixtureRecipe, accepted))
    accepted["vendor"] = VendorFigures(**_of(VendorFigures, accepted))
    faults += _not_calibrated(accepted, text)
    accepted |= {name: make(**_prefixed(name, accepted)) for name, make in _OF_FILES.items()}
    # do not blame the defaults that replace refused keys
    if not any((fault.column or "").startswith(("actuator", "constraint")) for fault in faults):
        of_layer = {k: v for k, v in accepted.items() if k.startswith(("constraint", "paper"))}
        layer = Settings(**of_layer).constraint
        accepted["uncertain"], wrong = _uncertain(laws, dimensions, layer, text)
        faults += wrong
    own = {k: accepted.pop(f"own_{k}") for k in _OWN if f"own_{k}" in accepted}
    forward = UserForward(**own, parameters=unknowns) if "function" in own else None
    if forward is None and not faults:
        faults += _without_forward(document, text)
    settings = Settings(dimensions=dimensions, priors=priors, forward=forward, **accepted)
    if not faults:
        faults += _unknown_operator(settings, text)
        faults += _unknown_controls(settings, "points" in document.get("reading", {}), text)
    return settings, tuple(faults)


_OF_FILES: Mapping[str, Callable[..., object]] = {
    "photographs": PhotographOptions,
    "markers": ForeignTable,
    "captures": CaptureOptions,
}
"""Tables of ``study.toml`` that define how a file is read."""
_OF_OPERATOR = {"operator", "points"}
_OWN = tuple(entry.name for entry in fields(UserForward) if entry.name != "parameters")


def _unknown_operator(settings: Settings, text: str) -> tuple[Fault, ...]:
    """Refuse an operator whose reading of this actuator is unknown."""
    if settings.operator in (None, "angle_over_arc"):
        return ()
    if settings.forward is None and settings.is_default_mould:
        return ()
    return (
        Fault(
            FILE,
            "is available for the default actuator only",
            "read the end face's rotation over the arc length and write angle_over_arc",
            _row_of(text, "reading", "operator"),
            "reading.operator",
            _as_written(settings.operator),
        ),
    )


def _unknown_controls(settings: Settings, stated: bool, text: str) -> tuple[Fault, ...]:
    """Refuse Kappa curves with an unknown number of control points."""
    least, most = POINTS_OF["kappa"]
    points = settings.reading_points
    if settings.operator != "kappa" or (stated and least <= points <= most):
        return ()
    problem = f"must be {least} to {most} with kappa, whose reading depends on it"
    remedy = "give the curves' number of control points, or export their points as markers.csv"
    row = _row_of(text, "reading", "points" if stated else "operator")
    value = str(points) if stated else "not stated"
    return (Fault(FILE, problem, remedy, row, "reading.points", value),)


def _without_forward(document: Mapping[str, Any], text: str) -> tuple[Fault, ...]:
    """Refuse keys that only a user's own forward map can use."""
    remedy = '[forward] function = "model.py:predict" must name the function that uses them'
    return tuple(
        Fault(FILE, "has no effect without [forward]", remedy, _row_of(text, name, None), name)
        for name in ("forward", "parameters", "reading")
        if name in document and not (name == "reading" and document[name].keys() <= _OF_OPERATOR)
    )


def _read_parameters(
    table: Mapping[str, Any], text: str
) -> tuple[tuple[Parameter, ...], tuple[Fault, ...]]:
    """Read ``[parameters]``: laws with unit and meaning."""
    found, faults = [], []
    for name, value in table.items():
        place = (_row_of(text, "parameters", name), _dotted("parameters", name), _as_written(value))
        if not isinstance(value, dict):
            remedy = 'write for example { law = "normal", mean = 9.8, sd = 0.5, unit = "m/s²" }'
            faults.append(Fault(FILE, "is not a law", remedy, *place))
            continue
        words = {key: value[key] for key in ("unit", "meaning") if key in value}
        if not all(isinstance(word, str) for word in words.values()):
            faults.append(Fault(FILE, "has a unit or meaning that is not text", "quote it", *place))
            continue
        if not name.strip():
            faults.append(Fault(FILE, "has no name", "write for example [parameters.g]", *place))
            continue
        try:
            law = law_from_mapping({k: v for k, v in value.items() if k not in words})
        except ValueError as error:
            faults.append(Fault(FILE, "is not a law", str(error), *place))
            continue
        found.append(Parameter(name, law, words.get("unit", "–"), words.get("meaning", "")))
    return tuple(found), tuple(faults)


def _mould(accepted: dict[str, Any]) -> AnyDimensions:
    """Pop the actuator's dimensions of any family from the accepted values."""
    mould = MOULDS[accepted.pop("kind", "pneunet")]
    sizes = {name: accepted.pop(name) for name in DIMENSIONS if name in accepted}
    own = set(_keys(mould))
    return mould(**{name: value for name, value in sizes.items() if name in own})


def _taken_laws(accepted: dict[str, Any]) -> dict[str, Distribution]:
    """Replace laws of dimensions in the accepted values by their medians; return the laws."""
    laws = {n: accepted[n] for n in DIMENSIONS if isinstance(accepted.get(n), Distribution)}
    accepted |= {name: float(law.quantile(0.5)) for name, law in laws.items()}
    return laws


def _uncertain(
    laws: Mapping[str, Distribution], dimensions: AnyDimensions, constraint: Constraint, text: str
) -> tuple[tuple[UncertainDimension, ...], tuple[Fault, ...]]:
    """Return the ranges of uncertain dimensions; refuse impossible ones."""
    impossible = _impossible(dimensions, constraint, text)
    if impossible:
        return (), impossible

    def problems(values: Mapping[str, float]) -> tuple[str, ...]:
        made = type(dimensions)(**(vars(dimensions) | dict(values)))
        return made.problems() or constraint.problems(made)

    def fault(name: str, problem: str, remedy: str) -> Fault:
        return Fault(FILE, problem, remedy, _row_of(text, "actuator", name), f"actuator.{name}")

    found, faults = list[UncertainDimension](), list[Fault]()
    for name, law in laws.items():
        try:
            found.append(uncertain_dimension(name, law, problems))
        except ValueError as error:
            faults.append(fault(name, str(error), "give a narrower law, or bounds"))
    if len(laws) > MOST:
        name = list(laws)[MOST]
        remedy = "give numbers for the least important dimensions"
        faults.append(fault(name, f"is one of more than {MOST} uncertain dimensions", remedy))
    if not faults:
        wrong = next(filter(None, map(problems, corners(tuple(found)))), ())
        faults += [
            fault(
                found[-1].name,
                f"conflicts with the other dimensions: {one}",
                "give narrower laws",
            )
            for one in wrong[:1]
        ]
    return tuple(found) if not faults else (), tuple(faults)


def _of_other_kinds(kind: Kind, table: Mapping[str, Any], text: str) -> tuple[Fault, ...]:
    """Refuse dimensions that actuators of this family do not have."""
    names = {name: {*_keys(mould)} for name, mould in MOULDS.items()}
    return tuple(
        Fault(
            FILE,
            f"is not a dimension of a {kind} actuator",
            "remove it, or write kind = "
            + " or ".join(_as_written(name) for name, known in names.items() if key in known),
            _row_of(text, "actuator", key),
            _dotted("actuator", key),
            _as_written(table[key]),
        )
        for key in table
        if key in DIMENSIONS and key not in names[kind]
    )


def _two_thicknesses(tables: Mapping[str, Any], text: str) -> tuple[Fault, ...]:
    """Refuse two thicknesses for one layer."""
    if not all("thickness" in tables.get(name, {}) for name in ("paper", "constraint")):
        return ()
    return (
        Fault(
            FILE,
            "repeats paper.thickness, which is of the same layer",
            "remove one of them",
            _row_of(text, "constraint", "thickness"),
            "constraint.thickness",
            _as_written(tables["constraint"]["thickness"]),
        ),
    )


def _of_elastomers(tables: Mapping[str, Any], text: str) -> tuple[Fault, ...]:
    """Refuse an elastomer without what it needs, and elastomer constants for any other layer."""
    table = tables.get("constraint", {})
    if table.get("kind") != "elastomer":
        return tuple(
            Fault(
                FILE,
                "is for an elastomer layer, but kind is not elastomer",
                'remove it, or write kind = "elastomer"',
                _row_of(text, "constraint", key),
                _dotted("constraint", key),
                _as_written(table[key]),
            )
            for key in ("C1", "C2", "C3", "unit")
            if key in table
        )
    needed = {"thickness": "mm", "C1": 'MPa, with unit = "MPa"'}
    there = table.keys() | tables.get("paper", {}).keys()
    return tuple(
        Fault(
            FILE,
            f"is an elastomer without {name}",
            f"give [constraint] {name} in {unit}",
            _row_of(text, "constraint", "kind"),
            "constraint.kind",
            '"elastomer"',
        )
        for name, unit in needed.items()
        if name not in there
    )


def _not_calibrated(accepted: dict[str, Any], text: str) -> tuple[Fault, ...]:
    """Refuse a law that is only compared with films, not calibrated."""
    law = accepted.get("law", "yeoh")
    if law in CALIBRATED_LAWS:
        return ()
    del accepted["law"]
    return (
        Fault(
            FILE,
            "is compared with the films, but cannot be calibrated: the finite element model uses "
            "Yeoh's constants",
            f"write {' or '.join(_as_written(name) for name in CALIBRATED_LAWS)}, or remove the "
            f"key; material_laws.csv of a run shows how well {law} predicts the films",
            _row_of(text, "material", "law"),
            "material.law",
            _as_written(law),
        ),
    )


def _of(part: type[MixtureRecipe | VendorFigures], accepted: dict[str, Any]) -> dict[str, Any]:
    """Pop the fields of a part from the accepted values."""
    names = {entry.name for entry in fields(part)}
    return {name: accepted.pop(name) for name in names & accepted.keys()}


def _prefixed(table: str, accepted: dict[str, Any]) -> dict[str, Any]:
    """Pop the keys prefixed with a table's name from the accepted values."""
    names = [name for name in accepted if name.startswith(f"{table}_")]
    return {name.removeprefix(f"{table}_"): accepted.pop(name) for name in names}


def _impossible(dimensions: AnyDimensions, constraint: Constraint, text: str) -> tuple[Fault, ...]:
    problems = [("actuator", one) for one in dimensions.problems()]
    if not problems:
        problems = [("constraint", one) for one in constraint.problems(dimensions)]
    usual = "change the dimensions so that an actuator can be made"
    return tuple(
        Fault(FILE, problem, remedy or usual, _row_of(text, table, None), table)
        for table, (problem, _, remedy) in ((t, one.partition("; ")) for t, one in problems)
    )


def _wrong_tables(document: Mapping[str, Any], text: str) -> tuple[Fault, ...]:
    return tuple(
        Fault(
            FILE,
            "is not a table",
            f"write [{name}] on a line of its own and its keys below",
            _row_of(text, "", name),
            name,
            _as_written(document[name]),
        )
        for name in TABLES
        if name in document and not isinstance(document[name], dict)
    )


def _unknown_keys(tables: Mapping[str, Mapping[str, Any]], text: str) -> tuple[Fault, ...]:
    known = {(entry.table, entry.key) for entry in ENTRIES}
    return tuple(
        Fault(
            FILE,
            "is not a known key",
            _suggest(table, key),
            _row_of(text, table, key),
            _dotted(table, key),
            None if isinstance(value, dict) else _as_written(value),
        )
        for table, entries in tables.items()
        for key, value in entries.items()
        if (table, key) not in known
    )


def _suggest(table: str, key: str) -> str:
    elsewhere = [entry.table for entry in ENTRIES if entry.key == key]
    if elsewhere:
        place = f"under [{elsewhere[0]}]" if elsewhere[0] else "above the first [table]"
        return f"it belongs {place}"
    known = [entry.key for entry in ENTRIES if entry.table == table]
    known += TABLES if not table else ()
    best = nearest(key, known, cutoff=0.5)
    return f"did you mean {best!r}?" if best else f"known here: {', '.join(known)}"


_NEAREST: Mapping[str, tuple[str, ...]] = {"effort": EFFORTS, "law": MATERIAL_LAWS}
"""Keys for which a misspelt value gets a suggestion."""


def _wrong_value(entry: _Entry, value: object, text: str) -> Fault:
    remedy = f"give {entry.wanted}"
    if entry.accepted is _Size and isinstance(value, dict):
        remedy = _wrong_law(value) or remedy
    if entry.field in _NEAREST and isinstance(value, str):
        best = nearest(value, _NEAREST[entry.field])
        remedy += f"; did you mean {best!r}?" if best else ""
    if isinstance(value, dict):
        unknown = [key for key in value if key not in KNOWN]
        best = nearest(unknown[0], KNOWN, cutoff=0.5) if unknown else None
        remedy += f"; did you mean {best!r}?" if best else ""
    row, column = _row_of(text, entry.table, entry.key), _dotted(entry.table, entry.key)
    return Fault(FILE, "is not a valid value", remedy, row, column, _as_written(value))


def _wrong_law(value: Mapping[str, object]) -> str:
    """Say what is wrong with a law; empty if valid."""
    try:
        law_from_mapping(value)
    except ValueError as error:
        return str(error)
    return ""


def _read_priors(
    table: Mapping[str, Any], text: str
) -> tuple[dict[str, Distribution], tuple[Fault, ...]]:
    priors, faults = {}, []
    for name, value in _flattened(table).items():
        row = _row_of(text, "priors", name)
        place = (row, _dotted("priors", name), _as_written(value))
        if not isinstance(value, dict):
            remedy = 'write for example { law = "normal", mean = 0.6, sd = 0.1 }'
            faults.append(Fault(FILE, "is not a law", remedy, *place))
            continue
        try:
            priors[name] = law_from_mapping(value)
        except ValueError as error:
            faults.append(Fault(FILE, "is not a law", str(error), *place))
    return priors, tuple(faults)


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


def _dotted(table: str, key: str) -> str:
    return f"{table}.{key}" if table else key


def _as_written(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        pairs = (f"{key} = {_as_written(entry)}" for key, entry in value.items())
        return f"{{ {', '.join(pairs)} }}"
    if isinstance(value, list):
        return f"[{', '.join(_as_written(entry) for entry in value)}]"
    return f'"{value}"' if isinstance(value, str) else str(value)


def _row_of(text: str, table: str, key: str | None) -> int | None:
    """Find the line of a key or table header, which `tomllib` does not report."""
    here = ""
    for row, line in enumerate(text.splitlines(), start=1):
        header = re.match(r"\s*\[\s*([\w.\-\"']+)\s*\]", line)
        if header:
            here = header[1].replace('"', "").replace("'", "")
            if here == (table if key is None else _dotted(table, key)):
                return row
        elif key is not None and here == table:
            name = line.partition("=")[0].strip().strip("\"'")
            if name == key or name.startswith(f"{key}."):
                return row
    return None
