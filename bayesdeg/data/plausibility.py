r"""Check readings for plausibility: wrong units and signs, and deviating single specimens.

A wrong unit multiplies a column by 4 to a million, while every effect known to the package changes
it by tens of percent, at most twofold. So columns are compared with each other, with the priors and
with other specimens by medians of log ratios. What no soft actuator can do is a fault; what is
merely unlikely is a warning, which is repeated with the verdict.
"""

import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from bayesdeg.data.families import MeshDimensions, Mould
from bayesdeg.data.settings import Dimensions, Settings
from bayesdeg.data.study import Study
from bayesdeg.data.tables import TABLES
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
    """Return what is impossible or unlikely in a study, file by file.

    Parameters
    ----------
    study : Study
        A study whose tables have no faults.
    expected : Expected
        Expectations from its priors.
    """
    # absurd numbers overflow; their ratios are not compared
    with np.errstate(all="ignore"):
        of_films = _tension(study, expected)
        trusted = None if of_films else study.tensile
        films = _in_likely_unit(study, expected) if of_films else film_moduli(trusted)
        material = _Material(expected, films[films["c1"] > 0.0])
        found = [*of_films, *_elongation(study.breaks, trusted, expected)]
        found += [*_published(study, expected), *_rates(study), *_thick_layer(study.settings)]
        found += _layer_unit(study.settings, material)
        if study.actuator is not None:
            found += _bending(study, material)
            found += _conditions(study.actuator)
        found += names_alike(study)
    return tuple(_where_it_stands(doubt, study) for doubt in found)


def times_stiffer(study: Study, expected: Expected) -> float:
    """Return by what factor a study's material is stiffer than expected, if it is a different one.

    1 where it is as expected, where no elastomer has the C1 of its films or moduli, and where
    actuators bend as the expected material would: then a unit is wrong.

    Parameters
    ----------
    study : Study
        A study whose tables have no faults.
    expected : Expected
        Expectations from priors of a different material, none stated for this one.
    """
    with np.errstate(all="ignore"):
        c1 = _known_c1(study)
        log_factor, impossible = _off_prior(
            np.log(c1["c1"].to_numpy(float)), c1["rate"].to_numpy(float), expected.c1
        )
        if impossible is None or not SOFTEST <= c1["c1"].median() <= STIFFEST:
            return 1.0
        if _off_bending(study, expected, c1.iloc[:0]) < _off_bending(study, expected, c1):
            return 1.0
    return _factor(log_factor)


def _off_bending(study: Study, expected: Expected, films: pd.DataFrame) -> float:
    """Return how far bending deviates from that expected with C1 of films or priors; 0 if not read.

    Absolute value of ln of the factor.
    """
    curves = [] if study.actuator is None else _curves(study.actuator)
    if not curves:
        return 0.0
    mould = study.settings.dimensions
    length = 1e-3 * mould.length * expected.linear_scale
    material = _Material(expected, films)
    return abs(float(np.median(_log_bending(curves, material, bending_of_beam(mould), length))))


def _known_c1(study: Study) -> pd.DataFrame:
    """Return C1 [MPa] with its degradation rate [%]: from films and published moduli."""
    found = film_moduli(study.tensile)[["rate", "c1"]]
    if study.summary is not None:
        rows = study.summary[study.summary["quantity"] == "young_modulus"]
        moduli = {"rate": rows["degradation_pct"].fillna(0.0), "c1": rows["value"] / 6.0}
        found = pd.DataFrame({k: [*found[k], *moduli[k]] for k in moduli}, dtype=float)
    return found[found["c1"] > 0.0]


def _where_it_stands(doubt: Doubt, study: Study) -> Doubt:
    """Point out that readings of lines come from points."""
    if study.line_points is None or doubt.fault.file != "actuator.csv":
        return doubt
    return replace(doubt, fault=replace(doubt.fault, file=study.lines_file))


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
    known = {rate: _median_and_above(law) for rate, law in sorted(laws.items())}
    known = {rate: q for rate, q in known.items() if np.all(np.isfinite(q)) and q[0] > 0.0}
    if not known:
        return np.full(len(rates), np.nan), np.full(len(rates), np.nan)
    at, quantiles = list(known), np.log(np.array(list(known.values())))
    median = np.interp(rates, at, quantiles[:, 0])
    return median, np.maximum(np.interp(rates, at, quantiles[:, 1]) - median, 1e-6)


def _median_and_above(law: Distribution) -> Floats:
    """Return a law's median, and its quantile one standard deviation of a normal law above.

    For a log-normal law, the default here, no special function is needed.
    """
    if isinstance(law, LogNormal):
        return law.median * np.exp([0.0, law.sigma])
    return law.quantile(np.array([0.5, 0.8413]))


def _off_prior(
    logs: Floats, rates: Floats, laws: Mapping[float, Distribution]
) -> tuple[float, bool | None]:
    """Return ln of the median over its prior, and whether that is impossible.

    The second is None if it is plausible.
    """
    median, sd = _prior_at(laws, rates)
    off = logs - median
    if not np.any(np.isfinite(off)):
        return 0.0, None
    log_factor, sds = float(np.nanmedian(off)), float(np.nanmedian(np.abs(off) / sd))
    if abs(log_factor) < np.log(LEAST_FACTOR_TO_PRIOR) or sds < UNLIKELY_SDS:
        return log_factor, None
    impossible = abs(log_factor) >= np.log(IMPOSSIBLE_FACTOR) and sds >= IMPOSSIBLE_SDS
    return log_factor, bool(impossible)


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


def _likely(factor: float, units: Units, tolerance: float, *, otherwise: str = OTHER_UNIT) -> str:
    unit = nearest_unit(factor, units, tolerance)
    if unit is None:
        return otherwise
    tenfold = np.log10(factor)
    slipped = abs(tenfold - round(tenfold)) < 0.1 and tolerance == NEAR_UNIT
    return f"likely in {unit}{', or with a slipped decimal point' if slipped else ''}"


