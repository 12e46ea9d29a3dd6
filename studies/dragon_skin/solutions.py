"""The marker map from finite element solutions, and its accuracy."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dragon_skin.balls import FEET
from dragon_skin.beam import KILOPASCAL, Beam, Divisions, Grip, Load, loads_of
from dragon_skin.causes import HIGHEST, LOWEST, STEEPEST
from dragon_skin.marker_map import MarkerMap, chebyshev_points
from dragon_skin.published import COMSOL, COMSOL_MODULUS
from dragon_skin.record import GRAVITY, LENGTH

Floats = NDArray[np.float64]

RANGE = (LOWEST, HIGHEST)  # C1 [kPa]
PITCHES = np.array([-STEEPEST, 0.0, STEEPEST])
LONGER = 2.0  # for the slope with free length [mm]
#: Grips whose resultants are this far from that of the upper face: inwards, and down the face.
SHIFTS: dict[str, tuple[Grip, float]] = {
    "load_point": ("top", 4.0),  # [mm]
    "load_depth": ("face", 13.0),  # [mm]
    "edge_line": ("edge", 1.0),  # share of the weight
}


def build_map(divisions: Divisions, points: int) -> MarkerMap:
    """Solve the beam over C1, load cases, pitch and free length, with slopes in the rest.

    Parameters
    ----------
    divisions : tuple of int
        Bricks along, across and up.
    points : int
        Values of C1.
    """
    log_c1 = chebyshev_points(np.log(RANGE[0]), np.log(RANGE[1]), points)
    beam = Beam(divisions)
    solved = [[_cases(beam, c1, pitch) for pitch in PITCHES] for c1 in np.exp(log_c1)]
    slopes = _slopes(beam, log_c1)
    beam.close()
    slopes["clamp_position"] = _length_slope(divisions, log_c1)
    ball, turn, moment = (
        np.array([[[case[i] for case in cases] for cases in row] for row in solved])
        for i in range(3)
    )
    return MarkerMap(log_c1, PITCHES, ball, turn, moment, slopes)


def direct(
    beam: Beam, load: Load, grip: Grip = "upper_face", share: float = 1.0
) -> tuple[Floats, Floats, float]:
    """Return balls (3, 3), turns (3, 3) and the clamp's moment of one solution.

    ``share`` of the weight acts on the grip, the rest on the upper face.
    """
    state = beam.solve(load, grip, share)
    return *beam.balls(state.displacement), beam.clamp_moment(load, state)


def check_map(forward: MarkerMap, divisions: Divisions, generator: np.random.Generator) -> Any:
    """Compare the map with direct solutions at random points, E from 200 to 350 kPa, within ±8°.

    Returns
    -------
    dict of float
        Largest distance of a ball by kind of check [mm].
    """
    c1 = np.exp(generator.uniform(np.log(200.0 / 6.0), np.log(350.0 / 6.0), 2))
    tilt = generator.uniform(-8.0, 8.0, 2)
    beam = Beam(divisions)

    def gap(effects: dict[str, float], load: Callable[[float, float, float], Load]) -> float:
        worst = 0.0
        for value, pitch in zip(c1, tilt, strict=True):
            sizes = {name: np.array([size]) for name, size in effects.items()}
            balls, _, _ = forward.at(np.array([value]), np.array([pitch]), sizes)
            exact = [direct(beam, load(value, p.force, pitch))[0] for p in loads_of(1.0)]
            worst = max(worst, float(np.linalg.norm(balls[0] - exact, axis=-1).max()))
        return worst

    gaps = {"C1 and pitch": gap({}, Load)}
    gaps["weight 2 mm inwards"] = _between(beam, forward, c1, "load_point", 2.0)
    gaps["weight 5 mm down the face"] = _between(beam, forward, c1, "load_depth", 5.0)
    gaps["half the weight as a line on the edge"] = _between(beam, forward, c1, "edge_line", 0.5)
    gaps["C2/C1 = 0.1"] = gap({"hardening": 0.1}, lambda c, f, p: Load(c, f, p, hardening=0.1))
    extra = 3.0 * GRAVITY * 1e-3
    gaps["3 g of markers"] = gap({"marker_mass": 3.0}, lambda c, f, p: Load(c, f + extra, p))
    beam.close()
    return gaps


def converge(meshes: list[Divisions], c1: float) -> list[dict[str, Any]]:
    """Return the balls by mesh at one C1 [kPa], and how far they are from the finest mesh's."""
    rows: list[dict[str, Any]] = []
    for divisions in meshes:
        beam = Beam(divisions)
        balls = np.array([direct(beam, load)[0] for load in loads_of(c1)])
        rows.append({"divisions": list(divisions), "unknowns": beam.unknowns, "balls_mm": balls})
        beam.close()
    finest = rows[-1]["balls_mm"]
    for row in rows:
        away = np.linalg.norm(row["balls_mm"] - finest, axis=-1)
        row["from_finest_mm"] = away.max(axis=1).tolist()
        row["sag_mm"] = (36.0 - row.pop("balls_mm")[:, 0, 2]).tolist()
    return rows


