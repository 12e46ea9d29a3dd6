"""A local web page for viewing and correcting traced lines.

It answers only on the loopback address. Other pages in the browser can neither read nor write: the
address contains a random token, requests must name this machine as the host, writing requests must
come from the page itself, and the page may load nothing from elsewhere.
"""

import json
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from threading import Lock

import cv2
import numpy as np
from numpy.typing import NDArray

from bayesdeg.console import errors
from bayesdeg.data.photographs import TracedPhotograph
from bayesdeg.errors import BayesdegError
from bayesdeg.files import parse_json, reason
from bayesdeg.pages.output import claimed
from bayesdeg_camera.folder import picture_of, read_traces, write_overlay, write_traces
from bayesdeg_camera.tracing.picture import resized
from bayesdeg_camera.tracing.record import corrected
from bayesdeg_camera.tracing.trace import OUTSIDE

Floats = NDArray[np.float64]

HOST = "127.0.0.1"
#: A line of a few hundred points has some 10 kB [bytes].
LARGEST_BODY = 1_000_000
#: Time after which a silent connection is closed [s].
PATIENCE = 30.0
#: Longer side of a photograph on the page [px], and its quality as JPEG.
SIDE, QUALITY = 2400, 88

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_STATIC = {
    "": ("trace_page.html", "text/html; charset=utf-8"),
    "page.js": ("trace_page.js", "text/javascript; charset=utf-8"),
    "page.css": ("trace_page.css", "text/css; charset=utf-8"),
}


class PageError(Exception):
    """A refused request with its status; the page shows the message."""

    def __init__(self, status: HTTPStatus, message: str) -> None:
        super().__init__(message)
        self.status = status


@dataclass
class Correction:
    """The traces of a folder, and their corrections.

    Parameters
    ----------
    folder : Path
        Of a trace.
    photographs : list of TracedPhotograph
        As they are now.
    """

    folder: Path
    photographs: list[TracedPhotograph]
    lock: Lock = field(default_factory=Lock)

    def shown(self, number: int) -> dict[str, object]:
        """Return the data of a photograph for the page."""
        one = self.photographs[number]
        names = (
            *("file", "width", "height", "pixels", "seen", "bend_angle_deg", "curvature_per_m"),
            *("length_mm", "not_sure", "corrected"),
        )
        return {name: getattr(one, name) for name in names}

    def picture(self, number: int) -> bytes:
        """Return a photograph as JPEG, no larger than a screen."""
        image = picture_of(self.folder, self.photographs[number])
        factor = min(1.0, SIDE / max(image.shape[:2]))
        small = resized(image, factor)
        _, content = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        return bytes(content)

    def save(self, asked: object) -> dict[str, object]:
        """Save the points of a photograph from the page, and rewrite everything.

        Raises
        ------
        PageError
            If they are not points of one of the photographs.
        """
        with self.lock:
            number, pixels = self._points_of(asked)
            changed = corrected(self.photographs[number], pixels)
            photographs = [*self.photographs]
            photographs[number] = changed
            write_traces(self.folder, photographs)
            write_overlay(self.folder, changed, picture_of(self.folder, changed))
            self.photographs = photographs
            return self.shown(number)

    def _points_of(self, asked: object) -> tuple[int, Floats]:
        """Return the number of a photograph and its points; refuse anything else."""
        wrong = PageError(HTTPStatus.BAD_REQUEST, "these are not points of a photograph")
        if not isinstance(asked, Mapping):
            raise wrong
        number = asked.get("number")
        if not isinstance(number, int) or not 0 <= number < len(self.photographs):
            raise wrong
        one = self.photographs[number]
        try:
            pixels = np.array(asked["pixels"], dtype=np.float64)
        except (KeyError, TypeError, ValueError):
            raise wrong from None
        size = np.array([one.width, one.height])
        if pixels.shape != (len(one.pixels), 2) or not np.all(np.isfinite(pixels)):
            raise wrong
        if np.any(pixels < -OUTSIDE * size) or np.any(pixels > (1.0 + OUTSIDE) * size):
            raise PageError(HTTPStatus.BAD_REQUEST, "a point is outside the photograph")
        if np.any(np.hypot(*np.diff(pixels, axis=0).T) < 1e-3):
            raise PageError(HTTPStatus.BAD_REQUEST, "two neighbouring points coincide")
        return number, pixels


class TraceServer(ThreadingHTTPServer):
    """Serves the page of a folder on the loopback address.

    Parameters
    ----------
    correction : Correction
        The traces that are shown and changed.
    port : int
        0 for a free one.
    """

    daemon_threads = True
    allow_reuse_address = False

    def __init__(self, correction: Correction, port: int = 0) -> None:
        self.correction, self.token = correction, secrets.token_urlsafe(24)
        super().__init__((HOST, port), TraceRequest)

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self.server_port}/{self.token}/"

    @cached_property
    def hosts(self) -> frozenset[str]:
        """Host names that a request may use."""
        return frozenset(f"{name}:{self.server_port}" for name in (HOST, "localhost"))


