"""Chromium without a screen, driven through chromedriver over plain HTTP: what a page logs, and what it asks for."""

import base64
import json
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import Request, urlopen

FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)


def missing() -> str:
    """Return what is missing for a browser test, in words; empty where nothing is."""
    absent = [name for name in ("chromium", "chromedriver") if shutil.which(name) is None]
    return f"{' and '.join(absent)} not installed" if absent else ""


class Page:
    """An open page."""

    def __init__(self, base: str, session: str) -> None:
        self._base, self._session = base, session

    def _call(self, method: str, path: str, body: Any = None) -> Any:
        return call(f"{self._base}/session/{self._session}/{path}", method, body)

    def open(self, path: Path) -> float:
        """Open a file and return how many seconds it took until its script had run."""
        self._call("POST", "url", {"url": "about:blank"})
        self._call("POST", "se/log", {"type": "performance"})  # what the browser's own first page asked for
        start = time.perf_counter()
        self._call("POST", "url", {"url": path.absolute().as_uri()})
        while self.run("return document.documentElement.dataset.ready") != "1":
            assert time.perf_counter() - start < 60.0, "the page's script did not come to its end"
            time.sleep(0.05)
        return time.perf_counter() - start

    def run(self, script: str) -> Any:
        """Return what a script returns."""
        return self._call("POST", "execute/sync", {"script": script, "args": []})

    def errors(self) -> list[str]:
        """Return what was logged as an error since the last call."""
        entries = self._call("POST", "se/log", {"type": "browser"})
        return [entry["message"] for entry in entries if entry["level"] == "SEVERE"]

    def requests(self) -> list[str]:
        """Return every address that was asked for over a network, since the last call."""
        found = []
        for entry in self._call("POST", "se/log", {"type": "performance"}):
            message = json.loads(entry["message"])["message"]
            if message["method"] in ("Network.requestWillBeSent", "Network.webSocketCreated"):
                found.append(message["params"].get("request", message["params"])["url"])
        return [url for url in found if not url.startswith(("file:", "data:", "blob:"))]

    def devtools(self, command: str, parameters: dict[str, Any]) -> Any:
        """Return what a command of the devtools protocol returns."""
        return self._call("POST", "goog/cdp/execute", {"cmd": command, "params": parameters})

    def screenshot(self, path: Path, *, selector: str = "") -> None:
        """Write a picture of the whole page, or of one element."""
        clip = {}
        if selector:
            box = self.run(
                f"const r = document.querySelector({json.dumps(selector)}).getBoundingClientRect();"
                "return {x: r.x + scrollX, y: r.y + scrollY, width: r.width, height: r.height, scale: 1}"
            )
            clip = {"clip": box}
        taken = self.devtools(
            "Page.captureScreenshot", {"captureBeyondViewport": True, **clip} if clip else self._whole()
        )
        path.write_bytes(base64.b64decode(taken["data"]))

    def _whole(self) -> dict[str, Any]:
        width, height = self.run("return [innerWidth, document.documentElement.scrollHeight]")
        clip = {"x": 0, "y": 0, "width": width, "height": height, "scale": 1}
        return {"captureBeyondViewport": True, "clip": clip}


def call(url: str, method: str, body: Any = None) -> Any:
    """Return the value of one answer of chromedriver."""
    data = None if body is None else json.dumps(body).encode()
    request = Request(url, data, {"Content-Type": "application/json"}, method=method)
    with urlopen(request, timeout=120) as answer:
        return json.load(answer)["value"]


@contextmanager
def browser(folder: Path, *, width: int = 1280, height: int = 900, flags: tuple[str, ...] = FLAGS) -> Iterator[Page]:
    """Yield a page of a fresh browser; `folder` is empty and holds its profile."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with subprocess.Popen(
        ["chromedriver", f"--port={port}"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as driver:
        try:
            base = f"http://127.0.0.1:{port}"
            _wait(base)
            options = {
                "binary": shutil.which("chromium"),
                "args": [*flags, f"--user-data-dir={folder}", f"--window-size={width},{height}"],
            }
            logs = {"browser": "ALL", "performance": "ALL"}
            wanted = {"alwaysMatch": {"goog:chromeOptions": options, "goog:loggingPrefs": logs}}
            session = call(f"{base}/session", "POST", {"capabilities": wanted})["sessionId"]
            try:
                yield Page(base, session)
            finally:
                call(f"{base}/session/{session}", "DELETE")
        finally:
            driver.terminate()


def _wait(base: str) -> None:
    for _ in range(200):
        try:
            if call(f"{base}/status", "GET")["ready"]:
                return
        except (URLError, ConnectionError):
            time.sleep(0.05)
    raise AssertionError("chromedriver did not start")
