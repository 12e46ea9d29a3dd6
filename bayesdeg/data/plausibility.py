r"""Check readings for plausibility: wrong units and signs, and deviating single specimens.

Each check is a row of a table: the file and column that it looks at, what it says, and the function
that looks; limits are the constants below.

A wrong unit multiplies a column by 4 to a million, while every effect known to the package changes
it by tens of percent, at most twofold. So columns are compared with each other, with the priors and
with other specimens by medians of log ratios. What no soft actuator can do is a fault; what is
merely unlikely is a warning, which is repeated with the verdict.
"""

import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from decimal import Decimal
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.data.families import MeshDimensions, Mould
from bayesdeg.data.settings import Dimensions
from bayesdeg.data.study import Study
from bayesdeg.data.tables import BASE_TABLES
from bayesdeg.errors import Fault, StudyError
from bayesdeg.priors import Distribution, LogNormal

Floats = NDArray[np.float64]
Integers = NDArray[np.intp]
Units = Mapping[str, float]

#: Factor of a number in a different unit over that in the column's unit.
STRESS_UNITS: Units = {
    "kPa": 1e3,
    "Pa": 1e6,
    "bar": 10.0,
    "psi": 145.04,
    "GPa": 1e-3,
}
PRESSURE_UNITS: Units = {
    "Pa": 1e3,
    "MPa": 1e-3,
    "bar": 1e-2,
    "mbar": 10.0,
    "psi": 0.14504,
    "mmHg": 7.5006,
}
CURVATURE_UNITS: Units = {"1/mm": 1e-3, "1/cm": 1e-2, "°/m": 57.296}
ANGLE_UNITS: Units = {
    "radians": 1.0 / 57.296,
    "degrees, multiplied by 180/π once too often": 57.296,
    "revolutions": 1.0 / 360.0,
}
VOLUME_UNITS: Units = {"mm³ or µl": 1e3, "l": 1e-3, "cl": 0.1, "m³": 1e-6}
PERCENT_UNITS: Units = {"a fraction instead of percent": 1e-2}

#: Within one level, effects change curvature and stiffness at most twofold (a degraded skin);
#: the smallest ratio of two units in use is that of mmHg to kPa, 7.5.
LEAST_FACTOR = 4.0
#: ln of stiffness per point of degradation: films of the publication give 0.05 to 0.09.
STEEPEST = 0.1
#: Specimens to compare with: at least two of the same level, within so many points, otherwise the
#: nearest ones, which are those of the next level of three and one more.
LEVEL, FEWEST_OF_LEVEL, NEIGHBOURS = 1.0, 2, 4
#: Beyond this it is not scatter in any material: two specimens of one study, or a prior.
IMPOSSIBLE_FACTOR = 100.0
#: In prior standard deviations: beyond 99.9 %, where no posterior can follow.
UNLIKELY_SDS, IMPOSSIBLE_SDS = 3.3, 5.0
#: Median over prior: bar for MPa is 10, and a prior may be off twofold without any fault.
LEAST_FACTOR_TO_PRIOR = 5.0
#: Ratio of pressures at equal curvature: specimens of one level are closer in stiffness.
LEAST_FACTOR_OF_PRESSURE = 2.0
#: Bend angle over curvature times length: scale and traced fibre change it 0.6 to 1.4 times.
LEAST_FACTOR_OF_ANGLE = 3.0
#: Bending over that expected from dimensions: bulging and ballooning stay within tenfold.
IMPOSSIBLE_BENDING = 30.0
#: Cavity volume over bend angle times width times height squared: 0.2 to 0.9 in both families by
#: finite elements; compressed air in the tubing made it 3 in a measured segment.
IMPOSSIBLE_VOLUME = 30.0
#: Thickness of paper or film on tetrahedra, where it has no bending stiffness [mm], up to which
#: this error is as small as that of a fine mesh.
THICKEST_WITHOUT_BENDING = 0.2
#: Resulting excess of curvatures over the square of the thickness [%/mm²]: relative to 10 mm high
#: bricks, 0.2 % at 0.1 mm, 0.5 to 0.7 at 0.2 mm and 3 at 0.5 mm, at the same E t.
BENDING_LEFT_OUT = 15.0
#: Share of the largest volume that may be read at zero pressure.
LARGEST_VOLUME_AT_REST = 0.1
#: C1 of moulding and printing materials [MPa]: from gels of E = 3 kPa, softer than the softest
#: silicones (Ecoflex 00-10: some 5 kPa), to polyurethanes of E = 48 MPa.
SOFTEST, STIFFEST = 5e-4, 8.0
#: If no unit is stated, a layer is refused below this share of the body's C1: half way to 1/1000.
MEANT_IN_MPA = 1000.0**0.5
#: Two full turns: clamp and tip would have met long before.
MOST_TURNING = 4.0 * np.pi
#: Stretch: the toughest hydrogels reach 23 (Sun et al. 2012, doi:10.1038/nature11409).
HIGHEST_STRETCH = 30.0
#: Bending of the default actuator of either family over that of a beam without bulging walls.
BULGING = 2.0
#: The same for a block without slots between its chambers, whose walls get shorter as they widen:
#: 0.3 to 0.75 by finite elements.
BULGING_WITHOUT_SLOTS = 0.5
#: Curvature at zero pressure beyond reading errors (0.3 1/m by their prior) [1/m].
LARGEST_AT_REST, LARGEST_SHARE_AT_REST = 1.5, 0.1
#: Ambient pressure, up to ambient pressure plus a first step of 50 kPa [kPa].
AIR_PRESSURE = (90.0, 150.0)
#: Change of ln response per point of degradation, four times the steepest known.
TOO_STEEP = 0.4
#: Strain and share of the largest stress below which a sign may be due to reading error.
LEAST_STRAIN, LEAST_STRESS = 0.05, 0.02
#: Prior reading errors [1/m, °]: smaller curvatures are replaced by these.
CURVATURE_ERROR, ANGLE_ERROR = 0.3, 0.7
#: Multiple of these errors beyond which curvature and angle are compared.
CLEAR = 5.0
#: Tolerance for naming a unit: scatter of specimens and of priors.
NEAR_UNIT, NEAR_UNIT_OF_PRIOR = 1.4, 2.5

#: Relative width that the digits of an angle and a curvature leave to their ratio: rows with a
#: smaller one show whether one was computed from the other.
FINE_DIGITS = 0.01
#: Relative tolerance for computed numbers that were not rounded.
ROUNDING = 1e-9
#: Relative tolerance for equal lengths.
SAME_LENGTH = 0.005

#: Number of distinct readings that two curves cannot share by chance.
LEAST_ALIKE = 4
#: Number of specimens compared pairwise; more are split into parts by degradation rate, so that
#: work and memory grow linearly.
MOST_COMPARED = 50
#: Number of degradation rates from which one with fewer specimens is conspicuous.
FEWEST_RATES = 3

OTHER_UNIT = "likely a different unit"
DEGREE = np.pi / 180.0
TINY = 1e-300
SMALLEST_ANGLE = 1e-9  # rad; effectively no bending


@dataclass(frozen=True)
class Doubt:
    """A reading that is implausible for its column.

    Parameters
    ----------
    fault : Fault
        Its place, what it was compared with, the likely mistake, and what to do.
    impossible : bool
        Whether it cannot be right, so nothing may be computed from it.
    is_alone : bool
        Whether it concerns a single specimen that the others contradict.
    """

    fault: Fault
    impossible: bool
    is_alone: bool = False

    def __str__(self) -> str:
        """Return the doubt as one line."""
        return str(self.fault)


@dataclass(frozen=True)
class Expected:
    """Expectations from the priors of a study.

    Parameters
    ----------
    c1, elongation : mapping of float to Distribution
        C1 [MPa] and the elongation at break [%] by degradation rate; interpolated in logarithms.
    linear_scale : float
        Length of the part over that of its mould.
    """

    c1: Mapping[float, Distribution]
    elongation: Mapping[float, Distribution]
    linear_scale: float = 1.0


def doubts(study: Study, expected: Expected) -> tuple[Doubt, ...]:
    """Return what is impossible or unlikely in a study without faults, file by file."""
    # absurd numbers overflow; their ratios are not compared
    with np.errstate(all="ignore"):
        evidence = _Evidence(study, expected)
        found = [] if study.tensile is None else _made(OF_FILMS, evidence)
        evidence = replace(evidence, are_films_doubtful=bool(found))
        found += _made(OF_STUDY, evidence)
        if evidence.bent:
            found += _made(OF_BENDING, evidence)
        if study.actuator is not None:
            found += _made(OF_CONDITIONS, evidence)
        found += names_alike(study)
    if study.line_points is None:
        return tuple(found)
    # readings of lines come from points
    return tuple(
        replace(one, fault=replace(one.fault, file=study.lines_file))
        if one.fault.file == "actuator.csv"
        else one
        for one in found
    )


