"""MQTT brokers of the tests' own, each in a process, on a free port."""

import os
import shutil
import signal
import socket
import subprocess
import time
from dataclasses import replace
from pathlib import Path

from autowaze.world.broker import BrokerAddress

DOCS = Path(__file__).parents[2] / "docs" / "brokers"
PATH = os.pathsep.join((os.environ.get("PATH", ""), "/usr/sbin", "/usr/local/sbin"))


class Broker:
    """A broker that can be killed and started again at the same address."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.folder = folder
        self.process = None

    @property
    def address(self) -> BrokerAddress:
        return BrokerAddress("127.0.0.1", self.port)

    @property
    def url(self) -> str:
        return str(self.address)

    def start(self) -> None:
        program = shutil.which(self.program, path=PATH)
        assert program, f"{self.program} is missing: make system"
        command = [program, "-c", self.configuration()]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + 20
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port), 1).close()
                return
            except OSError:
                assert time.monotonic() < deadline, f"{self.program} does not start"
                time.sleep(0.02)

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def stop(self) -> None:
        if self.process is not None:
            self.process.terminate()
            self.process.wait(20)


class Mosquitto(Broker):
    program = "mosquitto"

    def configuration(self, *lines: str) -> Path:
        path = self.folder / "mosquitto.conf"
        default = (f"listener {self.port} 127.0.0.1", "allow_anonymous true", "user root", "set_tcp_nodelay true")
        path.write_text("\n".join(lines or default) + "\n")
        return path


class Nats(Broker):
    program = "nats-server"

    def configuration(self) -> Path:
        path = self.folder / "nats.conf"
        path.write_text(
            f'server_name: test\nhost: "127.0.0.1"\nport: -1\njetstream {{ store_dir: "{self.folder}/jetstream" }}\n'
            f'mqtt {{ host: "127.0.0.1", port: {self.port} }}\n'
        )
        return path


class Guarded(Broker):
    """As the documentation sets it up.

    Args:
        certificate: chain and key, PEM files.
    """

    def __init__(self, folder: Path, certificate: tuple[Path, Path]) -> None:
        super().__init__(folder)
        self.certificate, self.key = certificate

    @property
    def address(self) -> BrokerAddress:
        return BrokerAddress("127.0.0.1", self.port, tls=True)

    def address_for(self, user: str) -> BrokerAddress:
        return replace(self.address, username=user, password=f"secret of {user}")


class GuardedMosquitto(Guarded, Mosquitto):
    def configuration(self) -> Path:
        passwords = self.folder / "passwords"
        passwords.touch(mode=0o600)
        for user in ("service", "car"):
            tool = shutil.which("mosquitto_passwd", path=PATH)
            subprocess.run([tool, "-b", passwords, user, f"secret of {user}"], check=True, capture_output=True)
        lines = (DOCS / "mosquitto.conf").read_text().splitlines()
        lines = [line for line in lines if not line.startswith("listener")]
        places = {
            "/etc/mosquitto/passwords": str(passwords),
            "/etc/mosquitto/certs/fullchain.pem": str(self.certificate),
            "/etc/mosquitto/certs/privkey.pem": str(self.key),
            "/etc/mosquitto": str(DOCS),
        }
        text = "\n".join([f"listener {self.port} 127.0.0.1", "user root", *lines])
        for there, here in places.items():
            text = text.replace(there, here)
        return super().configuration(text)


class GuardedNats(Guarded, Nats):
    def configuration(self) -> Path:
        text = (DOCS / "nats-server.conf").read_text()
        text = text.replace("port: 8883", f'host: "127.0.0.1", port: {self.port}')
        text = text.replace("/etc/nats/fullchain.pem", str(self.certificate))
        text = text.replace("/etc/nats/privkey.pem", str(self.key))
        text = text.replace("/var/lib/nats", str(self.folder / "jetstream"))
        text = text.replace('"change-me"', '"secret of service"').replace('"change-me-too"', '"secret of car"')
        path = self.folder / "nats.conf"
        path.write_text(f'host: "127.0.0.1"\nport: -1\n{text}')
        return path
