"""The live map: its page and the files that the page loads, as `make` built them into the package."""

from __future__ import annotations

import gzip
import hashlib
import mimetypes
from collections.abc import Collection
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path
from typing import Annotated

from fastapi import APIRouter, Header, Request, Response

from autowaze.cloud.api.problems import ProblemError, problems

BUILT = Path(__file__).parent.parent / "dashboard"
PAGE_POLICY = "; ".join(
    [
        "default-src 'none'",
        "script-src 'self'",
        "worker-src 'self' blob:",
        "style-src 'self'",
        "img-src 'self' data: blob:",
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    ]
)
"""Nothing is loaded from elsewhere; MapLibre draws icons from data and starts its worker from a blob."""
_YEAR_S = 365 * 24 * 3600
_FOREVER = f"public, max-age={_YEAR_S}, immutable"  # a file's name has the hash of what is in it
_TYPES = {".js": "text/javascript", ".mjs": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
_NOT_BUILT = b"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Autowaze</title>
<h1>The live map is not built</h1>
<p>The service runs. Its live map was not built when this package was installed from sources: run
<code>make live-map</code> in the checkout (it needs Node.js 20.19 or newer) and load this page again.</p>
<p>The same spots: <a href="/spots.geojson">/spots.geojson</a>; everything else: <a href="/?f=json">/?f=json</a>.</p>
</html>
"""


@dataclass(frozen=True)
class _File:
    plain: bytes
    packed: bytes
    media_type: str
    tag: str

    @classmethod
    def of(cls, body: bytes, media_type: str) -> _File:
        tag = f'"{hashlib.sha256(body).hexdigest()[:16]}"'
        return cls(body, gzip.compress(body, compresslevel=9, mtime=0), media_type, tag)

    def answer(self, request: Request, headers: dict[str, str]) -> Response:
        headers = {"ETag": self.tag, **headers}
        if request.headers.get("if-none-match") == self.tag:
            return Response(status_code=HTTPStatus.NOT_MODIFIED, headers=headers)
        packed = "gzip" in request.headers.get("accept-encoding", "") and len(self.packed) < len(self.plain)
        if packed:
            headers["Content-Encoding"] = "gzip"
        return Response(self.packed if packed else self.plain, media_type=self.media_type, headers=headers)


class Dashboard:
    """The built files, read when they are first asked for.

    Args:
        offers: what this service has for everyone, so that the page does not ask for what it would be refused:
            `streets`, `open` if nothing needs a token.
        folder: where `make live-map` put them.
    """

    def __init__(self, offers: Collection[str] = (), folder: Path = BUILT) -> None:
        self._folder = folder
        self._offers = f'<html data-offers="{" ".join(sorted(offers))}"'.encode()
        self._page: _File | None = None
        self._assets: dict[str, _File] | None = None

    def page(self, request: Request) -> Response:
        """The page, or how to build it."""
        if self._page is None and (self._folder / "index.html").is_file():
            built = (self._folder / "index.html").read_bytes()
            self._page = _File.of(built.replace(b"<html", self._offers, 1), "text/html")
        headers = {"Cache-Control": "no-cache", "Content-Security-Policy": PAGE_POLICY, "Vary": "Accept"}
        page = self._page or _File.of(_NOT_BUILT, "text/html")
        return page.answer(request, headers)

    def asset(self, request: Request, name: str) -> Response:
        """One of the files beside it; raises `ProblemError` 404 for others."""
        if self._assets is None:
            self._assets = {
                path.name: _File.of(path.read_bytes(), _media_type(path))
                for path in sorted(self._folder.glob("assets/*"))
                if path.is_file()
            }
        found = self._assets.get(name)
        if found is None:
            raise ProblemError(HTTPStatus.NOT_FOUND, "not_found", f"there is no file {name[:100]!r}")
        # A worker has the policy of its own file, not that of the page.
        return found.answer(request, {"Cache-Control": _FOREVER, "Content-Security-Policy": PAGE_POLICY})


def wants_page(request: Request) -> bool:
    """Whether who asks is a browser that shows pages, rather than a program that reads JSON."""
    if "f" in request.query_params:  # as other OGC services have it
        return request.query_params["f"] == "html"
    return "text/html" in request.headers.get("accept", "")


def dashboard_routes(dashboard: Dashboard) -> APIRouter:
    """`/assets/...`; the page itself is the landing page's other form."""
    router = APIRouter(tags=["live map"])

    @router.get(
        "/assets/{name}",
        response_class=Response,
        responses={
            200: {"content": {"*/*": {}}, "description": "A file of the live map"},
            304: {"description": "Not modified"},
            **problems(HTTPStatus.NOT_FOUND),
        },
    )
    async def asset(
        request: Request, name: str, if_none_match: Annotated[str | None, Header(max_length=200)] = None
    ) -> Response:
        """A file of the live map; its name changes with what is in it."""
        return dashboard.asset(request, name)

    return router


def _media_type(path: Path) -> str:
    return _TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