def times_stiffer(study: Study, expected: Expected) -> float:
    """Return by what factor a study's material is stiffer than expected, if it is a different one.

    The priors are those of a different material, none stated for this one. The factor is 1 where it
    is as expected, where no elastomer has the C1 of its films or moduli, and where actuators bend
    as the expected material would: then a unit is wrong.
    """
    with np.errstate(all="ignore"):
        c1 = film_moduli(study.tensile)[["rate", "c1"]]
        if study.summary is not None:
            rows = study.summary[study.summary["quantity"] == "young_modulus"]
            moduli = {"rate": rows["degradation_pct"].fillna(0.0), "c1": rows["value"] / 6.0}
            c1 = pd.DataFrame({k: [*c1[k], *moduli[k]] for k in moduli}, dtype=float)
        c1 = c1[c1["c1"] > 0.0]
        off = _off_prior(*_logs_and_rates(c1, "c1"), expected.c1)
        if not off.is_unlikely or not SOFTEST <= c1["c1"].median() <= STIFFEST:
            return 1.0
        evidence = _Evidence(study, expected)
        if evidence.off_bending(c1.iloc[:0]) < evidence.off_bending(c1):
            return 1.0
    return _factor(off.log_factor)


def refuse_impossible(found: Iterable[Doubt]) -> tuple[Doubt, ...]:
    """Return the doubts that are merely unlikely.

    Raises
    ------
    StudyError
        Lists every impossible doubt.
    """
    found = tuple(found)
    wrong = [doubt.fault for doubt in found if doubt.impossible]
    if wrong:
        raise StudyError(wrong)
    return found


# ---- comparisons


def nearest_unit(factor: float, units: Units, tolerance: float) -> str | None:
    """Return the unit whose factor is nearest; None if none is near.

    Examples
    --------
    >>> nearest_unit(990.0, PRESSURE_UNITS, NEAR_UNIT), nearest_unit(30.0, PRESSURE_UNITS, 1.4)
    ('Pa', None)
    """
    distance = {name: abs(np.log(factor / units[name])) for name in units}
    best = min(distance, key=lambda name: distance[name])
    return best if distance[best] <= np.log(tolerance) else None


def off_neighbours(differences: Floats, rates: Floats) -> Floats:
    r"""Return ln of the factor by which each specimen is off its neighbours; 0 if it is not.

    It is off if :math:`|d_{ij}| - s |D_i - D_j|` is above ln `LEAST_FACTOR` for most of the nearest
    j, with s the steepest effect of degradation.

    Parameters
    ----------
    differences : array, shape (n, n)
        ln of the value of i over that of j; nan where they cannot be compared.
    rates : array, shape (n,)
        Degradation rates [%].

    Examples
    --------
    >>> log_stiffness = np.log([1.0, 1.1, 10.0, 0.9])
    >>> off = off_neighbours(log_stiffness[:, None] - log_stiffness, np.zeros(4))
    >>> np.exp(off).round(1).tolist()
    [1.0, 1.0, 10.0, 1.0]
    """
    found = np.zeros(len(rates))
    for i, row in enumerate(differences):
        distance = np.abs(rates - rates[i])
        others = [j for j in np.argsort(distance, kind="stable") if j != i and np.isfinite(row[j])]
        if not others:
            continue
        of_level = int(np.sum(distance[others] <= LEVEL))
        nearest = np.array(others[: of_level if of_level >= FEWEST_OF_LEVEL else NEIGHBOURS])
        excess = np.abs(row[nearest]) - STEEPEST * distance[nearest]
        # the lower median: of two neighbours both must disagree, as one may be wrong itself
        if np.quantile(excess, 0.5, method="lower") > np.log(LEAST_FACTOR):
            at_least = distance[nearest] <= distance[nearest].min() + LEVEL
            found[i] = np.median(row[nearest[at_least]])
    return found


def _prior_at(laws: Mapping[float, Distribution], rates: Floats) -> tuple[Floats, Floats]:
    """Return ln of the median and its standard deviation at degradation rates; nan if unknown."""
    # for a log-normal law, the default here, no special function is needed
    known = {
        rate: law.median * np.exp([0.0, law.sigma])
        if isinstance(law, LogNormal)
        else law.quantile(np.array([0.5, 0.8413]))  # up to one sd of a normal law
        for rate, law in sorted(laws.items())
    }
    known = {rate: q for rate, q in known.items() if np.all(np.isfinite(q)) and q[0] > 0.0}
    if not known:
        return np.full(len(rates), np.nan), np.full(len(rates), np.nan)
    at, quantiles = list(known), np.log(np.array(list(known.values())))
    median = np.interp(rates, at, quantiles[:, 0])
    return median, np.maximum(np.interp(rates, at, quantiles[:, 1]) - median, 1e-6)


class _OffPrior(NamedTuple):
    """ln of a median over its prior, and what to think of it."""

    log_factor: float = 0.0
    is_unlikely: bool = False
    is_impossible: bool = False


def _off_prior(logs: Floats, rates: Floats, laws: Mapping[float, Distribution]) -> _OffPrior:
    """Compare the median of logarithms with its prior."""
    median, sd = _prior_at(laws, rates)
    off = logs - median
    if not np.any(np.isfinite(off)):
        return _OffPrior()
    log_factor, sds = float(np.nanmedian(off)), float(np.nanmedian(np.abs(off) / sd))
    if abs(log_factor) < np.log(LEAST_FACTOR_TO_PRIOR) or sds < UNLIKELY_SDS:
        return _OffPrior(log_factor)
    impossible = abs(log_factor) >= np.log(IMPOSSIBLE_FACTOR) and sds >= IMPOSSIBLE_SDS
    return _OffPrior(log_factor, True, bool(impossible))


def _factor(log_factor: float) -> float:
    """Return a factor clipped so that its inverse is finite."""
    return float(np.exp(np.clip(log_factor, np.log(TINY), -np.log(TINY))))


def _times(factor: float) -> str:
    """Word a factor; factors below 1 as a fraction.

    Examples
    --------
    >>> _times(10.04), _times(0.00106)
    ('10 times', '1/943 of')
    """
    return f"{_short(factor)} times" if factor >= 1.0 else f"1/{_short(1.0 / factor)} of"


def _short(value: float) -> str:
    """Return a number to three digits, without an exponent up to a million.

    Examples
    --------
    >>> _short(1053.0), _short(9.471), _short(2.4e8)
    ('1050', '9.47', '2.4e+08')
    """
    text = f"{value:.3g}"
    return f"{float(text):.0f}" if "e" in text and 1.0 <= abs(value) < 1e7 else text


def _compared(
    factor: float, units: Units, tolerance: float, *, otherwise: str = OTHER_UNIT
) -> dict[str, object]:
    """Return the words for a factor and for the likely mistake."""
    guess = _likely(factor, units, tolerance, otherwise=otherwise)
    return {"times": _times(factor), "guess": guess}


def _likely(factor: float, units: Units, tolerance: float, *, otherwise: str = OTHER_UNIT) -> str:
    unit = nearest_unit(factor, units, tolerance)
    if unit is None:
        return otherwise
    tenfold = np.log10(factor)
    slipped = abs(tenfold - round(tenfold)) < 0.1 and tolerance == NEAR_UNIT
    return f"likely in {unit}{', or with a slipped decimal point' if slipped else ''}"


# ---- evidence


@dataclass(frozen=True, eq=False)
class _Curve:
    """First loading of an actuator, by pressure; bend angles are nan where none was read."""

    name: str
    rate: float
    pressure: Floats
    curvature: Floats
    angle: Floats

    @property
    def end(self) -> float:
        """Curvature at the largest pressure [1/m]."""
        return float(self.curvature[-1])