class TraceRequest(BaseHTTPRequestHandler):
    """One request of the page."""

    server: TraceServer
    server_version, sys_version = "bayesdeg", ""
    timeout = PATIENCE

    def do_GET(self) -> None:
        """Send a part of the page, or a photograph."""
        self._answer(self._got)

    def do_POST(self) -> None:
        """Save the points of a photograph."""
        self._answer(self._saved)

    def log_message(self, *_args: object) -> None:
        """Log nothing: addresses contain the token."""

    def _answer(self, work: Callable[[str], tuple[bytes, str]]) -> None:
        try:
            self._send(HTTPStatus.OK, *work(self._checked_way()))
        except PageError as refused:
            self._refuse(refused.status, str(refused))
        except BayesdegError as fault:
            self._refuse(HTTPStatus.CONFLICT, str(fault))

    def _refuse(self, status: HTTPStatus, message: str) -> None:
        self.close_connection = True
        self._send(status, json.dumps({"error": message}).encode(), "application/json")

    def _checked_way(self) -> str:
        """Return the path after the token.

        Raises
        ------
        PageError
            If the request does not come from the page or someone with its address.
        """
        if self.headers.get("Host", "") not in self.server.hosts:
            raise PageError(HTTPStatus.MISDIRECTED_REQUEST, "wrong host")
        _, token, *rest = [*self.path.split("/", 2), ""]
        if not secrets.compare_digest(token.encode(), self.server.token.encode()):
            raise PageError(HTTPStatus.NOT_FOUND, "not found")
        return rest[0]

    def _got(self, way: str) -> tuple[bytes, str]:
        correction = self.server.correction
        if way in _STATIC:
            name, kind = _STATIC[way]
            return (files("bayesdeg_camera") / "templates" / name).read_bytes(), kind
        if way == "photographs.json":
            listed = [correction.shown(number) for number in range(len(correction.photographs))]
            return json.dumps(listed).encode(), "application/json"
        folder, _, number = way.partition("/")
        known = map(str, range(len(correction.photographs)))
        if folder == "photograph" and number in known:
            return correction.picture(int(number)), "image/jpeg"
        raise PageError(HTTPStatus.NOT_FOUND, "not found")

    def _saved(self, way: str) -> tuple[bytes, str]:
        origin = self.headers.get("Origin", "")
        if origin.removeprefix("http://") not in self.server.hosts or "//" not in origin:
            raise PageError(HTTPStatus.FORBIDDEN, "only this page may save")
        if self.headers.get("Sec-Fetch-Site", "same-origin") != "same-origin":
            raise PageError(HTTPStatus.FORBIDDEN, "only this page may save")
        if way != "save":
            raise PageError(HTTPStatus.NOT_FOUND, "not found")
        if self.headers.get("Content-Type", "").partition(";")[0] != "application/json":
            raise PageError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "points must be sent as JSON")
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal():
            raise PageError(HTTPStatus.LENGTH_REQUIRED, "the request has no content length")
        if len(length) > 9 or int(length) > LARGEST_BODY:
            raise PageError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too large for a line")
        try:
            asked = parse_json(self.rfile.read(int(length)))
        except ValueError:
            raise PageError(HTTPStatus.BAD_REQUEST, "not valid JSON") from None
        return json.dumps(self.server.correction.save(asked)).encode(), "application/json"

    def _send(self, status: HTTPStatus, content: bytes, kind: str) -> None:
        self.send_response(status)
        for name, value in {
            "Content-Type": kind,
            "Content-Length": str(len(content)),
            "Content-Security-Policy": POLICY,
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
            "Cache-Control": "no-store",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cross-Origin-Opener-Policy": "same-origin",
        }.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(content)


def serve(folder: Path, port: int | None) -> None:
    """Serve the page of a folder until the command is stopped.

    Parameters
    ----------
    folder : Path
        The ``--out`` folder of a trace.
    port : int, optional
        A free one by default.

    Raises
    ------
    BayesdegError
        If it has no traces or cannot be written, or the port is taken.
    """
    photographs = list(read_traces(folder))
    for one in photographs:
        picture_of(folder, one)
    with claimed(folder):
        try:
            server = TraceServer(Correction(folder, photographs), port or 0)
        except OSError as fault:
            raise BayesdegError(
                f"--port {port} cannot be used ({reason(fault)}); give a different port, or none"
            ) from fault
        with server:
            errors.print(f"{len(photographs)} photographs: {server.address}", soft_wrap=True)
            errors.print("Ctrl-C closes the page; saved corrections are kept", soft_wrap=True)
            server.serve_forever(poll_interval=0.2)
