"""The house rules of ARCHITECTURE.md: what is called what, and who may import whom."""

import ast
import configparser
import inspect
import re
import subprocess
import textwrap
from pathlib import Path

import pytest

import clfur
from clfur import layout

ROOT = Path(__file__).resolve().parents[1]
MODULES = sorted((ROOT / "clfur").rglob("*.py"))
TESTS = sorted((ROOT / "tests").rglob("*.py"))
KERNELS = sorted((ROOT / "cl").glob("*.cl"))


def stems(folder, suffix):
    return {path.stem for path in (ROOT / folder).glob(f"*{suffix}")} - {"__init__"}


SHARED = {"contact", "lighting", "scatter", "vectors"}   # what several stages or twins use
STAGES = sorted(stems("cl", ".cl") | (stems("clfur/stages", ".py") | stems("clfur/twin", ".py")) - SHARED)


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


def top(name):
    return name.split(".")[0]


def test_imports_are_seen():
    """The rules below are worth what `imported` sees."""
    seen = imported("import numpy as np, os.path\nfrom . import layout\nfrom ..device.scheduler import Scheduler\n"
                    "from clfur.stages import raster\ndef f():\n    from pyopencl import tools\n"
                    "    importlib.import_module('trimesh')", "clfur.stages")
    assert seen == {"numpy", "os.path", "clfur.stages.layout", "clfur.device.scheduler.Scheduler",
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


# What each package, or module at the top, may see of clfur, and of others what not all may.  A package sees itself.
SEES = {
    "_version": "", "errors": "", "color": "", "layout": "", "twin": "", "fitted": "",
    "scene": "errors color",
    "scene.display": "viewer",   # as late as a notebook asks for a picture
    "settings": "errors scene",
    "cache": "_version errors",
    "measures": "color",
    "device": "errors layout cache pyopencl",
    "files": "_version errors color scene mapbox_earcut imageio OpenEXR Imath av",
    "stages": "layout",
    "pipeline": "errors layout scene settings stages device",
    "budget": "errors scene settings measures fitted pipeline",
    "render": "errors scene settings device pipeline budget",
    "motion": "errors layout scene settings stages pipeline render",
    "film": "clfur errors color cache settings scene files device render motion judge pipeline av",
    "judge": "_version errors color cache measures layout settings scene files device budget render twin "
             "stages.tessellate",
    "viewer": "clfur errors color cache settings scene files device budget render motion pipeline judge "
              "nicegui fastapi uvicorn",
    "command": "clfur errors color cache settings scene files device budget judge film viewer",
    "__main__": "command", "__init__": "*",
}
GUARDED = {"pyopencl", "trimesh", "mapbox_earcut", "imageio", "OpenEXR", "Imath", "av", "nicegui", "fastapi", "uvicorn"}
STANDARD = {"bisect", "dataclasses", "typing", "math", "numpy"}   # all that stages, layout and twins may see of others


def seen_of(name):
    """What of clfur a full name belongs to: "clfur.stages.raster.raster" -> "stages"; "clfur" for its public names."""
    parts = name.split(".")
    known = (len(parts) > 1 and (ROOT / "clfur" / parts[1]).with_suffix(".py").is_file()) or (
        len(parts) > 1 and (ROOT / "clfur" / parts[1]).is_dir())
    return parts[1] if known else "clfur"


def breaches(module, source):
    """What a module's text ("clfur.stages.raster", ...) imports that it may not."""
    place = module.split(".")[1]
    allowed = {place, *SEES[place].split(), *SEES.get(f"{place}.{module.split('.')[-1]}", "").split()}
    names = imported(source, module.rpartition(".")[0])
    if "*" in allowed:
        return []
    wrong = [name for name in names if top(name) in GUARDED - allowed or top(name) in ("tests", "tools", "conftest")]
    if place in ("stages", "layout", "twin"):
        wrong += [name for name in names if top(name) not in STANDARD | {"clfur"}]
    for name in names:
        if top(name) == "clfur" and seen_of(name) not in allowed and not any(
                f"{name}.".startswith(f"clfur.{each}.") for each in allowed if "." in each):
            wrong.append(name)
    # Only the truth is judged by twins, and its rays by nothing at all.
    if place == "judge" and module.split(".")[2] not in ("truth", "geometry", "lights", "lobes", "places"):
        wrong += [name for name in names if name.startswith(("clfur.twin", "clfur.stages"))]
    if module == "clfur.judge.rays":
        wrong += [name for name in names if top(name) == "clfur"]
    return wrong


def module_of(path):
    name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    return f"{name}.__init__" if name == "clfur" else name


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports(path):
    assert not breaches(module_of(path), path.read_text())


def shared_by_import(source):
    """What a text of a test file imports from test files and from conftest."""
    names = {top(name.removeprefix("tests.")) for name in imported(source, "tests")}
    return {name for name in names if name == "conftest" or name.startswith("test_")}


@pytest.mark.parametrize("breach", [
    "import test_raster", "from test_raster import flat", "from conftest import DEVICES", "import conftest as c",
    "def f():\n    from test_house import top", "importlib.import_module('test_raster')", "from . import conftest",
    "from .test_raster import flat"])
def test_imports_of_tests_are_seen(breach):
    assert shared_by_import(breach) and not shared_by_import("from support.views import flat\nimport clfur")


def test_no_test_imports_a_test():
    """What several test files share is in tests/support; conftest holds fixtures, which nobody imports."""
    breaches = {path.name: shared_by_import(path.read_text()) for path in TESTS}
    assert len(TESTS) > 40 and not any(breaches.values()), breaches


@pytest.mark.parametrize("module, source", [
    ("clfur.scene.mesh", "from ..device import choose"), ("clfur.scene.mesh", "import pyopencl"),
    ("clfur.render", "from .stages import raster"), ("clfur.render", "import pyopencl as cl"),
    ("clfur.stages.raster", "from ..scene import Mesh"), ("clfur.stages.raster", "import attrs"),
    ("clfur.twin.raster", "from .. import layout"), ("clfur.twin.raster", "import scipy"),
    ("clfur.files.meshes", "from ..render import draw"), ("clfur.scene.mesh", "def f():\n    import trimesh"),
    ("clfur.judge.truth", "from ..stages.raster import raster"),
    ("clfur.judge.geometry", "from ..stages import raster"),
    ("clfur.judge.frontier", "from ..twin import shade"), ("clfur.judge.rays", "from ..scene import Mesh"),
    ("clfur.command.render", "from ..pipeline import plan"), ("clfur.device.team", "from ..scene import Mesh"),
    ("clfur.layout", "from . import settings"), ("clfur.cache", "from tests import support"),
    ("clfur.settings", "from clfur import render")])
def test_a_forbidden_import_is_found(module, source):
    assert breaches(module, source)


def test_what_is_allowed_is_no_breach():
    assert not breaches("clfur.judge.geometry", "from ..stages.tessellate import tessellate\nfrom ..twin import shade")
    assert not breaches("clfur.files.meshes", "import mapbox_earcut\nfrom ..scene import Mesh\nfrom .obj import obj")
    assert not breaches("clfur.command.render", "from .. import draw, save\nfrom .options import load_scene")


def test_every_package_is_installed():
    """An editable install finds them all, another one only what setup.cfg lists."""
    config = configparser.ConfigParser()
    config.read(ROOT / "setup.cfg")
    listed = set(re.findall(r"[\w.]+", config["options"]["packages"]))
    there = {".".join(path.parent.relative_to(ROOT).parts) for path in (ROOT / "clfur").rglob("__init__.py")}
    assert listed == there | {"clfur.cl"} and "clfur.pipeline" in there


def functions(source):
    """(name, lines, whether it is within another function) of each function of a text; its docstring does not count."""
    def walk(node, within):
        for child in ast.iter_child_nodes(node):
            is_function = isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef))
            if is_function:
                doc = child.body[0] if ast.get_docstring(child) else None
                lines = child.end_lineno - child.lineno + 1 - (doc.end_lineno - doc.lineno + 1 if doc else 0)
                yield child.name, lines, within
            yield from walk(child, within or is_function)
    return list(walk(ast.parse(source), False))