@dataclass(frozen=True)
class _Evidence:
    """What the checks look at."""

    study: Study
    expected: Expected
    are_films_doubtful: bool = False

    @cached_property
    def films(self) -> pd.DataFrame:
        """C1 of films, where positive."""
        found = film_moduli(self.study.tensile)
        return found[found["c1"] > 0.0]

    @cached_property
    def trusted(self) -> pd.DataFrame:
        """Films whose C1 is trusted; doubtful ones are converted from the likeliest unit.

        Of several units the one that agrees with the actuators' bending. No films where no unit
        explains them: C1 is then taken from the priors.
        """
        if not self.are_films_doubtful:
            return self.films
        off = _off_prior(*_logs_and_rates(self.films, "c1"), self.expected.c1)
        units = _stress_units(self.films, off.log_factor) if off.is_unlikely else []
        tried = [self.films.assign(c1=self.films["c1"] / STRESS_UNITS[unit]) for unit in units]
        return min(tried, key=self.off_bending, default=self.films.iloc[:0])

    def c1(self, rates: Floats, films: pd.DataFrame | None = None) -> tuple[Floats, str]:
        """Return C1 [MPa] and its source: reliable films, else the priors; nan where unknown."""
        films = self.trusted if films is None else films
        if not len(films):
            return np.exp(_prior_at(self.expected.c1, rates)[0]), "the prior"
        levels = np.log(films["c1"]).groupby(films["rate"]).median()
        at = levels.index.to_numpy(float)
        return np.exp(np.interp(rates, at, levels.to_numpy(float))), "the films"

    def off_bending(self, films: pd.DataFrame) -> float:
        """Return |ln| of bending over that expected with C1 of films or priors; 0 if not read."""
        return abs(float(np.median(self.log_bending(self.curves, films)))) if self.curves else 0.0

    def log_bending(self, curves: list[_Curve], films: pd.DataFrame | None = None) -> Floats:
        """Return ln of each actuator's bending over that expected from C1 and the dimensions."""
        pressure = np.array([curve.pressure[-1] for curve in curves])
        turned = np.array([max(curve.end * self.length, SMALLEST_ANGLE) for curve in curves])
        load = 1e-3 * pressure / self.c1(np.array([curve.rate for curve in curves]), films)[0]
        with np.errstate(divide="ignore"):
            return np.log(turned / (self.beam * load))

    @cached_property
    def curves(self) -> list[_Curve]:
        """Curves of specimens that have readings under pressure."""
        found: list[_Curve] = []
        if self.study.actuator is None:
            return found
        first = _first_loading(self.study.actuator)
        for name, rows in first.groupby("specimen_id", sort=False):
            read = rows[(rows["pressure_kPa"] > 0.0) & rows["curvature_per_m"].notna()]
            read = read.sort_values("pressure_kPa", kind="stable")
            if len(read):
                columns = ("pressure_kPa", "curvature_per_m", "bend_angle_deg")
                arrays = (read[column].to_numpy(np.float64) for column in columns)
                rate = float(read["degradation_pct"].iloc[0])
                found.append(_Curve(str(name), rate, *arrays))
        return found

    @cached_property
    def bent(self) -> list[_Curve]:
        """Curves of actuators that bent at all, or that have a single reading."""
        return [c for c in self.curves if len(c.curvature) == 1 or c.curvature.any()]

    @property
    def tensile(self) -> pd.DataFrame:
        """Rows of films."""
        assert self.study.tensile is not None
        return self.study.tensile

    @property
    def actuator(self) -> pd.DataFrame:
        """Rows of actuators."""
        assert self.study.actuator is not None
        return self.study.actuator

    @property
    def length(self) -> float:
        """Length of the part [m]."""
        return 1e-3 * self.study.settings.dimensions.length * self.expected.linear_scale

    @property
    def beam(self) -> float:
        """Expected bend angle over p/C1 [rad]."""
        return bending_of_beam(self.study.settings.dimensions)

    @cached_property
    def largest(self) -> float:
        """Largest curvature of all actuators [1/m]."""
        return max(float(np.abs(curve.curvature).max()) for curve in self.bent)


def _logs_and_rates(table: pd.DataFrame, column: str) -> tuple[Floats, Floats]:
    return np.log(table[column].to_numpy(float)), table["rate"].to_numpy(float)


def _first_loading(actuator: pd.DataFrame) -> pd.DataFrame:
    """Return the rows before any creep, softening or set."""
    first = actuator.groupby("specimen_id")["cycle"].transform("min")
    return actuator[(actuator["cycle"] == first) & (actuator["branch"] == "loading")]


def bending_of_beam(mould: Mould) -> float:
    """Return the approximate bend angle over p/C1 of an actuator of these dimensions [rad].

    The angle of a beam of its section (`Mould.beam_bending`), times `BULGING`, or
    `BULGING_WITHOUT_SLOTS`. The angle does not depend on the scale of the part.

    Examples
    --------
    >>> from bayesdeg.data.settings import Dimensions
    >>> round(bending_of_beam(Dimensions()), 2)
    1.29
    """
    has_slots = not isinstance(mould, Dimensions) or mould.gap > 0.0
    return (BULGING if has_slots else BULGING_WITHOUT_SLOTS) * mould.beam_bending


@dataclass(frozen=True)
class _Found:
    """Where a check found something: specimen, value, and the words of its sentence."""

    specimen: object
    value: float
    words: Mapping[str, object] = field(default_factory=dict)
    impossible: bool = True
    is_alone: bool = False
    among: int = 0  # specimens that may share it: it is then said once
    column: str = ""  # in place of the check's


@dataclass(frozen=True)
class _Check:
    """A row of the table of checks.

    ``unless`` names the checks after whose findings this one would repeat them.
    """

    name: str
    file: str
    column: str
    look: Callable[[_Evidence], Iterable[_Found]]
    problem: str
    remedy: str
    unless: tuple[str, ...] = ()


def _made(checks: Iterable[_Check], evidence: _Evidence) -> list[Doubt]:
    """Make checks in turn; say once what at least half of the specimens share."""
    found: dict[str, list[Doubt]] = {}
    for check in checks:
        if any(found.get(name) for name in check.unless):
            continue
        seen = [*check.look(evidence)]
        count = len(seen)
        shared = count > 1 and 2 * count >= seen[0].among > 0
        said = f" (as in {count - 1} of the other {seen[0].among - 1} specimens)" if shared else ""
        found[check.name] = [
            Doubt(
                Fault(
                    check.file,
                    check.problem.format(**one.words) + said,
                    check.remedy.format(**one.words),
                    None,
                    one.column or check.column,
                    f"{one.value:g}",
                    None if one.specimen is None else str(one.specimen),
                ),
                one.impossible,
                one.is_alone,
            )
            for one in (seen[:1] if shared else seen)
        ]
    return [doubt for doubts in found.values() for doubt in doubts]


# ---- films


def film_moduli(tensile: pd.DataFrame | None) -> pd.DataFrame:
    r"""Return C1 of each film from its smallest strains, with its degradation rate.

    The stress of a neo-Hookean solid over :math:`2 (\lambda - \lambda^{-n})`, with n of 2, 3 or 5
    in uniaxial, planar and equibiaxial tension, times λ for Cauchy stress.

    Returns
    -------
    pandas.DataFrame
        By specimen: ``rate`` [%], ``c1`` [MPa], which is not positive where signs are wrong, and
        ``stress`` [MPa], one of the stresses used.
    """
    rows = []
    if tensile is not None:
        stress, rate = tensile["stress_MPa"].to_numpy(), tensile["degradation_pct"].to_numpy()
        strain, c1 = np.abs(np.log(tensile["stretch"].to_numpy())), stress / _neo_hookean(tensile)
        for name, film in _rows_of_each(tensile["specimen_id"]):
            strained = film[strain[film] >= LEAST_STRAIN]
            first = strained[np.argsort(strain[strained])[:3]]
            if len(first):
                row = {"rate": rate[first[0]], "c1": c1.iloc[first].median()}
                rows.append({"specimen": str(name), **row, "stress": stress[first[0]]})
    found = pd.DataFrame(rows, columns=["specimen", "rate", "c1", "stress"])
    return found.set_index("specimen")


def _rows_of_each(names: pd.Series) -> Iterator[tuple[object, NDArray[np.intp]]]:
    """Yield every name with the positions of its rows, in order of first appearance."""
    codes, unique = pd.factorize(names)
    order = np.argsort(codes, kind="stable")
    ends = np.cumsum(np.bincount(codes, minlength=len(unique)))
    yield from zip(unique, np.split(order, ends)[:-1], strict=True)


def _neo_hookean(rows: pd.DataFrame) -> pd.Series:
    stretch = rows["stretch"]
    power = rows["mode"].map({"uniaxial": 2.0, "planar": 3.0, "equibiaxial": 5.0})
    cauchy = stretch.where(rows["stress_measure"] == "cauchy", 1.0)
    return 2.0 * (stretch - stretch**-power) * cauchy


