"""A headless Chromium, spoken to over pipes in its DevTools protocol; nothing but the browser is needed."""

import base64
import io
import itertools
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PIL import Image

_LONGEST = 180_000  # ms, of a wait
_NAMES = "chromium", "chromium-browser", "google-chrome"
_FLAGS = (
    *("--headless", "--no-sandbox", "--no-first-run", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--disable-quic", "--hide-scrollbars", "--remote-debugging-pipe"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
)
_START = """
import fcntl, os, sys
reading, writing = (fcntl.fcntl(int(number), fcntl.F_DUPFD, 10) for number in sys.argv[1:3])
os.dup2(reading, 3), os.dup2(writing, 4)
os.execvp(sys.argv[3], sys.argv[3:])
"""  # the protocol's pipes are the numbers 3 and 4


class Chromium:
    """A tab of Chromium. Use it as a context manager. Raises ``FileNotFoundError`` without Chromium."""

    def __init__(self) -> None:
        program = next(filter(None, map(shutil.which, _NAMES)), None)
        if program is None:
            raise FileNotFoundError(f"no {_NAMES[0]} on this machine")
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        read_here, write_there = os.pipe()
        read_there, write_here = os.pipe()
        words = [program, *_FLAGS, f"--user-data-dir={self._profile.name}", "about:blank"]
        command = [sys.executable, "-c", _START, str(read_there), str(write_there), *words]
        self._process = subprocess.Popen(
            command, pass_fds=(read_there, write_there), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.close(read_there)
        os.close(write_there)
        self._answers = os.fdopen(read_here, "rb")
        self._orders = os.fdopen(write_here, "wb")
        self._numbers = itertools.count(1)
        self._rest = b""  # received after the last whole message
        self._session = ""
        self.events: list[dict[str, Any]] = []

    def __enter__(self) -> "Chromium":
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send(f"{domain}.enable")
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None):
        self._process.kill()
        self._process.wait()
        self._answers.close()
        self._orders.close()
        self._profile.cleanup()

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Execute a command and return its result; events that come before it are kept."""
        number = next(self._numbers)
        order = {"id": number, "method": method, "params": parameters}
        self._orders.write(json.dumps(order | ({"sessionId": self._session} if self._session else {})).encode() + b"\0")
        self._orders.flush()
        while True:
            message = self._receive()
            if message.get("id") == number:
                assert "error" not in message, (method, message["error"])
                return message["result"]
            self.events.append(message)

    def evaluate(self, script: str, context: int | None = None) -> Any:
        """Return the value of a script, or of what it promises; in the tab, or in one of its :meth:`frames`."""
        target = {} if context is None else {"contextId": context}
        answer = self.send("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True, **target)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    @contextmanager
    def before_pages(self, script: str) -> Iterator[None]:
        """Run a script in pages that are opened inside a ``with``, before their own."""
        number = self.send("Page.addScriptToEvaluateOnNewDocument", source=script)["identifier"]
        try:
            yield
        finally:
            self.send("Page.removeScriptToEvaluateOnNewDocument", identifier=number)

    def open(self, path: Path, width: int, height: int) -> None:
        """Load a page of this program, and wait until it can be turned or says why it cannot."""
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.send("Page.navigate", url=path.as_uri())
        self.wait("['turns', 'still'].includes(document.body?.dataset.state)")

    def wait(self, condition: str, context: int | None = None) -> None:
        """Wait until a condition is true in the page; fail after minutes."""
        late = f"performance.now() > until ? fail(Error({json.dumps(condition)} + ' stays false'))"
        again = f"const again = () => {condition} ? done() : {late} : setTimeout(again, 50);"
        began = f"const until = performance.now() + {_LONGEST};"
        self.evaluate(f"new Promise((done, fail) => {{ {began} {again} again(); }})", context)

    def expect(self, event: str) -> None:
        """Wait for an event of the protocol."""
        while event not in (message["method"] for message in self.events):
            self.events.append(self._receive())

    def frames(self) -> list[int]:
        """Return the contexts of the frames of the page opened last, in their order."""
        created = self._parameters("Runtime.executionContextCreated")
        tree = self.send("Page.getFrameTree")["frameTree"].get("childFrames", [])
        contexts = {
            context["auxData"]["frameId"]: context["id"]
            for context in (parameters["context"] for parameters in created)
        }
        return [contexts[frame["frame"]["id"]] for frame in tree]

    def screenshot(self) -> UInt8[np.ndarray, "height width 4"]:
        """Return the pixels of the tab."""
        data = self.send("Page.captureScreenshot", format="png")["data"]
        with Image.open(io.BytesIO(base64.b64decode(data))) as image:
            return np.array(image.convert("RGBA"))

    def picture(self, script: str) -> UInt8[np.ndarray, "height width 4"]:
        """Return the canvas right after a script."""
        address = self.evaluate(f"{script}; document.querySelector('canvas').toDataURL()")
        with Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))) as image:
            return np.array(image.convert("RGBA"))

    def requests(self) -> list[str]:
        """Return the addresses of all requests."""
        urls = [parameters["request"]["url"] for parameters in self._parameters("Network.requestWillBeSent")]
        return [url for url in urls if not url.startswith(("data:", "blob:"))]

    def complaints(self) -> list[dict[str, Any]]:
        """Return the errors and the other messages of the console."""
        return self._parameters("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")

    def _parameters(self, *methods: str) -> list[dict[str, Any]]:
        """Return the parameters of the events of these kinds."""
        return [event["params"] for event in self.events if event["method"] in methods]

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            received = os.read(self._answers.fileno(), 1 << 16)
            assert received, "Chromium has ended"
            self._rest += received
        message, _, self._rest = self._rest.partition(b"\0")
        return json.loads(message)
