"""MQTT brokers of the tests' own, each in a process, on a free port."""

import os
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

from autowaze.world.broker import BrokerAddress

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
