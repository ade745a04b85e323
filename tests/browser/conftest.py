"""A browser, and a service with a street in it."""

import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from block import STREET, surroundings
from playwright.sync_api import sync_playwright
from serving import running

CHROMIUM = "/usr/bin/chromium"
SOFTWARE_GL = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
PAGE = Path(__file__).parents[2] / "src" / "autowaze" / "cloud" / "dashboard" / "index.html"


@pytest.fixture(scope="module")
def browser():
    assert Path(CHROMIUM).exists(), "these tests drive Debian's Chromium: make system"
    assert PAGE.exists(), "the live map is not built: make live-map"
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE_GL)
        yield chromium
        chromium.close()


@pytest.fixture
def serving(tmp_path):
    """Runs a service whose clock is the wall's, as a context."""

    @contextmanager
    def service(**parts):
        with running(tmp_path / "cloud.db", received=time.time, streets=surroundings(), street=STREET, **parts) as site:
            site.now = time.time()
            yield site

    return service


@pytest.fixture
def serve(serving):
    """Runs one until the test and its pages are done."""
    with ExitStack() as stack:
        yield lambda **parts: stack.enter_context(serving(**parts))


@pytest.fixture
def open_page(browser):
    """Opens the live map of a service; at the end of the test nothing may have gone wrong in the page."""
    contexts, complaints = [], []

    def opened(site, path="/", *, forgiven="", size=(1100, 720), **options):
        context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **options)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(15_000)

        def note(text):
            if not (forgiven and forgiven in text):
                complaints.append(text)

        page.on("console", lambda m: note(f"{m.type}: {m.text}") if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: note(str(error)))
        page.goto(site.url + path)
        page.wait_for_selector('#connection[data-state="open"]')
        page.wait_for_selector("#map[data-version]")
        return page

    yield opened
    for context in contexts:
        context.close()
    assert complaints == []
