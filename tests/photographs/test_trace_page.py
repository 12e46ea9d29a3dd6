"""The page on which lines are corrected: what it saves, and to whom it does not answer."""

import http.client
import json
import signal
import socket
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from bayesdeg.errors import BayesdegError
from bayesdeg_camera import page as trace_page
from bayesdeg_camera.folder import TraceFile, read_traces, refuse_lost_corrections, write_traces
from bayesdeg_camera.tracing.trace import BY_HAND
from tests.photographs.traced_folder import SCALE, served, traced_folder


@pytest.fixture
def folder(tmp_path):
    return traced_folder(tmp_path / "work")


@pytest.fixture
def server(folder):
    with served(folder) as made:
        yield made


def ask(server, way="", *, method="GET", body=None, token=None, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    token = server.token if token is None else token
    connection.request(method, f"/{token}/{way}", body=body, headers=named)
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer, content


def save(server, content, **headers):
    origin = f"http://127.0.0.1:{server.server_port}"
    known = {"Origin": origin, "Content_Type": "application/json"} | headers
    body = content if isinstance(content, bytes) else json.dumps(content).encode()
    kept = {name: value for name, value in known.items() if value is not None}
    return ask(server, "save", method="POST", body=body, **kept)


def listing(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


# ---- what is shown and saved


def test_it_shows_every_photograph_and_loads_nothing_from_elsewhere(server):
    for way in ("", "page.js", "page.css"):
        answer, content = ask(server, way)
        assert answer.status == 200
        assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
        assert "unsafe" not in answer.headers["Content-Security-Policy"]
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert b"https:" not in content
        text = content.replace(b"http://www.w3.org/2000/svg", b"")
        assert b"http:" not in text
    answer, content = ask(server, "photographs.json")
    found = json.loads(content)
    assert [one["file"] for one in found] == ["one.png", "two.png"]
    assert len(found[0]["pixels"]) == 30
    answer, content = ask(server, "photograph/1")
    assert content[:3] == b"\xff\xd8\xff"


def test_moved_points_are_saved_in_mm_by_the_same_transformation(server, folder):
    before = read_traces(folder)[0]
    pixels = np.array(before.pixels)
    pixels[-1] += [0.0, 30.0]
    answer, content = save(server, {"number": 0, "pixels": pixels.tolist()})
    assert answer.status == 200
    shown = json.loads(content)
    assert shown["corrected"]
    assert shown["bend_angle_deg"] > before.bend_angle_deg
    after, other = read_traces(folder)
    assert after.corrected
    assert not other.corrected
    assert after.pixels[-1] == pytest.approx(pixels[-1], abs=1e-3)
    markers = pd.read_csv(folder / "markers.csv")
    mine = markers[markers["file"] == "one.png"]
    # the first points stay, so that the frame does
    assert mine[["x_mm", "y_mm"]].to_numpy()[:-1] == pytest.approx(
        np.array(before.points)[:-1] - before.points[0], abs=0.3
    )
    # three points or so make the direction of an end
    assert after.bend_angle_error_deg > before.bend_angle_error_deg + 1.0
    drop = np.array(after.points[-1]) - np.array(before.points[-1])
    assert np.hypot(*drop) == pytest.approx(30.0 * SCALE, abs=0.3)
    assert mine["sd_mm"].iloc[-1] == pytest.approx(BY_HAND * SCALE, rel=1e-3)
    assert mine["sd_mm"].iloc[0] == pytest.approx(0.01)
    traces = pd.read_csv(folder / "traces.csv").set_index("file")
    assert traces["corrected"].to_dict() == {"one.png": 1, "two.png": 0}
    assert pd.read_csv(folder / "points.csv")["y_px"].iloc[29] == pytest.approx(
        pixels[-1, 1], abs=0.01
    )
    assert (folder / "one_traced.png").read_bytes()[:4] == b"\x89PNG"
    assert not (folder / "two_traced.png").exists()
    # what was corrected is not traced over
    with pytest.raises(BayesdegError, match=r"one\.png"):
        refuse_lost_corrections(folder)


def test_points_that_were_not_moved_change_nothing(server, folder):
    before = read_traces(folder)[1]
    answer, _ = save(server, {"number": 1, "pixels": before.pixels})
    assert answer.status == 200
    after = read_traces(folder)[1]
    assert not after.corrected
    assert after.pixels == before.pixels
    assert after.length_mm == pytest.approx(before.length_mm, rel=1e-3)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no json",
        b"[" * 100_000,
        b"null",
        b"[]",
        {"number": 0},
        {"number": 2, "pixels": []},
        {"number": -1, "pixels": []},
        {"number": "0", "pixels": []},
        {"number": True, "pixels": [[1, 2]]},
        {"number": 0, "pixels": [[1, 2]]},
        {"number": 0, "pixels": [["x", 2]] * 30},
        {"number": 0, "pixels": [[float("nan"), 2]] * 30},
        {"number": 0, "pixels": [[1e9, i] for i in range(30)]},
        {"number": 0, "pixels": [[5, 5]] * 30},
        {"number": 0, "pixels": {"a": 3}},
    ],
)
def test_what_are_no_points_is_refused(server, folder, content):
    before = listing(folder)
    answer, said = save(server, content)
    assert answer.status == 400
    assert json.loads(said)["error"]
    assert listing(folder) == before