def _and_others(count: int, total: int) -> str:
    return f" (as in {count - 1} of the other {total - 1} specimens)" if count > 1 else ""


def _told(wrong: Sequence[Fault], total: int) -> list[Fault]:
    """Return one common fault if at least half of the specimens have it, else each."""
    if len(wrong) < 2 or 2 * len(wrong) < total:
        return list(wrong)
    first = wrong[0]
    return [replace(first, problem=first.problem + _and_others(len(wrong), total))]


# ---- films


def film_moduli(tensile: pd.DataFrame | None) -> pd.DataFrame:
    r"""Return C1 of each film from its smallest strains, with its degradation rate.

    The stress of a neo-Hookean solid over :math:`2 (\lambda - \lambda^{-n})`, with n of 2, 3 or 5
    in uniaxial, planar and equibiaxial tension, times λ for Cauchy stress.

    Parameters
    ----------
    tensile : pandas.DataFrame or None
        As in `Study`.

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


def _tension(study: Study, expected: Expected) -> list[Doubt]:
    if study.tensile is None:
        return []
    found = [*_stretches(study.tensile)] or [*_signs(study.tensile)]
    if found:  # moduli would repeat it
        return found
    films = film_moduli(study.tensile)
    films = films[films["c1"] > 0.0]
    return [*_moduli(films, expected), *_odd_films(films)]


def _stretches(tensile: pd.DataFrame) -> Iterator[Doubt]:
    largest = tensile.groupby("specimen_id", sort=False)["stretch"].max()
    wrong = largest[largest > HIGHEST_STRETCH]
    if wrong.empty:
        return
    # stretch in percent begins at 100, strain in percent near 0
    smallest = float(tensile.groupby("specimen_id")["stretch"].min().median())
    likely, remedy = (
        ("stretch in percent", "divide by 100")
        if smallest >= 100.0 * (1.0 - LEAST_STRAIN)
        else ("strain in percent", "divide by 100 and add 1")
    )
    problem = f"is beyond any gel or rubber (stretch up to {HIGHEST_STRETCH:g}); likely "
    faults = [
        _fault(
            "tensile.csv", name, "stretch", value, problem + likely, f"{remedy}; 1 is unstrained"
        )
        for name, value in wrong.items()
    ]
    yield from _all(_told(faults, len(largest)), impossible=True)


def _signs(tensile: pd.DataFrame) -> Iterator[Doubt]:
    stretch, stress = tensile["stretch"], tensile["stress_MPa"]
    largest = stress.abs().groupby(tensile["specimen_id"]).transform("max")
    clear = (np.abs(stretch - 1.0) > LEAST_STRAIN) & (stress.abs() > LEAST_STRESS * largest)
    wrong = tensile[clear & (np.sign(stress) != np.sign(stretch - 1.0))]
    if wrong.empty:
        return
    as_strain = bool((wrong["stretch"] < 1.0).all())
    first = wrong.drop_duplicates("specimen_id")
    faults = [_wrong_sign(row, as_strain=as_strain) for _, row in first.iterrows()]
    yield from _all(_told(faults, tensile["specimen_id"].nunique()), impossible=True)


def _wrong_sign(row: "pd.Series[float]", *, as_strain: bool) -> Fault:
    stretch, stress = float(row["stretch"]), float(row["stress_MPa"])
    if as_strain:
        column, value = "stretch", stretch
        problem = f"is compression, but the stress in the same row is tensile ({stress:g} MPa)"
        remedy = "likely strain instead of stretch: add 1, so that 1 is undeformed"
    else:
        column, value = "stress_MPa", stress
        problem = f"has the wrong sign at a stretch of {stretch:g}"
        remedy = "give tension as positive; some testing machines record it as negative"
    return _fault("tensile.csv", row["specimen_id"], column, value, problem, remedy)


def _moduli(films: pd.DataFrame, expected: Expected) -> Iterator[Doubt]:
    rates, c1 = films["rate"].to_numpy(float), films["c1"].to_numpy(float)
    log_factor, impossible = _off_prior(np.log(c1), rates, expected.c1)
    if impossible is None:
        return
    middle = int(np.argmin(np.abs(np.log(c1 / np.median(c1)))))
    prior = np.exp(_prior_at(expected.c1, rates[[middle]])[0][0])
    factor = _factor(log_factor)
    units = _stress_units(films, log_factor)
    guess = f"likely in {' or '.join(units)}" if units else OTHER_UNIT
    impossible = impossible or not SOFTEST <= np.median(c1) <= STIFFEST
    rate = " at this degradation rate" if rates.any() else ""
    problem = (
        f"gives C1 = {c1[middle]:.3g} MPa at small strain, which is {_times(factor)} "
        f"the prior median ({prior:.3g} MPa{rate}); {guess}"
    )
    remedy = "give MPa; if the stress is right, set the prior of c1_at_… in study.toml"
    name, stress = str(films.index[middle]), float(films["stress"].iloc[middle])
    yield Doubt(_fault("tensile.csv", name, "stress_MPa", stress, problem, remedy), impossible)


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


def _in_likely_unit(study: Study, expected: Expected) -> pd.DataFrame:
    """Return doubtful films converted from the likeliest unit of their stress.

    Of several units the one that agrees with the actuators' bending. No films where no unit
    explains them: C1 is then taken from the priors.
    """
    films = film_moduli(study.tensile)
    films = films[films["c1"] > 0.0]
    logs, rates = np.log(films["c1"].to_numpy(float)), films["rate"].to_numpy(float)
    log_factor, impossible = _off_prior(logs, rates, expected.c1)
    units = [] if impossible is None else _stress_units(films, log_factor)
    tried = [films.assign(c1=films["c1"] / STRESS_UNITS[unit]) for unit in units]
    return min(tried, key=lambda one: _off_bending(study, expected, one), default=films.iloc[:0])


def _odd_films(films: pd.DataFrame) -> Iterator[Doubt]:
    logs = np.log(films["c1"].to_numpy(float))
    values = films["stress"].to_numpy(float)
    place = ("tensile.csv", "stress_MPa", "stiffness of the film")
    yield from _odd_ones(films, logs, values, place, STRESS_UNITS, "give MPa")


def _odd_ones(
    table: pd.DataFrame,
    logs: Floats,
    values: Floats,
    place: tuple[str, str, str],
    units: Units,
    remedy: str,
) -> Iterator[Doubt]:
    """Doubt each specimen that is far off its neighbours; ``place`` names file and column.

    The third entry of ``place`` words the compared quantity.
    """
    file, column, what = place
    off = _off(table["rate"].to_numpy(float), lambda part: logs[part, None] - logs[part])
    wrong = np.flatnonzero(off)
    if len(table) == 2:  # either may be wrong
        wrong = wrong[:1]
    names = [str(name) for name in table.index]
    for i in wrong:
        factor = _factor(off[i])
        slip = "likely a different unit, a slipped decimal point or a different material"
        guess = _likely(factor, units, NEAR_UNIT, otherwise=slip)
        problem = f"makes the {what} {_times(factor)} that of the specimens nearest in D_R; {guess}"
        said = f"{remedy}; compare with the test record, or leave the specimen out"
        impossible = bool(abs(off[i]) >= np.log(IMPOSSIBLE_FACTOR))
        yield Doubt(_fault(file, names[i], column, values[i], problem, said), impossible)


def _elongation(
    breaks: pd.DataFrame | None, tensile: pd.DataFrame | None, expected: Expected
) -> Iterator[Doubt]:
    if breaks is None:
        return
    table = breaks.set_index("specimen_id")[["degradation_pct", "elongation_pct"]]
    table.columns = pd.Index(["rate", "value"])
    values = table["value"].to_numpy(float)
    yield from _all_elongations(table, tensile, expected)
    place = ("break.csv", "elongation_pct", "elongation at break")
    yield from _odd_ones(table, np.log(values), values, place, PERCENT_UNITS, "give percent")


def _all_elongations(
    table: pd.DataFrame, tensile: pd.DataFrame | None, expected: Expected
) -> Iterator[Doubt]:
    """Doubt elongations that are below the films' stretch, or far off their prior."""
    values, rates = table["value"].to_numpy(float), table["rate"].to_numpy(float)
    place = ("break.csv", str(table.index[0]), "elongation_pct", float(values[0]))
    remedy = "give 100 (stretch at break − 1), 210 for a film that breaks at 3.1 times its length"
    stretched = _stretched(tensile, rates)
    beyond = 0.0 if stretched is None else float(np.nanmedian(np.log(values / stretched)))
    log_factor, impossible = _off_prior(np.log(values), rates, expected.elongation)
    if stretched is not None and beyond < -np.log(LEAST_FACTOR):
        films = "films of that degradation rate" if rates.any() else "films"
        problem = (
            f"is, like the others, far below the elongation that {films} reached in "
            f"tensile.csv (1/{_short(_factor(-beyond))} of that); likely a fraction or a stretch "
            "instead of percent"
        )
        yield Doubt(_fault(*place, problem, remedy), True)
    elif impossible is not None:
        factor = _factor(log_factor)
        guess = _likely(factor, PERCENT_UNITS, NEAR_UNIT_OF_PRIOR)
        problem = f"is, like the others, {_times(factor)} the prior median; {guess}"
        yield Doubt(_fault(*place, problem, remedy), impossible)


