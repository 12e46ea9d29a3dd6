"""What is fuzzed: a sound folder, the files of it that are changed, the commands that read them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from roifile import ROI_TYPE, ImagejRoi

from tests.hostile.inputs import forget_hash
from tests.hostile.test_hostile_runs import ROWS, about_prior, write_course
from tests.pages.synthetic_run import write_full
from tests.photographs.recordings import arc, names, write_c3d
from tests.run.planted_offset import planted_study
from tests.run.small_run import write_run
from tests.run.study_files import study_in

FULL = {
    "study.toml": """title = "Small"
seed = 7
note = "of nobody"
[actuator]
length = 50.0
width = 10.0
height = 10.0
chambers = 5
[constraint]
kind = "paper"
thickness = 0.1
[reading]
operator = "circle"
[rupture]
criterion = "cauchy_stress"
[priors]
volume_ratio = { law = "normal", mean = 0.62, sd = 0.07 }
[noise]
degradation_sd_pct = 1.0
[causes]
candidates = ["creep", "gravity"]
[sampling]
effort = "quick"
[suspects]
set_aside = true
[tensile]
fit_modes = ["uniaxial"]
""",
    "actuator.csv": "specimen_id,degradation_pct,degradation_sd_pct,pressure_kPa,curvature_per_m,"
    "bend_angle_deg,cycle,branch,time_s,humidity_pct,mount,ruptured\n"
    + "".join(
        f"a{k},{d},0.5,{p},{0.1 * p * (1 - 0.02 * d):.4f},{0.25 * p * (1 - 0.02 * d):.4f},"
        f"1,{branch},{240 * j + 60 * i},61,horizontal,0\n"
        for k, d in enumerate((0, 10, 25))
        for j, branch in enumerate(("loading", "unloading"))
        for i, p in enumerate((0, 40, 80, 120) if branch == "loading" else (120, 80, 40, 0))
    ),
    "moisture.csv": "film_id,time_h,mass_equilibrated_g,mass_dry_g\nm1,0,2.5,2.0\nm2,6,2.5,2.1\n"
    "m3,12,2.5,2.15\nm4,24,2.5,2.2\n",
    "shrinkage.csv": "film_id,mass_poured_g,mass_cured_g,mass_conditioned_g\n"
    "s1,10,6.3,6.1\ns2,10.2,6.4,6.2\n",
    "force.csv": "specimen_id,degradation_pct,pressure_kPa,tip_force_N\n"
    "t1,0,20,0.1\nt1,0,40,0.2\nt2,0,20,0.11\nt2,0,40,0.19\n",
}
MARKERS = "specimen_id,degradation_pct,pressure_kPa,point,x_mm,y_mm,sd_mm\n" + "".join(
    f"a{k},0,{p},{i},{4.0 * i:.3f},{-0.0002 * p * (4.0 * i) ** 2 / 10:.3f},0.05\n"
    for k in range(2)
    for p in (40, 80)
    for i in range(1, 11)
)
OWN = {
    "study.toml": """title = "Springs"