def against_comsol(divisions: Divisions) -> dict[str, Any]:
    """Compare surface points with the source's own COMSOL solutions at its modulus.

    The source states neither law nor mesh; its line load stands on the edge itself.
    """
    beam = Beam(divisions)
    ours = np.array(
        [
            FEET + beam.field_at(beam.solve(load, "edge", 1.0).displacement, FEET)
            for load in loads_of(COMSOL_MODULUS / 6.0)
        ]
    )
    beam.close()
    sag = FEET[:, 2] - ours[..., 2]
    theirs = FEET[:, 2] - COMSOL[..., 2]
    return {
        "largest_distance_mm": np.linalg.norm(ours - COMSOL, axis=-1).max(axis=1).tolist(),
        "sag_mm": sag.tolist(),
        "comsol_sag_mm": theirs.tolist(),
        "sag_ratio": (sag / theirs).mean(axis=1).tolist(),
    }


def _between(beam: Beam, forward: MarkerMap, c1: Floats, name: str, size: float) -> float:
    """Largest distance of the map's balls from those of a weight shared between two grips."""
    grip, shift = SHIFTS[name]
    share, worst = size / shift, 0.0
    for value in c1:
        balls, _, _ = forward.at(np.array([value]), np.zeros(1), {name: np.array([size])})
        exact = [direct(beam, load, grip, share)[0] for load in loads_of(float(value))]
        worst = max(worst, float(np.linalg.norm(balls[0] - exact, axis=-1).max()))
    return worst


def _cases(beam: Beam, c1: float, pitch: float) -> list[tuple[Floats, Floats, float]]:
    return [direct(beam, load) for load in loads_of(c1, pitch)]


def _slopes(beam: Beam, log_c1: Floats) -> dict[str, Floats]:
    """Return derivatives with the effects that are forces, by the tangent at each solution."""
    names = [*SHIFTS, "marker_mass", "hardening"]
    slopes: dict[str, list[list[Floats]]] = {name: [] for name in names}
    for c1 in np.exp(log_c1):
        cases = [_responses(beam, load) for load in loads_of(float(c1))]
        for i, name in enumerate(names):
            slopes[name].append([case[i] for case in cases])
    return {name: np.array(rows) for name, rows in slopes.items()}


def _responses(beam: Beam, load: Load) -> list[Floats]:
    state, stress = beam.solve(load), load.c1 * KILOPASCAL
    usual = beam.unit_force(load, "upper_face")
    forces = [
        load.force / stress * (beam.unit_force(load, grip) - usual) / shift
        for grip, shift in SHIFTS.values()
    ]
    forces.append(usual * GRAVITY * 1e-3 / stress)  # per gram
    forces.append(beam.hardening_force(load, state))
    here = np.concatenate(beam.balls(state.displacement), axis=1)
    found = []
    for response in beam.responses(load, state, forces):
        # a step small enough that the carried balls move in proportion
        step = 1e-3 / max(float(np.abs(response).max()), 1e-12)
        there = np.concatenate(beam.balls(state.displacement + step * response), axis=1)
        found.append((there - here) / step)
    return found


def _length_slope(divisions: Divisions, log_c1: Floats) -> Floats:
    fields = []
    for length in (LENGTH + LONGER, LENGTH - LONGER):
        beam = Beam(divisions, length)
        fields.append(
            [
                [np.concatenate(case[:2], axis=1) for case in _cases(beam, float(c1), 0.0)]
                for c1 in np.exp(log_c1)
            ]
        )
        beam.close()
    slope: Floats = (np.array(fields[0]) - np.array(fields[1])) / (2.0 * LONGER)
    return slope
