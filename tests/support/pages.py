"""What a page of `clfur view` would do, without a browser, and a small scene for it."""

import clfur
from clfur.viewer.windows import Link

from .browser import until


class Page:
    """What a page would do: it draws each picture at once, or when it is told to."""

    def __init__(self, drawing, at_once=True):
        self.drawing, self.at_once, self.got, self.lines = drawing, at_once, [], []
        self.link = Link(self.send, self.lines.append)
        self.window = drawing.open(str(id(self)))

    def connect(self, before="", **message):
        self.drawing.connect(self.window, self.link, before)
        self.tell(**{"n": 1, "size": [48, 36]} | message)
        return self

    def send(self, header, data):
        self.got.append((header, data))
        if self.at_once:
            self.drawn()

    def drawn(self):
        self.tell(drawn=1)

    def tell(self, **message):
        self.drawing.take(self.window, self.link, message)

    @property
    def last(self):
        return self.got[-1][0] if self.got else {}

    def settled(self):
        return until(lambda: self.last.get("final") and self.last["gesture"] == self.window.gesture)


def fur(n=200):
    mesh = clfur.load_mesh("sphere")
    hair = clfur.HairType(color=(0.5, 0.3, 0.1), segments=4, segment_length=0.06, width=0.02)
    return clfur.Scene(mesh, clfur.Strands(inner=1, outer=1, types=hair, roots=n, surface="flat"),
                       clfur.Camera(eye=(1, 1, 3)))