def _too_stretched(evidence: _Evidence) -> Iterator[_Found]:
    stretch = evidence.tensile.groupby("specimen_id", sort=False)["stretch"]
    largest = stretch.max()
    # stretch in percent begins at 100, strain in percent near 0
    in_percent = float(stretch.min().median()) >= 100.0 * (1.0 - LEAST_STRAIN)
    words = {
        "likely": "stretch in percent" if in_percent else "strain in percent",
        "do": "divide by 100" if in_percent else "divide by 100 and add 1",
    }
    for name, value in largest[largest > HIGHEST_STRETCH].items():
        yield _Found(name, value, words, among=len(largest))


def _wrong_signs(evidence: _Evidence, *, as_strain: bool) -> Iterator[_Found]:
    """Yield films under tension that shrink, or the reverse; strain is likely if all shrink."""
    tensile = evidence.tensile
    stretch, stress = tensile["stretch"], tensile["stress_MPa"]
    largest = stress.abs().groupby(tensile["specimen_id"]).transform("max")
    clear = (np.abs(stretch - 1.0) > LEAST_STRAIN) & (stress.abs() > LEAST_STRESS * largest)
    wrong = tensile[clear & (np.sign(stress) != np.sign(stretch - 1.0))]
    if bool((wrong["stretch"] < 1.0).all()) is not as_strain:
        return
    for row in wrong.drop_duplicates("specimen_id").to_dict("records"):
        words = {"stretch": float(row["stretch"]), "stress": float(row["stress_MPa"])}
        value = words["stretch" if as_strain else "stress"]
        among = tensile["specimen_id"].nunique()
        yield _Found(row["specimen_id"], value, words, among=among)


def _stress_units(films: pd.DataFrame, log_factor: float) -> list[str]:
    """Return possible units of the films' stress, the likeliest first.

    The unit that matches the factor to the prior; and kPa, where no elastomer has the C1 as read
    but one has a thousandth of it.
    """
    unit = nearest_unit(_factor(log_factor), STRESS_UNITS, NEAR_UNIT_OF_PRIOR)
    found, c1 = [unit] if unit else [], float(films["c1"].median())
    if STIFFEST < c1 <= STRESS_UNITS["kPa"] * STIFFEST and unit != "kPa":
        found.append("kPa")
    return found


def _moduli(evidence: _Evidence) -> Iterator[_Found]:
    films, laws = evidence.films, evidence.expected.c1
    logs, rates = _logs_and_rates(films, "c1")
    off = _off_prior(logs, rates, laws)
    if not off.is_unlikely:
        return
    c1 = films["c1"].to_numpy(float)
    middle = int(np.argmin(np.abs(np.log(c1 / np.median(c1)))))
    units = _stress_units(films, off.log_factor)
    words = {
        "c1": c1[middle],
        "times": _times(_factor(off.log_factor)),
        "prior": np.exp(_prior_at(laws, rates[[middle]])[0][0]),
        "rate": " at this degradation rate" if rates.any() else "",
        "guess": f"likely in {' or '.join(units)}" if units else OTHER_UNIT,
    }
    impossible = off.is_impossible or not SOFTEST <= np.median(c1) <= STIFFEST
    yield _Found(films.index[middle], float(films["stress"].iloc[middle]), words, impossible)


def _odd_ones(table: pd.DataFrame, logs: Floats, values: Floats, units: Units) -> Iterator[_Found]:
    """Yield each specimen that is far off its neighbours."""
    off = _off(table["rate"].to_numpy(float), lambda part: logs[part, None] - logs[part])
    wrong = np.flatnonzero(off)
    slip = "likely a different unit, a slipped decimal point or a different material"
    for i in wrong[:1] if len(table) == 2 else wrong:  # of two either may be wrong
        words = _compared(_factor(off[i]), units, NEAR_UNIT, otherwise=slip)
        impossible = bool(abs(off[i]) >= np.log(IMPOSSIBLE_FACTOR))
        yield _Found(table.index[i], values[i], words, impossible)


def _odd_films(evidence: _Evidence) -> Iterator[_Found]:
    films = evidence.films
    yield from _odd_ones(
        films, _logs_and_rates(films, "c1")[0], films["stress"].to_numpy(float), STRESS_UNITS
    )


def _elongations(evidence: _Evidence) -> pd.DataFrame:
    """Return the elongation at break of each film, with its degradation rate."""
    breaks = evidence.study.breaks
    if breaks is None:
        return pd.DataFrame({"rate": [], "value": []}, dtype=float)
    names = {"degradation_pct": "rate", "elongation_pct": "value"}
    return breaks.set_index("specimen_id").rename(columns=names)[["rate", "value"]]


def _below_films(evidence: _Evidence) -> Iterator[_Found]:
    """Doubt elongations at break that are below the stretch of films of that rate."""
    table = _elongations(evidence)
    tensile = None if evidence.are_films_doubtful else evidence.study.tensile
    if tensile is None or table.empty:
        return
    values, rates = table["value"].to_numpy(float), table["rate"].to_numpy(float)
    films = tensile.groupby("specimen_id").agg({"degradation_pct": "first", "stretch": "max"})
    distance = np.abs(films["degradation_pct"].to_numpy(float) - rates[:, None])
    largest = np.where(distance <= 1.0, films["stretch"].to_numpy(float), -np.inf).max(axis=1)
    strain = 100.0 * (np.where(np.isfinite(largest), largest, np.nan) - 1.0)
    strain = np.where(strain > 0.0, strain, np.nan)
    if np.isnan(strain).all():
        return
    beyond = float(np.nanmedian(np.log(values / strain)))
    if beyond < -np.log(LEAST_FACTOR):
        words = {
            "films": "films of that degradation rate" if rates.any() else "films",
            "share": _short(_factor(-beyond)),
        }
        yield _Found(table.index[0], values[0], words)


def _elongations_off_prior(evidence: _Evidence) -> Iterator[_Found]:
    table = _elongations(evidence)
    off = _off_prior(*_logs_and_rates(table, "value"), evidence.expected.elongation)
    if off.is_unlikely:
        words = _compared(_factor(off.log_factor), PERCENT_UNITS, NEAR_UNIT_OF_PRIOR)
        yield _Found(table.index[0], table["value"].iloc[0], words, off.is_impossible)


def _odd_elongations(evidence: _Evidence) -> Iterator[_Found]:
    table = _elongations(evidence)
    values = table["value"].to_numpy(float)
    yield from _odd_ones(table, np.log(values), values, PERCENT_UNITS)


def _published(evidence: _Evidence, quantity: str) -> Iterator[_Found]:
    summary, expected = evidence.study.summary, evidence.expected
    if summary is None:
        return
    per, laws, units = {
        "young_modulus": (6.0, expected.c1, STRESS_UNITS),
        "elongation_at_break": (1.0, expected.elongation, PERCENT_UNITS),
    }[quantity]
    rows = summary[summary["quantity"] == quantity]
    values = rows["value"].to_numpy(float)
    rates = rows["degradation_pct"].fillna(0.0).to_numpy(float)
    off = _off_prior(np.log(values / per), rates, laws)
    if off.is_unlikely:
        words = _compared(_factor(off.log_factor), units, NEAR_UNIT_OF_PRIOR)
        yield _Found(None, values[0], words, off.is_impossible)


# ---- degradation rates and the layer


def _as_fraction(
    evidence: _Evidence, response: Callable[[_Evidence], pd.DataFrame]
) -> Iterator[_Found]:
    """Doubt rates that are all below 1 % although responses change as over tens of percent."""
    table = response(evidence)
    table = table[table["value"] > 0.0]
    rates = table["rate"].to_numpy(float)
    if len(table) < 3 or not 0.02 <= np.ptp(rates) <= 1.0 or np.abs(rates).max() > 1.0:
        return
    change = abs(steepness(rates, np.log(table["value"].to_numpy(float))))
    if change >= TOO_STEEP and change * np.ptp(rates) >= np.log(1.5):
        words = {"times": _times(_factor(change * np.ptp(rates))), "points": np.ptp(rates)}
        at = int(np.argmax(rates))
        yield _Found(table.index[at], rates[at], words)


def _stiffness(evidence: _Evidence) -> pd.DataFrame:
    return film_moduli(evidence.study.tensile).rename(columns={"c1": "value"})


def _bending_per_pressure(evidence: _Evidence) -> pd.DataFrame:
    rows = [(c.name, c.rate, c.curvature[-1] / c.pressure[-1]) for c in evidence.curves]
    return pd.DataFrame(rows, columns=["specimen", "rate", "value"]).set_index("specimen")


