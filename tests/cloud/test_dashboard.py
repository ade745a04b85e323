"""The page of the live map, as browsers and programs get it."""

import asyncio

import httpx
import pytest
from fastapi import FastAPI
from serving import assert_problem, running

from autowaze.cloud.api.dashboard import Dashboard, dashboard_routes
from autowaze.cloud.api.problems import answer_with_problems


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    with running(tmp_path_factory.mktemp("dashboard") / "cloud.db") as running_site:
        yield running_site


@pytest.fixture
def built(tmp_path):
    """A page that loads one script, as the build leaves it."""
    (tmp_path / "assets").mkdir()
    (tmp_path / "index.html").write_text('<!doctype html>\n<html lang="en"></html>\n', encoding="utf-8")
    (tmp_path / "assets" / "index-1234.js").write_text("let spots = 1;\n" * 100, encoding="utf-8")
    (tmp_path / "secret.txt").write_text("not for everyone", encoding="utf-8")
    return tmp_path


class Asking:
    """Asks an application without a socket."""

    def __init__(self, app):
        self._app = app

    def get(self, path, headers=None):
        async def ask():
            transport = httpx.ASGITransport(self._app)
            async with httpx.AsyncClient(transport=transport, base_url="http://service") as client:
                return await client.get(path, headers=headers)

        return asyncio.run(ask())


def served(folder, offers=()):
    app = FastAPI()
    dashboard = Dashboard(offers, folder)
    app.include_router(dashboard_routes(dashboard))
    app.add_api_route("/", dashboard.page, response_model=None)
    answer_with_problems(app)
    return Asking(app)


def test_browsers_get_the_page_and_programs_the_links(site):
    page = site.client.get("/", headers={"Accept": "text/html,application/xhtml+xml,*/*;q=0.8"})
    assert page.headers["Content-Type"] == "text/html; charset=utf-8"
    assert page.headers["Cache-Control"] == "no-cache"
    assert "Accept" in page.headers["Vary"]
    for headers in ({}, {"Accept": "application/json"}):
        links = site.client.get("/", headers=headers)
        assert links.json()["title"] == "Autowaze"
        assert "Accept" in links.headers["Vary"]
    assert site.client.get("/?f=json", headers={"Accept": "text/html"}).json()["links"]
    assert "<html" in site.client.get("/?f=html").text


def test_the_page_may_load_nothing_from_elsewhere(site):
    policy = site.client.get("/?f=html").headers["Content-Security-Policy"]
    sources = {part.split()[0]: part.split()[1:] for part in policy.split("; ")}
    assert sources["default-src"] == ["'none'"]
    assert {source for values in sources.values() for source in values} == {"'none'", "'self'", "blob:", "data:"}


def test_the_page_says_what_the_service_offers_to_everyone(built):
    assert '<html data-offers="open streets" lang="en">' in served(built, ("streets", "open")).get("/").text
    assert '<html data-offers="" lang="en">' in served(built).get("/").text


def test_assets_are_kept_for_long_and_sent_small(built):
    client = served(built)
    asset = client.get("/assets/index-1234.js")
    assert asset.text.startswith("let spots")
    assert asset.headers["Content-Type"].startswith("text/javascript")
    assert "immutable" in asset.headers["Cache-Control"]
    assert asset.headers["Content-Encoding"] == "gzip"
    assert int(asset.headers["Content-Length"]) < 200
    again = client.get("/assets/index-1234.js", headers={"If-None-Match": asset.headers["ETag"]})
    assert again.status_code == httpx.codes.NOT_MODIFIED
    assert again.content == b""


@pytest.mark.parametrize("name", ["secret.txt", "..%2Fsecret.txt", "%2e%2e%2findex.html", "x" * 5000])
def test_nothing_but_the_assets_is_served(built, name):
    assert_problem(served(built).get(f"/assets/{name}"), 404, "not_found")


def test_a_package_without_the_page_says_how_to_build_it(tmp_path):
    page = served(tmp_path).get("/")
    assert page.status_code == httpx.codes.OK
    assert "make live-map" in page.text
    assert "/spots.geojson" in page.text
