"""A running service, and drives to feed it."""

import subprocess
import time
from dataclasses import replace

import pytest
from postgres_server import PostgresServer
from serving import STREET, running

from autowaze.world.wire import encode_diff


@pytest.fixture
def site(tmp_path):
    with running(tmp_path / "cloud.db") as site:
        yield site


@pytest.fixture(scope="session")
def certificate(tmp_path_factory):
    """A key and a certificate for localhost that signs itself."""
    folder = tmp_path_factory.mktemp("tls")
    command = "openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2 -subj /CN=localhost"
    names = ["-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"]
    files = ["-keyout", str(folder / "key.pem"), "-out", str(folder / "cert.pem")]
    subprocess.run([*command.split(), *names, *files], check=True, capture_output=True)
    return folder / "cert.pem", folder / "key.pem"


@pytest.fixture(scope="session")
def diffs():
    return STREET.drive(STREET.park([0, 2, 5, 9]))


@pytest.fixture(scope="session")
def payloads(diffs):
    return [encode_diff(diff) for diff in diffs]


@pytest.fixture(scope="session")
def passes(diffs):
    """Many small diffs, as if cars passed one after the other."""

    def later(diff, session):
        path = replace(diff.trajectory, time=diff.trajectory.time + session)
        start, end = diff.start + session, diff.end + session
        return replace(diff, session=session, start=start, end=end, new=diff.new[:0], trajectory=path)

    return [encode_diff(later(diff, session)) for session in range(1, 21) for diff in diffs]


@pytest.fixture(scope="session")
def server():
    """A PostgreSQL server with PostGIS; whoever stops it starts it again."""
    server = PostgresServer()
    yield server
    server.remove()


@pytest.fixture(params=["sqlite", "postgres"])
def address(request, tmp_path):
    """Of an empty store, of either kind."""
    if request.param == "sqlite":
        return tmp_path / "cloud.db"
    return request.getfixturevalue("server").make(f"cloud_{time.monotonic_ns()}")
