"""Chromium without a window, driven over a pair of pipes (DevTools protocol), for tests."""

import atexit
import base64
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
OPTIONS = ("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--hide-scrollbars")
_TIMEOUT_S = 5
_OF_THE_DRIVER = "GL Driver Message"
"""Stands in what a graphics driver says of its own speed; no page causes that."""


def chromium() -> str | None:
    """Return the program; None where there is none."""
    return next((found for name in PROGRAMS if (found := shutil.which(name))), None)


class Program:
    """A running browser, and the pipes by which all its pages are driven."""

    def __init__(self, *, webgl: bool) -> None:
        program = chromium()
        assert program is not None
        to_browser, self._commands = os.pipe()
        self._answers, from_browser = os.pipe()
        self._profile = tempfile.mkdtemp(prefix="wil-browser-")
        # The protocol is spoken on descriptors 3 and 4, wherever ours are.
        line = f'exec "$0" "$@" 3<&{to_browser} 4>&{from_browser}'
        options = [*OPTIONS, "--enable-unsafe-swiftshader" if webgl else "--disable-3d-apis"]
        arguments = [*options, "--remote-debugging-pipe", f"--user-data-dir={self._profile}"]
        self._process = subprocess.Popen(  # noqa: S603 - a browser of this machine
            ["/bin/bash", "-c", line, program, *arguments],
            pass_fds=(to_browser, from_browser),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._buffer = b""
        self._count = 0
        self.pages: dict[str, Page] = {}

    @property
    def is_running(self) -> bool:
        return self._process.poll() is None

    def send(self, method: str, session: str | None = None, **parameters: Any) -> dict[str, Any]:
        """Send a command and return its answer; events on the way are noted."""
        self._count += 1
        message: dict[str, Any] = {"id": self._count, "method": method, "params": parameters}
        if session is not None:
            message["sessionId"] = session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while (answer := self._receive()).get("id") != self._count:
            self._note(answer)
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']}")
        found: dict[str, Any] = answer["result"]
        return found

    def receive_event(self) -> None:
        """Wait for an event, and have its page note it."""
        self._note(self._receive())

    def close(self) -> None:
        """End the browser."""
        with suppress(OSError, RuntimeError):
            os.write(self._commands, b'{"id": 0, "method": "Browser.close"}\0')
        os.close(self._commands)
        try:
            self._process.wait(_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        os.close(self._answers)
        for _ in range(_TIMEOUT_S * 10):  # processes of its own may still write there
            shutil.rmtree(self._profile, ignore_errors=True)
            if not Path(self._profile).exists():
                break
            time.sleep(0.1)

    def _note(self, event: dict[str, Any]) -> None:
        if (page := self.pages.get(event.get("sessionId", ""))) is not None:
            page.note(event)

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            data = os.read(self._answers, 1 << 20)
            if not data:
                raise RuntimeError("chromium has ended")
            self._buffer += data
        line, _, self._buffer = self._buffer.partition(b"\0")
        found: dict[str, Any] = json.loads(line)
        return found


class Page:
    """One tab. errors: of its console and its scripts. requests: what it asked for, but itself."""

    def __init__(self, program: Program, context: str) -> None:
        self._program = program
        self.context = context
        self._loaded = 0
        self.errors: list[str] = []
        self.requests: list[str] = []
        where = {"url": "about:blank", "browserContextId": context}
        target = program.send("Target.createTarget", **where)["targetId"]
        attached = program.send("Target.attachToTarget", targetId=target, flatten=True)
        self.session: str = attached["sessionId"]
        program.pages[self.session] = self
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Send a command about this tab and return its answer."""
        return self._program.send(method, self.session, **parameters)

    def open(self, url: str) -> None:
        """Open a page and wait until it is loaded."""
        before = self._loaded
        self.send("Page.navigate", url=url)
        while self._loaded == before:
            self._program.receive_event()

    def value(self, script: str) -> Any:
        """Return what an expression comes to."""
        found = self.send("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def press(self, key: str) -> None:
        """Press a key."""
        for kind in ("keyDown", "keyUp"):
            text = {"text": key} if len(key) == 1 and kind == "keyDown" else {}
            self.send("Input.dispatchKeyEvent", type=kind, key=key, **text)

    def settle(self) -> None:
        """Let the page draw, and take what it says meanwhile."""
        script = "new Promise((done) => requestAnimationFrame(() => setTimeout(done, 50)))"
        self.send("Runtime.evaluate", expression=script, awaitPromise=True)

    def resize(self, width_px: int, height_px: int, *, dark: bool = False) -> None:
        """Show the page on a screen of this size."""
        size = {"width": width_px, "height": height_px, "deviceScaleFactor": 1}
        self.send("Emulation.setDeviceMetricsOverride", **size, mobile=width_px < 600)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.send("Emulation.setEmulatedMedia", features=[scheme])

    def screenshot(self, path: Path, *, whole: bool = False) -> None:
        """Write what is seen, or the whole page, as PNG."""
        shot = self.send("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(shot["data"]))

    def note(self, event: dict[str, Any]) -> None:
        """Note what the browser says of this tab."""
        method, about = event.get("method"), event.get("params", {})
        if method == "Page.loadEventFired":
            self._loaded += 1
        elif method == "Runtime.exceptionThrown":
            self.errors.append(str(about["exceptionDetails"]))
        elif method == "Runtime.consoleAPICalled" and about["type"] in {"error", "warning"}:
            self.errors.append(str(about["args"]))
        elif method == "Log.entryAdded" and about["entry"]["level"] in {"error", "warning"}:
            if _OF_THE_DRIVER not in about["entry"]["text"]:
                self.errors.append(str(about["entry"]["text"]))
        elif method == "Network.requestWillBeSent" and about["type"] != "Document":
            self.requests.append(about["request"]["url"])


_running: dict[bool, Program] = {}
"""The browsers of this process, one with WebGL and one without: each takes 2 s of the processor to
start."""


@contextmanager
def browser(*, webgl: bool = False) -> Iterator[Page]:
    """Open a page that shares no cookies, cache or storage with others, and close it.

    webgl: have it, drawn in software.
    """
    program = _running.get(webgl)
    if program is None or not program.is_running:
        program = _running[webgl] = Program(webgl=webgl)
        atexit.register(program.close)
    context = program.send("Target.createBrowserContext")["browserContextId"]
    try:
        yield Page(program, context)
    finally:
        program.pages = {
            session: page for session, page in program.pages.items() if page.context != context
        }
        with suppress(OSError, RuntimeError):
            program.send("Target.disposeBrowserContext", browserContextId=context)