def steepness(rates: Floats, logs: Floats) -> float:
    """Return the median slope over pairs of specimens, per point of degradation; 0 without pairs.

    The Theil–Sen estimate, robust against a quarter of wrong specimens.

    Examples
    --------
    >>> steepness(np.arange(5.0), np.array([0.0, 0.5, 1.0, 1.5, 9.0]))
    0.5
    """
    first, second = np.triu_indices(len(rates), 1)
    apart = np.abs(rates[first] - rates[second]) > 0.1 * np.ptp(rates)
    if not apart.any():
        return 0.0
    first, second = first[apart], second[apart]
    return float(np.median((logs[first] - logs[second]) / (rates[first] - rates[second])))


def _thick_layer(evidence: _Evidence) -> Iterator[_Found]:
    """Doubt paper or film on tetrahedra that is too thick to neglect its bending stiffness."""
    settings = evidence.study.settings
    mould, thickness = settings.dimensions, settings.paper.thickness
    on_tetrahedra = isinstance(mould, MeshDimensions) and mould.cells == "tetrahedra"
    if on_tetrahedra and settings.layer.is_membrane and thickness > THICKEST_WITHOUT_BENDING:
        yield _Found(None, thickness, {"excess": BENDING_LEFT_OUT * thickness**2}, impossible=False)


def _layer_unit(evidence: _Evidence) -> Iterator[_Found]:
    """Doubt constants of an elastomer layer far softer than the body, or than any elastomer.

    The layer should stretch less than the body. Without a stated unit kPa is assumed; a layer then
    softer than the body may be meant in MPa.
    """
    settings = evidence.study.settings
    if not settings.layer.is_slab:
        return
    layer, value = settings.layer.constants[0], settings.constraint.C1 or 0.0
    known, source = evidence.c1(np.zeros(1))
    body, stated = float(known[0]), settings.constraint.unit
    softest = body / (LEAST_FACTOR if stated is None else IMPOSSIBLE_FACTOR)
    if not (layer < softest or layer > STIFFEST):
        return
    meant = stated is None and layer < softest
    words = {
        "c1": value,
        "unit": stated or "kPa, the default unit",
        "times": _times(layer / body),
        "body": 1e3 * body,
        "source": source,
        "in_mpa": f"; {value:g} MPa would be {_times(value / body)} that" if meant else "",
    }
    refused = stated is None and (layer * MEANT_IN_MPA < body or layer > STIFFEST)
    yield _Found(None, value, words, refused)


# ---- bending of actuators


def _still(evidence: _Evidence) -> Iterator[_Found]:
    """Doubt actuators that did not bend at all."""
    for curve in evidence.curves:
        if curve not in evidence.bent:
            words = {"pressure": curve.pressure[-1]}
            yield _Found(curve.name, 0.0, words, not evidence.bent, is_alone=bool(evidence.bent))


def _backwards(evidence: _Evidence) -> Iterator[_Found]:
    for curve in evidence.bent:
        if curve.end < -LARGEST_SHARE_AT_REST * evidence.largest:
            words = {"pressure": curve.pressure[-1]}
            yield _Found(curve.name, curve.end, words, among=len(evidence.bent))


def _opposite_angles(evidence: _Evidence) -> Iterator[_Found]:
    for curve in evidence.bent:
        angle = float(curve.angle[-1])
        least = max(LARGEST_SHARE_AT_REST * evidence.largest, CURVATURE_ERROR)
        if curve.end > least and angle < -ANGLE_ERROR:
            words = {"curvature": curve.end}
            yield _Found(curve.name, angle, words, among=len(evidence.bent))


def _angles(evidence: _Evidence) -> Iterator[_Found]:
    """Doubt curvature or bend angle, whichever contradicts the pressure, where they disagree."""
    length = evidence.length
    for curve in evidence.bent:
        turned, size = DEGREE * curve.angle, np.abs(curve.curvature)
        wide = size >= 0.5 * size.max()
        wide &= (size >= CLEAR * CURVATURE_ERROR) | (np.abs(curve.angle) >= CLEAR * ANGLE_ERROR)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.abs(turned / (curve.curvature * length))[wide]
        ratio = ratio[np.isfinite(ratio) & (ratio > 0.0)]
        off = float(np.median(np.log(ratio))) if len(ratio) else 0.0
        if not abs(off) > np.log(LEAST_FACTOR_OF_ANGLE):
            continue
        factor, c1 = _factor(off), evidence.c1(np.array([curve.rate]))[0][0]
        likely = _log(evidence.beam / (1e3 * c1) * float(curve.pressure[-1]))
        angle, by_curvature = float(curve.angle[-1]), curve.end * length
        if abs(_log(by_curvature) - likely) > abs(_log(DEGREE * angle) - likely):
            column, value, unit, units = "curvature_per_m", curve.end, "1/m", CURVATURE_UNITS
            factor, source = 1.0 / factor, "bend angle"
            other = f"{DEGREE * angle / length:.3g} 1/m"
        else:
            column, value, unit, units = "bend_angle_deg", angle, "degrees", ANGLE_UNITS
            source, other = "curvature", f"{by_curvature / DEGREE:.3g}°"
        words = _compared(factor, units, NEAR_UNIT)
        words |= {"source": source, "other": other, "unit": unit, "length": 1e3 * length}
        yield _Found(curve.name, value, words, among=len(evidence.bent), column=column)


def computed_angles(actuator: pd.DataFrame) -> NDArray[np.bool_]:
    """Return at which rows the bend angle is curvature times one length, to the last digit.

    The length is the same on all rows, or on those of a specimen. Such an angle was not read: one
    of the two was computed from the other.

    Examples
    --------
    >>> read = pd.DataFrame({"specimen_id": "a", "curvature_per_m": [1.053, 2.131, 4.4, 8.61]})
    >>> angle = np.rad2deg(0.06 * read["curvature_per_m"]).round(2)
    >>> computed_angles(read.assign(bend_angle_deg=angle)).all()
    np.True_
    >>> computed_angles(read.assign(bend_angle_deg=angle + [0.0, 0.1, 0.0, -0.1])).any()
    np.False_
    """
    lengths = implied_lengths(actuator)
    both = lengths["least"].notna().to_numpy()
    if _is_one_length(lengths):
        return both
    found = np.zeros(len(lengths), dtype=bool)
    for _, rows in _rows_of_each(actuator["specimen_id"]):
        found[rows] = _is_one_length(lengths.iloc[rows])
    return both & found


def implied_lengths(actuator: pd.DataFrame) -> pd.DataFrame:
    """Return the range of the ratio of angle to curvature [m] that rounding allows."""
    bend, angle = actuator["curvature_per_m"], actuator["bend_angle_deg"]
    size, turned = bend.abs(), DEGREE * angle * np.sign(bend)
    by_specimen = actuator["specimen_id"]
    of_bend = bend.groupby(by_specimen).transform(_half_digit)
    of_angle = DEGREE * angle.groupby(by_specimen).transform(_half_digit)
    with np.errstate(divide="ignore", invalid="ignore"):
        most = ((turned + of_angle) / (size - of_bend)).where(size > of_bend, np.inf)
    least = (turned - of_angle) / (size + of_bend)
    there = turned.notna()
    return pd.DataFrame({"least": least.where(there), "most": most.where(there)})


def _is_one_length(lengths: pd.DataFrame) -> bool:
    """Return whether one length fits the digits of all rows, and enough rows are precise."""
    least, most = lengths["least"].max(), lengths["most"].min()
    fine = (lengths["most"] - lengths["least"]) <= FINE_DIGITS * lengths["most"].abs()
    return bool(fine.sum() >= LEAST_ALIKE and 0.0 < least <= most)


def _half_digit(values: pd.Series) -> pd.Series:
    """Return half a unit in the last place of each number, assuming equal decimals or digits."""
    digits = [Decimal(repr(float(x))).normalize().as_tuple() for x in values.dropna() if x]
    if not digits:
        return pd.Series(0.0, index=values.index)
    decimals = max(-int(one.exponent) for one in digits)
    significant = max(len(one.digits) for one in digits)
    size = values.abs()
    with np.errstate(divide="ignore"):
        last: pd.Series = 0.5 * 10.0 ** (np.floor(np.log10(size)) + 1.0 - significant)
    return last.clip(lower=0.5 * 10.0**-decimals).clip(lower=ROUNDING * size)


