"""The live map as people use it: live changes, replay, search, drawing."""

import json
import time

import numpy as np
from block import ACCENT, STREET, drive_by, lon_lat_of, looking_at, picture, share_of, states
from playwright.sync_api import expect

from autowaze.cloud.store.tokens import Scope, TokenRegister

FREE_GREEN = (18, 163, 111)


def test_a_spot_turns_on_the_map_within_a_second_of_the_diff(serve, open_page):
    site = serve()
    page = open_page(site, looking_at(3))
    expect(page.locator("#empty")).to_contain_text("No car has looked yet")
    assert share_of(picture(page), FREE_GREEN) < 0.001
    page.click("#tab-spots")
    before = page.locator("#map").get_attribute("data-version")
    drive_by(site, [0, 5], 1)
    acknowledged = time.monotonic()
    page.wait_for_selector('li[data-spot="S3"][data-state="vacant"]', timeout=1000)
    page.wait_for_function("v => document.getElementById('map').dataset.version > v", arg=before, timeout=1000)
    assert time.monotonic() - acknowledged < 1.0
    assert share_of(picture(page), FREE_GREEN) > 0.01
    expect(page.locator("#announcer")).to_contain_text("changed")
    counts = page.locator("#summary strong").all_text_contents()
    truth = list(states(site).values())
    assert counts == [str(truth.count(state)) for state in ("vacant", "occupied", "unknown")]
    page.click("#tab-activity")
    expect(page.locator(".log")).to_contain_text("new features")


def test_the_day_can_be_played_again(serve, open_page):
    site = serve()
    drive_by(site, [0, 1, 2, 3, 4, 5, 6, 7], 1)
    full = states(site)
    time.sleep(1.2)
    middle = time.time()
    time.sleep(1.2)
    drive_by(site, [], 2)
    drive_by(site, [], 3)
    empty = states(site)
    assert full != empty
    page = open_page(site)
    page.click("#tab-spots")
    extent = site.client.get("/history/extent").json()
    assert extent["start"] < middle < extent["end"]
    page.select_option("#speed", "1")
    page.evaluate(
        """at => { const scrub = document.getElementById('scrub'); scrub.value = at;
                   scrub.dispatchEvent(new Event('input')); }""",
        round(middle),
    )
    page.wait_for_selector('#connection[data-state="replay"]')
    shown = "rows => Object.fromEntries(rows.map(row => [row.dataset.spot, row.dataset.state]))"
    assert page.eval_on_selector_all("li[data-spot]", shown) == full
    page.click("#play")
    turned = next(spot for spot in full if full[spot] != empty[spot])
    page.wait_for_selector(f'li[data-spot="{turned}"][data-state="{empty[turned]}"]')
    page.click("#back-to-live")
    page.wait_for_selector('#connection[data-state="open"]')
    assert page.eval_on_selector_all("li[data-spot]", shown) == empty


def test_the_nearest_spot_is_found_with_a_route(serve, open_page):
    site = serve()
    drive_by(site, [0, 1, 2, 6], 1)
    page = open_page(site, looking_at(1, zoom=19))
    assert share_of(picture(page), ACCENT["light"]) < 0.001
    page.click("text=Search from the middle of the map")
    first = page.locator(".results button").first
    expect(first).to_contain_text("free on arrival")
    lon, lat = lon_lat_of(1)
    answer = site.client.get(f"/nearest?lon={lon}&lat={lat}&limit=5&mode=walking").json()
    nearest = answer["spots"][0]
    assert first.locator(".name").text_content() == nearest["spot_id"]
    chance = first.locator(".when strong").text_content()
    assert abs(float(chance.strip(" <>%")) / 100 - nearest["probability_on_arrival"]) < 0.02
    page.wait_for_timeout(1500)  # the map moves there
    assert share_of(picture(page), ACCENT["light"]) > 0.003
    drive_by(site, list(range(8)), 2)  # somebody took it
    drive_by(site, list(range(8)), 3)
    expect(page.locator(".toast").first).to_contain_text("no longer free")


