"""Test photographs of bent actuators, rendered from finite element shapes.

    uv run python benchmarks/photograph_scenes.py --count 12 --seed 1 --out /tmp/photographs

writes JPEG files and ``truth.json`` with the edge of gel and paper in mm. A scene is drawn in the
plane of the actuator's side, in mm, and seen by a tilted pinhole camera; then come shadow, glare,
uneven light, blur, noise of the sensor and compression. A target lies in the same plane: a
checkerboard, a ruler, or none, where the length of the paper is known instead.
"""

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from photograph_shapes import Shape, shapes

Floats = NDArray[np.float64]
Image = NDArray[np.float32]

BACKGROUNDS = ("white", "grey", "black", "mat", "wood")
TARGETS = ("grid", "ruler", "length")
LINES = ("paper", "markers", "hint")
LONG_SIDE = {3: 2048, 5: 2592, 12: 4032}  # pixels, by megapixels
SHIFT = 6  # bits of a fraction of a pixel
TILT = {"grid": 12.0, "ruler": 2.5, "length": 2.5}
"""Largest tilt of the camera [deg]: without a plane target it is held square by eye."""
SQUARE = 5.0  # mm, of the checkerboard


@dataclass(frozen=True)
class Scene:
    """A photograph and what is known of it.

    Parameters
    ----------
    image : array of uint8, shape (rows, columns, 3)
        Blue, green, red.
    line : array, shape (m, 2)
        True edge of gel and paper, from the clamp [mm].
    dots : array, shape (k, 2)
        True centres of the marks on the line, where there are marks [mm].
    line_px : array, shape (m, 2)
        Where the edge is in the photograph [px].
    target, method, background : str
        What gives the scale, how the line is to be found, what lies behind.
    megapixels : int
    """

    image: NDArray[np.uint8]
    line: Floats
    dots: Floats
    line_px: Floats
    target: str
    method: str
    background: str
    megapixels: int

    @property
    def length(self) -> float:
        """Length of the edge, which paper keeps [mm]."""
        return float(np.sum(np.hypot(*np.diff(self.line, axis=0).T)))


def camera(rng: np.random.Generator, size: tuple[int, int], tilt: float) -> Floats:
    """Return the homography from the plane [mm] to the photograph [px]."""
    width, height = size
    distance, view = rng.uniform(250.0, 450.0), rng.uniform(105.0, 130.0)
    focal = width * distance / view
    about = np.radians(rng.uniform(-tilt, tilt, 2))
    turn = np.radians(rng.uniform(-8.0, 8.0))
    (sx, sy, st), (cx, cy, ct) = np.sin([*about, turn]), np.cos([*about, turn])
    rotation = (
        np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        @ np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        @ np.array([[ct, -st, 0], [st, ct, 0], [0, 0, 1]])
    )
    flip = np.diag([1.0, -1.0, 1.0])  # rows of a photograph count downwards
    pose = np.column_stack([(rotation @ flip)[:, :2], [*rng.uniform(-4.0, 4.0, 2), distance]])
    inner = np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]])
    return np.asarray(inner @ pose, dtype=np.float64)