def without_comments(source):
    """A text of OpenCL C with as many lines, and nothing in the place of comments."""
    return re.sub(r"/\*.*?\*/|//[^\n]*", lambda comment: "\n" * comment[0].count("\n"), source, flags=re.S)


def kernel_bodies(source):
    """(name, lines) of each function of a text of OpenCL C."""
    source, found = without_comments(source), []
    for match in re.finditer(r"^(?!#|typedef)[A-Za-z_][^;{}#]*?\b(\w+)\s*\([^;{}]*\)\s*\{", source, re.M):
        depth, end = 1, match.end()
        while depth and end < len(source):
            depth += {"{": 1, "}": -1}.get(source[end], 0)
            end += 1
        found.append((match[1], source.count("\n", match.end(), end) - 1))
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_functions_fit_on_a_screen(path):
    assert not [name for name, lines, _ in functions(path.read_text()) if lines > 60]


@pytest.mark.parametrize("path", [path for path in MODULES if path.parent.name == "pipeline"],
                         ids=lambda path: path.name)
def test_no_closures_in_the_pipeline(path):
    """What a function reads stands among its arguments."""
    source = path.read_text()
    assert not [name for name, _, within in functions(source) if within] and not lambdas(source)


def lambdas(source):
    """Lines of a text that make a function within a function without a name."""
    functions = ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda
    return [node.lineno for outer in ast.walk(ast.parse(source)) if isinstance(outer, functions)
            for node in ast.walk(outer) if isinstance(node, ast.Lambda) and node is not outer]