def _stretched(tensile: pd.DataFrame | None, rates: Floats) -> Floats | None:
    """Return the elongation reached by films of these degradation rates [%]; None if none was."""
    if tensile is None:
        return None
    films = tensile.groupby("specimen_id").agg({"degradation_pct": "first", "stretch": "max"})
    distance = np.abs(films["degradation_pct"].to_numpy(float) - rates[:, None])
    largest = np.where(distance <= 1.0, films["stretch"].to_numpy(float), -np.inf).max(axis=1)
    strain = 100.0 * (np.where(np.isfinite(largest), largest, np.nan) - 1.0)
    strain = np.where(strain > 0.0, strain, np.nan)
    return None if np.isnan(strain).all() else strain


def _published(study: Study, expected: Expected) -> Iterator[Doubt]:
    if study.summary is None:
        return
    known = {
        "young_modulus": (6.0, expected.c1, STRESS_UNITS, "MPa"),
        "elongation_at_break": (1.0, expected.elongation, PERCENT_UNITS, "percent"),
    }
    for quantity, (share, laws, units, unit) in known.items():
        rows = study.summary[study.summary["quantity"] == quantity]
        values = rows["value"].to_numpy(float)
        rates = rows["degradation_pct"].fillna(0.0).to_numpy(float)
        if not len(values):
            continue
        log_factor, impossible = _off_prior(np.log(values / share), rates, laws)
        if impossible is not None:
            factor = _factor(log_factor)
            guess = _likely(factor, units, NEAR_UNIT_OF_PRIOR)
            problem = f"({quantity}) is {_times(factor)} the prior median; {guess}"
            remedy = f"give {unit}, or set the prior in study.toml"
            yield Doubt(
                _fault("summary.csv", None, "value", values[0], problem, remedy), impossible
            )


# ---- the actuator


