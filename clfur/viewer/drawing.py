"""One thread that draws for all windows, and another one that codes what it has drawn."""

import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from .. import draw
from ..errors import Error, Stopped
from ..files.images import png_bytes
from ..scene.origin import copied
from ..settings import label
from .coding import jpeg
from .document import Document
from .pace import Pace, ways
from .told import told
from .windows import AHEAD, MOST, REST, Link, Window


class Drawing:
    """Draws a document for its windows, each with its own camera, by turns.

    devices: what `clfur.draw` takes; no other thread may draw with them. While a window's camera, or the document,
    changes, pictures are fast ones, of the newest camera; `REST` seconds later comes the final one, with the document's
    settings. It is given up when anything that it shows changes, or when another window moves. A page has at most one
    picture that it has not told to be drawn, and nothing is drawn for one that is hidden. closed: whether it is to end.
    """

    def __init__(self, document: Document, devices: Any) -> None:
        self.document, self.devices = document, devices
        self.windows: dict[str, Window] = {}
        self._changed = threading.Condition()
        self._last: Window | None = None      # that was drawn for
        self._drawn: Any = None               # what of: see `_state`
        self._document_changed = 0.0
        self.closed = False
        self._works: deque[tuple[Future, Callable[[], Any]]] = deque()
        self._pace = Pace(len(ways(document.settings)))
        self._coder = ThreadPoolExecutor(1, "coding")
        self._thread = threading.Thread(target=self._run, name="drawing", daemon=True)
        self._end = document.subscribe(self._on_change)

    def start(self) -> None:
        """Begin to draw."""
        self._thread.start()

    def close(self, seconds: float | None = None) -> bool:
        """End, after at most so many seconds -> whether it has: a kernel that is being built cannot be stopped."""
        self._end()
        with self._changed:
            self.closed = True
            self._changed.notify_all()
        if self._thread.ident:
            self._thread.join(seconds)
        self._coder.shutdown(wait=not self._thread.is_alive())
        return not self._thread.is_alive()

    def do(self, work: Callable[[], Any]) -> Future:
        """Have the thread that draws call work(), with its devices, ahead of any other picture -> a Future of what it
        returns or raises."""
        done: Future = Future()
        with self._changed:
            self._works.append((done, work))
            self._changed.notify()
        return done

    def open(self, key: str) -> Window:
        """A new window of this name."""
        scene = self.document.scene   # before: whoever changes the document may wait for ours
        with self._changed:
            unseen = [each for each in self.windows.values() if each.link is None]
            for each in unseen[:max(len(self.windows) - MOST, 0)]:
                del self.windows[each.key]
            window = self.windows[key] = Window(key, scene)
            return window

    def connect(self, window: Window, link: Link, before: str = "") -> None:
        """A window's page is there, which was the window ``before`` until it was loaded anew."""
        with self._changed:
            earlier = self.windows.get(before)
            if earlier is not None and earlier is not window and not window.pictures:
                window.look_like(earlier)
                if earlier.link is None:
                    del self.windows[before]
            window.link, window.shown, window.changed = link, (None, False), time.monotonic()
            self._changed.notify()

    def disconnect(self, window: Window, link: Link) -> None:
        """The page has gone."""
        with self._changed:
            if window.link is link:
                window.link = None

    def take(self, window: Window, link: Link, message: dict[str, Any]) -> None:
        """What a page tells: as `Window.takes`, and {"hidden": whether nobody can see it, "drawn": it has drawn a
        picture}. Raises Error where it is no such message."""
        scene = self.document.scene
        with self._changed:
            if message.get("drawn"):
                link.under_way = max(link.under_way - 1, 0)
            if "hidden" in message:
                link.hidden = bool(message["hidden"])
            window.takes(message, scene)
            if "n" in message and window.shown == (self._state(window), True):
                link.tell({"gesture": window.gesture})   # nothing is another: the page has its picture already
            self._changed.notify()

    def _on_change(self):
        with self._changed:
            self._document_changed = time.monotonic()
            self._changed.notify()

    # What follows runs in the thread that draws.

    def _run(self):
        while True:
            self._work()
            with self._changed:
                window, final = self._next()
                if self.closed:
                    return
                if self._works:
                    continue
                if window is None:
                    self._changed.wait(final)
                    continue
                link, window.pictures = window.link, window.pictures + 1
                link.under_way += 1
                self._last, self._drawn = window, self._state(window)
            try:
                self._draw(window, link, final)
                continue
            except Stopped:
                pass
            except Exception as error:   # of a device too, or ours: the page goes on
                self._tell(window, link, error, self._drawn)
            with self._changed:
                link.under_way -= 1

    def _work(self):
        """Do what `do` was given."""
        while self._works and not self.closed:
            done, work = self._works.popleft()
            if not done.set_running_or_notify_cancel():   # nobody waits for it any more
                continue
            try:
                done.set_result(work())
            except BaseException as error:   # whoever asked for it is told
                done.set_exception(error)

    def _next(self):
        """(window, whether its final picture) to draw, moving ones first; or (None, seconds until there is one)."""
        now, resting, soon = time.monotonic(), None, None
        for window in self._turns():
            wish = self._wish(window, now)
            if wish == "moving":
                return window, False
            if wish == "final":
                resting = resting or window
            elif wish is not None:
                soon = min(wish, soon or wish)
        return (resting, True) if resting else (None, soon)

    def _turns(self):
        """The windows, from the one after the last on."""
        windows = list(self.windows.values())
        at = windows.index(self._last) + 1 if self._last in windows else 0
        return windows[at:] + windows[:at]

    def _wish(self, window, now):
        """What a window should be shown: "moving", "final", seconds until that is known, or None for nothing."""
        link = window.link
        if link is None or link.hidden or link.under_way >= AHEAD or not window.sized:
            return None
        if self.document.playing:
            return "moving"
        state = self._state(window)
        if window.shown == (state, True):
            return None
        if window.shown[0] != state:   # also where it rests since: there was no time for a picture of it
            return "moving"
        left = max(window.changed, self._document_changed) + REST - now
        return left if left > 0 else "final"

    def _state(self, window):
        return window.orbit, self.document.version

    def _draw(self, window, link, final):
        """Draw a picture of a window, and let it be coded."""
        document = self.document
        document.advance(self.devices)
        version = document.version   # before the rest: what is changed meanwhile is drawn anew
        scene, settings = document.scene, document.settings
        with self._changed:
            if scene.camera is not window.home:   # another scene
                window.go_home(scene)
            orbit, gesture, number = window.orbit, window.gesture, window.pictures
            state = self._drawn = orbit, version
            repeated = document.playing or (window.shown[0] is not None and window.shown[0][1] == version)
        began, divided = time.monotonic(), 1
        if final:
            link.tell({"drawing": number})
        else:
            settings, divided = self._pace.of(ways(settings, scene.shells is not None))
        width, height = orbit.size
        pictured = orbit.resized(((width + divided - 1) // divided, (height + divided - 1) // divided))

        def is_over():
            return self.closed or (final and self._is_late(window, link, state))
        scene = copied(scene, camera=pictured.camera())
        frame = draw(scene, self.devices, settings, stop=is_over)
        seconds = time.monotonic() - began
        if not final and repeated and not frame.building:   # else it is the hair's time, or a compiler's
            self._pace.took(seconds)
        with self._changed:
            if window.link is link:   # else its next page has seen none
                window.shown = state, final
        header = {
            "picture": number, "gesture": gesture, "final": final, "size": pictured.size, "orbit": orbit.told(),
            "seconds": seconds, "strands": frame.strands, "settings": label(frame.settings or settings),
            "device": frame.device}
        self._coder.submit(self._code, window, link, frame.images["color"], header, state)
        if final:
            window.told = told(frame, scene)

    def _is_late(self, window, link, state):
        """Whether nobody waits for the final picture of a state any more, or another window moves."""
        if window.link is not link or link.hidden or self._works or self._state(window) != state:
            return True
        now = time.monotonic()
        return any(self._wish(other, now) == "moving" for other in list(self.windows.values()) if other is not window)

    def _code(self, window, link, image, header, state):
        """Bring a page its picture, but a final one that is late already."""
        late = header["final"] and self._state(window) != state
        try:
            if not late:
                data = png_bytes(image) if header["final"] else jpeg(image)
                if self._state(window) == state:   # what was told meanwhile is in it, too
                    header["gesture"] = window.gesture
                return link.send(header, data)
        except Exception as error:   # of a format or memory: the next picture may be better
            self._tell(window, link, error, state)
        with self._changed:
            if late and window.shown == (state, True):   # it may come back to that state
                window.shown = state, False
            link.under_way -= 1
            self._changed.notify()

    def _tell(self, window, link, error, state):
        """Tell a page why there is no picture; the last one stays, and none of that state is tried again."""
        if self.document.playing:   # else it would be told again and again
            self.document.pause()
        if not isinstance(error, (Error, MemoryError)):
            traceback.print_exception(error, file=sys.stderr)
        line = str(error) if isinstance(error, Error) else f"{type(error).__name__}: {error}"
        link.tell({"error": " ".join(line.split())[:500]})
        with self._changed:
            if window.link is link:
                window.shown = state, True

