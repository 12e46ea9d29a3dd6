"""Further experiments that a study could add to: only what it does not have yet."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bayesdeg.criticism.experiments import Experiment
from bayesdeg.criticism.experiments_design import ActuatorDesign, FilmDesign
from bayesdeg.criticism.experiments_measurement import ActuatorTests, FilmTests
from bayesdeg.criticism.experiments_part import (
    GAUGE,
    LENGTH,
    PAPER,
    STRIP,
    WALL,
    WEIGHED,
    PartMeasurements,
    Quantity,
)
from bayesdeg.inference.model import Model

Floats = NDArray[np.float64]

LONG_HOLD = 120.0  # s, of each step
HELD = np.array([0.0, 10.0, 30.0, 60.0, 120.0, 300.0, 900.0, 1800.0])  # s, at one pressure
MOUNTS = {
    "hanging": "hanging, its clamped end up",
    "bending_up": "as a cantilever that bends upwards",
    "bending_down": "as a cantilever that bends downwards",
    "horizontal": "with its bending plane horizontal",
}
MODES = {
    "equibiaxial": "equibiaxial tension",
    "planar": "planar tension",
    "uniaxial": "uniaxial tension",
}
FRESH = 0.5  # %


def candidate_experiments(model: Model) -> tuple[Experiment, ...]:
    """Return the experiments that the tests of a study could be followed by.

    They keep to the pressures, to the degradation rates and to the number of specimens of the
    study. Tests that can be made at any degradation rate are offered at the lowest and at the
    highest; `bayesdeg.criticism.experiments.rank` keeps the better one.

    Parameters
    ----------
    model : Model
        The base model of the study, with its data.

    Returns
    -------
    tuple of Experiment
        Empty if it has neither actuators nor films.
    """
    found: list[Experiment] = []
    if model.actuator is not None:
        design = ActuatorDesign.of(model.actuator)
        for level in dict.fromkeys((design.levels[0], design.levels[-1])):
            found += _histories(design, level)
            found += _finer(design, level)
            found += _of_part(design, level)
        found += _at_levels(design, model)
    if model.tensile is not None:
        found += _modes(FilmDesign.of(model.tensile))
    return tuple(found)


def _histories(design: ActuatorDesign, level: float) -> Iterator[Experiment]:
    """Yield tests at one degradation rate whose load has another course, or another mount."""
    data, rising, where = design.data, design.pressures(level), design.words(level)
    low, top = rising[0], rising[-1]
    steps = np.linspace(0.0, (2 * len(rising) - 1) * design.dwell, 2 * len(rising))
    timed = "" if design.timed else ", times recorded,"
    if not np.any(data.branch == "unloading"):
        falling = rising[-2::-1]
        curves = design.curves(
            [level],
            np.append(rising, falling),
            time=steps[:-1],
            branch=np.repeat(["loading", "unloading"], [len(rising), len(falling)]),
        )
        words = f"unloading branch {top:g} → {low:g} kPa after loading{timed} on {where}"
        yield design.experiment("unloading", words, curves)
    if np.all(data.cycle == 1):
        curves = design.curves(
            [level], np.tile(rising, 2), time=steps, cycle=np.repeat([1, 2], len(rising))
        )
        words = f"a second loading {low:g} → {top:g} kPa after the first{timed} on {where}"
        yield design.experiment("cycle", words, curves)
    if design.dwell < 0.5 * LONG_HOLD:
        time = np.linspace(0.0, (len(rising) - 1) * LONG_HOLD, len(rising))
        curves = design.curves([level], rising, time=time)
        words = f"each pressure step held {LONG_HOLD:g} s before it is read, on {where}"
        yield design.experiment("held steps", words, curves)
    if not design.long_hold:
        middle = float(rising[len(rising) // 2])
        curves = design.curves([level], np.full(len(HELD), middle), time=HELD)
        words = f"{middle:g} kPa held for 30 min and read {len(HELD)} times, on {where}"
        yield design.experiment("hold", words, curves)
    for mount in [m for m in MOUNTS if m not in data.mount]:
        curves = design.curves([level], rising, mount=mount)
        words = f"loading {low:g} → {top:g} kPa, mounted {MOUNTS[mount]}, on {where}"
        yield design.experiment("second mount", words, curves)


def _finer(design: ActuatorDesign, level: float) -> Iterator[Experiment]:
    """Yield tests at one degradation rate that read more."""
    rising, where = design.pressures(level), design.words(level)
    low, top = rising[0], rising[-1]
    if len(rising) > 1:
        between = 0.5 * (rising + np.append(0.0, rising[:-1]))
        finer = np.sort(np.append(rising, between))
        words = f"pressure steps half as large, {finer[0]:g} → {top:g} kPa, on {where}"
        yield design.experiment("finer steps", words, design.curves([level], finer))
    if not design.data.with_angle:
        curves = design.curves([level], rising, angle=True)
        words = f"bend angle read beside curvature, {low:g} → {top:g} kPa, on {where}"
        yield design.experiment("bend angle", words, curves)


def _at_levels(design: ActuatorDesign, model: Model) -> Iterator[Experiment]:
    """Yield tests at another degradation rate, and one more specimen at each."""
    new = design.another_level(model.nodes[-1])
    if new is not None:
        rising = design.pressures(new)
        words = f"loading {rising[0]:g} → {rising[-1]:g} kPa on {design.words(new)}"
        yield design.experiment("another level", words, design.curves([new], rising))
    levels = design.levels
    rising = design.pressures(levels[-1])
    words = f"the same test on {len(levels)} more {'specimens' if levels[1:] else 'specimen'}"
    words += ", one at each degradation rate" if levels[1:] else f" at {levels[0]:g} %"
    curves = design.curves(levels, rising)
    yield Experiment("more specimens", words, len(levels), ActuatorTests(curves, 1))


def _of_part(design: ActuatorDesign, level: float) -> Iterator[Experiment]:
    """Yield direct measurements of the part at one degradation rate."""
    where = design.words(level)
    rising = design.pressures(level)
    gauge = np.unique(rising[[0, len(rising) // 2, -1]])
    measured: list[tuple[str, Quantity, Floats]] = [
        ("length of the part, by calliper", LENGTH, rising[-1:]),
        ("thickness of the roof, cut open under a microscope", WALL, rising[-1:]),
        ("tension of a strip cut from the wall, beside the films'", STRIP, rising[-1:]),
        ("stiffness of a strip of the paper, peeled off the part", PAPER, rising[-1:]),
        ("a second gauge at the far end of the chambers", GAUGE, gauge),
    ]
    if level > FRESH:
        again = "degradation rate of a piece of the actuator itself, weighed"
        measured.append((again, WEIGHED, rising[-1:]))
    for words, quantity, pressure in measured:
        test = PartMeasurements(
            quantity,
            np.array([[level]]),
            np.array([[design.degradation_sd(level)]]),
            pressure[None],
            design.copies,
        )
        yield Experiment(words, f"{words}, on {where}", design.copies, test)


def _modes(films: FilmDesign) -> Iterator[Experiment]:
    """Yield tests of films in modes of tension that there are none of."""
    for mode in [m for m in MODES if m not in films.data.modes]:
        number = f"{films.copies} new films" if films.copies > 1 else "a new film"
        words = f"{MODES[mode]} of {number} at {films.level:g} %"
        test = FilmTests(films.curves(mode), films.copies)
        yield Experiment(mode, words, films.copies, test)
