"""A headless Chromium, led through its DevTools pipe: one process for all pages, widths, colours and paper."""

import base64
import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_ALONE = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--enable-unsafe-swiftshader",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)


class Browser:
    """One tab of it."""

    def __init__(self, commands: int, answers: int) -> None:
        self._commands, self._answers = os.fdopen(commands, "wb", buffering=0), os.fdopen(answers, "rb", buffering=0)
        self._rest, self._count, self._session = b"", 0, None
        self._events: list[dict[str, Any]] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """What a method of the DevTools protocol answers."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        message |= {} if self._session is None else {"sessionId": self._session}
        self._commands.write(json.dumps(message).encode() + b"\0")
        while (told := self._next()).get("id") != self._count:
            self._events.append(told)
        assert "error" not in told, (method, told)
        return told["result"]

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            read = os.read(self._answers.fileno(), 1 << 20)
            assert read, "the browser has ended"
            self._rest += read
        first, _, self._rest = self._rest.partition(b"\0")
        return json.loads(first)

    def open(self, path: Path) -> None:
        """Go to a page, and wait for it."""
        self._events.clear()
        self.call("Page.navigate", url=path.as_uri())
        while not any(event.get("method") == "Page.loadEventFired" for event in self._events):
            self._events.append(self._next())

    def show(self, width: int, scheme: str = "light", media: str = "screen") -> None:
        """The page at a width in px, all its height in view, so that each place of it can be asked for."""
        self.call(
            "Emulation.setEmulatedMedia", media=media, features=[{"name": "prefers-color-scheme", "value": scheme}]
        )
        for height in (900, None):
            tall = height or self.run("document.documentElement.scrollHeight")
            self.call("Emulation.setDeviceMetricsOverride", width=width, height=tall, deviceScaleFactor=1, mobile=False)

    def run(self, script: str) -> Any:
        """The value of a script in the page."""
        told = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in told, told
        return told["result"].get("value")

    def pdf(self) -> bytes:
        """The page as it is printed."""
        return base64.b64decode(self.call("Page.printToPDF", preferCSSPageSize=True)["data"])

    def picture(self) -> bytes:
        """A PNG of what is shown."""
        return base64.b64decode(self.call("Page.captureScreenshot")["data"])

    def close(self) -> None:
        """End the browser."""
        self._session = None
        self.call("Browser.close")
        self._commands.close()
        self._answers.close()

    @property
    def complaints(self) -> list[dict[str, Any]]:
        """What the console and the log have said since the page was opened, but for the speed of drawing."""
        told = ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded")
        return [each for each in self._events if each.get("method") in told and "GPU stall" not in json.dumps(each)]


def installed() -> str | None:
    """The path of a Chromium, where one is here."""
    return next(filter(None, map(shutil.which, BROWSERS)), None)


@contextmanager
def opened(program: str, home: Path) -> Iterator[Browser]:
    """The browser with a home of its own, ended at the end."""
    (theirs_in, ours_out), (ours_in, theirs_out) = os.pipe(), os.pipe()
    flags = (*_ALONE, f"--user-data-dir={home}", "--remote-debugging-pipe")
    pipes = f'exec "$@" 3<&{theirs_in} 4>&{theirs_out}'  # Chromium reads its commands at 3 and answers at 4
    process = subprocess.Popen(
        ["bash", "-c", pipes, "chromium", program, *flags],
        pass_fds=(theirs_in, theirs_out),
        env=os.environ | {"HOME": str(home)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(theirs_in)
    os.close(theirs_out)
    browser = Browser(ours_out, ours_in)
    try:
        yield browser
    finally:
        browser.close()
        process.wait(timeout=30)
