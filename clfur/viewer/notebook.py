"""A Scene in a notebook that turns with the mouse: a widget of anywidget, a library that is asked for only here."""

import functools
import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ..errors import Error, shown
from ..scene import Scene
from ..scene.origin import copied
from ..settings import Settings
from .pace import Pace, ways
from .pictures import device_of, drawn, scene_png

JAVASCRIPT = Path(__file__).with_name("notebook.js")
LARGEST = 640, 480   # of the picture where no size is told


def view(scene: Scene, device: Any = None, settings: Settings | None = None, size: Sequence[int] | None = None) -> Any:
    """Show a `Scene` in a notebook, where the mouse turns it -> a widget.

    A drag turns around what the camera looks at, with Shift it pans, the wheel zooms, a double click goes back. While
    the camera moves it is drawn fast; at rest as ``settings`` say, `Settings()` if None. device: as for `Scheduler`; of
    one that is given the device is meant. size: (width, height) of the picture in pixels; if None the camera's, but no
    larger than 640 x 480. What a notebook keeps of it on disk is a still picture.
    Raises `clfur.Error` for anything else, and without anywidget, which ``pip install "clfur[notebook]"`` brings.
    """
    if not isinstance(scene, Scene):
        raise Error(f"scene is {shown(scene)}; allowed: a clfur.Scene")
    settings = Settings() if settings is None else settings
    if not isinstance(settings, Settings):
        raise Error(f"settings is {shown(settings)}; allowed: a clfur.Settings")
    if size is None:
        share = min(1.0, *(most / own for most, own in zip(LARGEST, scene.camera.size)))
        size = [max(round(share * own), 1) for own in scene.camera.size]
    from .orbit import Orbit  # not above, where all who import clfur would wait for it

    return _widget()(scene, device_of(device), settings, Orbit.of(scene, size))


class Drawing:
    """Pictures of a Scene from the newest camera, drawn in a thread that lasts as long as there is something to draw:
    a kernel that drew them itself would answer nothing else meanwhile.

    device: an OpenCL device. orbit: an `Orbit`, where the camera begins. send(content, picture): is given each picture
    in that thread: {"final": whether it is as ``settings`` say} and the bytes of a PNG file, or {"error": a line} and
    None.
    """

    def __init__(self, scene: Scene, device: Any, settings: Settings, orbit: Any,
                 send: Callable[[dict, bytes | None], None]) -> None:
        self.scene, self.settings, self.orbit = scene, settings, orbit
        self._device, self._send, self._begun = device, send, orbit
        self._pace = Pace(len(ways(settings)))
        self._lock = threading.Lock()
        self._wanted: tuple[Any, bool] | None = None   # one slot: a newer camera takes the place of one that waits
        self._draws = False

    def heed(self, asked: dict) -> None:
        """What the page asks for: {"turn": [x, y], "pan": [x, y], "zoom": steps, "reset": ..., "rest": ...}, each or
        none: how the camera moves, as `Orbit` has it, and whether it has come to rest."""
        orbit = self._begun if asked.get("reset") else self.orbit
        turn, pan = (tuple(map(float, asked.get(name, (0, 0)))) for name in ("turn", "pan"))
        zoom = float(asked.get("zoom", 0))
        if all(map(math.isfinite, (*turn, *pan, zoom))):
            orbit = orbit.turned(*turn).panned(*pan).zoomed(zoom)
        with self._lock:
            self.orbit = orbit
            # Of several views one may rest while another waits for how it moves: it is shown that first.
            moves = self._wanted is not None and not self._wanted[1]
            self._wanted = orbit, bool(asked.get("rest")) and not moves
            begins, self._draws = not self._draws, True
        if begins:
            threading.Thread(target=self._draw, name="clfur.view").start()

    def _draw(self):
        while True:
            with self._lock:
                wanted, self._wanted, self._draws = self._wanted, None, self._wanted is not None
            if wanted is None:
                return
            try:
                self._picture(*wanted)
            except Exception as error:   # told in the page: nobody sees what a thread raises
                with suppress(Exception):   # but of a page that is gone: another may ask
                    self._send({"error": " ".join(str(error).split()) or type(error).__name__}, None)

    def _picture(self, orbit, final):
        began, settings = time.perf_counter(), self.settings
        if not final:
            settings, divided = self._pace.of(ways(settings, self.scene.shells is not None))
            orbit = orbit.resized([(each + divided - 1) // divided for each in orbit.size])
        scene = copied(self.scene, camera=orbit.camera())
        # A final picture is given up for a newer camera; a moving one is not, or who never rests would see none.
        picture = drawn(scene, settings, self._device, self._is_old if final else _never)
        if picture is None:
            return
        if not final:
            self._pace.took(time.perf_counter() - began)
        self._send({"final": final}, picture)

    def _is_old(self):
        return self._wanted is not None


def _never():
    return False


@functools.cache
def _widget():
    """The class of widgets."""
    try:
        from anywidget import AnyWidget
    except ImportError:
        raise Error('clfur.view needs anywidget: pip install "clfur[notebook]"') from None

    class View(AnyWidget):
        _esm = JAVASCRIPT.read_text(encoding="utf-8")

        def __init__(self, scene, device, settings, orbit):
            super().__init__()
            self.drawing = Drawing(scene, device, settings, orbit, self._put)
            self._device = device
            self.on_msg(self._heed)

        def _heed(self, _, content, __):
            self.drawing.heed(content)

        def _put(self, content, picture):
            self.send(content, None if picture is None else [picture])

        def __repr__(self):
            return f"clfur.view({self.drawing.scene!r})"

        def _repr_mimebundle_(self, **options):
            bundle = super()._repr_mimebundle_(**options)
            data, about = bundle if isinstance(bundle, tuple) else (bundle, {})
            drawing = self.drawing
            picture = scene_png(copied(drawing.scene, camera=drawing.orbit.camera()), self._device)
            return data | ({"image/png": picture} if picture else {}), about

    return View