@pytest.mark.parametrize("path", [*KERNELS, *sorted((ROOT / "cl").glob("*.h"))], ids=lambda path: path.name)
def test_kernels_fit_on_two_screens(path):
    bodies = kernel_bodies(path.read_text())
    assert not [name for name, lines in bodies if lines > 150 and name != "march"]
    kernels = re.findall(r"__kernel\s+void\s+(\w+)", without_comments(path.read_text()))
    assert set(kernels) <= {name for name, _ in bodies} and (kernels or path.suffix == ".h" or once_more(path))


def once_more(path):
    """Whether a file has the kernels of another one, made otherwise."""
    return re.search(r'^#include "\w+\.cl"$', path.read_text(), re.M) is not None


def unannotated(source):
    """Public functions and methods of a text with an argument or a result whose type is not told."""
    found, body = [], ast.parse(source).body
    for node in body + [inner for outer in body if isinstance(outer, ast.ClassDef) for inner in outer.body]:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            bare = [each.arg for each in arguments if each.annotation is None and each.arg not in ("self", "cls")]
            found += [node.name] if bare or node.returns is None else []
    return found


@pytest.mark.parametrize("path", [path for path in MODULES if path.parent.name in ("stages", "pipeline")],
                         ids=lambda path: path.name)
def test_stages_and_the_pipeline_are_annotated(path):
    assert not unannotated(path.read_text())


def test_public_names_are_annotated():
    """The functions of `clfur`, and the methods and properties of its classes that are not of a library's."""
    for name in clfur.__all__:
        public = getattr(clfur, name)
        if inspect.isfunction(public):
            assert not unannotated(inspect.getsource(public)), name
        elif inspect.isclass(public):
            assert not unannotated(textwrap.dedent(inspect.getsource(public))), name


def test_a_missing_type_is_found():
    assert unannotated("def f(a: int) -> int: pass\ndef _g(a): pass") == []
    assert unannotated("def f(a): pass\nclass A:\n    def g(self) -> None: pass\n    def h(self, *, b) -> None: pass\n"
                       "    def i(self): pass") == ["f", "h", "i"]


def test_long_functions_and_closures_are_found():
    long = "def f():\n" + "    x = 1\n" * 60
    assert functions(long) == [("f", 61, False)]
    assert functions('class A:\n    def f(self):\n        """One\n        two."""\n        def g(): pass\n') == [
        ("f", 2, False), ("g", 1, True)]
    assert lambdas("def f():\n    return sorted(x, key=lambda y: -y)") == [2] and not lambdas("f = lambda: 1")
    kernel = ("/* Text. */\n__kernel void f(\n    int a)   // (see; there)\n{\n" + "    a;\n" * 151
              + "}\ninline int g(void)\n{\n    {\n    }\n}\n")
    assert kernel_bodies(kernel) == [("f", 151), ("g", 2)]
    assert kernel_bodies("__kernel void f(const int a) {\n" + "    a;\n" * 9 + "    }\n") == [("f", 9)]


