"""Modules under the names that they had at first: found, with a warning that names their new place.

They go in 0.2.  What `clfur` itself names has not moved.
"""

import importlib
import sys
import warnings
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec

MOVED = {
    "checks": "scene.checks", "fur": "scene", "shell_fur": "scene.shells",
    "parts": "pipeline.plan", "shadows": "pipeline.shadows", "views": "pipeline.views",
    "mesh": "files.meshes", "teapot": "files.teapot", "image": "files.images",
    "scheduler": "device.scheduler", "team": "device.team", "vendors": "device.vendors",
    "rays": "judge.rays", "isolated": "judge.isolated",
    "selftest": "judge.selftest", "chart": "judge.chart", "report": "judge.report",
    "cli": "command.main", "cli_chart": "command.chart", "cli_compare": "command.compare",
    "cli_devices": "command.devices", "cli_scene": "command.options", "cli_types": "command.types",
}
PUBLIC = "compare", "frontier", "truth"   # in judge/; users have these names, and they stay


class Moved(MetaPathFinder, Loader):
    """Finds the module `clfur.old` as what is `clfur.new` today."""

    def find_spec(self, name, path=None, target=None):
        package, _, old = name.rpartition(".")
        return ModuleSpec(name, self) if package == "clfur" and old in MOVED else None

    def create_module(self, spec):
        new = "clfur." + MOVED[spec.name.rpartition(".")[2]]
        warnings.warn(f"{spec.name} is {new} now; the old name goes in 0.2", DeprecationWarning,
                      stacklevel=2)
        module = importlib.import_module(new)
        spec.loader_state = module.__spec__
        return module

    def exec_module(self, module):
        """It has run under its own name already, and is to be called by it again."""
        module.__spec__ = module.__spec__.loader_state


def install():
    """Let `import clfur.old` find what has moved."""
    sys.meta_path.append(Moved())
    for name in PUBLIC:   # there from the start: an import would put the module in the place of the function
        sys.modules[f"clfur.{name}"] = importlib.import_module(f"clfur.judge.{name}")
