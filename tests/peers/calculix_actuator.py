"""The same body in CalculiX: an input deck of full eight-node bricks, run by ``ccx``.

CalculiX has no brick with a pressure field of its own; its C3D8 with eight Gauss points is our
``LINEAR_FULL``. Its volumetric energy is (J − 1)²/D1, so D1 = 2/K. Paper is left out: membranes
become solids there.
"""

import os
import shutil
import subprocess
import time
from pathlib import Path

import numpy as np
from skfem import ElementHex1

from bayesdeg.actuator.body import LINEAR_FULL
from tests.peers.peer_path import PeerPath, refuse_special

# corners of C3D8 on the unit cube, and its faces in the order of their labels P1 … P6
CORNERS = np.array(
    [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]]
)
FACES = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))

# residual over mean force, and correction over increment of the displacement
TIGHT = "1e-6, 1e-5"
# iterations before CalculiX gives up or cuts: without the stiffness of the follower pressure,
# which its static steps leave out, they converge linearly
PATIENT = ("100, 400, 100, 400, 100, 4, , 10", "0.25, 0.5, 0.75, 0.85, , , 1.5")
# stress units in C1, since residuals below 1e-6 count as none
STRESS = 1e6


def program():
    """Return the path of ``ccx``, or None."""
    return shutil.which("ccx")


def solve(body, material, *, loads, folder):
    """Return the equilibria of a body at rising cavity pressures, in units of C1.

    Every load is one static step with large displacements, cut by CalculiX where it must; the
    deck and what ``ccx`` writes stay in ``folder``.
    """
    refuse_special(material)
    if material.paper_group > 0.0:
        raise ValueError("CalculiX has no membrane of zero thickness: set paper_group=0")
    if body.element is not LINEAR_FULL:
        raise ValueError(f"CalculiX has no {body.element.name}")
    cells = body.elements[:, _places()]
    Path(folder, "actuator.inp").write_text(deck(body, cells, material, loads=loads))
    start = time.perf_counter()
    done = subprocess.run(
        [program(), "-i", "actuator"],
        cwd=folder,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    seconds = time.perf_counter() - start
    if done.returncode or "*ERROR" in done.stdout or "Job finished" not in done.stdout:
        raise RuntimeError(f"ccx failed:\n{done.stdout[-2000:]}")
    displacements = _read(Path(folder, "actuator.dat").read_text(), len(body.nodes), len(loads))
    return PeerPath(displacements, _iterations(Path(folder, "actuator.cvg")), 0.0, seconds)


def deck(body, cells, material, *, loads):
    """Return the input deck: nodes and bricks numbered from 1."""
    ratios = (1.0, material.c2_ratio, material.c3_ratio)
    compliance = 2.0 / (STRESS * material.bulk_ratio)
    # (J − 1)⁴/D2 + (J − 1)⁶/D3 is added: infinity takes it out, zero does not
    law = (*(STRESS * c for c in ratios), compliance, 1e30, 1e30)
    held = np.argwhere(body.fixed) + 1
    return "\n".join(
        [
            "*NODE, NSET=ALL",
            *(f"{i}, {x!r}, {y!r}, {z!r}" for i, (x, y, z) in enumerate(body.nodes.tolist(), 1)),
            "*ELEMENT, TYPE=C3D8, ELSET=SOLID",
            *(", ".join(map(str, row)) for row in _numbered(cells)),
            "*BOUNDARY",
            *(f"{node}, {axis}" for node, axis in held.tolist()),
            "*MATERIAL, NAME=RUBBER",
            "*HYPERELASTIC, YEOH",
            ", ".join(f"{float(value)!r}" for value in law),
            "*SOLID SECTION, ELSET=SOLID, MATERIAL=RUBBER",
            *(line for load in loads for line in _step(cells, body.cavity, float(load))),
            "",
        ]
    )


def _numbered(cells):
    return [(i, *(row + 1).tolist()) for i, row in enumerate(cells, 1)]


def _step(cells, cavity, load):
    return [
        "*STEP, NLGEOM, INC=1000",
        "*STATIC",
        "1., 1., 1e-6, 1.",
        "*CONTROLS, PARAMETERS=FIELD",
        TIGHT,
        "*CONTROLS, PARAMETERS=TIME INCREMENTATION",
        *PATIENT,
        "*DLOAD",
        *(f"{cell}, P{label}, {STRESS * load!r}" for cell, label in labels(cells, cavity)),
        "*NODE PRINT, NSET=ALL, FREQUENCY=1000",
        "U",
        "*END STEP",
    ]


def labels(cells, faces):
    """Return brick and label, from 1, of faces given by their nodes."""
    there = {
        frozenset(row[list(corners)].tolist()): (cell, label)
        for cell, row in enumerate(cells, 1)
        for label, corners in enumerate(FACES, 1)
    }
    return [there[frozenset(face)] for face in faces.tolist()]


def _places():
    places = np.asarray(ElementHex1().doflocs)
    return [int(np.flatnonzero(np.all(places == corner, axis=1))[0]) for corner in CORNERS]


def _read(text, n_nodes, n_loads):
    """Displacements at the end of every step: one table a step."""
    rows = [line.split() for line in text.splitlines()]
    values = np.array([row[1:4] for row in rows if len(row) == 4 and row[0].isdigit()], dtype=float)
    return values.reshape(n_loads, n_nodes, 3)


def _iterations(path):
    rows = [line.split() for line in path.read_text().splitlines()]
    return sum(1 for row in rows if row and row[0].isdigit())
