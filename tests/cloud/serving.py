"""The service behind a real socket, in a thread of the test."""

import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass, field

import httpx
from street import Street

from autowaze.cloud.api import create_app
from autowaze.cloud.api.guard import Guard
from autowaze.cloud.api.server import WebServer, listening_socket
from autowaze.cloud.durable import DurableService
from autowaze.cloud.passes import PassJournal
from autowaze.cloud.service import CloudService
from autowaze.cloud.store import open_store

STREET = Street(count=12)
NOW = 2000.0


@dataclass
class Site:
    """One running service.

    Attributes:
        clock: seconds since the epoch; advance it by setting `now`.
    """

    url: str
    durable: DurableService
    street: Street = STREET
    now: float = NOW
    client: httpx.Client = field(init=False)

    def __post_init__(self):
        self.client = httpx.Client(base_url=self.url, timeout=10)

    def hand_in(self, payload, **headers):
        return self.client.post(
            "/v1/diffs", content=payload, headers={"Content-Type": "application/octet-stream", **headers}
        )


@contextmanager
def running(
    path, tokens=None, limit=None, street=STREET, admit=None, received=lambda: NOW, replays=False, port=0, **parts
):
    """A service in a thread of this process; `received` is its clock for the time of receipt."""
    store = open_store(path)
    journal = PassJournal()
    durable = DurableService(lambda: CloudService(street.parking_map), store, received, admit, journal.note)
    listening = listening_socket("127.0.0.1", port)
    site = Site(f"http://127.0.0.1:{listening.getsockname()[1]}", durable, street)
    app = create_app(
        durable,
        street.parking_map,
        Guard(tokens, limit),
        None if replays else lambda: site.now,
        journal,
        surveyed_at=500.0,
        **parts,
    )
    server = WebServer(app)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
    thread.start()
    while not server.started and thread.is_alive():  # on a new machine it compiles first
        time.sleep(0.01)
    try:
        with site.client:
            yield site
    finally:
        server.stop()
        thread.join(20)
        store.close()
    assert not thread.is_alive()


def assert_problem(response, status, error):
    assert response.status_code == status, response.text
    body = response.json()
    assert body["error"] == error
    assert body["error_description"]
    assert isinstance(body["error_details"], list)