def _thick_layer(settings: Settings) -> Iterator[Doubt]:
    """Doubt paper or film on tetrahedra that is too thick to neglect its bending stiffness."""
    mould, thickness = settings.dimensions, settings.paper.thickness
    if (
        not isinstance(mould, MeshDimensions)
        or mould.cells != "tetrahedra"
        or not settings.layer.is_membrane
        or thickness <= THICKEST_WITHOUT_BENDING
    ):
        return
    problem = (
        "is the thickness of a layer modelled without bending stiffness on tetrahedra: curvatures "
        f"will be about {BENDING_LEFT_OUT * thickness**2:.2g} % too large"
    )
    remedy = "mesh the part with hexahedra, or add this to mesh_error"
    yield Doubt(_fault("study.toml", None, "thickness", thickness, problem, remedy), False)


# ---- degradation rates


def _rates(study: Study) -> Iterator[Doubt]:
    """Doubt rates that are all below 1 % although responses change as over tens of percent."""
    for file, table in _responses(study):
        rates = table["rate"].to_numpy(float)
        if len(table) < 3 or not 0.02 <= np.ptp(rates) <= 1.0 or np.abs(rates).max() > 1.0:
            continue
        steep = steepness(rates, np.log(table["value"].to_numpy(float)))
        if abs(steep) < TOO_STEEP or abs(steep) * np.ptp(rates) < np.log(1.5):
            continue
        factor = _factor(abs(steep) * np.ptp(rates))
        problem = (
            f"is the largest degradation rate, yet {table.attrs['what']} changes "
            f"{_times(factor)} over {np.ptp(rates):.2g} points; likely a fraction instead of "
            "percent"
        )
        remedy = "give percent: 25, not 0.25"
        at = int(np.argmax(rates))
        fault = _fault(file, str(table.index[at]), "degradation_pct", rates[at], problem, remedy)
        yield Doubt(fault, True)


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


def _responses(study: Study) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield each file's response to degradation: rate and a positive value by specimen."""
    films = film_moduli(study.tensile).rename(columns={"c1": "value"})
    films.attrs["what"] = "the stiffness of the films"
    yield "tensile.csv", films[films["value"] > 0.0]
    if study.breaks is not None:
        names = {"degradation_pct": "rate", "elongation_pct": "value"}
        broken = study.breaks.set_index("specimen_id").rename(columns=names)
        broken.attrs["what"] = "the elongation at break"
        yield "break.csv", broken
    if study.actuator is not None:
        curves = _curves(study.actuator)
        bent = pd.DataFrame(
            [(c.name, c.rate, c.curvature[-1] / c.pressure[-1]) for c in curves],
            columns=["specimen", "rate", "value"],
        ).set_index("specimen")
        bent.attrs["what"] = "the curvature"
        yield "actuator.csv", bent[bent["value"] > 0.0]


# ---- actuators


@dataclass(frozen=True)
class _Curve:
    """First loading of an actuator, by pressure; bend angles are nan where none was read."""

    name: str
    rate: float
    pressure: Floats
    curvature: Floats
    angle: Floats


@dataclass(frozen=True)
class _Material:
    """C1 by degradation rate: from the films where they are reliable, else from the priors."""

    expected: Expected
    films: pd.DataFrame

    def c1(self, rates: Floats) -> tuple[Floats, str]:
        """Return C1 [MPa], nan where unknown, and its source."""
        if not len(self.films):
            return np.exp(_prior_at(self.expected.c1, rates)[0]), "the prior"
        levels = np.log(self.films["c1"]).groupby(self.films["rate"]).median()
        at = levels.index.to_numpy(float)
        return np.exp(np.interp(rates, at, levels.to_numpy(float))), "the films"


def _layer_unit(settings: Settings, material: _Material) -> Iterator[Doubt]:
    """Doubt constants of an elastomer layer far softer than the body, or than any elastomer.

    The layer should stretch less than the body. Without a stated unit kPa is assumed; a layer then
    softer than the body may be meant in MPa.
    """
    if not settings.layer.is_slab:
        return
    layer, value = settings.layer.constants[0], settings.constraint.C1
    known, source = material.c1(np.zeros(1))
    body, stated = float(known[0]), settings.constraint.unit
    softest = body / (LEAST_FACTOR if stated is None else IMPOSSIBLE_FACTOR)
    if not (layer < softest or layer > STIFFEST):
        return
    in_mpa = (
        f"; {value:g} MPa would be {_times(value / body)} that"
        if stated is None and layer < softest
        else ""
    )
    problem = (
        f"is {value:g} {stated or 'kPa, the default unit'}: {_times(layer / body)} the C1 of the "
        f"body ({1e3 * body:.3g} kPa from {source}){in_mpa}"
    )
    remedy = 'write unit = "MPa" or unit = "kPa" in [constraint]; it applies to C1, C2 and C3'
    refused = stated is None and (layer * MEANT_IN_MPA < body or layer > STIFFEST)
    yield Doubt(_fault("study.toml", None, "constraint.C1", value, problem, remedy), refused)


def _first_loading(actuator: pd.DataFrame) -> pd.DataFrame:
    """Return the rows before any creep, softening or set."""
    first = actuator.groupby("specimen_id")["cycle"].transform("min")
    return actuator[(actuator["cycle"] == first) & (actuator["branch"] == "loading")]


def _curves(actuator: pd.DataFrame) -> list[_Curve]:
    """Return the curves of specimens that have readings under pressure."""
    found = []
    for name, rows in _first_loading(actuator).groupby("specimen_id", sort=False):
        read = rows[(rows["pressure_kPa"] > 0.0) & rows["curvature_per_m"].notna()]
        read = read.sort_values("pressure_kPa", kind="stable")
        if len(read):
            columns = ("pressure_kPa", "curvature_per_m", "bend_angle_deg")
            arrays = (read[column].to_numpy(np.float64) for column in columns)
            found.append(_Curve(str(name), float(read["degradation_pct"].iloc[0]), *arrays))
    return found


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