def seen(points: Floats, homography: Floats) -> Floats:
    """Map points of the plane into the photograph."""
    flat = np.column_stack([points.reshape(-1, 2), np.ones(points.size // 2)]) @ homography.T
    return np.asarray((flat[:, :2] / flat[:, 2:]).reshape(points.shape))


class Canvas:
    """A photograph in the making; linear light is not modelled."""

    def __init__(self, size: tuple[int, int], homography: Floats, colour: Floats) -> None:
        self.width, self.height = size
        self.homography = homography
        self.image: Image = np.empty((self.height, self.width, 3), dtype=np.float32)
        self.image[:] = colour

    def paint(
        self, polygons: list[Floats], colour: Floats, *, opacity: float = 1.0, soft: float = 0.0
    ) -> None:
        """Fill polygons of the plane; ``soft`` is the blur of their edges [px]."""
        found = self.cover(polygons, soft)
        if found is None:
            return
        (rows, columns), alpha = found
        part = self.image[rows, columns]
        part += (opacity * alpha)[..., None] * (np.float32(colour) - part)

    def cover(
        self, polygons: list[Floats], soft: float = 0.0
    ) -> tuple[tuple[slice, slice], Image] | None:
        """Return the window of polygons and the share of every pixel that they cover."""
        placed = [seen(one, self.homography) for one in polygons]
        every = np.concatenate(placed)
        room = 2 + int(3 * soft)
        low = np.maximum(np.floor(every.min(axis=0)).astype(int) - room, 0)
        high = np.minimum(np.ceil(every.max(axis=0)).astype(int) + room, [self.width, self.height])
        if np.any(high <= low):
            return None
        columns, rows = high - low
        fine = np.zeros((2 * rows, 2 * columns), dtype=np.uint8)
        for one in placed:
            # pixel centres are whole numbers in the photograph
            corners = np.round((2.0 * (one - low) + 0.5) * 2**SHIFT).astype(np.int32)
            cv2.fillPoly(fine, [corners], 255, lineType=cv2.LINE_AA, shift=SHIFT)
        alpha = cv2.resize(fine, (columns, rows), interpolation=cv2.INTER_AREA)
        alpha = alpha.astype(np.float32) / np.float32(255.0)
        if soft:
            alpha = cv2.GaussianBlur(alpha, (0, 0), soft)
        return (slice(low[1], high[1]), slice(low[0], high[0])), alpha


def clouds(rng: np.random.Generator, size: tuple[int, int], cells: int) -> Image:
    """Return smooth random numbers of unit size over a photograph."""
    rows = max(2, cells * size[1] // size[0])
    coarse = rng.normal(size=(rows, cells)).astype(np.float32)
    return np.asarray(cv2.resize(coarse, size, interpolation=cv2.INTER_CUBIC))


def rectangle(x: float, y: float, width: float, height: float, turn: float = 0.0) -> Floats:
    """Return the corners of a rectangle about its centre."""
    c, s = np.cos(turn), np.sin(turn)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [width / 2, height / 2]
    return np.asarray(corners @ np.array([[c, s], [-s, c]]) + [x, y])


def disc(centre: Floats, radius: float) -> Floats:
    """Return a circle as a polygon."""
    at = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)
    return np.asarray(centre + radius * np.column_stack([np.cos(at), np.sin(at)]))


def background(rng: np.random.Generator, canvas: Canvas, kind: str) -> None:
    """Lay what is behind the actuator."""
    size = (canvas.width, canvas.height)
    if kind == "wood":
        grain = np.float32(rng.normal(size=(size[1] // 24 + 2, 4)))
        lines = cv2.resize(grain, size, interpolation=cv2.INTER_CUBIC)
        canvas.image += 7.0 * lines[..., None] + 3.0 * clouds(rng, size, 40)[..., None]
    else:
        canvas.image += 1.5 * clouds(rng, size, 60)[..., None]
    if kind == "mat":
        for at in np.arange(-80.0, 81.0, 10.0):
            lines_of = [rectangle(at, 0.0, 0.25, 160.0), rectangle(0.0, at, 160.0, 0.25)]
            canvas.paint(lines_of, np.array([150.0, 190.0, 160.0]), opacity=0.6)


def behind(rng: np.random.Generator, kind: str) -> Floats:
    """Return the colour of a background (blue, green, red)."""
    grey = {"white": 225.0, "grey": 140.0, "black": 35.0}
    if kind in grey:
        return np.full(3, grey[kind]) + rng.normal(0.0, 5.0, 3)
    return np.array([90.0, 110.0, 50.0] if kind == "mat" else [110.0, 150.0, 185.0]) + rng.normal(
        0.0, 5.0, 3
    )


def checkerboard(canvas: Canvas, corner: Floats, columns: int, rows: int) -> None:
    """Lay a printed checkerboard with a white rim; ``corner`` is its lower left."""
    size = np.array([columns, rows]) * SQUARE
    middle = corner + size / 2
    wide, high = size + 2 * SQUARE
    canvas.paint([rectangle(middle[0], middle[1], wide, high)], np.full(3, 235.0))
    dark = [
        rectangle(corner[0] + SQUARE * (i + 0.5), corner[1] + SQUARE * (j + 0.5), SQUARE, SQUARE)
        for i in range(columns)
        for j in range(rows)
        if (i + j) % 2 == 0
    ]
    canvas.paint(dark, np.full(3, 30.0))


def ruler(canvas: Canvas, start: Floats, length: int) -> None:
    """Lay a ruler with a tick every millimetre, longer at 5 and at 10."""
    middle = start + np.array([length / 2, -4.0])
    canvas.paint(
        [rectangle(middle[0], middle[1], length + 6.0, 12.0)], np.array([205.0, 225.0, 228.0])
    )
    ticks = []
    for i in range(length + 1):
        long = 6.0 if i % 10 == 0 else 4.5 if i % 5 == 0 else 3.0
        ticks.append(rectangle(start[0] + i, start[1] + 1.5 - long / 2, 0.18, long))
    canvas.paint(ticks, np.full(3, 25.0))


def clutter(rng: np.random.Generator, canvas: Canvas, keep: Floats) -> None:
    """Strew small objects where they do not touch what is needed (boxes, shape (n, 4))."""
    for _ in range(int(rng.integers(2, 6))):
        for _attempt in range(20):
            at, reach = rng.uniform([-58.0, -42.0], [58.0, 42.0]), rng.uniform(2.0, 9.0)
            if np.all(
                (at[0] + reach < keep[:, 0])
                | (at[0] - reach > keep[:, 2])
                | (at[1] + reach < keep[:, 1])
                | (at[1] - reach > keep[:, 3])
            ):
                colour = rng.uniform(10.0, 245.0, 3)
                if rng.random() < 0.5:
                    canvas.paint([disc(at, 0.8 * reach)], colour, soft=0.7)
                else:
                    long = rectangle(at[0], at[1], 1.6 * reach, 0.5 * reach, rng.uniform(0, np.pi))
                    canvas.paint([long], colour, soft=0.7)
                break


def drawn_shape(rng: np.random.Generator) -> Shape:
    """Draw a shape: a material, and a pressure between two that were solved."""
    curve = shapes()[int(rng.random() < 0.4)]
    at = rng.uniform(0.5, len(curve) - 2.0)
    low = int(at)
    return curve[low].mixed(curve[low + 1], at - low)


def offset(line: Floats, distance: float) -> Floats:
    """Move a line to its right, away from the gel."""
    along = np.gradient(line, axis=0)
    along /= np.hypot(*along.T)[:, None]
    return np.asarray(line + distance * np.column_stack([along[:, 1], -along[:, 0]]))


def marks_on(line: Floats) -> Floats:
    """Return centres of marks: two on each stiff end, and others between."""
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    wanted = np.concatenate(
        [[0.5, 2.1], np.linspace(4.5, arc[-1] - 4.5, 10), arc[-1] - np.array([2.1, 0.5])]
    )
    return np.column_stack([np.interp(wanted, arc, axis) for axis in line.T])


def actuator(
    rng: np.random.Generator, canvas: Canvas, shape: Shape, shift: Floats, *, marked: bool
) -> None:
    """Draw clamp, gel and paper, with shading and glare on the gel."""
    faces, line = [face + shift for face in shape.faces], shape.line + shift
    scale = canvas.width / 115.0  # pixels in a millimetre, nearly
    shadow = rng.uniform([-2.5, -3.5], [2.5, 0.5])
    canvas.paint(
        [f + shadow for f in faces],
        np.zeros(3),
        opacity=rng.uniform(0.1, 0.45),
        soft=scale * rng.uniform(0.5, 1.5),
    )
    thickness = rng.uniform(0.1, 0.25)
    canvas.paint(
        [np.concatenate([line, offset(line, thickness)[::-1]])], rng.uniform(215.0, 250.0, 3)
    )
    amber = np.array([30.0, 105.0, 190.0]) + rng.normal(0.0, 12.0, 3)
    found = canvas.cover(faces)
    assert found is not None
    (rows, columns), alpha = found
    shading = 6.0 * clouds(rng, (alpha.shape[1], alpha.shape[0]), 12)
    part = canvas.image[rows, columns]
    part += alpha[..., None] * (np.float32(amber) + shading[..., None] - part)
    for _ in range(int(rng.integers(0, 5))):
        spot = faces[int(rng.integers(len(faces)))].mean(axis=0)
        if np.min(np.hypot(*(line - spot).T)) > 1.2 or rng.random() < 0.3:
            canvas.paint(
                [disc(spot, rng.uniform(0.2, 0.8))],
                np.full(3, 250.0),
                opacity=rng.uniform(0.4, 0.9),
                soft=0.15 * scale,
            )
    metal = rng.uniform(60.0, 130.0) + rng.normal(0.0, 4.0, 3)
    canvas.paint([rectangle(shift[0] - 7.0, shift[1] + 4.0, 14.0, 20.0)], metal)
    canvas.paint([rectangle(shift[0] - 20.0, shift[1] + 4.0, 14.0, 3.0)], np.full(3, 215.0))
    if marked:
        ink = (np.array([25.0, 25.0, 25.0]), np.array([170.0, 60.0, 20.0]))[int(rng.integers(2))]
        canvas.paint([disc(dot, 0.45) for dot in marks_on(line)], ink)


def finished(rng: np.random.Generator, canvas: Canvas) -> NDArray[np.uint8]:
    """Apply uneven light, blur and noise of the sensor."""
    size = (canvas.width, canvas.height)
    x, y = np.meshgrid(
        np.linspace(-1, 1, size[0], dtype=np.float32), np.linspace(-1, 1, size[1], dtype=np.float32)
    )
    gx, gy = rng.uniform(-0.12, 0.12, 2)
    fall = rng.uniform(0.0, 0.12)
    light = np.float32(1.0) + np.float32(gx) * x + np.float32(gy) * y
    light -= np.float32(fall) * (x * x + y * y)
    image = canvas.image * light[..., None] * np.float32(rng.uniform(0.85, 1.08))
    image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.6, 1.6) * size[0] / 3000.0)
    noise = np.float32(rng.uniform(1.0, 5.0))
    image += noise * rng.standard_normal(image.shape, dtype=np.float32)
    return np.asarray(np.clip(image, 0.0, 255.0).astype(np.uint8))


def scene(
    seed: int,
    *,
    megapixels: int | None = None,
    target: str | None = None,
    method: str | None = None,
    kind: str | None = None,
    shape: Shape | None = None,
) -> Scene:
    """Draw a photograph; what is not given is drawn by the seed."""
    rng = np.random.default_rng([23, seed])
    drawn = drawn_shape(rng)
    shape = shape or drawn
    # each is drawn, so that what is given changes no later draw
    drawn_target = str(rng.choice(TARGETS, p=[0.5, 0.2, 0.3]))
    drawn_method = str(rng.choice(LINES, p=[0.6, 0.2, 0.2]))
    drawn_kind = str(rng.choice(BACKGROUNDS))
    drawn_megapixels = int(rng.choice([3, 5, 12], p=[0.6, 0.25, 0.15]))
    target, method = target or drawn_target, method or drawn_method
    kind, megapixels = kind or drawn_kind, megapixels or drawn_megapixels
    width = LONG_SIDE[megapixels]
    size = (width, 3 * width // 4)
    homography = camera(rng, size, TILT[target])
    canvas = Canvas(size, homography, behind(rng, kind))
    background(rng, canvas, kind)
    shift = rng.uniform([-28.0, 10.0], [-16.0, 20.0])
    line = shape.line + shift
    keep = [[line[0, 0] - 26, line[:, 1].min() - 5, line[:, 0].max() + 12, shift[1] + 24]]
    if target == "grid":
        # under the clamp, where no actuator bends to
        corner = np.array([-50.0, -35.0]) + rng.uniform(-2.0, 2.0, 2)
        checkerboard(canvas, corner, 7, 5)
        keep.append([*(corner - 6), *(corner + SQUARE * np.array([7, 5]) + 6)])
    elif target == "ruler":
        start = np.array([-45.0, -31.0]) + rng.uniform(-2.0, 2.0, 2)
        ruler(canvas, start, 80)
        keep.append([start[0] - 4, start[1] - 12, start[0] + 84, start[1] + 4])
    clutter(rng, canvas, np.array(keep))
    actuator(rng, canvas, shape, shift, marked=method == "markers")
    dots = marks_on(line) if method == "markers" else np.empty((0, 2))
    return Scene(
        finished(rng, canvas), line, dots, seen(line, homography), target, method, kind, megapixels
    )


def main() -> None:
    """Write some photographs."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--megapixels", type=int, choices=tuple(LONG_SIDE))
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    truth = {}
    for seed in range(given.seed, given.seed + given.count):
        one = scene(seed, megapixels=given.megapixels)
        name = f"{seed:04d}.jpg"
        cv2.imwrite(str(given.out / name), one.image, [cv2.IMWRITE_JPEG_QUALITY, 92])
        truth[name] = {
            "line_mm": one.line.tolist(),
            "target": one.target,
            "method": one.method,
            "background": one.background,
        }
    (given.out / "truth.json").write_text(json.dumps(truth), encoding="utf-8")


if __name__ == "__main__":
    main()
