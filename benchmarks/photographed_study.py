"""Whether a pressure offset is found in photographs of actuators.

    uv run python benchmarks/photographed_study.py --json

solves 18 actuators, with 14 kPa that the sensor reads and the chambers do not have, draws a
photograph of every shape with a checkerboard in it (perspective, blur, noise, shadow, glare and
clutter, see `photograph_scenes.py`), and writes a study of nothing but ``photos.csv``, ``photos/``
and films. Beside it is the same study from exact curvatures and angles, ``exact/``. Both are run.
The shapes are kept in ``--shapes``; they are solved on the mesh of the test photographs, which is
not that of the emulator.
"""

import argparse
import json
import tempfile
import tomllib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
from marked_study import READING, solved, verdict
from photograph_scenes import SQUARE, scene
from photograph_shapes import MESH, Shape, side_view

from bayesdeg.laboratory.experiment import Design, tear_films, weigh_shrinkage
from bayesdeg.laboratory.truth import Truth

SEED = 31
MEGAPIXELS, QUALITY = 3, 92
BACKGROUNDS = ("white", "grey", "mat")
SETTINGS = 'title = "Virtual: {name}"\nseed = 7\nvirtual = true\n'


def shapes(seed: int) -> tuple[pd.DataFrame, list[Shape]]:
    """Solve every actuator; return a row a photograph with its true reading, and its shape."""
    rows, found = [], []
    for one in solved(seed, MESH):
        view = side_view(one.mesh, one.nodes)
        found.append(Shape(view.faces, view.line))
        curvature, angle = 1e3 * one.angle / one.length, np.degrees(one.angle)
        rows.append((one.name, one.level, one.pressure, curvature, angle))
    columns = ["specimen_id", "degradation_pct", "pressure_kPa"]
    return pd.DataFrame(rows, columns=[*columns, "curvature_per_m", "bend_angle_deg"]), found


def kept_shapes(path: Path | None, seed: int) -> tuple[pd.DataFrame, list[Shape]]:
    """Return shapes from a file, or solve and keep them."""
    if path is not None and path.exists():
        with np.load(path, allow_pickle=False) as kept:
            table = pd.DataFrame({n: kept[n] for n in kept.files if n not in ("faces", "lines")})
            pairs = zip(kept["faces"], kept["lines"], strict=True)
            return table, [Shape(faces, line) for faces, line in pairs]
    table, found = shapes(seed)
    if path is not None:
        columns: dict[str, Any] = {str(n): np.array(table[n].tolist()) for n in table}
        faces, lines = np.array([s.faces for s in found]), np.array([s.line for s in found])
        np.savez_compressed(path, faces=faces, lines=lines, **columns)
    return table, found


def photographs(folder: Path, table: pd.DataFrame, found: list[Shape], seed: int) -> pd.DataFrame:
    """Draw a photograph of every shape; return the rows of ``photos.csv``."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = []
    for i, (row, shape) in enumerate(zip(table.itertuples(), found, strict=True)):
        one = scene(
            1000 * seed + i,
            megapixels=MEGAPIXELS,
            target="grid",
            method="paper",
            kind=BACKGROUNDS[i % len(BACKGROUNDS)],
            shape=shape,
        )
        name = f"{row.specimen_id}_{row.pressure_kPa:03.0f}.jpg"
        cv2.imwrite(str(folder / name), one.image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        rows.append((name, row.specimen_id, row.degradation_pct, row.pressure_kPa))
    return pd.DataFrame(rows, columns=["file", "specimen_id", "degradation_pct", "pressure_kPa"])


def write_studies(out: Path, table: pd.DataFrame, found: list[Shape], seed: int) -> None:
    """Write both studies, with the same films."""
    truth, generator, design = Truth(), np.random.default_rng([seed, 2]), Design()
    tensile, breaks, _ = tear_films(design, truth, generator)
    shrinkage = weigh_shrinkage(design.shrinkage, truth, generator, design.mixture)
    films = {"tensile.csv": tensile, "break.csv": breaks, "shrinkage.csv": shrinkage}
    photos = photographs(out / "photographed" / "photos", table, found, seed)
    read = ["curvature_per_m", "bend_angle_deg"]
    errors = np.random.default_rng([seed, 1]).standard_normal((len(table), 2)) * READING
    exact = table.assign(
        **dict(zip(read, (table[read] + errors).round(4).to_numpy().T, strict=True))
    )
    for name, file, rows in (
        ("photographed", "photos.csv", photos),
        ("exact", "actuator.csv", exact),
    ):
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        settings = SETTINGS.format(name=name)
        if name == "photographed":
            settings += f'[photographs]\ngrid = {SQUARE}\nbase = "left"\n'
        assert tomllib.loads(settings)
        (folder / "study.toml").write_text(settings, encoding="utf-8")
        for file_name, frame in (films | {file: rows}).items():
            frame.to_csv(folder / file_name, index=False)


def main() -> None:
    """Make the studies, run them, and say what was named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--shapes", type=Path, help="npz file: read if there, else written")
    parser.add_argument("--out", type=Path, help="folder for the studies; else a temporary one")
    parser.add_argument("--effort", default="standard", help="of both runs")
    parser.add_argument("--write", action="store_true", help="write the studies, run nothing")
    asked = parser.parse_args()
    out = asked.out or Path(tempfile.mkdtemp())
    write_studies(out, *kept_shapes(asked.shapes, asked.seed), asked.seed)
    if asked.write:
        return
    results = {name: verdict(out / name, asked.effort) for name in ("photographed", "exact")}
    traces = pd.read_csv(out / "reports" / "photographed" / "traces.csv")
    results["photographed"]["refused"] = int(traces["refused"].notna().sum())
    results["photographed"]["photographs"] = len(traces)
    if asked.json:
        print(json.dumps(results))
    else:
        print(pd.DataFrame(results).T)


if __name__ == "__main__":
    main()