def _bending(study: Study, material: _Material) -> list[Doubt]:
    assert study.actuator is not None
    curves = _curves(study.actuator)
    if not curves:
        return []
    dead = [c for c in curves if len(c.curvature) > 1 and not c.curvature.any()]
    curves = [c for c in curves if c not in dead]
    still = [*_still(dead, impossible=not curves)]
    if not curves:
        return still
    beam, length = bending_of_beam(study.settings.dimensions), study.settings.dimensions.length
    length = 1e-3 * length * material.expected.linear_scale  # m, of the part
    against = [*_directions(curves)] or [*_angles(curves, material, beam, length)]
    if against:
        return [*still, *against]
    found = [*_wound(curves, length)] or [*_compliance(curves, material, beam, length)]
    found = found or [*_volumes(study, length)]
    mishaps = (*_duplicates(study.actuator), *_survivors(study.actuator))
    found += [] if study.line_points else _computed(study)
    return [
        *still,
        *found,
        *_odd_actuators(curves),
        *(mishaps if study.settings.suspects.set_aside else ()),
    ]


def _still(curves: list[_Curve], *, impossible: bool) -> Iterator[Doubt]:
    """Doubt actuators that did not bend at all."""
    for curve in curves:
        problem = f"is 0 at every pressure up to {curve.pressure[-1]:g} kPa"
        remedy = "check the tubing and the reading, or leave the specimen out"
        fault = _fault("actuator.csv", curve.name, "curvature_per_m", 0.0, problem, remedy)
        yield Doubt(fault, impossible, is_alone=not impossible)


def _directions(curves: list[_Curve]) -> Iterator[Doubt]:
    largest = max(float(np.abs(curve.curvature).max()) for curve in curves)
    remedy = "give bending towards the paper, the direction under pressure, as positive"
    backwards, against = [], []
    for curve in curves:
        end, angle = float(curve.curvature[-1]), float(curve.angle[-1])
        if end < -LARGEST_SHARE_AT_REST * largest:
            problem = f"is negative at the largest pressure ({curve.pressure[-1]:g} kPa)"
            place = ("actuator.csv", curve.name, "curvature_per_m", end)
            backwards.append(_fault(*place, problem, remedy))
        elif end > max(LARGEST_SHARE_AT_REST * largest, CURVATURE_ERROR) and angle < -ANGLE_ERROR:
            problem = f"has the opposite sign of the curvature in the same row ({end:g} 1/m)"
            place = ("actuator.csv", curve.name, "bend_angle_deg", angle)
            against.append(_fault(*place, problem, remedy))
    yield from _all(_told(backwards, len(curves)), impossible=True)
    yield from _all(_told(against, len(curves)), impossible=True)