def _computed(evidence: _Evidence) -> Iterator[_Found]:
    """Doubt angles that were computed from curvatures, or curvatures from angles."""
    if evidence.study.line_points:
        return
    actuator = evidence.actuator.reset_index(drop=True)
    rows = computed_angles(actuator)
    if not rows.any():
        return
    each = implied_lengths(actuator)[rows]
    of_all = _is_one_length(each)
    lengths = each.groupby(["all"] * len(each) if of_all else actuator["specimen_id"][rows])
    middle = 500.0 * (lengths["least"].max() + lengths["most"].min())  # mm
    low, high, stated = middle.min(), middle.max(), evidence.study.settings.dimensions.length
    one = high - low <= SAME_LENGTH * high
    same = one and abs(middle.median() - stated) <= SAME_LENGTH * stated
    angle = actuator["bend_angle_deg"]
    words = {
        "rows": int(rows.sum()),
        "all": int(angle.notna().sum()),
        "length": f"{middle.median():.1f} mm"
        if one
        else f"{low:.1f} to {high:.1f} mm, by specimen",
        "says": "as in study.toml" if same else f"but study.toml has {stated:g} mm",
        "do": "" if same else "; check the length used in the computation",
    }
    yield _Found(None, angle[rows].iloc[-1], words, impossible=False)


def _log(value: float) -> float:
    """Return ln of the absolute value; for 0, of something very small."""
    return float(np.log(max(abs(value), TINY)))


def _wound(evidence: _Evidence) -> Iterator[_Found]:
    for curve in evidence.bent:
        size = np.abs(curve.curvature)
        turning = float(size.max()) * evidence.length
        if turning > MOST_TURNING:
            words = {"turns": turning / (2.0 * np.pi), "length": 1e3 * evidence.length}
            value = float(curve.curvature[np.argmax(size)])
            yield _Found(curve.name, value, words, among=len(evidence.bent))