def test_a_photograph_that_changed_is_neither_shown_nor_corrected(server, folder):
    (folder.parent / "one.png").write_bytes((folder.parent / "two.png").read_bytes())
    assert ask(server, "photograph/0")[0].status == 409


# ---- who is not answered


@pytest.mark.parametrize(
    "host", ["evil.example", "127.0.0.1", "127.0.0.1:1", "", "evil.example:{}"]
)
def test_a_name_that_was_bound_to_this_machine_is_not_answered(server, host):
    answer, content = ask(server, "photographs.json", Host=host.format(server.server_port))
    assert answer.status == 421
    assert b"one.png" not in content


@pytest.mark.parametrize("token", ["", "x", "%C3%A9", "..", "A" * 5000])
def test_without_the_token_nothing_is_answered(server, token):
    answer, content = ask(server, "photographs.json", token=token)
    assert answer.status in (404, 414)
    assert b"one.png" not in content


@pytest.mark.parametrize(
    "way",
    [
        *("../trace.json", "trace.json", "%2e%2e/trace.json", "photograph/../../one.png"),
        *("photograph/2", "photograph/-1", "photograph/x"),
    ],
)
def test_files_are_not_served(server, way):
    assert ask(server, way)[0].status == 404


@pytest.mark.parametrize(
    "headers",
    [
        {"Origin": "http://evil.example"},
        {"Origin": None},
        {"Origin": "null"},
        {"Origin": "https://127.0.0.1:{}"},
        {"Origin": "127.0.0.1:{}"},
        {"Origin": "http://127.0.0.1"},
        {"Sec_Fetch_Site": "cross-site"},
        {"Sec_Fetch_Site": "same-site"},
        {"Content_Type": "text/plain"},
        {"Content_Type": "application/x-www-form-urlencoded"},
        {"Host": "evil.example"},
    ],
)
def test_another_page_cannot_save(server, folder, headers):
    before = listing(folder)
    pixels = (np.array(read_traces(folder)[0].pixels) + 3.0).tolist()
    filled = {k: v and v.format(server.server_port) for k, v in headers.items()}
    answer, _ = save(server, {"number": 0, "pixels": pixels}, **filled)
    assert answer.status in (403, 415, 421)
    assert listing(folder) == before
    assert answer.headers["Access-Control-Allow-Origin"] is None


@pytest.mark.parametrize(
    ("length", "status"), [("2000000", 413), ("9" * 40, 413), ("-1", 411), ("x", 411), (None, 411)]
)
def test_a_body_of_any_other_size_is_not_read(server, length, status):
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=10) as raw:
        lines = [
            f"POST /{server.token}/save HTTP/1.1",
            f"Host: 127.0.0.1:{server.server_port}",
            f"Origin: http://127.0.0.1:{server.server_port}",
            "Content-Type: application/json",
            *([] if length is None else [f"Content-Length: {length}"]),
        ]
        raw.sendall("\r\n".join([*lines, "", ""]).encode())
        assert f" {status} ".encode() in raw.recv(4096)


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "HEAD"])
def test_other_methods_are_not_there(server, method):
    assert ask(server, method=method)[0].status == 501


def test_it_listens_on_the_loopback_address_alone(server):
    assert server.socket.getsockname()[0] == "127.0.0.1"


# ---- the command


def command(folder, *options):
    words = [sys.executable, "-m", "bayesdeg", "trace", "--page", str(folder), *options]
    return subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


def test_ctrl_c_ends_the_page_and_leaves_nothing_behind(folder):
    before = listing(folder)
    running = command(folder)
    address = running.stderr.readline().split()[-1]
    assert address.startswith("http://127.0.0.1:")
    second = command(folder)
    assert second.wait(60) == 2
    running.send_signal(signal.SIGINT)
    assert running.wait(30) == 3
    assert "Traceback" not in running.stderr.read()
    assert listing(folder) == before
    for one in (running, second):
        one.stderr.close()
        one.stdout.close()


@pytest.mark.parametrize("options", [["--port", "80"], ["photo.jpg"], ["--out", "x"]])
def test_options_that_do_not_go_with_a_page_are_refused(folder, options):
    done = command(folder, *options)
    assert done.wait(60) == 2
    assert "Traceback" not in done.stderr.read()
    done.stderr.close()
    done.stdout.close()


@pytest.mark.parametrize("content", [None, "", "{}x", '{"photographs": 3}', "pixels", "place"])
def test_a_damaged_folder_is_refused(folder, content):
    path = folder / "trace.json"
    if content is None:
        path.unlink()
    elif content == "pixels":
        found = [one.model_copy(update={"pixels": one.pixels[:3]}) for one in read_traces(folder)]
        path.write_text(trace_page_file(found), encoding="utf-8")
    elif content == "place":
        found = [one.model_copy(update={"place": "../no.png"}) for one in read_traces(folder)]
        write_traces(folder, found)
    else:
        path.write_text(content, encoding="utf-8")
    with pytest.raises(BayesdegError) as refused:
        trace_page.serve(folder, None)
    assert "\n" not in str(refused.value)


def trace_page_file(found):
    return TraceFile(photographs=tuple(found)).text()


def test_a_port_that_is_taken_is_said(folder, server):
    with pytest.raises(BayesdegError, match=str(server.server_port)):
        trace_page.serve(folder, server.server_port)
    assert (folder / "trace.json").exists()
