"""Judges of pictures: the truth, other devices, other settings; and what shows their findings."""

import lazy_loader

__getattr__, __dir__, _ = lazy_loader.attach(__name__, ["truth"])   # for `clfur.truth`
