"""Finds, describes and chooses OpenCL devices."""

import os
import re
import warnings
from typing import Any

import pyopencl as cl

from .. import cache
from ..errors import Error, shown
from . import caches, programs, vendors
from .memory import allowed, planned

CHECKER = "Oclgrind"   # the platform that the extra "test" brings
_TYPES = {"gpu": cl.device_type.GPU, "cpu": cl.device_type.CPU}


def find() -> list[cl.Device]:
    """All OpenCL devices (pyopencl.Device), in platform and then device order; maybe none."""
    return [device for devices in _platforms() for device in devices]


def choose(device: Any = None) -> cl.Device:
    """The OpenCL device that ``device`` means, or CLFUR_DEVICE, PYOPENCL_CTX or the best one if it is None.

    Accepts what `pick` does, and a pyopencl.Device, which comes back as it is.
    Raises `clfur.Error` if there is no such device.
    """
    _start()
    if isinstance(device, cl.Device):
        return device
    if device is not None and not isinstance(device, str):
        raise Error(f"device is {shown(device)}; allowed: None, 'auto', 'cpu', 'gpu', part of a name such as 'pocl', a "
                    "number behind these as in 'pocl:1', numbers of platform and device as in '1:0', or a "
                    "pyopencl.Device")
    source, wish = _wish() if device is None else ("", device)
    platforms = _platforms()
    try:
        return pick(wish, platforms, *(_known(platforms) if wish.strip().lower().startswith("auto") else ()))
    except Error as error:
        raise Error(f"{source}: {error}" if source else str(error)) from None


def pick(text, platforms, failed=(), measured=()):
    """The device that ``text`` means among ``platforms``, a list of lists of devices.

    "auto", "cpu", "gpu", or a part of the platform's name or version or else of the device's name, in any
    case; ":1" after it takes the second match in the order of "auto" (GPU, CPU, others; PoCL first).
    "1:0" and "1" are numbers of platform and device.  "auto" takes the devices that ``failed`` their self-test last,
    and of those that are ``measured``, [(device, seconds of a frame)], the fastest first: see `_best_first`.
    Raises `clfur.Error` if there is no such device.
    """
    if not any(platforms):
        # PoCL without a folder for its kernel cache is there, but shows no device.
        hint = "; PoCL also needs a cache folder it can write to" if platforms else ""
        raise Error(f"there is no OpenCL device; {vendors.advice()}{hint}")
    matches = _matches(text, platforms, failed, measured)
    if not matches:
        kinds = [kind for kind in ("cpu", "gpu") if _matches(kind, platforms)]
        there = ", ".join(f"{handle} ({describe(device)})" for handle, device in handles(platforms))
        raise Error(f"no OpenCL device matches {shown(text)}; allowed: {', '.join(['auto', *kinds])}, or part of a "
                    f"name of what is there: {there}")
    return matches[0]


def handles(platforms=None):
    """(text, device) for each device of ``platforms``, or of all there are: a short text that means it to `pick`."""
    platforms = _platforms() if platforms is None else platforms
    found = []
    for p, devices in enumerate(platforms):
        for d, device in enumerate(devices):
            short = "pocl" if _is_pocl(device) else re.match(r"\w*", device.platform.name.lower())[0]
            place = next((n for n, match in enumerate(_matches(short, platforms)) if match is device), None)
            found.append((f"{p}:{d}" if place is None else f"{short}:{place}" if place else short, device))
    return found


def describe(device: cl.Device) -> str:
    """Short text for people, such as "PoCL 3.0 · Intel Xeon (2 units)": driver, processor, compute units."""
    if _is_pocl(device):
        driver = re.findall(r"pocl *[\d.]*", device.platform.version, re.IGNORECASE)[0].replace("pocl", "PoCL")
    else:
        driver = f"{device.platform.name} {device.driver_version}"
    units = device.max_compute_units
    return f"{_tidy(driver)} · {_short_name(device)} ({units} unit{'s' * (units != 1)})"


def reason(platforms, failed=(), measured=()):
    """Why "auto" takes the device that it takes, in a few words: "no GPU; PoCL before other CPU drivers"."""
    best = pick("auto", platforms, failed, measured)
    devices = _matches("auto", platforms)
    if len(devices) == 1:
        return "it is the only device" + "; it failed its check, though" * (best in failed)
    skipped = [handle for handle, device in handles(platforms)
               if device in failed and best not in failed and _rank(device) <= _rank(best)]
    rivals = [device for device in devices if best in failed or device not in failed]
    kinds, kind = [_rank(device)[0] for device in rivals], _rank(best)[0]
    words = [f"{', '.join(skipped)} failed the check"] if skipped else []
    if best in failed:
        words.append("all failed their check")
    timed = [device for device, _ in measured if device in rivals]
    if best in timed and len(timed) > 1:
        return "; ".join([*words, f"the fastest of {len(timed)} that were measured"])
    if kind == 0 and max(kinds) > 0:
        words.append("GPU before CPU")
    elif kind and not skipped:
        words.append(("", "no GPU", "no GPU or CPU")[kind])
    named = ("GPU", "CPU", "device")[kind]
    same = [device for device in rivals if _rank(device)[0] == kind]
    if _is_pocl(best) and not all(map(_is_pocl, same)):
        words.append(f"PoCL before other {named} drivers")
    if (alike := sum(_rank(device) == _rank(best) for device in rivals)) > 1:
        words.append(f"the first of {alike} {'PoCL devices' if _is_pocl(best) else f'{named}s'}")
    return "; ".join(words) or "the best there is"