seed = 3
[forward]
function = "model.py:predict"
[parameters.k]
law = "lognormal"
median = 2.0
sigma = 1.0
[reading]
unit = "N"
""",
    "readings.csv": "specimen,x,reading\n"
    + "".join(f"s{i % 2},{i},{2.0 * i + 0.1}\n" for i in range(8)),
}
MODEL = "def predict(values, x):\n    return values['k'][:, None] * x['x'][None, :]\n"


@dataclass(frozen=True)
class Subject:
    """A sound folder and what reads it.

    ``{folder}`` in a command is the folder, ``{made}`` a place in it that may be written.
    """

    name: str
    make: Callable[[Path], object]
    files: tuple[str, ...]
    commands: tuple[str, ...]


def _study(folder: Path) -> None:
    study_in(folder, FULL)


def _lines(folder: Path) -> None:
    study_in(folder, {"markers.csv": MARKERS}, without=("actuator.csv",))


def _captured(folder: Path) -> None:
    (folder / "captures").mkdir()
    holds = np.concatenate([np.repeat(arc(angle)[None], 12, axis=0) for angle in (0.2, 0.5)])
    holds += [300.0, -120.0, 850.0]
    volts = np.repeat([0.8, 1.6], 12)
    write_c3d(folder / "captures" / "one.c3d", holds, names(), pressures=volts)
    rows = "specimen_id,degradation_pct,pressure_kPa,file,first_frame,last_frame\n"
    rows += "S1,0,,one.c3d,1,12\nS1,0,80,one.c3d,13,24\n"
    (folder / "captures.csv").write_text(rows, encoding="utf-8")
    settings = f'title = "Moved"\nseed = 7\n[captures]\nmarkers = {names()}\noffset = 0.5\n'
    settings += 'sd = 0.05\npressure = "p"\nkPa_per_unit = 50.0\nzero = 0.0\n'
    (folder / "study.toml").write_text(settings, encoding="utf-8")


def _own(folder: Path) -> None:
    for name, text in {**OWN, "model.py": MODEL}.items():
        (folder / name).write_text(text, encoding="utf-8")


def _run(folder: Path) -> None:
    (folder / "study").mkdir()
    write_run(folder / "run", planted_study(folder / "study"), chain=about_prior)
    write_course(folder / "run")
    (folder / "rows.csv").write_text(ROWS, encoding="utf-8")


def _unsigned(folder: Path) -> None:
    """Make a run whose posteriors are read whatever they hold: else their hash alone is tried."""
    _run(folder)
    for file in (folder / "run").glob("*.nc"):
        forget_hash(folder / "run", file.name)


def _report(folder: Path) -> None:
    write_full(folder / "report", "named")


def _photograph(folder: Path) -> None:
    image = np.full((480, 640, 3), 235, np.uint8)
    at = np.linspace(0.0, 1.0, 200)
    line = np.column_stack([80 + 480 * at, 160 + 90 * at**2])

    def fill(bottom: np.ndarray, height: float) -> None:
        shape = np.round(np.vstack([bottom, (bottom - [0, height])[::-1]])).astype(np.int32)
        cv2.fillPoly(image, [shape], (40, 60, 70), lineType=cv2.LINE_AA)

    fill(line, 20)
    for start in range(0, 200, 40):  # chambers
        fill(line[start : start + 32], 95)
    for ending in ("png", "jpg"):
        cv2.imwrite(str(folder / f"photo.{ending}"), image)
    hint = "".join(f"{x:.1f},{y:.1f}\n" for x, y in line[::20])
    (folder / "hint.csv").write_text("x_px,y_px\n" + hint, encoding="utf-8")
    drawn = ImagejRoi.frompoints(line[::20])
    drawn.roitype = ROI_TYPE.POLYLINE
    drawn.tofile(folder / "hint.roi")
    about = (
        "file,specimen_id,pressure_kPa,degradation_pct\nphoto.png,S1,120,5\nphoto.jpg,S1,120,5\n"
    )
    (folder / "photos.csv").write_text(about, encoding="utf-8")


def _photographed(folder: Path) -> None:
    (folder / "photos").mkdir()
    _photograph(folder / "photos")
    for name in ("photos.csv", "hint.roi"):
        (folder / "photos" / name).rename(folder / name)
    # the second would be a copy of the first
    about = (
        "file,specimen_id,pressure_kPa,degradation_pct\nphoto.png,S1,120,5\nphoto.jpg,S2,120,5\n"
    )
    (folder / "photos.csv").write_text(about, encoding="utf-8")
    settings = 'title = "Seen"\nseed = 7\n[photographs]\nscale = 0.09\nhint = "hint.roi"\n'
    (folder / "study.toml").write_text(settings, encoding="utf-8")


ANSWERS = (
    "predict {folder}/run --pressure 40 --degradation 10 --emulator {folder}/emulator.npz",
    "control {folder}/run --degradation 10 --curvature 4 --emulator {folder}/emulator.npz",
    "predict {folder}/run --pressure 40 --hours 6 --base --json --emulator {folder}/emulator.npz",
)
TRACE = "trace {folder}/photo.%s --scale 0.09 --out {made}"
SUBJECTS = (
    Subject(
        "study",
        _study,
        (
            *("study.toml", "actuator.csv", "tensile.csv", "break.csv", "summary.csv"),
            *("moisture.csv", "shrinkage.csv", "force.csv"),
        ),
        ("check {folder}",),
    ),
    Subject("lines", _lines, ("markers.csv", "study.toml"), ("check {folder}",)),
    Subject(
        "recordings",
        _captured,
        ("captures/one.c3d", "captures.csv", "study.toml"),
        ("check {folder}",),
    ),
    Subject("own map", _own, ("readings.csv", "study.toml"), ("check {folder}",)),
    Subject(
        "run",
        _run,
        ("run/run.json", "run/verdict.json", "emulator.npz"),
        ANSWERS,
    ),
    Subject(
        "posterior",
        _unsigned,
        ("run/posterior.nc", "run/posterior_base.nc", "run/posterior_course.nc"),
        ANSWERS,
    ),
    Subject(
        "report",
        _report,
        (
            *("report/run.json", "report/verdict.json", "report/bands.csv", "report/gain.csv"),
            *("report/observations.csv", "report/rupture.csv", "report/parameters.csv"),
        ),
        ("report {folder}/report",),
    ),
    Subject(
        "photograph",
        _photograph,
        ("photo.png", "photo.jpg", "hint.csv", "hint.roi", "photos.csv"),
        tuple(
            TRACE % ending + extra
            for ending in ("png", "jpg")
            for extra in (
                *("", " --hint {folder}/hint.csv", " --about {folder}/photos.csv"),
                *(" --hint {folder}/hint.roi", " --line {folder}/hint.roi"),
            )
        ),
    ),
    Subject(
        "photographed study",
        _photographed,
        ("photos.csv", "study.toml", "hint.roi", "photos/photo.png", "photos/photo.jpg"),
        ("check {folder}",),
    ),
)