def test_the_top_is_small():
    assert len(list((ROOT / "clfur").glob("*.py"))) <= 12


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.name)
def test_no_vectors_of_three_in_buffers(path):
    """OpenCL stores a float3 in four floats: host and device would disagree."""
    text = without_comments(path.read_text())
    three = re.compile(r"\b(?:__global|__constant|__local|global|constant|local)\b[^,;(){}]*\b[a-z]+3\b")
    assert three.search("volatile __global const float3 *p")
    assert not three.search("__global float4 *p, float3 q")
    assert not three.search(text)
    assert ("__kernel" in text or once_more(path)) and "{{" not in text


def test_no_struct_has_room_for_disagreement():
    for name, struct in layout.STRUCTS.items():
        for member in struct.names:
            assert struct[member].shape[-1] == 4 and struct[member].base.itemsize == 4, f"{name}.{member}"


def number(expression):
    """The value of a text of numbers and operators alone, or None."""
    try:
        tree = ast.parse(expression.strip(), mode="eval")
        plain = (ast.Expression, ast.Constant, ast.BinOp, ast.UnaryOp, ast.operator, ast.unaryop)
        if all(isinstance(node, plain) for node in ast.walk(tree)):
            return float(eval(compile(tree, "", "eval")))
    except (SyntaxError, TypeError, ValueError):
        pass


def defined_in_c(text):
    """{name: value} of the numbers that a text of OpenCL C defines."""
    found = re.findall(r"^#define (\w+) (.+)$", without_comments(text), re.M)
    values = {name: number(re.sub(r"(?<=[\d.])[fFuUlL]+\b", "", value)) for name, value in found}
    return {name: value for name, value in values.items() if value is not None}


def defined_in_python(source):
    """{name: value} of the numbers that a module gives names to."""
    values = {}
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign):
            target, given = node.targets[0], node.value
            several = isinstance(target, ast.Tuple) and isinstance(given, ast.Tuple)
            for name, value in zip(target.elts, given.elts) if several else [(target, given)]:
                if isinstance(name, ast.Name) and number(ast.unparse(value)) is not None:
                    values[name.id] = number(ast.unparse(value))
    return values


def twice(kernels, modules):
    """Names of constants that both a kernel and a module define."""
    here = {pair for text in kernels for pair in defined_in_c(text).items()}
    return sorted(name for name, _ in here & {pair for source in modules for pair in defined_in_python(source).items()})


def test_constants_stand_once():
    """What host and device both need is in `layout.CONSTANTS`; twins have copies of their own, on purpose."""
    kernels = [path.read_text() for path in (ROOT / "cl").iterdir() if path.suffix in (".cl", ".h")]
    modules = [path.read_text() for path in MODULES if path.parent.name != "twin"]
    assert twice(kernels, modules) == []
    assert twice(kernels, [*modules, "FRACTION, OTHER = 24, 5"]) == ["FRACTION"]
    defined = {name for text in kernels for name in defined_in_c(text)}
    assert {"FRACTION", "UNSEEN"} <= defined and not defined & layout.CONSTANTS.keys()


@pytest.mark.parametrize("kernel, source", [
    ("#define ROWS 16         // of points", "ROWS, MOST_ROWS = 16, 4096"), ("#define STEP 0.75f", "STEP = .75"),
    ("#define FLAG 0x80u", "FLAG = 1 << 7   # a bit"), ("#define LESS (1.0f / 256)", "LESS = 1 / 256"),
    ("#define NONE (-2)", "NONE = -2")])
def test_constants_that_stand_twice_are_found(kernel, source):
    assert len(twice([kernel], ["import math", source])) == 1
    assert not twice([kernel], [source.lower()]) and not twice([kernel], [re.sub(r"\d+", "3", source)])
    assert not twice([re.sub(r" .*", " OTHER", kernel)], [source])


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