def survey():
    """All that is known of this machine's OpenCL, as what JSON can hold: see `clfur devices --json`."""
    found = _found()
    platforms = [devices for _, devices in found]
    named, (failed, measured) = handles(platforms), _known(platforms)
    handle_of = {id(device): handle for handle, device in named}
    source, wish = _wish()
    default = auto = None
    if named:
        auto = {"device": handle_of[id(pick("auto", platforms, failed, measured))],
                "why": reason(platforms, failed, measured)}
        matches = _matches(wish, platforms, failed, measured)
        default = {"by": source or "auto", "text": wish, "device": handle_of[id(matches[0])] if matches else None}
    return {"auto": auto, "default": default, "platforms": [
        {"name": platform.name, "version": platform.version, "vendor": platform.vendor, "devices": [
            {"device": handle_of[id(device)], "number": f"{p}:{d}", **_facts(device)}
            for d, device in enumerate(devices)]}
        for p, (platform, devices) in enumerate(found) if devices or platform.name != CHECKER]}


def local_devices(wish):
    """Numbers ("0:1") of the devices on this machine that jobs can be shared among, one at a time each.

    wish: None, or what `choose` takes, or a list of these. Without it, and none in the environment: all GPUs that did
    not fail the self-test, if "auto" means one of them, or what `choose` takes.
    """
    several = wish if isinstance(wish, (list, tuple)) else [wish]
    platforms = _platforms()
    if several == [None] and not _wish()[0]:
        failed, measured = _known(platforms)
        gpus = [device for devices in platforms for device in devices
                if device.type & cl.device_type.GPU and device not in failed]
        several = gpus if gpus and pick("auto", platforms, failed, measured) in gpus else several
    chosen = [choose(getattr(one, "device", one)) for one in several]   # a Scheduler's
    return [f"{p}:{d}" for one in chosen for p, devices in enumerate(platforms) for d, device in enumerate(devices)
            if device == one]


def probe(vendor):
    """What becomes of one `vendors.Vendor` -> (status, one line).

    In a process of its own where OCL_ICD_VENDORS is its place: its driver may crash.
    """
    if trouble := vendors.trouble(vendor):
        return trouble
    found = _found()
    devices = [describe(device) for _, devices in found for device in devices]
    if devices:
        return "loaded", f"{len(devices)} device{'s' * (len(devices) != 1)}: {', '.join(devices)}"
    if not found:
        return "no platform", "the driver loads, but shows no platform"
    hints = {"rusticl": "RUSTICL_ENABLE must name its drivers, such as llvmpipe or radeonsi",
             "portable": "PoCL needs a folder that it can write to: HOME, XDG_CACHE_HOME or POCL_CACHE_DIR",
             "clover": "Mesa's Clover drives some older AMD GPUs only"}
    names = ", ".join(platform.name for platform, _ in found)
    hint = next((f"; {hint}" for name, hint in hints.items() if name in names.lower()), "")
    return "no device", f"{names} is there, but has no device{hint}"


_started = None   # the process that has started OpenCL


def check_process():
    """Raises `clfur.Error` in a process forked from one that had started OpenCL: drivers hang there."""
    if _started not in (None, os.getpid()):
        raise Error('OpenCL does not survive a fork: start processes by "spawn", as '
                    'multiprocessing.get_context("spawn") does')


def _start():
    """Before the first use of OpenCL in this process."""
    global _started
    check_process()
    if _started is None:
        vendors.prepare()
        programs.leave_pyopencls_cache()
        for line in caches.notes:
            warnings.warn(line, RuntimeWarning, stacklevel=3)
        _started = os.getpid()


def _wish():
    """(variable, text) of the device that the user's environment names; ("", "auto") without."""
    return next(((name, os.environ[name]) for name in ("CLFUR_DEVICE", "PYOPENCL_CTX")
                 if os.environ.get(name, "").strip()), ("", "auto"))


def _platforms():
    """The devices of each OpenCL platform: a list of lists."""
    return [devices for _, devices in _found()]


