"""The live map for everyone: small screens, keyboards, screen readers, light and dark."""

from pathlib import Path

import pytest
from block import drive_by, looking_at, picture
from playwright.sync_api import expect

AXE = Path(__file__).parents[2] / "live-map" / "node_modules" / "axe-core" / "axe.min.js"
TABS = ("find", "spots", "activity", "service", "draw")


@pytest.fixture
def town(serve):
    site = serve()
    drive_by(site, [0, 1, 4], 1)
    return site


def violations(page):
    found = page.evaluate("() => axe.run(document, {resultTypes: ['violations']})")["violations"]
    return [(v["id"], [node["html"][:200] + node["failureSummary"] for node in v["nodes"]]) for v in found]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_to_complain_about(town, open_page, scheme):
    page = open_page(town, color_scheme=scheme)
    page.evaluate(AXE.read_text(encoding="utf-8"))
    page.click("#tab-spots")
    page.click('li[data-spot="S2"] button')
    for tab in TABS:
        page.click(f"#tab-{tab}")
        if tab == "find":
            page.click("text=Search from the middle of the map")
            expect(page.locator(".results button").first).to_be_visible()
        if tab == "draw":
            page.click("text=Put one in the middle")
        assert violations(page) == [], f"{tab}, {scheme}"


def test_everything_is_in_reach_at_360_pixels(town, open_page):
    page = open_page(town, size=(360, 640), has_touch=True, is_mobile=True, device_scale_factor=2)
    assert page.locator("#map").bounding_box()["height"] > 180
    for tab in TABS:
        page.tap(f"#tab-{tab}")
        assert page.evaluate("document.documentElement.scrollWidth") <= 360
        for control in page.locator("button:visible, select:visible, input:visible").all():
            if control.evaluate("e => e.offsetWidth <= 1 || getComputedStyle(e).opacity === '0'"):
                continue  # shown by its label
            control.scroll_into_view_if_needed()
            box = control.bounding_box()
            what = control.evaluate("e => e.outerHTML.slice(0, 120)")
            assert box["x"] >= 0, what
            assert box["x"] + box["width"] <= 360, what
            assert box["width"] >= 24 or "checkbox" in what, what
    page.tap("#tab-spots")
    page.tap('li[data-spot="S3"] button')
    expect(page.locator(".card h2")).to_be_in_viewport()


def test_the_keyboard_alone_is_enough(town, open_page):
    page = open_page(town, looking_at(3))
    page.keyboard.press("Tab")
    expect(page.locator(".skip")).to_be_focused()
    assert page.locator(".skip").bounding_box()["y"] >= 0
    page.keyboard.press("Enter")
    page.keyboard.press("Tab")
    expect(page.locator("#tab-find")).to_be_focused()
    page.keyboard.press("ArrowRight")
    expect(page.locator("#tab-spots")).to_be_focused()
    expect(page.locator("#panel-spots")).to_be_visible()
    page.keyboard.press("Tab")
    page.keyboard.type("S6")
    expect(page.locator("li[data-spot]")).to_have_count(1)
    for _ in range(4):
        page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.closest('li')?.dataset.spot") == "S6"
    outline = page.evaluate("getComputedStyle(document.activeElement).outlineWidth")
    assert outline == "3px"
    page.keyboard.press("Enter")
    expect(page.locator(".card h2")).to_have_text("Spot S6")
    page.wait_for_timeout(900)
    page.focus("#map canvas")
    expect(page.locator("#crosshair")).to_have_css("opacity", "1")
    page.click('[data-action="close"]')
    page.focus("#map canvas")
    page.keyboard.press("Enter")
    expect(page.locator(".card h2")).to_have_text("Spot S6")
    page.focus("#scrub")
    page.keyboard.press("Home")
    page.wait_for_selector('#connection[data-state="replay"]')
    assert page.get_attribute("#scrub", "aria-valuetext") != "Now"
    page.focus("#back-to-live")
    page.keyboard.press("Enter")
    page.wait_for_selector('#connection[data-state="open"]')


def test_dark_is_dark_and_stays_as_chosen(town, open_page):
    page = open_page(town, color_scheme="dark")
    brightness = "getComputedStyle(document.querySelector('.bar')).backgroundColor.match(/\\d+/g).map(Number)"
    assert max(page.evaluate(brightness)) < 60
    assert picture(page).mean() < 70
    page.click("#theme")
    assert min(page.evaluate(brightness)) > 200
    page.wait_for_timeout(500)
    assert picture(page).mean() > 180
    page.reload()
    page.wait_for_selector("#map[data-version]")
    assert min(page.evaluate(brightness)) > 200


def test_nothing_moves_by_itself_for_those_who_want_calm(town, open_page):
    page = open_page(town, reduced_motion="reduce")
    page.click("#tab-spots")
    page.click('li[data-spot="S7"] button')
    page.wait_for_timeout(300)
    assert page.evaluate("document.getAnimations().filter(a => a.playState === 'running').length") == 0
