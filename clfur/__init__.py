"""Fur and hair on meshes, rendered with OpenCL."""

from .command.endings import watch_imports

watch_imports()   # ahead of all that takes time to import

# ruff: noqa: E402
import importlib.util
import sys
import types

import lazy_loader

from ._version import __version__ as __version__

# Each name is imported when it is first used, from where __init__.pyi says: all of them take longer than most need.
_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name):
    """A public name, or a module that nobody has imported yet, such as `clfur.device`."""
    if name in __all__:
        return _public(name)
    if not name.startswith("_") and importlib.util.find_spec(f"{__name__}.{name}"):
        return importlib.import_module(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _known_as(name):
    """A module whose names are those of another one, which is imported once one of them is used."""
    module = types.ModuleType(name)


    def get(attribute):
        if attribute.startswith("__"):   # who goes through all modules, as `inspect` does, asks for these
            raise AttributeError(f"module {name!r} has no attribute {attribute!r} yet")
        return getattr(importlib.import_module(name), attribute)
    module.__getattr__ = get
    return module


for _name in ("compare", "frontier", "truth"):   # in judge/; users import them by these names
    # There from the start: an import would put the module in the place of the function.
    sys.modules[f"clfur.{_name}"] = _known_as(f"clfur.judge.{_name}")
