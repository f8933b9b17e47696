"""Which drivers the loader looks at, and Intel's from PyPI among them, with made-up files."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from clfur import Error, cache
from clfur.device import caches, vendors

ROOT = Path(__file__).resolve().parents[1]
INTEL = b"/prefix with space/lib/libintelocl.so"


@pytest.fixture
def place(monkeypatch, tmp_path):
    """A machine with one driver, and Intel's installed by pip -> its folder; nothing is set."""
    system = tmp_path / "system"
    system.mkdir()
    (system / "pocl.icd").write_bytes(b"libpocl.so.2\n")
    monkeypatch.setenv("OPENCL_VENDOR_PATH", str(system))
    monkeypatch.setenv("POCL_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(caches, "notes", [])
    monkeypatch.setenv("OCL_ICD_VENDORS", "before")   # so that it is as it was after the test
    monkeypatch.delenv("OCL_ICD_VENDORS")
    monkeypatch.setattr(vendors, "_intel", INTEL.decode)
    monkeypatch.setattr(cache, "folder", tmp_path.joinpath)
    return tmp_path


def pointed_to():
    return Path(os.environ["OCL_ICD_VENDORS"])


def test_intel_is_added(place):
    assert vendors.prepare() is None
    folder = pointed_to()
    assert folder.parent == place / "vendors"
    assert {f.name: f.read_bytes() for f in folder.iterdir()} == {
        "pocl.icd": b"libpocl.so.2\n", "clfur-intel.icd": INTEL}
    times = {f: f.stat().st_mtime_ns for f in folder.iterdir()}
    assert vendors.prepare() is None   # again, as in a child that inherits it: nothing is written
    assert pointed_to() == folder and times == {f: f.stat().st_mtime_ns for f in folder.iterdir()}
    listed, lines = vendors.vendors()
    assert lines == [] and [(Path(v.place).name, v.origin) for v in listed[:2]] == [
        ("pocl.icd", "system"), ("clfur-intel.icd", "intel-opencl-rt, added by clfur")]


def test_no_system_drivers(place, monkeypatch):
    monkeypatch.setenv("OPENCL_VENDOR_PATH", str(place / "none"))
    vendors.prepare()
    assert [f.name for f in pointed_to().iterdir()] == ["clfur-intel.icd"]
    assert vendors.vendors()[1] == [f"there are no .icd files in {place / 'none'}"]


def test_other_drivers_have_another_folder(place):
    vendors.prepare()
    first = pointed_to()
    (place / "system" / "mesa.icd").write_bytes(b"libmesa.so")
    vendors.prepare()
    assert pointed_to() != first and (pointed_to() / "mesa.icd").is_file() and first.is_dir()


def test_a_damaged_folder_is_mended(place):
    vendors.prepare()
    (pointed_to() / "pocl.icd").unlink()
    (pointed_to() / "clfur-intel.icd").write_bytes(b"half")
    vendors.prepare()
    assert (pointed_to() / "pocl.icd").is_file() and (pointed_to() / "clfur-intel.icd").read_bytes() == INTEL


def test_what_the_user_has_set_stays(place, monkeypatch):
    mine = place / "mine"
    mine.mkdir()
    monkeypatch.setenv("OCL_ICD_VENDORS", str(mine))
    assert vendors.prepare() is None and pointed_to() == mine and not (place / "vendors").exists()
    assert f"OCL_ICD_VENDORS is {mine}, a folder without .icd files" in vendors.vendors()[1]
    monkeypatch.setenv("OCL_ICD_VENDORS", "")   # the loader takes it for unset
    vendors.prepare()
    assert pointed_to().parent == place / "vendors"


def test_without_intel_nothing_happens(place, monkeypatch):
    vendors.prepare()
    monkeypatch.setattr(vendors, "_intel", lambda: None)
    vendors.prepare()   # as in a child whose Python has none
    assert "OCL_ICD_VENDORS" not in os.environ
    monkeypatch.setattr(vendors, "_intel", INTEL.decode)


@pytest.mark.parametrize("library, twice", [
    ("libintelocl.so", False), ("libintelocl.so.2026.1", False), ("/there/libintelocl.so", True),
    ("{here}/libintelocl.so", False), ("libintelocl_emu.so", True)])
def test_the_system_has_intel(place, library, twice):
    """No second one beside one that is there, whatever an .icd file names that is not."""
    (place / "libintelocl.so").touch()
    (place / "system" / "intel.icd").write_text(library.format(here=place))
    vendors.prepare()
    assert ("OCL_ICD_VENDORS" in os.environ) == twice


def test_a_cache_that_cannot_be_written(place):
    """Intel's driver is told of in a temporary folder then."""
    (place / "vendors").write_text("a file where the folder should be")
    assert vendors.prepare() is None
    assert pointed_to().parents[1] == caches.private() and (pointed_to() / "clfur-intel.icd").read_bytes() == INTEL
    assert vendors.prepare() is None and vendors.vendors()[0][1].origin == "intel-opencl-rt, added by clfur"
    with pytest.raises(Error):
        cache.write(place / "vendors" / "a", b"")


def test_no_folder_can_be_written(place, monkeypatch):
    def refuse(*_, **__):
        raise OSError(28, "No space left on device")
    (place / "vendors").write_text("a file where the folder should be")
    monkeypatch.setattr(caches, "private", refuse)
    assert "intel-opencl-rt is installed, but the loader is not told of it: " in vendors.prepare()
    assert "OCL_ICD_VENDORS" not in os.environ
    assert vendors.vendors()[1] == [vendors.prepare()]


def test_two_at_once(place):
    """Processes that start together agree, and none sees half a folder."""
    code = ("import os, sys, pathlib; from clfur import cache; from clfur.device import vendors; "
            "cache.folder = pathlib.Path(sys.argv[1]).joinpath; vendors._intel = lambda: '/i/libintelocl.so'; "
            "vendors.prepare(); f = pathlib.Path(os.environ['OCL_ICD_VENDORS']); "
            "print(f, sorted((x.name, x.read_bytes()) for x in f.glob('*.icd')))")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    running = [subprocess.Popen([sys.executable, "-c", code, str(place)], env=environment, stdout=subprocess.PIPE)
               for _ in range(6)]
    outputs = {process.communicate(timeout=60)[0] for process in running}
    assert len(outputs) == 1 and b"clfur-intel.icd" in outputs.pop() and all(p.returncode == 0 for p in running)
    assert len(list((place / "vendors").iterdir())) == 1


@pytest.mark.parametrize("value", ["libpocl.so.2", "{place}/system/pocl.icd", "pocl.icd"])
def test_one_driver_alone(place, monkeypatch, value):
    monkeypatch.setenv("OCL_ICD_VENDORS", value.format(place=place))
    listed, lines = vendors.vendors()
    assert [v.library for v in listed] == ["libpocl.so.2"] and lines == []


@pytest.mark.parametrize("value, kind", [("{place}/none", "folder or file"), ("{place}/none.icd", "file"),
                                         ("none.icd", "file")])
def test_pointing_to_nothing(place, monkeypatch, value, kind):
    value = value.format(place=place)
    monkeypatch.setenv("OCL_ICD_VENDORS", value)
    assert vendors.vendors() == ([], [f"OCL_ICD_VENDORS is {value}, and there is no such {kind}"])


def test_the_library_of_an_installed_wheel(place, monkeypatch):
    class File:
        def __init__(self, name):
            self.name = name

        def locate(self):
            return place / "site" / ".." / "lib" / self.name
    monkeypatch.undo()
    monkeypatch.setattr("importlib.metadata.files", lambda name: {"intel-opencl-rt": [
        File("libOpenCL.so"), File("libintelocl.so.1"), File("libintelocl.so")]}[name])
    assert vendors._intel() is None   # named, but not there
    (place / "site").mkdir()
    (place / "lib").mkdir()
    (place / "lib" / "libintelocl.so").touch()
    assert vendors._intel() == str(place / "lib" / "libintelocl.so")
