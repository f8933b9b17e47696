"""Finds which drivers OpenCL's loader looks at, and adds Intel's from PyPI to them; needs no OpenCL itself."""

import ctypes
import hashlib
import importlib.metadata
import importlib.util
import os
import platform
import sys
from dataclasses import dataclass
from pathlib import Path

from .. import cache
from ..errors import Error
from . import caches

SYSTEM = "/etc/OpenCL/vendors"
ADDED = "clfur-intel.icd"


# Where .icd files do not tell the drivers.
NOT_BY_FILES = {
    "win32": r"Windows keeps its drivers in the registry, in HKEY_LOCAL_MACHINE\SOFTWARE\Khronos\OpenCL\Vendors",
    "darwin": "pyopencl's wheel for macOS takes the OpenCL of macOS, and looks at no other driver",
}
# What brings an OpenCL driver, by sys.platform and processor.
CONDA = "conda-forge's pyopencl and pocl have one for the CPU"
DRIVERS = {
    ("linux", "x86_64"): "pip install pocl-binary-distribution brings one for the CPU",
    ("linux", ""): f"your system's PoCL is one for the CPU (Debian, Ubuntu: apt install pocl-opencl-icd), or {CONDA}",
    ("win32", "AMD64"): "a graphics driver brings one, pip install intel-opencl-rt intel-cmplr-lib-rt one for the CPU",
    ("darwin", ""): f"macOS has one of its own, which shows no device; {CONDA}",
}


@dataclass(frozen=True)
class Vendor:
    """A driver that the loader knows of.

    place: what OCL_ICD_VENDORS must be for this driver alone, an .icd file or a library.  library: what is to be
    loaded, "" if the file names none.  origin: who put it there.
    """

    place: str
    library: str
    origin: str


def advice():
    """What brings an OpenCL driver to this machine, in a few words."""
    kinds = (sys.platform, platform.machine()), (sys.platform, "")
    return next((DRIVERS[kind] for kind in kinds if kind in DRIVERS), f"a graphics driver brings one, or {CONDA}")


def prepare():
    """Point OpenCL's loader to the system's drivers and Intel's from PyPI, if that is installed in this Python, and
    drivers to folders for their kernels that can be written.

    The wheel's own .icd file names a place where the library is not.  The loader reads OCL_ICD_VENDORS when OpenCL is
    first used, so later this has no effect; one that the user has set stays as it is.  Writes to clfur's cache folder
    or a temporary one; where neither can be written, Intel's driver stays away, and the line that comes back says so.
    """
    caches.prepare()
    given = os.environ.get("OCL_ICD_VENDORS")
    if given and not _ours(given):
        return None
    if sys.platform == "win32":   # drivers are named by the registry, and by this
        if library := _intel():
            os.environ.setdefault("OCL_ICD_FILENAMES", library)
        return None
    if given:   # of a parent process, whose Python may have been another one
        del os.environ["OCL_ICD_VENDORS"]
    there = _system()
    library = _added([_vendor(file, "system") for file in there])
    if library is None:
        return None
    files = {file.name: _read(file) or b"" for file in there}
    try:
        os.environ["OCL_ICD_VENDORS"] = str(_write({**files, ADDED: os.fsencode(library)}))
    except (Error, OSError) as error:   # all other drivers work without
        return f"intel-opencl-rt is installed, but the loader is not told of it: {error}"
    return None


def vendors():
    """The drivers that the loader looks at now, as ([Vendor], [what else there is to say, a line each])."""
    lines = [line for line in [prepare()] if line] + caches.notes
    if note := NOT_BY_FILES.get(sys.platform):
        return [], [*lines, note]
    given = os.environ.get("OCL_ICD_VENDORS", "")
    if given and not _ours(given):
        path = Path(given)
        if not path.is_dir():   # that driver alone, even without the one that pyopencl brings
            if given.endswith(".icd"):
                path = path if "/" in given else _system_folder() / path
                if not path.is_file():
                    return [], [f"OCL_ICD_VENDORS is {given}, and there is no such file"]
                return [_vendor(path, "OCL_ICD_VENDORS")], []
            if "/" in given and not path.exists():
                return [], [f"OCL_ICD_VENDORS is {given}, and there is no such folder or file"]
            return [Vendor(given, given, "OCL_ICD_VENDORS")], []
        found = [_vendor(file, "OCL_ICD_VENDORS") for file in _icds(path)]
        if not found:
            lines.append(f"OCL_ICD_VENDORS is {given}, a folder without .icd files")
        if _intel():
            lines.append("OCL_ICD_VENDORS is set, so clfur does not add Intel's driver from PyPI")
    else:
        there = _system()
        found = [_vendor(file, "system") for file in there]
        if not found:
            lines.append(f"there are no .icd files in {_system_folder()}")
        if given:
            found.append(_vendor(Path(given, ADDED), "intel-opencl-rt, added by clfur"))
    return found + [_vendor(file, "comes with pyopencl") for file in _bundled()], lines


