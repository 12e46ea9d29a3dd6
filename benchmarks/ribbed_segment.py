"""A ribbed segment solved by finite elements against the one that was measured.

The segment is that of Marchese, Katzschmann and Rus (doi:10.1089/soro.2014.0022), of Ecoflex 00-30;
pressures and curvatures below are numbers stated by the authors. Its cover over the slits is not
stated, so that several are tried; the constants are those of one uniaxial pull of the silicone to a
stretch of 5. It is a comparison, no calibration.

    uv run python benchmarks/ribbed_segment.py --covers 5 5.65 6
"""

import argparse

import numpy as np

from bayesdeg.actuator.curve import ExactMap
from bayesdeg.actuator.families import geometry_of
from bayesdeg.actuator.inputs import Inputs
from bayesdeg.actuator.status import Resolution
from bayesdeg.data.families import Constraint, RibbedDimensions

CONSTANTS = (8.0e-3, 8.1e-5, 1e-9)  # MPa
FILM = 3e5  # N/m, a film of 0.1 mm that does not stretch
MESH = Resolution(along=2.0, across=6.0, up=3.2)
READ = ((0.0, 0.0), (3.49, 0.468), (7.5, 1.024), (11.25, 1.661), (14.35, 2.46), (16.68, 3.6))
PRESSURES = np.array([5.0, 10.0, 15.0])  # kPa


def curvatures(cover: float, stiffness: float) -> np.ndarray:
    """Return curvatures at ``PRESSURES``, of a material so many times as stiff [1/m]."""
    one = np.ones((1, 1))
    segment = geometry_of(RibbedDimensions(cover=cover), Constraint("film"))
    c1, c2, c3 = (stiffness * value * one for value in CONSTANTS)
    inputs = Inputs(PRESSURES[None], c1, c2, c3, one, FILM * one)
    return np.asarray(ExactMap(segment, MESH)(inputs).curvature[0], dtype=np.float64)


def main() -> None:
    """Print a line for each cover and stiffness."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--covers", type=float, nargs="+", default=[5.65])
    parser.add_argument("--stiffness", type=float, nargs="+", default=[1.0, 1.2])
    asked = parser.parse_args()
    pressure, curvature = np.array(READ).T
    print("kPa", PRESSURES, "read", np.interp(PRESSURES, pressure, curvature).round(2))
    for cover in asked.covers:
        for stiffness in asked.stiffness:
            found = curvatures(cover, stiffness).round(2)
            print(f"cover {cover:g} mm, {stiffness:g} times as stiff:", found, flush=True)


if __name__ == "__main__":
    main()
