"""A PostgreSQL server of our own, in a temporary folder, reached by a Unix socket; no other cluster is touched."""

import os
import pwd
import shutil
import subprocess
import tempfile
from pathlib import Path

BINARIES = Path(os.environ.get("AUTOWAZE_POSTGRES_BIN", "/usr/lib/postgresql/15/bin"))
NOBODY = "postgres"
"""PostgreSQL refuses to run as root; Debian's package makes this user."""


class PostgresServer:
    """Runs from when it is made until it is removed; with `durable` it syncs to disk, as in operation."""

    def __init__(self, durable: bool = False) -> None:
        if not (BINARIES / "initdb").exists():
            raise RuntimeError(f"{BINARIES}: no PostgreSQL 15 there: make system, or set AUTOWAZE_POSTGRES_BIN")
        self.folder = Path(tempfile.mkdtemp(prefix="autowaze-postgres-"))
        if os.geteuid() == 0:
            shutil.chown(self.folder, NOBODY)
        self._data = self.folder / "data"
        self._run(
            "initdb", "--no-sync", "--auth=trust", "--username=cars", "--encoding=UTF8", "--no-locale", self._data
        )
        settings = ["listen_addresses = ''", f"unix_socket_directories = '{self.folder}'", "max_connections = 40"]
        if not durable:
            settings += ["fsync = off", "full_page_writes = off"]
        with (self._data / "postgresql.conf").open("a") as file:
            file.write("\n".join(["", *settings, ""]))
        self.start()

    def url(self, database: str) -> str:
        return f"postgresql://cars@/{database}?host={self.folder}"

    def make(self, database: str) -> str:
        """A new database; returns its URL."""
        self._run("createdb", "--host", self.folder, "--username=cars", database)
        return self.url(database)

    def start(self) -> None:
        self._run("pg_ctl", "start", "--wait", "--silent", "-D", self._data, "-l", self.folder / "log")

    def stop(self, mode: str = "immediate") -> None:
        self._run("pg_ctl", "stop", "--wait", "--silent", "-D", self._data, "-m", mode)

    def remove(self) -> None:
        self.stop()
        shutil.rmtree(self.folder)

    def _run(self, binary: str, *arguments: object) -> None:
        command = [str(BINARIES / binary), *map(str, arguments)]
        as_nobody = {}
        if os.geteuid() == 0:
            entry = pwd.getpwnam(NOBODY)
            as_nobody = {"user": entry.pw_uid, "group": entry.pw_gid, "extra_groups": []}
        subprocess.run(command, check=True, cwd="/", stdout=subprocess.DEVNULL, **as_nobody)
