"""Finds, describes and chooses OpenCL devices."""

import os
import re

import pyopencl as cl

from .errors import Error

_TYPES = {"gpu": cl.device_type.GPU, "cpu": cl.device_type.CPU}


def find():
    """All OpenCL devices (pyopencl.Device), in platform and then device order; maybe none."""
    return [device for devices in _platforms() for device in devices]


def choose(device=None):
    """The OpenCL device that ``device`` means, or CLFUR_DEVICE, PYOPENCL_CTX or the best one if it is None.

    Accepts what `pick` does, and a pyopencl.Device, which comes back as it is.
    Raises `clfur.Error` if there is no such device.
    """
    if isinstance(device, cl.Device):
        return device
    if device is not None and not isinstance(device, str):
        raise Error(f"device must be text such as 'pocl', or a pyopencl.Device, not {device!r}")
    source = ""
    if device is None:
        source, device = next(((f"{name}: ", os.environ[name]) for name in ("CLFUR_DEVICE", "PYOPENCL_CTX")
                               if os.environ.get(name, "").strip()), ("", "auto"))
    try:
        return pick(device, _platforms())
    except Error as error:
        raise Error(f"{source}{error}") from None


def pick(text, platforms):
    """The device that ``text`` means among ``platforms``, a list of lists of devices.

    "auto", "cpu", "gpu", or a part of the platform's name or version or else of the device's name, in any
    case; ":1" after it takes the second match in the order of "auto" (GPU, CPU, others; PoCL first).
    "1:0" and "1" are numbers of platform and device.  Raises `clfur.Error` if there is no such device.
    """
    if not any(platforms):
        # PoCL without a folder for its kernel cache is there, but shows no device.
        hint = "; PoCL also needs a cache folder it can write to" if platforms else ""
        raise Error(f'there is no OpenCL device; pip install "pyopencl[pocl]" brings one for the CPU{hint}')
    matches = _matches(text, platforms)
    if not matches:
        there = ", ".join(f"{handle} ({describe(device)})" for handle, device in handles(platforms))
        raise Error(f"no OpenCL device matches {text!r}; there is {there}")
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


def describe(device):
    """Short text for people, such as "PoCL 3.0 · Intel Xeon (2 units)": driver, processor, compute units."""
    if _is_pocl(device):
        driver = re.search(r"pocl *[\d.]*", device.platform.version, re.IGNORECASE)[0].replace("pocl", "PoCL")
    else:
        driver = f"{device.platform.name} {device.driver_version}"
    # PoCL puts its own name and the compiler's for the processor ahead of the processor's name.
    name = re.sub(r"^(pthread|basic|cpu)-([a-z0-9_-]+-(?=[A-Z]))?", "", device.name)
    units = device.max_compute_units
    return f"{_tidy(driver)} · {_tidy(name)} ({units} unit{'s' * (units != 1)})"


def _platforms():
    """The devices of each OpenCL platform: a list of lists."""
    try:
        return [_devices(platform) for platform in cl.get_platforms()]
    except cl.Error as error:
        if "PLATFORM_NOT_FOUND_KHR" in str(error):
            return []
        raise Error(f"OpenCL does not start: {error}") from None


def _devices(platform):
    try:
        return platform.get_devices()
    except cl.Error:   # a driver that finds none, or that fails, must not hide the others
        return []


def _matches(text, platforms):
    """The devices that ``text`` means, the best first; maybe none."""
    text = text.strip().lower()
    if numbers := re.fullmatch(r"(\d+)(?::(\d+))?", text):
        platform, device = (int(number or 0) for number in numbers.groups())
        return platforms[platform][device:device + 1] if platform < len(platforms) else []
    name, first = text, 0
    if numbered := re.fullmatch(r"(.+):(\d+)", text):
        name, first = numbered[1], int(numbered[2])
    devices = sorted((device for platform in platforms for device in platform), key=_rank)   # stable
    if name == "auto":
        found = devices
    elif name in _TYPES:
        found = [d for d in devices if d.type & _TYPES[name]]
    else:
        # The platform goes first: "intel" is Intel's driver where there is one, not PoCL on Intel's CPU.
        found = ([d for d in devices if name in f"{d.platform.name}\n{d.platform.version}".lower()]
                 or [d for d in devices if name in d.name.lower()]) if name else []
    return found[first:]


def _is_pocl(device):
    return "pocl" in device.platform.version.lower()


def _rank(device):
    kind = 0 if device.type & cl.device_type.GPU else 1 if device.type & cl.device_type.CPU else 2
    return kind, not _is_pocl(device)


def _tidy(text):
    return " ".join(re.sub(r"\((R|TM|C)\)|\bProcessor\b", "", text, flags=re.IGNORECASE).split())