def test_a_spot_is_drawn_corrected_and_deleted(serve, open_page, tmp_path):
    secret = TokenRegister(tmp_path / "cloud.db").add("operator", frozenset({Scope.OPERATOR}))
    site = serve(tokens=TokenRegister(tmp_path / "cloud.db"))
    beyond = STREET.centre(7) + STREET.along * 12
    lon, lat = lon_lat_of(7) + (lon_lat_of(7) - lon_lat_of(6)) * 2
    page = open_page(site, f"/#map=20.5/{lat:.7f}/{lon:.7f}")
    page.click("#tab-draw")
    page.click("text=Draw four corners")
    box = page.locator("#map canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    for dx, dy in ((-60, -80), (60, -80), (60, 80), (-60, 80)):
        page.mouse.click(x + dx, y + dy)
    expect(page.locator(".handle.corner")).to_have_count(4)
    page.fill("#draft-id", "NEW")
    page.select_option("#draft-kind", "perpendicular")
    page.click("text=Save spot")
    expect(page.locator(".toast")).to_contain_text("needs an operator token")
    page.fill("#token", secret)
    page.click("text=Use token")
    page.click("text=Save spot")
    page.wait_for_selector('.toast:has-text("NEW is saved")')
    feature = site.client.get("/collections/spots/items/NEW").json()
    assert feature["properties"]["kind"] == "perpendicular"
    corners = np.array(feature["geometry"]["coordinates"][0][:4])
    metres = STREET.parking_map.georeference.to_map(corners)[:, :2]
    assert np.linalg.norm(metres.mean(axis=0) - beyond) < 0.3
    assert np.ptp(metres[:, 1]) > np.ptp(metres[:, 0]) > 2

    page.click("#tab-spots")
    page.click('li[data-spot="NEW"] button')
    page.click("text=Correct outline")
    page.focus(".handle.middle")
    for _ in range(5):
        page.keyboard.press("Shift+ArrowRight")
    with page.expect_response(lambda response: response.request.method == "PUT" and "NEW" in response.url):
        page.click("text=Save spot")  # the word of the first time may still be shown
    page.wait_for_selector('.toast:has-text("NEW is saved")')
    after = site.client.get("/collections/spots/items/NEW").json()["geometry"]["coordinates"][0][:4]
    shift = STREET.parking_map.georeference.to_map(np.array(after))[:, :2].mean(axis=0) - metres.mean(axis=0)
    assert np.allclose(shift, [5, 0], atol=0.05)

    with page.expect_download() as download:
        page.click("text=Export parking map")
    exported = json.loads(download.value.path().read_text(encoding="utf-8"))
    assert len(exported["features"]) == len(STREET.parking_map) + 1

    page.on("dialog", lambda dialog: dialog.accept())
    page.click("#tab-spots")
    page.click('li[data-spot="NEW"] button')
    page.click("text=Correct outline")
    page.click("text=Delete spot")
    page.wait_for_selector('.toast:has-text("NEW is deleted")')
    assert "NEW" not in states(site)


def test_the_feature_map_shows_as_points(serve, open_page):
    site = serve()
    drive_by(site, [2, 3, 4], 1)
    page = open_page(site, looking_at(3))
    before = picture(page)
    page.click('[aria-label="Feature map as points"]')
    expect(page.locator("#announcer")).to_contain_text("features of the map")
    page.wait_for_timeout(500)
    assert (picture(page) != before).any(axis=2).mean() > 0.002


def test_the_page_comes_back_after_the_service_restarts(serving, open_page):
    with serving() as site:
        drive_by(site, [0], 1)
        port = int(site.url.rpartition(":")[2])
        page = open_page(site, forgiven="ERR_")
        page.click("#tab-spots")
    page.wait_for_selector('#connection[data-state="waiting"]')
    with serving(port=port) as site:
        drive_by(site, list(range(8)), 2)
        drive_by(site, list(range(8)), 3)
        turned = next(spot for spot, state in states(site).items() if state == "occupied" and spot != "S0")
        page.wait_for_selector(f'li[data-spot="{turned}"][data-state="occupied"]')
        expect(page.locator("#connection")).to_have_text("Live")
