"""Traced lines are corrected in a real browser: by mouse, by keys, and saved."""

import numpy as np
import pandas as pd
import pytest

from bayesdeg_camera.folder import read_traces
from tests.browser.chromium import NEEDED
from tests.photographs.traced_folder import HEIGHT, WIDTH, served, traced_folder

pytestmark = NEEDED


@pytest.fixture
def folder(tmp_path):
    return traced_folder(tmp_path)


@pytest.fixture
def server(folder):
    with served(folder) as made:
        yield made


@pytest.fixture
def page(browser, server):
    """The page with its first photograph; what it complains of is collected."""
    made = browser.new_page(viewport={"width": 1200, "height": 900})
    made.complaints, made.asked = [], []
    made.on("console", lambda said: made.complaints.append(said.text))
    made.on("pageerror", lambda fault: made.complaints.append(str(fault)))
    made.on("request", lambda request: made.asked.append(request.url))
    made.goto(server.address)
    made.wait_for_selector("svg[data-loaded='0']")
    yield made
    made.close()


def handle(page, point):
    """Return the middle of a point's handle on the screen."""
    box = page.locator(f"[data-point='{point}'] .handle").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def pixel(page):
    """Return the size of a pixel of the photograph on the screen."""
    return page.locator("#drawing").bounding_box()["width"] / WIDTH


def saved(page, name):
    page.click("#save")
    page.wait_for_selector(f"#said:has-text('{name}')")


def test_it_loads_nothing_from_elsewhere_and_complains_of_nothing(page, server):
    assert page.complaints == []
    origin = server.address.rsplit("/", 2)[0]
    assert page.asked
    assert all(url.startswith(origin) for url in page.asked)
    assert page.locator("[data-point]").count() == 30
    assert page.locator("#choice option").all_inner_texts() == ["one.png", "two.png"]
    assert page.locator("#save").is_disabled()
    # the photograph itself is drawn, at its size
    image = page.locator("#drawing image").bounding_box()
    assert image["height"] / image["width"] == pytest.approx(HEIGHT / WIDTH, rel=0.01)


def test_a_point_is_dragged_and_saved(page, folder):
    before = read_traces(folder)[0]
    page.locator("#reach").fill("0")
    x, y = handle(page, 20)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 5, y + 10, steps=3)
    page.mouse.move(x + 12 * pixel(page), y - 18 * pixel(page), steps=5)
    page.mouse.up()
    assert page.locator("#save").is_enabled()
    assert read_traces(folder)[0] == before
    saved(page, "one.png")
    after = read_traces(folder)[0]
    shift = np.array(after.pixels) - np.array(before.pixels)
    assert shift[20] == pytest.approx([12.0, -18.0], abs=0.6)
    assert np.abs(np.delete(shift, 20, axis=0)).max() < 1e-9
    assert after.corrected
    assert "one.png (corrected)" in page.locator("#choice option").all_inner_texts()
    assert page.complaints == []


def test_arrow_keys_move_a_point_and_its_neighbours(page, folder):
    before = read_traces(folder)[0]
    page.locator("#reach").fill("2")
    page.locator("[data-point='10']").focus()
    for key in ("ArrowUp", "ArrowUp", "ArrowLeft", "Shift+ArrowDown"):
        page.keyboard.press(key)
    saved(page, "one.png")
    shift = np.array(read_traces(folder)[0].pixels) - np.array(before.pixels)
    assert shift[10] == pytest.approx([-1.0, 8.0], abs=1e-3)
    assert shift[9] == pytest.approx([-0.75, 6.0], abs=1e-2)
    assert shift[12] == pytest.approx([-0.25, 2.0], abs=1e-2)
    assert np.abs(shift[[0, 7, 13, 29]]).max() == 0.0


def test_the_readings_follow_and_the_tables_with_them(page, folder):
    page.locator("#reach").fill("12")
    page.locator("[data-point='29']").focus()
    for _ in range(3):
        page.keyboard.press("Shift+ArrowDown")
    said = page.locator("#read").inner_text()
    saved(page, "one.png")
    assert page.locator("#read").inner_text() != said
    row = pd.read_csv(folder / "traces.csv").set_index("file").loc["one.png"]
    assert f"{row['bend_angle_deg']:.2f}°" in page.locator("#read").inner_text()
    assert row["bend_angle_deg"] > np.degrees(0.5) + 1.0
    assert row["corrected"] == 1


def test_what_was_moved_can_be_undone_and_is_not_lost_by_mistake(page, folder):
    before = read_traces(folder)
    page.locator("[data-point='5']").focus()
    page.keyboard.press("ArrowDown")
    asked = []

    def keep(dialog):
        asked.append(dialog.message)
        dialog.dismiss()

    page.once("dialog", keep)
    page.click("#next")
    assert len(asked) == 1
    assert page.locator("#choice").input_value() == "0"
    page.click("#undo")
    assert page.locator("#save").is_disabled()
    page.click("#next")
    page.wait_for_selector("svg[data-loaded='1']")
    assert read_traces(folder) == before


def test_a_handle_keeps_its_size_when_the_page_is_zoomed(page):
    small = page.locator("[data-point='0'] .handle").bounding_box()["width"]
    page.select_option("#zoom", "4")
    large = page.locator("[data-point='0'] .handle").bounding_box()["width"]
    assert large == pytest.approx(small, rel=0.05)
    assert pixel(page) * WIDTH > 4000


def test_what_cannot_be_saved_is_said_and_stays_on_the_page(page, folder):
    page.locator("[data-point='5']").focus()
    page.keyboard.press("ArrowDown")
    (folder.parent / "one.png").unlink()
    page.click("#save")
    page.wait_for_selector("#said.wrong")
    assert "one.png" in page.locator("#said").inner_text()
    assert page.locator("#save").is_enabled()


def test_another_page_can_neither_read_nor_save(browser, server, folder, tmp_path):
    """As a page of an attacker who knows even the token."""
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    attack = f"""async () => {{
        const found = [];
        for (const [way, options] of [
            ["photographs.json", {{}}],
            ["save", {{method: "POST", mode: "no-cors", body: '{{"number": 0}}'}}],
            ["save", {{method: "POST", headers: {{"Content-Type": "application/json"}}}}],
        ]) {{
            try {{
                const answer = await fetch("{server.address}" + way, options);
                found.push(answer.type === "opaque" ? "opaque" : await answer.text());
            }} catch (fault) {{ found.push("refused"); }}
        }}
        return found;
    }}"""
    page = browser.new_page()
    (tmp_path / "evil.html").write_text("<title>x</title>", encoding="utf-8")
    page.goto((tmp_path / "evil.html").as_uri())
    assert set(page.evaluate(attack)) <= {"refused", "opaque"}
    page.close()
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