def _angles(
    curves: list[_Curve], material: _Material, beam: float, length: float
) -> Iterator[Doubt]:
    """Doubt specimens whose bend angle is not curvature times length."""
    faults = []
    for curve in curves:
        turned = DEGREE * curve.angle
        wide = np.abs(curve.curvature) >= 0.5 * np.abs(curve.curvature).max()
        wide &= (np.abs(curve.curvature) >= CLEAR * CURVATURE_ERROR) | (
            np.abs(curve.angle) >= CLEAR * ANGLE_ERROR
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.abs(turned / (curve.curvature * length))[wide]
        ratio = ratio[np.isfinite(ratio) & (ratio > 0.0)]
        off = float(np.median(np.log(ratio))) if len(ratio) else 0.0
        if abs(off) > np.log(LEAST_FACTOR_OF_ANGLE):
            c1 = material.c1(np.array([curve.rate]))[0][0]
            faults.append(_wrong_angle(curve, _factor(off), beam / (1e3 * c1), length))
    yield from _all(_told(faults, len(curves)), impossible=True)


def _wrong_angle(curve: _Curve, factor: float, per_pressure: float, length: float) -> Fault:
    """Say that angle and curvature disagree, and which of them contradicts the pressure."""
    likely = per_pressure * float(curve.pressure[-1])
    by_curvature = float(curve.curvature[-1]) * length
    by_angle = DEGREE * float(curve.angle[-1])
    remedy = f"and check the length in study.toml (arc length {1e3 * length:.3g} mm)"
    if abs(_log(by_curvature) - _log(likely)) > abs(_log(by_angle) - _log(likely)):
        guess = _likely(1.0 / factor, CURVATURE_UNITS, NEAR_UNIT)
        problem = (
            f"is {_times(1.0 / factor)} the value from the bend angle in the same row "
            f"({by_angle / length:.3g} 1/m); {guess}"
        )
        place = ("curvature_per_m", float(curve.curvature[-1]))
        return _fault("actuator.csv", curve.name, *place, problem, f"give 1/m, {remedy}")
    guess = _likely(factor, ANGLE_UNITS, NEAR_UNIT)
    problem = (
        f"is {_times(factor)} the value from the curvature in the same row "
        f"({by_curvature / DEGREE:.3g}°); {guess}"
    )
    place = ("bend_angle_deg", float(curve.angle[-1]))
    return _fault("actuator.csv", curve.name, *place, problem, f"give degrees, {remedy}")


def computed_angles(actuator: pd.DataFrame) -> NDArray[np.bool_]:
    """Return at which rows the bend angle is curvature times one length, to the last digit.

    The length is the same on all rows, or on those of a specimen. Such an angle was not read: one
    of the two was computed from the other.

    Parameters
    ----------
    actuator : pandas.DataFrame
        As in `Study`.

    Returns
    -------
    array of bool, shape (n_rows,)

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
    """Return the smallest and largest ratio of angle to curvature [m] that digits allow."""
    bend, angle = actuator["curvature_per_m"], actuator["bend_angle_deg"]
    size, turned = bend.abs(), DEGREE * angle * np.sign(bend)
    of_bend, of_angle = (
        one.groupby(actuator["specimen_id"]).transform(_half_digit) for one in (bend, angle)
    )
    of_angle = DEGREE * of_angle
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


def _computed(study: Study) -> Iterator[Doubt]:
    """Doubt angles that were computed from curvatures, or curvatures from angles."""
    assert study.actuator is not None
    actuator = study.actuator.reset_index(drop=True)
    rows = computed_angles(actuator)
    if not rows.any():
        return
    each = implied_lengths(actuator)[rows]
    of_all = _is_one_length(each)
    lengths = each.groupby(["all"] * len(each) if of_all else actuator["specimen_id"][rows])
    middle = 500.0 * (lengths["least"].max() + lengths["most"].min())  # mm
    low, high, stated = middle.min(), middle.max(), study.settings.dimensions.length
    one = high - low <= SAME_LENGTH * high
    which = f"{middle.median():.1f} mm" if one else f"{low:.1f} to {high:.1f} mm, by specimen"
    same = one and abs(middle.median() - stated) <= SAME_LENGTH * stated
    says = "as in study.toml" if same else f"but study.toml has {stated:g} mm"
    angle = actuator["bend_angle_deg"]
    problem = (
        f"equals curvature_per_m times a length, to the last digit, on {int(rows.sum())} of "
        f"{int(angle.notna().sum())} rows with an angle ({which}, {says}): one was computed "
        "from the other, so the angle adds no information and only the curvature is used"
    )
    remedy = "give angles that were read, or leave them out"
    if not same:
        remedy += "; check the length used in the computation"
    yield Doubt(
        _fault("actuator.csv", None, "bend_angle_deg", angle[rows].iloc[-1], problem, remedy), False
    )


def _log(value: float) -> float:
    """Return ln of the absolute value; for 0, of something very small."""
    return float(np.log(max(abs(value), TINY)))


def _wound(curves: list[_Curve], length: float) -> Iterator[Doubt]:
    faults = []
    for curve in curves:
        turning = float(np.abs(curve.curvature).max()) * length
        if turning > MOST_TURNING:
            problem = (
                f"winds the actuator into {turning / (2.0 * np.pi):.3g} turns over its length of "
                f"{1e3 * length:.3g} mm; likely in °/m, or the length in study.toml is not in mm"
            )
            value = float(curve.curvature[np.argmax(np.abs(curve.curvature))])
            place = ("actuator.csv", curve.name, "curvature_per_m", value)
            faults.append(_fault(*place, problem, "give 1/m, in radians over metres"))
    yield from _all(_told(faults, len(curves)), impossible=True)


def _log_bending(curves: list[_Curve], material: _Material, beam: float, length: float) -> Floats:
    """Return ln of each actuator's bending over that expected from C1 and the dimensions."""
    pressure = np.array([curve.pressure[-1] for curve in curves])
    turned = np.array([max(curve.curvature[-1] * length, SMALLEST_ANGLE) for curve in curves])
    load = 1e-3 * pressure / material.c1(np.array([curve.rate for curve in curves]))[0]
    with np.errstate(divide="ignore"):
        return np.log(turned / (beam * load))


def _compliance(
    curves: list[_Curve], material: _Material, beam: float, length: float
) -> Iterator[Doubt]:
    """Doubt pressure or curvature of all actuators, given C1 and the dimensions."""
    off = _log_bending(curves, material, beam, length)
    log_factor = float(np.median(off))
    if not abs(log_factor) > np.log(LEAST_FACTOR):  # nan where C1 is unknown
        return
    at = int(np.argsort(off)[len(off) // 2])
    c1, source = material.c1(np.array([curves[at].rate]))
    compared = f"{source} ({c1[0]:.3g} MPa at {curves[at].rate:g} %)"
    ratios = (_factor(log_factor), float(1e-3 * curves[at].pressure[-1] / c1[0]))
    fault = _stiff_or_soft(curves[at], ratios, compared, length)
    yield Doubt(fault, bool(abs(log_factor) >= np.log(IMPOSSIBLE_BENDING)))


def _stiff_or_soft(
    curve: _Curve, ratios: tuple[float, float], compared: str, length: float
) -> Fault:
    """Say that bending does not match pressure; ``ratios`` are bending over expected, and p/C1."""
    factor, load = ratios
    turned = float(curve.curvature[-1]) * length
    by_pressure = _likely(1.0 / factor, PRESSURE_UNITS, NEAR_UNIT_OF_PRIOR, otherwise="")
    by_curvature = _likely(factor, CURVATURE_UNITS, NEAR_UNIT_OF_PRIOR, otherwise="")
    # values in their usual range are right: p/C1 of 0.02 to 5, bending of some degrees to a turn
    pressure_odd, curvature_odd = not 0.02 <= load <= 5.0, not 0.05 <= turned <= 2.0 * np.pi
    guesses = [f"pressure {by_pressure}"] if by_pressure and not curvature_odd else []
    guesses += [f"curvature {by_curvature}"] if by_curvature and not pressure_odd else []
    column, value = ("pressure_kPa", float(curve.pressure[-1]))
    if curvature_odd and not pressure_odd:
        column, value = ("curvature_per_m", float(curve.curvature[-1]))
    problem = (
        f"is inconsistent: {_short(curve.curvature[-1])} 1/m at "
        f"{_short(curve.pressure[-1])} kPa is {_times(factor)} the bending expected from the "
        f"dimensions and the C1 of {compared}, and p/C1 is {_short(load)}; "
        f"{' or '.join(guesses) or OTHER_UNIT}"
    )
    remedy = "give kPa and 1/m; otherwise check [actuator] and the priors of c1_at_… in study.toml"
    return _fault("actuator.csv", curve.name, column, value, problem, remedy)


def _volumes(study: Study, length: float) -> Iterator[Doubt]:
    """Doubt volumes of the cavity: their sign, their zero, their unit, and single specimens."""
    assert study.actuator is not None
    if "cavity_volume_ml" not in study.actuator:
        return
    rows = _first_loading(study.actuator)
    rows = rows[rows["cavity_volume_ml"].notna() & rows["curvature_per_m"].notna()]
    pressed = rows[rows["pressure_kPa"] > 0.0].sort_values("pressure_kPa", kind="stable")
    ends = pressed.drop_duplicates("specimen_id", keep="last").set_index("specimen_id")
    if not len(ends):
        return
    total, last = len(ends), ends["cavity_volume_ml"]
    against = [*_shrunk(last, total)] or [*_not_from_rest(rows, last)]
    yield from against
    turned = length * ends["curvature_per_m"]
    known = (turned > CLEAR * DEGREE * ANGLE_ERROR) & (last > 0.0)
    if against or not known.any():
        return
    mould, scale = study.settings.dimensions, 1e3 * length / study.settings.dimensions.length
    swept = 1e-3 * mould.width * mould.height**2 * scale**3 * turned[known]  # ml
    logs = np.log(last[known].to_numpy(float) / swept.to_numpy(float))
    table = ends.loc[known, ["degradation_pct"]].rename(columns={"degradation_pct": "rate"})
    values = last[known].to_numpy(float)
    log_factor = float(np.median(logs))
    if abs(log_factor) > np.log(IMPOSSIBLE_VOLUME):
        yield _wrong_volume(str(table.index[0]), float(values[0]), _factor(log_factor))
        return
    place = ("actuator.csv", "cavity_volume_ml", "volume at the same bending")
    yield from _odd_ones(table, logs, values, place, VOLUME_UNITS, "give ml")


def _wrong_volume(name: str, value: float, factor: float) -> Doubt:
    problem = (
        f"is, like the others, {_times(factor)} the volume swept by width, height and bend "
        f"angle of the actuator;  {_likely(factor, VOLUME_UNITS, NEAR_UNIT_OF_PRIOR)}"
    )
    remedy = "give ml (cm³); otherwise check [actuator] in study.toml, in mm"
    place = ("actuator.csv", name, "cavity_volume_ml", value)
    return Doubt(_fault(*place, problem, remedy), True)


def _shrunk(last: "pd.Series[float]", total: int) -> Iterator[Doubt]:
    problem = "is negative at the largest pressure, although pressure widens the chambers"
    remedy = "give the increase of the volume over that at zero pressure as positive"
    faults = [
        _fault("actuator.csv", name, "cavity_volume_ml", value, problem, remedy)
        for name, value in last[last < 0.0].items()
    ]
    yield from _all(_told(faults, total), impossible=True)


def _not_from_rest(rows: pd.DataFrame, last: "pd.Series[float]") -> Iterator[Doubt]:
    at_rest = rows[rows["pressure_kPa"].abs() <= 1e-9].drop_duplicates("specimen_id")
    largest = at_rest["specimen_id"].map(last.abs())
    far = at_rest["cavity_volume_ml"].abs() > LARGEST_VOLUME_AT_REST * largest
    problem = "is the volume at zero pressure, which must be subtracted from every reading"
    remedy = "subtract it from the volumes of this specimen, so that the first is 0"
    faults = [
        _fault("actuator.csv", row["specimen_id"], "cavity_volume_ml", value, problem, remedy)
        for (_, row), value in zip(
            at_rest[far].iterrows(), at_rest.loc[far, "cavity_volume_ml"], strict=True
        )
    ]
    yield from _all(_told(faults, rows["specimen_id"].nunique()), impossible=True)


def _odd_actuators(curves: list[_Curve]) -> Iterator[Doubt]:
    def differences(part: Integers) -> Floats:
        return np.array([[_log_ratio(curves[i], curves[j]) for j in part] for i in part])

    rates = np.array([curve.rate for curve in curves])
    off = _off(rates, differences)
    wrong = np.flatnonzero(off)
    for i in wrong[:1] if len(curves) == 2 else wrong:
        distance = np.abs(rates - rates[i])
        distance[i] = np.inf
        near = np.flatnonzero(distance <= distance.min() + LEVEL)
        near = near[np.argsort(distance[near], kind="stable")][:MOST_COMPARED]
        yield _odd_actuator(curves[i], [curves[j] for j in near], _factor(off[i]))


def _off(rates: Floats, differences: Callable[[Integers], Floats]) -> Floats:
    """Return `off_neighbours`; for many specimens, among those of similar rate."""
    found = np.zeros(len(rates))
    parts = -(-len(rates) // MOST_COMPARED)
    for part in np.array_split(np.argsort(rates, kind="stable"), parts) if parts else ():
        part.sort()
        found[part] = off_neighbours(differences(part), rates[part])
    return found


def _odd_actuator(curve: _Curve, near: list[_Curve], factor: float) -> Doubt:
    """Doubt the column that is unusual: its pressures or its curvatures."""
    pressures = float(np.median([c.pressure[-1] for c in near]))
    of_pressure = float(curve.pressure[-1]) / pressures
    is_of_pressure = abs(np.log(of_pressure)) > np.log(2.0)
    column, units, values, unit = "curvature_per_m", CURVATURE_UNITS, curve.curvature, "1/m"
    ratio = _curvature_ratio
    if is_of_pressure:
        ratio = _pressure_ratio
        column, units, values, unit = "pressure_kPa", PRESSURE_UNITS, curve.pressure, "kPa"
    exact = float(np.median([ratio(curve, other) for other in near]))
    factor = exact if np.isfinite(exact) and exact > 0.0 else factor
    slip = "likely a different unit, a slipped decimal point or a swapped label"
    guess = _likely(factor, units, NEAR_UNIT, otherwise=slip)
    at_same = "for the same curvature" if is_of_pressure else "at the same pressure"
    names = ", ".join(c.name for c in near[:3])
    problem = (
        f"is {_times(factor)} that of the actuators nearest in D_R {at_same} ({names}); {guess}"
    )
    remedy = f"give {unit}; compare with the test record, or leave the specimen out"
    fault = _fault("actuator.csv", curve.name, column, float(values[-1]), problem, remedy)
    return Doubt(fault, bool(abs(np.log(factor)) >= np.log(IMPOSSIBLE_FACTOR)), is_alone=True)


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
        float(np.interp(reached, [0.0, *_rising(c)], [0.0, *c.pressure])) for c in (one, other)
    )
    return first / second if second != 0.0 else float("nan")


def _rising(curve: _Curve) -> Floats:
    """Return the largest curvature up to each pressure."""
    return np.asarray(np.maximum.accumulate(np.maximum(curve.curvature, 0.0)), np.float64)


def _duplicates(actuator: pd.DataFrame) -> Iterator[Doubt]:
    """Doubt curves that equal those of a different specimen to the last digit."""
    seen: dict[tuple[tuple[float, ...], ...], str] = {}
    for name, rows in actuator.groupby("specimen_id", sort=False):
        read = rows[(rows["pressure_kPa"] > 0.0) & rows["curvature_per_m"].notna()]
        curve = (tuple(read["pressure_kPa"]), tuple(read["curvature_per_m"]))
        if len(set(curve[1])) < LEAST_ALIKE:
            continue
        if curve in seen:
            problem = (
                f"and all other curvatures are those of specimen '{seen[curve]}' to the last digit"
            )
            remedy = "one is likely a copy: give the readings of each, or leave one out"
            place = ("actuator.csv", name, "curvature_per_m", float(curve[1][-1]))
            yield Doubt(_fault(*place, problem, remedy), False)
        seen.setdefault(curve, str(name))


def _survivors(actuator: pd.DataFrame) -> Iterator[Doubt]:
    """Doubt that all specimens of the highest degradation rate are listed, if it has fewer."""
    first = actuator.drop_duplicates("specimen_id")
    rate = first["degradation_pct"].to_numpy(np.float64)
    order = np.argsort(rate)
    member = np.empty(len(rate), dtype=np.int64)
    member[order] = np.cumsum(np.diff(rate[order], prepend=rate[order][:1]) > LEVEL)
    counts = np.bincount(member)
    if len(counts) < FEWEST_RATES or not counts[-1] < counts[:-1].min():
        return
    highest = actuator["specimen_id"].isin(first["specimen_id"][member == len(counts) - 1])
    if (actuator.loc[highest, "ruptured"] > 0.5).any():
        return
    problem = (
        f"has only {counts[-1]} of the actuators, every other degradation rate at least "
        f"{counts[:-1].min()}, and none of them burst; are only survivors listed?"
    )
    remedy = "add the rows of those that burst, with ruptured = 1 at the last pressure"
    place = ("actuator.csv", None, "degradation_pct", float(rate.max()))
    yield Doubt(_fault(*place, problem, remedy), False)


def _conditions(actuator: pd.DataFrame) -> Iterator[Doubt]:
    """Doubt curvature without pressure, and a humidity that is a fraction."""
    yield from _at_rest(actuator)
    yield from _absolute(actuator)
    humidity = actuator["humidity_pct"].dropna()
    if len(humidity) and 0.0 < humidity.max() <= 1.0:
        problem = "is the largest humidity of all rows; likely a fraction instead of percent"
        place = ("actuator.csv", None, "humidity_pct", float(humidity.max()))
        yield Doubt(_fault(*place, problem, "give percent: 60, not 0.6"), False)


def _absolute(actuator: pd.DataFrame) -> Iterator[Doubt]:
    """Doubt pressures that begin at ambient pressure with straight actuators."""
    curves = _curves(actuator)
    low, high = AIR_PRESSURE
    begun = [c for c in curves if low <= c.pressure[0] <= high and len(c.pressure) > 1]
    straight = [c for c in begun if c.curvature[0] < LARGEST_SHARE_AT_REST * c.curvature[-1]]
    if curves and len(straight) == len(curves):
        problem = "is the smallest pressure, at which the actuators are still straight; likely the "
        problem += "absolute instead of the gauge pressure"
        place = ("actuator.csv", curves[0].name, "pressure_kPa", float(curves[0].pressure[0]))
        yield Doubt(_fault(*place, problem, "subtract the ambient pressure, about 101 kPa"), False)


def _at_rest(actuator: pd.DataFrame) -> Iterator[Doubt]:
    rows = _first_loading(actuator)
    size = rows["curvature_per_m"].abs()
    largest = size.groupby(rows["specimen_id"]).transform("max")
    at_rest = rows["pressure_kPa"].abs() <= 1e-9
    far = size > np.maximum(LARGEST_AT_REST, LARGEST_SHARE_AT_REST * largest)
    wrong = rows[at_rest & far].drop_duplicates("specimen_id")
    problem = "is the curvature at zero pressure, which must be subtracted from every reading"
    remedy = "subtract it from the curvatures of this specimen, so that the first is 0"
    faults = [
        _fault("actuator.csv", row["specimen_id"], "curvature_per_m", v, problem, remedy)
        for (_, row), v in zip(wrong.iterrows(), wrong["curvature_per_m"], strict=True)
    ]
    yield from _all(_told(faults, rows["specimen_id"].nunique()), impossible=False)


# ---- names


def names_alike(study: Study) -> Iterator[Doubt]:
    """Doubt names of specimens that differ only in capitals, blanks, hyphens or zeros."""
    files = {name: table.file for name, table in TABLES.items()}
    for name in (*TABLES, *study.others):
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


# ---- wording


def _fault(
    file: str, specimen: object, column: str, value: float, problem: str, remedy: str
) -> Fault:
    name = None if specimen is None else str(specimen)
    return Fault(file, problem, remedy, None, column, f"{value:g}", name)


def _all(faults: Iterable[Fault], *, impossible: bool) -> Iterator[Doubt]:
    return (Doubt(fault, impossible) for fault in faults)
