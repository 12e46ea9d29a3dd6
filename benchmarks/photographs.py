"""How well the bottom line is traced on rendered photographs whose truth is known.

    uv run python benchmarks/photographs.py --json

draws 200 photographs by seed, writes each as JPEG in memory, reads and traces it as the command
does, and compares bend angle and curvature with those of the true line by the same operator. Seeds
from 6007 on were never looked at; those below were, while the tracing was written. ``seconds`` is
the median time of reading and tracing a photograph of 12 megapixels.
"""

import argparse
import json
import os
import sys
import time
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import cv2
import numpy as np
from photograph_scenes import SQUARE, Scene, scene

from bayesdeg.errors import BayesdegError
from bayesdeg_camera.tracing.picture import read_picture
from bayesdeg_camera.tracing.trace import PictureScale, Trace, angle_and_length, trace

cv2.setNumThreads(1)

QUALITY = 92  # of JPEG
FIRST = 6007
NORMAL_90 = 1.645
WRONG = 3.0  # stated standard deviations
HINT_ERROR = 0.35  # mm, of a hand
ANGLE_FLOOR = 1.0  # deg: actuators that bend less have no relative error of curvature


def scale_of(one: Scene) -> PictureScale:
    """Return what a person would say of the target."""
    if one.target == "grid":
        return PictureScale(grid=SQUARE)
    if one.target == "ruler":
        return PictureScale(ruler=1.0)
    return PictureScale(length=round(one.length, 1))


def hint_of(one: Scene, seed: int) -> np.ndarray | None:
    """Return six points that a hand would set near the line."""
    if one.method != "hint":
        return None
    at = np.linspace(0, len(one.line_px) - 1, 6).astype(int)
    error = HINT_ERROR * one.image.shape[1] / 115.0
    return np.asarray(
        one.line_px[at] + np.random.default_rng([24, seed]).normal(0.0, error, (6, 2))
    )


def attempt(seed: int, megapixels: int | None) -> dict[str, Any]:
    """Trace one photograph."""
    one = scene(seed, megapixels=megapixels)
    content = cv2.imencode(".jpg", one.image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()
    hint, rng = hint_of(one, seed), np.random.default_rng([25, seed])
    start = time.process_time()
    found: Trace | None = None
    problem = ""
    try:
        image = read_picture("photograph.jpg", content)
        found = trace(image, scale_of(one), rng=rng, hint=hint)
    except BayesdegError as fault:
        problem = str(fault)
    seconds = time.process_time() - start
    angle, length = angle_and_length(one.line)
    record: dict[str, Any] = {
        "seed": seed,
        "target": one.target,
        "method": one.method,
        "background": one.background,
        "megapixels": one.megapixels,
        "seconds": seconds,
        "problem": problem,
        "true_angle": -np.degrees(angle),
        "true_curvature": -1e3 * angle / length,
    }
    if found is not None:
        record |= {
            "angle": found.angle,
            "angle_sd": found.angle_error,
            "curvature": found.curvature,
            "curvature_sd": found.curvature_error,
            "doubts": list(found.doubts),
        }
    return record


def summary(records: list[dict[str, Any]]) -> dict[str, float]:
    """Return the figures of the report."""
    read = [one for one in records if "angle" in one]

    def column(name: str) -> np.ndarray:
        return np.array([one[name] for one in read], dtype=np.float64)

    angle_error = column("angle") - column("true_angle")
    curvature_error = column("curvature") - column("true_curvature")
    bent = np.abs(column("true_angle")) > ANGLE_FLOOR
    relative = 100.0 * np.abs(curvature_error / column("true_curvature"))[bent]
    scores = np.concatenate(
        [angle_error / column("angle_sd"), curvature_error / column("curvature_sd")]
    )
    worst = np.max(np.abs(scores.reshape(2, -1)), axis=0)
    plain = [one for one in records if one["method"] != "markers"]
    large = [one["seconds"] for one in records if one["megapixels"] == 12]
    return {
        "photographs": len(records),
        "angle_median_deg": float(np.median(np.abs(angle_error))),
        "angle_p95_deg": float(np.quantile(np.abs(angle_error), 0.95)),
        "curvature_median_pct": float(np.median(relative)),
        "curvature_p95_pct": float(np.quantile(relative, 0.95)),
        "coverage_90": float(np.mean(np.abs(scores) <= NORMAL_90)),
        "refused": 1.0 - len(read) / len(records),
        "refused_without_marks": float(np.mean(["angle" not in one for one in plain])),
        "silently_wrong": float(np.sum(worst > WRONG)) / len(records),
        "seconds": float(np.median(large)) if large else float("nan"),
    }


def main() -> None:
    """Trace photographs and print how well that went."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=FIRST)
    parser.add_argument("--megapixels", type=int)
    parser.add_argument("--each", action="store_true", help="a line a photograph, as JSON")
    parser.add_argument("--json", action="store_true", help="print nothing but the result")
    given = parser.parse_args()
    records = []
    for seed in range(given.seed, given.seed + given.count):
        records.append(attempt(seed, given.megapixels))
        if given.each:
            sys.stderr.write(json.dumps(records[-1]) + "\n")
    found = summary(records)
    if given.json:
        print(json.dumps(found, indent=1))
    else:
        for name, value in found.items():
            print(f"{name:24s}{value:.3g}")


if __name__ == "__main__":
    main()