def trouble(vendor):
    """Why a driver's library cannot be loaded, as (status, one line), or None.  Loads it: a driver may crash."""
    if not vendor.library:
        text = _read(Path(vendor.place))
        return ("unreadable", "the file cannot be read") if text is None else ("empty file", "it names no library")
    try:
        library = ctypes.CDLL(vendor.library)
    except OSError as error:
        said = " ".join(str(error).split())
        if "cannot open shared object file" not in said:
            status = "symbol missing" if "undefined symbol" in said else "not a library"
        else:
            status = "library not found"
            if not said.startswith(vendor.library):
                said = f"a library that it needs is missing: {said}"
        return status, said
    if not hasattr(library, "clGetExtensionFunctionAddress"):
        return "symbol missing", "it is no OpenCL driver: it has no clGetExtensionFunctionAddress"
    return None


def _vendor(file, origin):
    library = _library(file)
    beside = file.parent / library
    # pyopencl's loader finds the library that it brings beside itself.
    return Vendor(str(file), str(beside) if library and "/" not in library and beside.is_file() else library, origin)


def _added(system):
    """Intel's driver from PyPI, if it is to be added to these; None if it is not installed or there already."""
    # "/" marks a path, which may name nothing; the loader searches for other names.
    named = [v.library for v in system if Path(v.library).name.startswith("libintelocl.so")]
    return None if any("/" not in library or Path(library).is_file() for library in named) else _intel()


def _intel():
    """Path of Intel's driver as pip has installed it in this Python, or None."""
    try:
        files = importlib.metadata.files("intel-opencl-rt") or []
    except importlib.metadata.PackageNotFoundError:
        return None
    paths = [Path(file.locate()).resolve() for file in files if file.name in ("libintelocl.so", "intelocl64.dll")]
    return next((str(path) for path in paths if path.is_file()), None)


def _system_folder():
    return Path(os.environ.get("OPENCL_VENDOR_PATH") or SYSTEM)


def _system():
    return _icds(_system_folder())


def _bundled():
    """The .icd files in pyopencl's own folder, which its loader reads besides."""
    spec = importlib.util.find_spec("pyopencl")   # finds it, does not import it
    return _icds(Path(spec.origin).parent / ".libs") if spec and spec.origin else []


def _icds(folder):
    try:
        return sorted(file for file in folder.iterdir() if file.name.endswith(".icd"))
    except OSError:   # no such folder: no drivers
        return []


def _read(file):
    try:
        return file.read_bytes()
    except OSError:
        return None


def _library(file):
    """The library that an .icd file names: its first line, as the loader reads it."""
    return os.fsdecode((_read(file) or b"").split(b"\n")[0])


def _ours(path):
    """Whether OCL_ICD_VENDORS was set by `prepare`, here or in a parent process."""
    try:
        kept = Path(path).parent == cache.folder("vendors")
    except Error:   # no cache folder, so nothing in it
        kept = False
    return kept or Path(path, ADDED).is_file()


def _write(files):
    """Folder of these files {name: bytes} in the cache, or a temporary one; raises `clfur.Error` or OSError if neither
    can be written.

    It is named by what it holds, and every process makes sure of every file: several may do so at once.
    """
    name = hashlib.sha256(repr(sorted(files.items())).encode()).hexdigest()[:16]
    try:
        return _filled(cache.folder("vendors") / name, files)
    except Error:
        return _filled(caches.private() / "vendors" / name, files)


def _filled(path, files):
    for name, content in files.items():
        if _read(path / name) != content:
            cache.write(path / name, content)
    return path
