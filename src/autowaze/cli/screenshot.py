"""A picture of a page, taken by a Chromium that nobody sees."""

from __future__ import annotations

import base64
import itertools
import json
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect

from autowaze.world.errors import AutowazeError, DependencyError

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
MAP_IS_DRAWN = "document.querySelector('#map')?.dataset.version !== undefined"
PATIENCE_S = 60.0
SETTLE_S = 2.0
"""After the page says that it is ready: what fades in and slides into place."""
_LARGEST_MESSAGE = 64 << 20
_SWITCHES = (
    "--headless",
    "--no-sandbox",  # containers seldom allow it, and the page is our own
    "--use-gl=angle",
    "--use-angle=swiftshader",  # without a graphics card WebGL is drawn by the processor
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--hide-scrollbars",
    "--remote-debugging-port=0",
)


def take_screenshot(
    url: str,
    path: str | Path,
    size: tuple[int, int] = (1280, 800),
    dark: bool = False,
    script: str = "",
    ready: str = MAP_IS_DRAWN,
) -> None:
    """Write a PNG of a page as a browser shows it, WebGL included, with or without a graphics card.

    Args:
        size: of the window, CSS pixels; below 600 wide it is a phone with two device pixels to each of them.
        dark: whether the browser prefers dark colours.
        script: JavaScript to run before the picture, once the page is ready.
        ready: JavaScript that is true when the page is ready.

    Raises:
        DependencyError: there is no Chromium.
        AutowazeError: the browser did not start, or the page was not ready within a minute.
    """
    with _browser() as address, connect(address, max_size=_LARGEST_MESSAGE) as connection:
        tab = _Tab(connection)
        phone = size[0] < 600
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 2 if phone else 1, "mobile": phone}
        tab.ask("Emulation.setDeviceMetricsOverride", **metrics)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        tab.ask("Emulation.setEmulatedMedia", features=[scheme])
        failure = tab.ask("Page.navigate", url=url).get("errorText")
        if failure:
            raise AutowazeError(f"{url}: the browser cannot load it: {failure}")
        tab.wait_for(ready, url)
        if script:
            tab.evaluate(script)
        time.sleep(SETTLE_S)
        picture = base64.b64decode(tab.ask("Page.captureScreenshot", format="png")["data"])
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(picture)
    except OSError as error:
        raise AutowazeError(f"{path}: cannot be written: {error.strerror}") from error


class _Tab:
    """One tab, by the Chrome DevTools protocol."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        self._numbers = itertools.count(1)

    def ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The answer to one command; events in between are passed over."""
        number = next(self._numbers)
        try:
            self._connection.send(json.dumps({"id": number, "method": method, "params": parameters}))
            while True:
                message = json.loads(self._connection.recv(PATIENCE_S))
                if message.get("id") == number:
                    break
        except (WebSocketException, TimeoutError, OSError) as error:
            raise AutowazeError(f"the browser does not answer {method}: {error}") from error
        if "error" in message:
            raise AutowazeError(f"the browser refuses {method}: {message['error'].get('message')}")
        result: dict[str, Any] = message["result"]
        return result

    def evaluate(self, expression: str) -> Any:
        """The value of some JavaScript."""
        answer = self.ask("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            raise AutowazeError(f"the page fails at {expression!r}: {answer['exceptionDetails'].get('text')}")
        return answer["result"].get("value")

    def wait_for(self, condition: str, url: str) -> None:
        """Wait until some JavaScript is true."""
        deadline = time.monotonic() + PATIENCE_S
        while not self.evaluate(condition):
            if time.monotonic() > deadline:
                raise AutowazeError(f"{url}: the page was not ready within {PATIENCE_S:g} s; is the live map built?")
            time.sleep(0.2)


@contextmanager
def _browser() -> Iterator[str]:
    """A browser with one empty tab; yields the tab's address."""
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        raise DependencyError("no Chromium to take a picture with: install Debian's package chromium")
    # Chromium's helpers may write to the profile a moment longer than it lives.
    with tempfile.TemporaryDirectory(prefix="autowaze-browser-", ignore_cleanup_errors=True) as profile:
        command = [program, *_SWITCHES, f"--user-data-dir={profile}", "about:blank"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            yield _tab_address(Path(profile) / "DevToolsActivePort", process)
        finally:
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _tab_address(port_file: Path, process: subprocess.Popen[bytes]) -> str:
    """Where the first tab listens, when it does."""
    from urllib.request import urlopen

    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline and process.poll() is None:
        try:
            port = port_file.read_text(encoding="ascii").split()[0]
            with urlopen(f"http://127.0.0.1:{port}/json/list", timeout=5) as answer:
                tabs = [target for target in json.load(answer) if target["type"] == "page"]
            if tabs:
                return str(tabs[0]["webSocketDebuggerUrl"])
        except (OSError, IndexError, ValueError):
            pass
        time.sleep(0.1)
    raise AutowazeError("Chromium did not start: run `chromium --headless --no-sandbox about:blank` to see why")
