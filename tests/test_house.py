"""The house rules of ARCHITECTURE.md: what is called what, and who may import whom."""

import ast
import re
import subprocess
from pathlib import Path

import pytest

from clfur import layout

ROOT = Path(__file__).resolve().parents[1]
MODULES = sorted((ROOT / "clfur").rglob("*.py"))
KERNELS = sorted((ROOT / "cl").glob("*.cl"))
STANDARD = {"bisect", "dataclasses", "typing", "math"}


def stems(folder, suffix):
    return {path.stem for path in (ROOT / folder).glob(f"*{suffix}")} - {"__init__"}


STAGES = sorted(stems("cl", ".cl") | stems("clfur/stages", ".py") | stems("clfur/twin", ".py"))


def imported(source, package):
    """Full names of the modules that a text of Python in this package ("clfur.stages") imports, at any depth.

    `from x import y` gives x.y, so that a module taken from a package is seen.
    """
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            parts = package.split(".")[:len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join(parts + [node.module] * bool(node.module))
            names |= {f"{base}.{alias.name}" for alias in node.names}
        elif (isinstance(node, ast.Call) and getattr(node.func, "attr", getattr(node.func, "id", "")) in (
                "import_module", "__import__") and node.args and isinstance(node.args[0], ast.Constant)):
            names.add(str(node.args[0].value))
    return names


def imports_of(path):
    relative = path.relative_to(ROOT)
    return imported(path.read_text(), ".".join(relative.parent.parts))


def top(name):
    return name.split(".")[0]


def test_imports_are_seen():
    """The rules below are worth what `imported` sees."""
    seen = imported("import numpy as np, os.path\nfrom . import layout\nfrom ..scheduler import Scheduler\n"
                    "from clfur.stages import raster\ndef f():\n    from pyopencl import tools\n"
                    "    importlib.import_module('trimesh')", "clfur.stages")
    assert seen == {"numpy", "os.path", "clfur.stages.layout", "clfur.scheduler.Scheduler",
                    "clfur.stages.raster", "pyopencl.tools", "trimesh"}
    assert imported("from .. import layout", "clfur.stages") == {"clfur.layout"}
    assert len(MODULES) > 15 and len(KERNELS) >= 4


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_is_four_files(stage):
    for file in (f"clfur/stages/{stage}.py", f"cl/{stage}.cl", f"clfur/twin/{stage}.py",
                 f"tests/test_{stage}.py"):
        assert (ROOT / file).is_file(), f"the stage {stage} has no {file}"
    assert "pytest.mark.small" in (ROOT / f"tests/test_{stage}.py").read_text(), f"{stage} has no test for Oclgrind"


def test_the_stages_are_there():
    assert {"tessellate", "strands", "raster", "shade"} <= set(STAGES)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports(path):
    module, names = ".".join(path.relative_to(ROOT).with_suffix("").parts), imports_of(path)
    tops = {top(name) for name in names}
    own = {name for name in names if top(name) == "clfur"}

    assert not tops & {"tests", "tools", "conftest"}
    if module not in ("clfur.device", "clfur.scheduler", "clfur.signature"):
        assert "pyopencl" not in tops
    if module != "clfur.mesh":
        assert "trimesh" not in tops
    if module != "clfur.image":
        assert not tops & {"imageio", "OpenEXR"}
    if module.startswith("clfur.twin."):
        assert tops <= {"numpy", "math"}
    if module in ("clfur.truth", "clfur.rays"):   # no kernel that draws, counts or lights is judged by itself
        assert {name for name in own if name.startswith("clfur.stages")} <= {"clfur.stages.tessellate.tessellate"}
        assert module == "clfur.truth" or not own
    if module.startswith("clfur.stages."):
        assert tops - {"clfur"} <= {"numpy"} | STANDARD
        assert all(f"{name}.".startswith(("clfur.layout.", "clfur.stages.")) for name in own)
    if module in ("clfur.compare", "clfur.frontier", "clfur.report") or module.startswith("clfur.cli"):
        assert not any(name.startswith(("clfur.stages", "clfur.twin")) for name in own)
    assert module.startswith(("clfur.twin", "clfur.truth")) or not any(name.startswith("clfur.twin") for name in own)


def test_scene_needs_no_opencl():
    """Nothing that scene.py imports, nor what that imports, touches pyopencl."""
    seen, todo = set(), {"clfur.scene"}
    while todo:
        module = todo.pop()
        path = ROOT.joinpath(*module.split(".")).with_suffix(".py")
        if module in seen or not path.is_file():
            continue
        seen.add(module)
        names = imports_of(path)
        assert "pyopencl" not in {top(name) for name in names}, f"{module} imports pyopencl"
        todo |= {part for name in names if top(name) == "clfur" for part in (name, name.rpartition(".")[0])}
    assert {"clfur.scene", "clfur.errors"} <= seen


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.name)
def test_no_vectors_of_three_in_buffers(path):
    """OpenCL stores a float3 in four floats: host and device would disagree."""
    text = re.sub(r"/\*.*?\*/|//[^\n]*", "", path.read_text(), flags=re.S)
    three = re.compile(r"\b(?:__global|__constant|__local|global|constant|local)\b[^,;(){}]*\b[a-z]+3\b")
    assert three.search("volatile __global const float3 *p")
    assert not three.search("__global float4 *p, float3 q")
    assert not three.search(text)
    assert "__kernel" in text and "{{" not in text


def test_no_struct_has_room_for_disagreement():
    for name, struct in layout.STRUCTS.items():
        for member in struct.names:
            assert struct[member].shape[-1] == 4 and struct[member].base.itemsize == 4, f"{name}.{member}"


def ours():
    """The files that git tracks; without git, those of the known folders."""
    try:
        listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True).stdout
        names = [name for name in listed.decode().split("\0") if name]
    except (OSError, subprocess.CalledProcessError):
        names = [p.relative_to(ROOT) for d in ("clfur", "cl", "tests", "tools") for p in (ROOT / d).rglob("*")
                 if p.suffix in (".py", ".cl", ".h", ".md")]
    return [ROOT / name for name in names if (ROOT / name).is_file()]


def test_no_paths_of_this_machine():
    """Neither a home folder nor this checkout's place is written into any file."""
    homes = re.compile(r"(?<![\w.:/-])/(?:home|root|Users|work)/\w")
    assert homes.search("see /" + "home/me") and not homes.search("https://example.org/home/x")
    places = [str(place) for place in (ROOT, Path.home()) if len(place.parts) > 1]
    files = ours()
    assert len(files) > 20
    for path in files:
        text = path.read_bytes().decode("utf-8", "ignore")
        found = [p for p in places if p in text and len(p) > 5] + homes.findall(text)
        assert not found, f"{path.relative_to(ROOT)} names {found}"