def _found():
    """Each OpenCL platform and its devices: a list of (platform, list)."""
    _start()
    try:
        with caches.unheard():   # drivers start threads
            platforms = cl.get_platforms()
    except cl.Error as error:
        if "PLATFORM_NOT_FOUND_KHR" in str(error):
            return []
        raise Error(f"OpenCL does not start: {error}") from None
    # It is there to check kernels, and takes a hundred times as long: nobody draws with it unless it is alone.
    left_out = CHECKER if len(platforms) > 1 else None
    return [(platform, [] if platform.name == left_out else _devices(platform)) for platform in platforms]


def _devices(platform):
    try:
        return platform.get_devices()
    except cl.Error:   # a driver that finds none, or that fails, must not hide the others
        return []


def _matches(text, platforms, failed=(), measured=()):
    """The devices that ``text`` means, the best first; maybe none."""
    text = text.strip().lower()
    if numbers := re.fullmatch(r"(\d{1,9})(?::(\d{1,9}))?", text):
        platform, device = (int(number or 0) for number in numbers.groups())
        return platforms[platform][device:device + 1] if platform < len(platforms) else []
    name, first = text, 0
    if numbered := re.fullmatch(r"(.+):(\d{1,9})", text):
        name, first = numbered[1], int(numbered[2])
    devices = sorted((device for platform in platforms for device in platform), key=_rank)   # stable
    if name == "auto":
        found = _best_first(devices, failed, measured)
    elif name in _TYPES:
        found = [d for d in devices if d.type & _TYPES[name]]
    else:
        # The platform goes first: "intel" is Intel's driver where there is one, not PoCL on Intel's CPU.
        found = ([d for d in devices if name in f"{d.platform.name}\n{d.platform.version}".lower()]
                 or [d for d in devices if name in d.name.lower()]) if name else []
    return found[first:]


def _best_first(devices, failed, measured):
    """Devices in the order of "auto", of what is ordered by kind: those that failed last; and of the others those that
    were measured, [(device, seconds)], take each other's places by speed, while others keep theirs.

    So a GPU that was never measured stays before CPUs that were: a new driver must not turn a machine to its CPU.
    """
    passing = [device for device in devices if device not in failed]
    timed = [device for device, _ in sorted(measured, key=lambda each: each[1]) if device in passing]
    fastest = iter(timed)
    return [next(fastest) if device in timed else device for device in passing] + [
        device for device in devices if device in failed]


def _identity(device):
    """Texts that distinguish a device and its driver from others, also where machines share a home."""
    return [device.platform.name, device.platform.version, device.name, device.driver_version,
            str(device.max_compute_units)]


def _known(platforms):
    """([device] whose last self-test failed, [(device, seconds of a frame)] that were measured), as remembered."""
    devices = [(device, _identity(device)) for devices in platforms for device in devices]
    return ([device for device, identity in devices if (cache.recall(identity) or ("pass",))[0] != "pass"],
            [(device, seconds) for device, identity in devices if (seconds := cache.recall_seconds(identity))])


def shares_processor(one, other):
    """Whether two devices are the same processor: one device, or two drivers of this machine's CPU."""
    return one is other or one == other or all(
        device.type & cl.device_type.CPU and device.parent_device is None for device in (one, other))


def _facts(device):
    """What `survey` has of a device; sizes in bytes."""
    check, seconds = cache.recall(_identity(device)), cache.recall_seconds(_identity(device))
    memory, limit = planned(device.global_mem_size, allowed(device.max_compute_units, is_shared(device)))
    return {
        "name": device.name,
        "short_name": _short_name(device),
        "type": next((name.upper() for name, kind in _TYPES.items() if device.type & kind), "other"),
        "driver": device.driver_version,
        "compute_units": device.max_compute_units,
        "memory": device.global_mem_size,
        "planned": memory,
        "limit": limit,
        "largest_allocation": device.max_mem_alloc_size,
        "fp64": bool(device.double_fp_config),
        "int64_atomics": "cl_khr_int64_extended_atomics" in device.extensions.split(),
        "description": describe(device),
        "identity": _identity(device),
        "check": check and {"verdict": check[0], "message": check[1], "seconds": seconds},
    }


def is_shared(device):
    """Whether a device's memory is the machine's own."""
    return bool(device.type & cl.device_type.CPU or device.host_unified_memory)


def _is_pocl(device):
    return "pocl" in device.platform.version.lower()


def _rank(device):
    kind = 0 if device.type & cl.device_type.GPU else 1 if device.type & cl.device_type.CPU else 2
    return kind, not _is_pocl(device)


def _short_name(device):
    # PoCL puts its own name and the compiler's for the processor ahead of the processor's name.
    return _tidy(re.sub(r"^(pthread|basic|cpu)-([a-z0-9_-]+-(?=[A-Z]))?", "", device.name))


def _tidy(text):
    return " ".join(re.sub(r"\((R|TM|C)\)|\bProcessor\b", "", text, flags=re.IGNORECASE).split())