def _compliance(evidence: _Evidence) -> Iterator[_Found]:
    """Doubt pressure or curvature of all actuators, given C1 and the dimensions."""
    curves = evidence.bent
    off = evidence.log_bending(curves)
    log_factor = float(np.median(off))
    if not abs(log_factor) > np.log(LEAST_FACTOR):  # nan where C1 is unknown
        return
    curve = curves[int(np.argsort(off)[len(off) // 2])]
    c1, source = evidence.c1(np.array([curve.rate]))
    factor, load = _factor(log_factor), float(1e-3 * curve.pressure[-1] / c1[0])
    turned = curve.end * evidence.length
    by_pressure = _likely(1.0 / factor, PRESSURE_UNITS, NEAR_UNIT_OF_PRIOR, otherwise="")
    by_curvature = _likely(factor, CURVATURE_UNITS, NEAR_UNIT_OF_PRIOR, otherwise="")
    # values in their usual range are right: p/C1 of 0.02 to 5, bending of some degrees to a turn
    pressure_odd, curvature_odd = not 0.02 <= load <= 5.0, not 0.05 <= turned <= 2.0 * np.pi
    guesses = [f"pressure {by_pressure}"] if by_pressure and not curvature_odd else []
    guesses += [f"curvature {by_curvature}"] if by_curvature and not pressure_odd else []
    words = {
        "curvature": _short(curve.curvature[-1]),
        "pressure": _short(curve.pressure[-1]),
        "times": _times(factor),
        "known": f"{source} ({c1[0]:.3g} MPa at {curve.rate:g} %)",
        "load": _short(load),
        "guess": " or ".join(guesses) or OTHER_UNIT,
    }
    column, value = "pressure_kPa", float(curve.pressure[-1])
    if curvature_odd and not pressure_odd:
        column, value = "curvature_per_m", curve.end
    impossible = bool(abs(log_factor) >= np.log(IMPOSSIBLE_BENDING))
    yield _Found(curve.name, value, words, impossible, column=column)


# ---- volumes of cavities


def _volumes(evidence: _Evidence) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the rows with a volume, and by specimen that with the largest pressure."""
    rows = _first_loading(evidence.actuator)
    if "cavity_volume_ml" not in rows:
        rows = rows.iloc[:0].assign(cavity_volume_ml=0.0)
    rows = rows[rows["cavity_volume_ml"].notna() & rows["curvature_per_m"].notna()]
    pressed = rows[rows["pressure_kPa"] > 0.0].sort_values("pressure_kPa", kind="stable")
    ends = pressed.drop_duplicates("specimen_id", keep="last").set_index("specimen_id")
    return rows[:0] if ends.empty else rows, ends


def _shrunk(evidence: _Evidence) -> Iterator[_Found]:
    last = _volumes(evidence)[1]["cavity_volume_ml"]
    for name, value in last[last < 0.0].items():
        yield _Found(name, value, among=len(last))


def _volumes_at_rest(evidence: _Evidence) -> Iterator[_Found]:
    rows, ends = _volumes(evidence)
    at_rest = rows[rows["pressure_kPa"].abs() <= 1e-9].drop_duplicates("specimen_id")
    largest = at_rest["specimen_id"].map(ends["cavity_volume_ml"].abs())
    far = at_rest["cavity_volume_ml"].abs() > LARGEST_VOLUME_AT_REST * largest
    among = rows["specimen_id"].nunique()
    for row in at_rest[far].to_dict("records"):
        yield _Found(row["specimen_id"], float(row["cavity_volume_ml"]), among=among)


def _volumes_over_swept(evidence: _Evidence) -> tuple[pd.DataFrame, Floats, Floats]:
    """Return rates of specimens that clearly bent, their volumes [ml], and ln of volume over swept.

    Width times height squared times bend angle is swept.
    """
    ends, mould = _volumes(evidence)[1], evidence.study.settings.dimensions
    last, turned = ends["cavity_volume_ml"], evidence.length * ends["curvature_per_m"]
    known = (turned > CLEAR * DEGREE * ANGLE_ERROR) & (last > 0.0)
    scale = 1e3 * evidence.length / mould.length
    swept = 1e-3 * mould.width * mould.height**2 * scale**3 * turned[known]  # ml
    values = last[known].to_numpy(float)
    table = ends.loc[known, ["degradation_pct"]].rename(columns={"degradation_pct": "rate"})
    return table, values, np.log(values / swept.to_numpy(float))


def _wrong_volumes(evidence: _Evidence) -> Iterator[_Found]:
    table, values, logs = _volumes_over_swept(evidence)
    log_factor = float(np.median(logs)) if len(logs) else 0.0
    if abs(log_factor) > np.log(IMPOSSIBLE_VOLUME):
        words = _compared(_factor(log_factor), VOLUME_UNITS, NEAR_UNIT_OF_PRIOR)
        yield _Found(table.index[0], float(values[0]), words)


def _odd_volumes(evidence: _Evidence) -> Iterator[_Found]:
    table, values, logs = _volumes_over_swept(evidence)
    yield from _odd_ones(table, logs, values, VOLUME_UNITS)


# ---- single actuators


def _odd_actuators(evidence: _Evidence) -> Iterator[_Found]:
    """Doubt the column in which an actuator is unusual: its pressures or its curvatures."""
    curves = evidence.bent

    def differences(part: Integers) -> Floats:
        return np.array([[_log_ratio(curves[i], curves[j]) for j in part] for i in part])

    rates = np.array([curve.rate for curve in curves])
    off = _off(rates, differences)
    wrong = np.flatnonzero(off)
    for i in wrong[:1] if len(curves) == 2 else wrong:
        distance, curve = np.abs(rates - rates[i]), curves[i]
        distance[i] = np.inf
        close = np.flatnonzero(distance <= distance.min() + LEVEL)
        close = close[np.argsort(distance[close], kind="stable")][:MOST_COMPARED]
        near = [curves[j] for j in close]
        of_pressure = float(curve.pressure[-1]) / float(np.median([c.pressure[-1] for c in near]))
        if abs(np.log(of_pressure)) > np.log(2.0):
            ratio, units, value = _pressure_ratio, PRESSURE_UNITS, float(curve.pressure[-1])
            column, unit, at_same = "pressure_kPa", "kPa", "for the same curvature"
        else:
            ratio, units, value = _curvature_ratio, CURVATURE_UNITS, curve.end
            column, unit, at_same = "curvature_per_m", "1/m", "at the same pressure"
        exact = float(np.median([ratio(curve, other) for other in near]))
        factor = exact if np.isfinite(exact) and exact > 0.0 else _factor(off[i])
        slip = "likely a different unit, a slipped decimal point or a swapped label"
        words = _compared(factor, units, NEAR_UNIT, otherwise=slip)
        words |= {"at_same": at_same, "names": ", ".join(c.name for c in near[:3]), "unit": unit}
        impossible = bool(abs(np.log(factor)) >= np.log(IMPOSSIBLE_FACTOR))
        yield _Found(curve.name, value, words, impossible, is_alone=True, column=column)


def _off(rates: Floats, differences: Callable[[Integers], Floats]) -> Floats:
    """Return `off_neighbours`; for many specimens, among those of similar rate."""
    found = np.zeros(len(rates))
    parts = -(-len(rates) // MOST_COMPARED)
    for part in np.array_split(np.argsort(rates, kind="stable"), parts) if parts else ():
        part.sort()
        found[part] = off_neighbours(differences(part), rates[part])
    return found


def _log_ratio(one: _Curve, other: _Curve) -> float:
    """Return ln of the ratio of curvatures at the largest pressure that both were read at.

    If their pressures do not overlap, the ratio of curvatures over pressures. Near ballooning,
    curvatures differ much at equal pressure, and pressures little at equal curvature: then 0.
    """
    bent = min(float(one.curvature.max()), float(other.curvature.max())) > CURVATURE_ERROR
    if bent and abs(np.log(_pressure_ratio(one, other))) < np.log(LEAST_FACTOR_OF_PRESSURE):
        return 0.0
    top = min(one.pressure[-1], other.pressure[-1])
    if top >= max(one.pressure[0], other.pressure[0]):
        values = [float(np.interp(top, c.pressure, c.curvature)) for c in (one, other)]
        first, second = (max(value, CURVATURE_ERROR) for value in values)
    else:
        first, second = (max(c.curvature[-1], 0.0) / c.pressure[-1] for c in (one, other))
    return float(np.log(first / second)) if first > 0.0 and second > 0.0 else float("nan")


def _curvature_ratio(one: _Curve, other: _Curve) -> float:
    """Return the ratio of curvatures at the end of the shorter curve, even if small."""
    top = min(one.pressure[-1], other.pressure[-1])
    first, second = (float(np.interp(top, c.pressure, c.curvature)) for c in (one, other))
    return first / second if second != 0.0 else float("nan")


def _pressure_ratio(one: _Curve, other: _Curve) -> float:
    """Return the ratio of pressures at equal curvature, near the end of the curves."""
    reached = 0.8 * min(float(one.curvature.max()), float(other.curvature.max()))
    first, second = (
        float(np.interp(reached, [0.0, *rising], [0.0, *curve.pressure]))
        for curve in (one, other)
        for rising in [np.maximum.accumulate(np.maximum(curve.curvature, 0.0))]
    )
    return first / second if second != 0.0 else float("nan")


def _copies(evidence: _Evidence) -> Iterator[_Found]:
    """Doubt curves that equal those of a different specimen to the last digit."""
    seen: dict[tuple[tuple[float, ...], ...], str] = {}
    for name, rows in evidence.actuator.groupby("specimen_id", sort=False):
        read = rows[(rows["pressure_kPa"] > 0.0) & rows["curvature_per_m"].notna()]
        curve = (tuple(read["pressure_kPa"]), tuple(read["curvature_per_m"]))
        if len(set(curve[1])) < LEAST_ALIKE:
            continue
        if curve in seen:
            yield _Found(name, float(curve[1][-1]), {"other": seen[curve]}, impossible=False)
        seen.setdefault(curve, str(name))


def _survivors(evidence: _Evidence) -> Iterator[_Found]:
    """Doubt that all specimens of the highest degradation rate are listed, if it has fewer."""
    actuator = evidence.actuator
    first = actuator.drop_duplicates("specimen_id")
    rate = first["degradation_pct"].to_numpy(np.float64)
    order = np.argsort(rate)
    member = np.empty(len(rate), dtype=np.int64)
    member[order] = np.cumsum(np.diff(rate[order], prepend=rate[order][:1]) > LEVEL)
    counts = np.bincount(member)
    if len(counts) < FEWEST_RATES or not counts[-1] < counts[:-1].min():
        return
    highest = actuator["specimen_id"].isin(first["specimen_id"][member == len(counts) - 1])
    if not (actuator.loc[highest, "ruptured"] > 0.5).any():
        words = {"count": counts[-1], "others": counts[:-1].min()}
        yield _Found(None, float(rate.max()), words, impossible=False)


# ---- conditions of tests


def _curvatures_at_rest(evidence: _Evidence) -> Iterator[_Found]:
    rows = _first_loading(evidence.actuator)
    size = rows["curvature_per_m"].abs()
    largest = size.groupby(rows["specimen_id"]).transform("max")
    at_rest = rows["pressure_kPa"].abs() <= 1e-9
    far = size > np.maximum(LARGEST_AT_REST, LARGEST_SHARE_AT_REST * largest)
    among = rows["specimen_id"].nunique()
    for row in rows[at_rest & far].drop_duplicates("specimen_id").to_dict("records"):
        value = float(row["curvature_per_m"])
        yield _Found(row["specimen_id"], value, impossible=False, among=among)


def _absolute(evidence: _Evidence) -> Iterator[_Found]:
    """Doubt pressures that begin at ambient pressure with straight actuators."""
    curves, (low, high) = evidence.curves, AIR_PRESSURE
    if curves and all(
        low <= c.pressure[0] <= high
        and len(c.pressure) > 1
        and c.curvature[0] < LARGEST_SHARE_AT_REST * c.curvature[-1]
        for c in curves
    ):
        yield _Found(curves[0].name, float(curves[0].pressure[0]), impossible=False)


def _humidity(evidence: _Evidence) -> Iterator[_Found]:
    humidity = evidence.actuator["humidity_pct"].dropna()
    if len(humidity) and 0.0 < humidity.max() <= 1.0:
        yield _Found(None, float(humidity.max()), impossible=False)


# ---- the table of checks


_FILMS, _BREAKS, _ACTUATORS = "tensile.csv", "break.csv", "actuator.csv"
_SIGNS = ("stretch", "compression", "sign")
_ODD = "that of the specimens nearest in D_R; {guess}"
_COMPARE = "compare with the test record, or leave the specimen out"
_FROM_REST = "which must be subtracted from every reading"
_SIGN = ("backwards", "opposite")
_AGAINST = (*_SIGN, "angle")
_BENDING = (*_AGAINST, "wound", "compliance")
_VOLUME = (*_BENDING, "shrunk", "volume at rest")

OF_FILMS = (
    _Check(
        "stretch",
        *(_FILMS, "stretch", _too_stretched),
        f"is beyond any gel or rubber (stretch up to {HIGHEST_STRETCH:g}); likely {{likely}}",
        "{do}; 1 is unstrained",
    ),
    _Check(
        "compression",
        *(_FILMS, "stretch", partial(_wrong_signs, as_strain=True)),
        "is compression, but the stress in the same row is tensile ({stress:g} MPa)",
        "likely strain instead of stretch: add 1, so that 1 is undeformed",
        unless=("stretch",),
    ),
    _Check(
        "sign",
        *(_FILMS, "stress_MPa", partial(_wrong_signs, as_strain=False)),
        "has the wrong sign at a stretch of {stretch:g}",
        "give tension as positive; some testing machines record it as negative",
        unless=("stretch",),
    ),
    _Check(
        "modulus",
        *(_FILMS, "stress_MPa", _moduli),
        "gives C1 = {c1:.3g} MPa at small strain, which is {times} the prior median "
        "({prior:.3g} MPa{rate}); {guess}",
        "give MPa; if the stress is right, set the prior of c1_at_… in study.toml",
        unless=_SIGNS,
    ),
    _Check(
        "odd film",
        *(_FILMS, "stress_MPa", _odd_films),
        f"makes the stiffness of the film {{times}} {_ODD}",
        f"give MPa; {_COMPARE}",
        unless=_SIGNS,
    ),
)
"""Checks that show whether the films can be trusted."""
OF_STUDY = (
    _Check(
        "below films",
        *(_BREAKS, "elongation_pct", _below_films),
        "is, like the others, far below the elongation that {films} reached in tensile.csv "
        "(1/{share} of that); likely a fraction or a stretch instead of percent",
        "give 100 (stretch at break − 1), 210 for a film that breaks at 3.1 times its length",
    ),
    _Check(
        "elongation",
        *(_BREAKS, "elongation_pct", _elongations_off_prior),
        "is, like the others, {times} the prior median; {guess}",
        "give 100 (stretch at break − 1), 210 for a film that breaks at 3.1 times its length",
        unless=("below films",),
    ),
    _Check(
        "odd elongation",
        *(_BREAKS, "elongation_pct", _odd_elongations),
        f"makes the elongation at break {{times}} {_ODD}",
        f"give percent; {_COMPARE}",
    ),
    *(
        _Check(
            quantity,
            *("summary.csv", "value", partial(_published, quantity=quantity)),
            f"({quantity}) is {{times}} the prior median; {{guess}}",
            f"give {unit}, or set the prior in study.toml",
        )
        for quantity, unit in {"young_modulus": "MPa", "elongation_at_break": "percent"}.items()
    ),
    *(
        _Check(
            f"rates of {file}",
            *(file, "degradation_pct", partial(_as_fraction, response=response)),
            f"is the largest degradation rate, yet {what} changes {{times}} over {{points:.2g}} "
            "points; likely a fraction instead of percent",
            "give percent: 25, not 0.25",
        )
        for file, what, response in (
            (_FILMS, "the stiffness of the films", _stiffness),
            (_BREAKS, "the elongation at break", _elongations),
            (_ACTUATORS, "the curvature", _bending_per_pressure),
        )
    ),
    _Check(
        "thick layer",
        *("study.toml", "thickness", _thick_layer),
        "is the thickness of a layer modelled without bending stiffness on tetrahedra: curvatures "
        "will be about {excess:.2g} % too large",
        "mesh the part with hexahedra, or add this to mesh_error",
    ),
    _Check(
        "soft layer",
        *("study.toml", "constraint.C1", _layer_unit),
        "is {c1:g} {unit}: {times} the C1 of the body ({body:.3g} kPa from {source}){in_mpa}",
        'write unit = "MPa" or unit = "kPa" in [constraint]; it applies to C1, C2 and C3',
    ),
    _Check(
        "still",
        *(_ACTUATORS, "curvature_per_m", _still),
        "is 0 at every pressure up to {pressure:g} kPa",
        "check the tubing and the reading, or leave the specimen out",
    ),
)
"""Checks of films, means, degradation rates and the layer."""
OF_BENDING = (
    _Check(
        "backwards",
        *(_ACTUATORS, "curvature_per_m", _backwards),
        "is negative at the largest pressure ({pressure:g} kPa)",
        "give bending towards the paper, the direction under pressure, as positive",
    ),
    _Check(
        "opposite",
        *(_ACTUATORS, "bend_angle_deg", _opposite_angles),
        "has the opposite sign of the curvature in the same row ({curvature:g} 1/m)",
        "give bending towards the paper, the direction under pressure, as positive",
    ),
    _Check(
        "angle",
        *(_ACTUATORS, "bend_angle_deg", _angles),
        "is {times} the value from the {source} in the same row ({other}); {guess}",
        "give {unit}, and check the length in study.toml (arc length {length:.3g} mm)",
        unless=_SIGN,
    ),
    _Check(
        "wound",
        *(_ACTUATORS, "curvature_per_m", _wound),
        "winds the actuator into {turns:.3g} turns over its length of {length:.3g} mm; likely in "
        "°/m, or the length in study.toml is not in mm",
        "give 1/m, in radians over metres",
        unless=_AGAINST,
    ),
    _Check(
        "compliance",
        *(_ACTUATORS, "pressure_kPa", _compliance),
        "is inconsistent: {curvature} 1/m at {pressure} kPa is {times} the bending expected from "
        "the dimensions and the C1 of {known}, and p/C1 is {load}; {guess}",
        "give kPa and 1/m; otherwise check [actuator] and the priors of c1_at_… in study.toml",
        unless=(*_AGAINST, "wound"),
    ),
    _Check(
        "shrunk",
        *(_ACTUATORS, "cavity_volume_ml", _shrunk),
        "is negative at the largest pressure, although pressure widens the chambers",
        "give the increase of the volume over that at zero pressure as positive",
        unless=_BENDING,
    ),
    _Check(
        "volume at rest",
        *(_ACTUATORS, "cavity_volume_ml", _volumes_at_rest),
        f"is the volume at zero pressure, {_FROM_REST}",
        "subtract it from the volumes of this specimen, so that the first is 0",
        unless=(*_BENDING, "shrunk"),
    ),
    _Check(
        "volume",
        *(_ACTUATORS, "cavity_volume_ml", _wrong_volumes),
        "is, like the others, {times} the volume swept by width, height and bend angle of the "
        "actuator; {guess}",
        "give ml (cm³); otherwise check [actuator] in study.toml, in mm",
        unless=_VOLUME,
    ),
    _Check(
        "odd volume",
        *(_ACTUATORS, "cavity_volume_ml", _odd_volumes),
        f"makes the volume at the same bending {{times}} {_ODD}",
        f"give ml; {_COMPARE}",
        unless=(*_VOLUME, "volume"),
    ),
    _Check(
        "computed",
        *(_ACTUATORS, "bend_angle_deg", _computed),
        "equals curvature_per_m times a length, to the last digit, on {rows} of {all} rows with an "
        "angle ({length}, {says}): one was computed from the other, so the angle adds no "
        "information and only the curvature is used",
        "give angles that were read, or leave them out{do}",
        unless=_AGAINST,
    ),
    _Check(
        "odd actuator",
        *(_ACTUATORS, "curvature_per_m", _odd_actuators),
        "is {times} that of the actuators nearest in D_R {at_same} ({names}); {guess}",
        f"give {{unit}}; {_COMPARE}",
        unless=_AGAINST,
    ),
    _Check(
        "copy",
        *(_ACTUATORS, "curvature_per_m", _copies),
        "and all other curvatures are those of specimen '{other}' to the last digit",
        "one is likely a copy: give the readings of each, or leave one out",
        unless=_AGAINST,
    ),
    _Check(
        "survivors",
        *(_ACTUATORS, "degradation_pct", _survivors),
        "has only {count} of the actuators, every other degradation rate at least {others}, and "
        "none of them burst; are only survivors listed?",
        "add the rows of those that burst, with ruptured = 1 at the last pressure",
        unless=_AGAINST,
    ),
)
"""Checks of actuators of which at least one bent."""
OF_CONDITIONS = (
    _Check(
        "at rest",
        *(_ACTUATORS, "curvature_per_m", _curvatures_at_rest),
        f"is the curvature at zero pressure, {_FROM_REST}",
        "subtract it from the curvatures of this specimen, so that the first is 0",
    ),
    _Check(
        "absolute",
        *(_ACTUATORS, "pressure_kPa", _absolute),
        "is the lowest pressure, yet the actuators are still straight there; likely the absolute "
        "instead of the gauge pressure",
        "subtract the ambient pressure, about 101 kPa",
    ),
    _Check(
        "humidity",
        *(_ACTUATORS, "humidity_pct", _humidity),
        "is the largest humidity of all rows; likely a fraction instead of percent",
        "give percent: 60, not 0.6",
    ),
)
"""Checks of how the actuators were tested."""


# ---- names


def names_alike(study: Study) -> Iterator[Doubt]:
    """Doubt names of specimens that differ only in capitals, blanks, hyphens or zeros."""
    files = {name: table.file for name, table in BASE_TABLES.items()}
    for name in (*BASE_TABLES, *study.others):
        table = study.given(name)
        column = "film_id" if name in ("moisture", "shrinkage") else "specimen_id"
        if table is None or column not in table:
            continue
        by_form: dict[str, list[str]] = {}
        for one in dict.fromkeys(table[column].dropna().astype(str)):
            by_form.setdefault(_plain_name(one), []).append(one)
        for alike in by_form.values():
            if len(alike) > 1:
                others = ", ".join(repr(one) for one in alike[1:])
                problem = f"is nearly the same name as {others}; they are read as {len(alike)}"
                remedy = "write a specimen's name identically on all its rows"
                place = (None, column, alike[0])
                yield Doubt(Fault(files.get(name, f"{name}.csv"), problem, remedy, *place), False)


def _plain_name(name: str) -> str:
    """Return a name without capitals, blanks, hyphens and leading zeros.

    Examples
    --------
    >>> _plain_name("A 05-b") == _plain_name("a5B"), _plain_name("1-1") == _plain_name("11")
    (True, False)
    >>> _plain_name("1.05") == _plain_name("1.5")
    False
    """
    folded = re.sub(r"[\s_-]+", "-", unicodedata.normalize("NFKC", name).casefold())
    return re.sub(r"(?<![\d.])0+(?=\d)", "", re.sub(r"(?<!\d)-|-(?!\d)", "", folded))
