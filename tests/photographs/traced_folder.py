"""A folder as ``bayesdeg trace`` leaves it, of photographs that are not traced but made up."""

import io
import threading
from contextlib import contextmanager

import numpy as np
from PIL import Image

from bayesdeg.data.photographs import TracedPhotograph
from bayesdeg_camera.folder import read_traces, write_traces
from bayesdeg_camera.page import Correction, TraceServer
from bayesdeg_camera.tracing.plane import mapped
from bayesdeg_camera.tracing.record import hash_of
from bayesdeg_camera.tracing.trace import into_frame

WIDTH, HEIGHT, COUNT = 640, 480, 30
SCALE = 0.1  # mm/px


def line(bend=0.5):
    """Return a circular arc that bends downwards by an angle [px]."""
    at = np.linspace(0.0, bend, COUNT)
    radius = 400.0 / bend
    return np.column_stack([100 + radius * np.sin(at), 200 + radius * (1.0 - np.cos(at))])


def photograph(name, content, bend=0.5):
    pixels = line(bend).round(3)
    upright = np.diag([SCALE, -SCALE, 1.0])
    motion = into_frame(mapped(upright, pixels)) @ upright
    points = mapped(motion, pixels)
    return TracedPhotograph(
        file=name,
        place=f"../{name}",
        sha256=hash_of(content),
        specimen_id=name.partition(".")[0],
        pressure=100.0,
        degradation=0.0,
        width=WIDTH,
        height=HEIGHT,
        pixels=pixels.tolist(),
        points=points.tolist(),
        errors=np.full((COUNT, 2), 0.01).tolist(),
        seen=[True] * (COUNT - 1) + [False],
        to_mm=motion.tolist(),
        bend_angle_deg=float(np.degrees(bend)),
        curvature_per_m=1e3 * bend / 40.0,
        length_mm=40.0,
        scale_from="grid",
    )


def traced_folder(path, names=("one.png", "two.png")):
    """Write photographs, and beside them a folder with what was traced of them."""
    path.mkdir(parents=True, exist_ok=True)
    found = []
    for i, name in enumerate(names):
        content = io.BytesIO()
        shade = np.linspace(60, 200, WIDTH)[None, :, None] * np.ones((HEIGHT, 1, 3))
        Image.fromarray((shade + 20 * i).astype(np.uint8)).save(content, "PNG")
        (path / name).write_bytes(content.getvalue())
        found.append(photograph(name, content.getvalue(), 0.5 + 0.2 * i))
    write_traces(path / "traced", found)
    return path / "traced"


@contextmanager
def served(folder):
    """The local page of a folder, answering in a thread."""
    made = TraceServer(Correction(folder, list(read_traces(folder))))
    thread = threading.Thread(target=made.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    yield made
    made.shutdown()
    thread.join()
    made.server_close()
