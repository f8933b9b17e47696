"""A server of `clfur view`, and a real browser that looks at it."""

import contextlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from urllib.parse import urlsplit

import pytest

NAMES = "chromium", "chromium-browser", "google-chrome-stable", "google-chrome", "chrome"
WAIT = 20_000    # milliseconds
FIRST = 90_000   # for a first picture, which kernels may have to be built for

# In each page: all that its socket of pictures gets and sends, with times; and events that a mouse would make.
RECORDER = """
window.log = [];
const Socket = WebSocket;
window.WebSocket = class extends Socket {
  constructor(...given) {
    super(...given);
    if (!String(given[0]).includes("/pictures")) return;
    window.pictures = this;
    this.addEventListener("message", (event) => {
      const length = new DataView(event.data).getUint32(0, true);
      const header = new TextDecoder().decode(new Uint8Array(event.data, 4, length));
      log.push({ at: performance.now(), got: JSON.parse(header) });
    });
  }
  send(data) {
    if (this.url.includes("/pictures")) log.push({ at: performance.now(), sent: JSON.parse(data) });
    super.send(data);
  }
};
window.pointer = (name, x, y, more = {}) => {
  const stage = document.getElementById("stage");
  stage.setPointerCapture = () => {};
  const usual = { pointerId: 1, clientX: x, clientY: y, buttons: 1, bubbles: true };
  stage.dispatchEvent(new PointerEvent(name, { ...usual, ...more }));
};
window.drag = (from, to, more = {}) => {
  pointer("pointerdown", ...from, more); pointer("pointermove", ...to, more); pointer("pointerup", ...to, more);
};
window.told = () => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));   // to the server
window.shake = (seconds) => new Promise((done) => {
  const began = performance.now();
  pointer("pointerdown", 150, 100);
  const timer = setInterval(() => {
    const t = (performance.now() - began) / 1000;
    pointer("pointermove", 150 + 90 * Math.sin(2 * t), 100 + 40 * Math.sin(1.3 * t));
    if (t > seconds) { clearInterval(timer); pointer("pointerup", 150, 100); done(performance.now()); }
  }, 16);
});
"""


@contextlib.contextmanager
def chromium():
    """A Chromium without a window, the machine's or playwright's own; without one the test is skipped, loudly."""
    library = pytest.importorskip("playwright.sync_api", reason="NO BROWSER IS DRIVEN: playwright is not installed")
    with library.sync_playwright() as playwright:
        own = playwright.chromium.executable_path
        path = next(filter(None, map(shutil.which, NAMES)), own if os.path.exists(own) else None)
        if path is None:
            pytest.skip("NO BROWSER IS DRIVEN: there is no Chromium; your system has one, or `playwright install`")
        browser = playwright.chromium.launch(executable_path=path, args=[
            "--no-sandbox", "--enable-unsafe-swiftshader"])   # the latter: WebGL, also without a GPU
        yield browser
        browser.close()


@dataclass
class Served:
    """A `clfur view` that runs: the page's address, its parts, and what it has written to stderr."""

    process: subprocess.Popen
    address: str
    errors: object

    @property
    def port(self):
        return urlsplit(self.address).port

    @property
    def token(self):
        return urlsplit(self.address).query.removeprefix("token=")

    def said(self):
        self.errors.seek(0)
        return self.errors.read()


@contextlib.contextmanager
def serving(*arguments):
    """A `Served` of these arguments of `clfur view`, which in the end SIGTERM ends, if it hasn't: with exit code 0."""
    with tempfile.TemporaryFile("w+") as errors, subprocess.Popen(
            [sys.executable, "-m", "clfur", "view", *map(str, arguments), "--no-browser"],
            stdout=subprocess.PIPE, stderr=errors, text=True) as process:
        try:
            line = process.stdout.readline()
            found = re.search(r"http://\S+", line)
            served = Served(process, found and found[0], errors)
            assert found, served.said()
            yield served
        finally:
            process.terminate()
            try:
                code = process.wait(30)
            finally:
                process.kill()
        assert code == (0 if os.name == "posix" else code), served.said()


def opened(context, address):
    """A page that has shown its first final picture."""
    page = context.new_page()
    page.add_init_script(RECORDER)
    page.goto(address)
    settled(page, FIRST)
    return page


def settled(page, milliseconds=WAIT):
    """Wait till a page shows the final picture of all that it has told -> the picture's header."""
    page.wait_for_function("window.clfur && clfur.header && clfur.header.final && clfur.header.gesture === clfur.told",
                           timeout=milliseconds)
    return page.evaluate("clfur.header")


def after(page, script):
    """Do something in a page, and wait for the final picture of it -> its header."""
    page.evaluate(script)
    page.evaluate("told()")
    return settled(page)


def until(true, seconds=20.0):
    """Wait till true() is, which is returned."""
    end = time.monotonic() + seconds
    while not (found := true()):
        assert time.monotonic() < end, "it did not come to pass"
        time.sleep(0.02)
    return found
