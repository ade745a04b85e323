"""Pulling models from a server that misbehaves as servers do."""

import hashlib
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from autowaze.vehicle.semantics.model_config import ModelConfig
from autowaze.vehicle.semantics.model_store import ModelStore, PublishedModel, published_models
from autowaze.world.errors import ModelError

CONTENT = bytes(range(256)) * 4096


class Handler(BaseHTTPRequestHandler):
    requests: list[str | None] = []  # noqa: RUF012

    def do_GET(self):
        wanted = self.headers.get("Range")
        self.requests.append(wanted)
        start = int(wanted[len("bytes=") : -1]) if wanted and "/resumable" in self.path else 0
        content = CONTENT[::-1] if "/wrong" in self.path else CONTENT
        self.send_response(206 if start else 200)
        self.send_header("Content-Length", str(len(content) - start))
        self.end_headers()
        first_try = wanted is None and "/broken" in self.path
        self.wfile.write(content[start : len(content) // 2 if first_try else None])

    def log_message(self, *args):
        pass


@pytest.fixture
def server():
    Handler.requests.clear()
    http = HTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=http.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{http.server_port}"
    http.shutdown()
    thread.join()
    http.server_close()


def store(folder, url):
    model = PublishedModel(
        name="small",
        summary="a small model",
        licence="MIT",
        url=url,
        size_bytes=len(CONTENT),
        sha256=hashlib.sha256(CONTENT).hexdigest(),
        config=ModelConfig(layout="yolo-seg"),
    )
    return ModelStore(folder, (model,))


def test_a_pulled_model_is_checked_stored_and_listed(tmp_path, server):
    models = store(tmp_path, f"{server}/model")
    assert models.models()[0].path is None
    seen = []
    path = models.pull("small", lambda done, total: seen.append((done, total)))
    assert path.read_bytes() == CONTENT
    assert seen[-1] == (len(CONTENT), len(CONTENT))
    assert models.models()[0].path == models.path("small") == path
    assert ModelConfig.beside(path).layout == "yolo-seg"
    models.pull("small")
    assert len(Handler.requests) == 1


@pytest.mark.parametrize("place", ["resumable", "not-so"])
def test_a_broken_download_continues(tmp_path, server, place):
    models = store(tmp_path, f"{server}/broken/{place}")
    with pytest.raises(ModelError, match=r"cannot be fetched.*run the command again"):
        models.pull("small")
    assert models.models()[0].path is None
    assert models.pull("small").read_bytes() == CONTENT
    assert Handler.requests == [None, f"bytes={len(CONTENT) // 2}-"]


def test_a_file_that_is_not_the_published_one_is_refused(tmp_path, server):
    with pytest.raises(ModelError, match="is not the published file"):
        store(tmp_path, f"{server}/wrong").pull("small")
    assert not list(tmp_path.iterdir())


def test_offline_says_where_to_put_the_file(tmp_path):
    with pytest.raises(ModelError, match=r"cannot be fetched.*small\.onnx by hand"):
        store(tmp_path, "http://127.0.0.1:9/model").pull("small")


def test_a_model_not_pulled_yet_says_how(tmp_path):
    with pytest.raises(ModelError, match="autowaze models pull small"):
        store(tmp_path, "http://127.0.0.1:9/").path("small")
    with pytest.raises(ModelError, match=r"'other'; there are: small"):
        store(tmp_path, "http://127.0.0.1:9/").path("other")


def test_published_models_are_complete():
    models = published_models()
    assert models
    for model in models:
        assert model.licence
        assert model.config.layout
        assert model.url.startswith("https://")
