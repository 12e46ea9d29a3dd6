"""Single table of names: every quantity with its symbol, unit and meaning.

Columns of files, inputs and outputs of the forward map and axes of figures all use it. Column names
end with their unit (``_pct``, ``_h``, ``_g``, ``_MPa``, ``_kPa``, ``_per_m``, ``_deg``, ``_s``);
symbols are those of doi:10.3389/frobt.2021.760485.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, get_args

DIMENSIONLESS = "–"

#: Largest seed, the largest integer of a TOML file; the smallest is 0.
LARGEST_SEED = 2**63 - 1

#: Sampling effort.
Effort = Literal["quick", "standard", "thorough"]
EFFORTS: tuple[Effort, ...] = get_args(Effort)

#: Side of a photograph.
Side = Literal["left", "right", "top", "bottom"]
SIDES: tuple[Side, ...] = get_args(Side)

#: Words of actuator.csv: direction of the pressure, mount of the actuator.
BRANCHES = LOADING, UNLOADING = ("loading", "unloading")
MOUNTS = ("horizontal", "hanging", "bending_up", "bending_down")

#: Temperatures of a room, or an oven, in which gels are tested [°C].
COLDEST, HOTTEST = -20.0, 90.0

#: Ending of a name by unit.
SUFFIXES: Mapping[str, str] = MappingProxyType(
    {
        "%": "_pct",
        "h": "_h",
        "min": "_min",
        "s": "_s",
        "g": "_g",
        "MPa": "_MPa",
        "kPa": "_kPa",
        "1/m": "_per_m",
        "°": "_deg",
        "°C": "_C",
        "mm": "_mm",
        "px": "_px",
        "mm/px": "_mm_per_px",
        "N": "_N",
        "ml": "_ml",
        "N/m": "_N_per_m",
        "kN/m³": "_kN_per_m3",
        "g/cm³": "_g_per_cm3",
    }
)


@dataclass(frozen=True)
class Quantity:
    """A named quantity.

    Parameters
    ----------
    name : str
        Full name, as in files and code.
    symbol : str
        As in equations; empty for labels.
    unit : str
        One of the keys of `SUFFIXES`, or an en dash for none.
    meaning : str
        In a few words.
    """

    name: str
    symbol: str
    unit: str
    meaning: str


_ROWS = (
    ("film_id", "", "–", "the film"),
    ("specimen_id", "", "–", "the test piece, or the actuator at one degradation"),
    ("time_h", "t", "h", "time in the soil"),
    ("mass_equilibrated_g", "M_0", "g", "mass in equilibrium with 67 % relative humidity"),
    ("mass_dry_g", "M_d", "g", "mass after 24 h at 110 °C"),
    ("moisture_content_pct", "M_C", "%", "moisture content on the wet basis"),
    ("time_min", "t", "min", "time in the enzyme solution"),
    ("mass_dry_before_g", "M'_0", "g", "dry mass before degradation"),
    ("mass_dry_after_g", "M'", "g", "dry mass after degradation"),
    ("mass_equilibrated_before_g", "M_e1", "g", "mass at 67 % humidity before degradation"),
    ("mass_equilibrated_after_g", "M_e2", "g", "mass at 67 % humidity after degradation"),
    ("mass_loss_pct", "M_loss", "%", "dry mass lost by degradation"),
    ("mass_poured_g", "m_0", "g", "mass poured into the mould"),
    ("mass_cured_g", "m_1", "g", "mass after curing"),
    ("mass_conditioned_g", "m_2", "g", "mass after conditioning at 67 % relative humidity"),
    ("volume_ratio", "α", "–", "volume after conditioning over volume before"),
    ("linear_scale", "s", "–", "length of the part over length of the mould, α^(1/3)"),
    ("degradation_pct", "D_R", "%", "degradation rate: loss of moisture content, wet basis"),
    ("degradation_sd_pct", "", "%", "standard error of the degradation rate"),
    ("mode", "", "–", "mode of loading: uniaxial, equibiaxial or planar"),
    ("stretch", "λ", "–", "length over undeformed length along the load"),
    ("stress_MPa", "σ", "MPa", "stress along the load"),
    ("stress_measure", "", "–", "nominal (over the undeformed area) or cauchy"),
    ("elongation_pct", "", "%", "elongation at break, 100 (λ_break − 1)"),
    ("pressure_kPa", "p", "kPa", "gauge pressure in the chambers"),
    ("curvature_per_m", "κ", "1/m", "bend angle over deformed arc length of the bottom line"),
    ("bend_angle_deg", "φ", "°", "rotation of the free end face relative to the clamped one"),
    ("tip_force_N", "F", "N", "force that holds the tip in the bending direction"),
    ("cavity_volume_ml", "ΔV", "ml", "increase of the chambers' volume over that at zero pressure"),
    ("curvature_sd_per_m", "", "1/m", "reading error of the curvature"),
    ("bend_angle_sd_deg", "", "°", "reading error of the bend angle"),
    ("file", "", "–", "name of the photograph in the folder photos, of the recording in captures"),
    ("first_frame", "", "–", "first frame of the hold, as numbered in the recording"),
    ("last_frame", "", "–", "last frame of the hold, as numbered in the recording"),
    ("point", "", "–", "number along the line, counted from the clamped end"),
    ("x_mm", "x", "mm", "position of a point along the clamped end"),
    ("y_mm", "y", "mm", "position of a point away from the paper"),
    ("x_px", "", "px", "position of a point in its picture, to the right"),
    ("y_px", "", "px", "position of a point in its picture, downwards"),
    ("scale_mm_per_px", "", "mm/px", "size of a pixel"),
    ("sd_mm", "", "mm", "standard error of each coordinate of a point"),
    ("time_s", "t", "s", "time since the specimen's first row"),
    ("cycle", "", "–", "loading cycle, counted from 1"),
    ("branch", "", "–", "loading or unloading"),
    ("humidity_pct", "RH", "%", "relative humidity of the room"),
    ("temperature_C", "T", "°C", "temperature of the room"),
    ("batch", "", "–", "mixture or day of the specimen"),
    ("mount", "", "–", "how the actuator is held: horizontal, hanging, bending_up, bending_down"),
    ("ruptured", "", "–", "1 where the specimen burst, else 0"),
    ("quantity", "", "–", "which statistic is given"),
    ("value", "", "–", "value of the statistic, in the unit given"),
    ("sd", "", "–", "standard deviation of the statistic"),
    ("n", "N", "–", "number of specimens"),
    ("unit", "", "–", "unit of value and standard deviation"),
    ("source", "", "–", "reference of the statistic"),
    ("young_modulus", "Y", "MPa", "Young's modulus of films at zero strain; 6 C1 of Yeoh's law"),
    ("modulus_100", "", "MPa", "nominal stress at a stretch of 2 in uniaxial tension"),
    ("elongation_at_break", "", "%", "elongation at break"),
    ("r_squared", "R²", "–", "1 − SSE/SST of simulation against experiment"),
    ("ruptured_count", "", "–", "actuators that burst"),
    ("tested_count", "", "–", "actuators tested"),
    ("mass_loss_slope", "", "–", "mass loss over degradation rate, dry basis"),
    ("pressure", "p", "kPa", "true gauge pressure in the chambers"),
    ("reference_pressure", "p_0", "kPa", "gauge pressure at which the reading was set to zero"),
    ("c1", "C1", "MPa", "first constant of Yeoh's law"),
    ("c2", "C2", "MPa", "second constant of Yeoh's law"),
    ("c3", "C3", "MPa", "third constant of Yeoh's law"),
    ("bulk_modulus", "K", "MPa", "bulk modulus"),
    ("paper_stiffness", "E t", "N/m", "membrane stiffness of the paper"),
    ("wall_factor", "", "–", "wall thickness over that of the drawing"),
    ("skin_stiffening", "", "–", "stiffness of the skin over the mean, minus 1"),
    ("body_force", "ρ g", "kN/m³", "weight of the material per volume"),
    ("curvature", "κ", "1/m", "bend angle over deformed arc length of the bottom line"),
    ("bend_angle", "φ", "°", "rotation of the free end face relative to the clamped one"),
    ("peak_stretch", "λ_max", "–", "largest principal stretch in the actuator"),
    ("slope", "p ∂κ/∂p", "1/m", "change of curvature for a relative change of pressure"),
    ("probability", "P", "–", "probability of rupture"),
    ("paper_thickness_mm", "t", "mm", "thickness of the paper"),
    ("density_g_per_cm3", "ρ", "g/cm³", "density"),
)

#: Every quantity by its name.
QUANTITIES: Mapping[str, Quantity] = MappingProxyType({row[0]: Quantity(*row) for row in _ROWS})


def stem(name: str) -> str:
    """Take the unit off the name of a quantity.

    Parameters
    ----------
    name : str
        A key of `QUANTITIES`.

    Returns
    -------
    str

    Examples
    --------
    >>> stem("curvature_sd_per_m")
    'curvature_sd'
    """
    suffix = SUFFIXES.get(QUANTITIES[name].unit, "")
    return name.removesuffix(suffix) if suffix else name


def axis_label(name: str) -> str:
    """Word the label of an axis.

    Parameters
    ----------
    name : str
        A key of `QUANTITIES`.

    Returns
    -------
    str
        Spelled-out name and unit.

    Examples
    --------
    >>> axis_label("curvature_per_m")
    'curvature [1/m]'
    >>> axis_label("peak_stretch")
    'peak stretch'
    """
    words, unit = stem(name).replace("_", " "), QUANTITIES[name].unit
    return words if unit == DIMENSIONLESS else f"{words} [{unit}]"


def p_value_text(value: float, replicates: float | None = None) -> str:
    """Word a p-value with only significant digits.

    Parameters
    ----------
    value : float
        From 0 to 1, or nan if unknown. From n simulated data sets it is (1 + #)/(1 + n), a multiple
        of 1/(1 + n).
    replicates : float, optional
        That n; if no data set exceeds the observed one, the value is worded as a bound.

    Returns
    -------
    str
        At most two significant digits and three decimals.

    Examples
    --------
    >>> p_value_text(0.3134), p_value_text(0.02494), p_value_text(0.00213), p_value_text(2e-6)
    ('p = 0.31', 'p = 0.025', 'p = 0.002', 'p < 0.001')
    >>> p_value_text(1 / 201, 200), p_value_text(2 / 201, 200), p_value_text(1 / 50, 49)
    ('p < 0.005', 'p = 0.01', 'p ≤ 0.02')
    """
    if math.isnan(value):
        return "p unknown"
    # between none and one exceeding, since counts of simulated data vary a little between steps
    if replicates and 0.001 <= value < 1.5 / (1.0 + replicates):
        unit = 10.0 ** math.floor(math.log10(value))
        bound = math.ceil(value / unit - 1e-9) * unit
        return f"p {'<' if value < bound * (1.0 - 1e-9) else '≤'} {bound:.3g}"
    if value < 0.001:
        return "p < 0.001"
    return f"p = {value:.2f}" if value >= 0.0995 else f"p = {value:.3f}".removesuffix("0")
