"""Recordings of motion capture, written by the reader's own writer."""

import ezc3d
import numpy as np

LENGTH = 43.0  # mm
#: From a frame of the actuator, x along the clamped end and z away from the paper, to a laboratory.
TURNED = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]
WHERE = np.array([300.0, -120.0, 850.0])


def arc(angle, count=12, *, below=0.0):
    """Points of an arc that leaves the base along x and bends to z < 0, so far below it [mm]."""
    radius = LENGTH / angle
    at = np.linspace(0.0, angle, count)
    reach = radius - below
    return np.column_stack([reach * np.sin(at), 0.0 * at, reach * np.cos(at) - radius])


def names(count=12, subject=""):
    return [f"{subject}B{i + 1}" for i in range(count)]


def write_c3d(path, points, labels, *, unit="mm", pressures=None, channel="p", first=1,
              channel_unit="V", samples=4):  # fmt: skip
    """Write frames of markers, (n_frames, n_markers, 3) [unit]; nan where one is not seen."""
    file = ezc3d.c3d()
    about = file["parameters"]["POINT"]
    about["RATE"]["value"] = [100.0]
    about["LABELS"]["value"] = tuple(labels)
    about["UNITS"]["value"] = (unit,) if unit else ()
    shape = (4, len(labels), len(points))
    whole = np.ones(shape)
    whole[:3] = np.transpose(points, (2, 1, 0))
    gone = np.isnan(whole[0])
    whole[:3, gone] = 0.0
    file["data"]["points"] = whole
    file["data"]["meta_points"]["residuals"] = np.where(gone, -1.0, 0.0)[None]
    file["header"]["points"]["first_frame"] = first - 1
    if pressures is not None:
        about = file["parameters"]["ANALOG"]
        about["RATE"]["value"] = [100.0 * samples]
        about["LABELS"]["value"] = (channel,)
        about["UNITS"]["value"] = (channel_unit,)
        file["data"]["analogs"] = np.repeat(pressures, samples)[None, None]
    file.write(str(path))
