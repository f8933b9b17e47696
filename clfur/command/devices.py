"""`clfur devices`: what OpenCL devices there are, whether they draw right, and why a driver is not there."""

import contextlib
import hashlib
import json
import os
import re
import sys
import threading
from concurrent.futures import Future, ThreadPoolExecutor, wait

import click

from .. import cache
from ..device import caches, vendors
from ..errors import Error
from ..judge.isolated import isolated
from . import endings
from .lines import say

LOADING, CHECKING = 60, 180   # seconds; PoCL compiles every kernel on the first run


@click.command()
@click.option("--check", is_flag=True, help="Draw a small picture on each device and say whether it is right, and how "
              "fast a larger one is; auto then takes the fastest that is right.")
@click.option("--why", is_flag=True, help="List every driver that OpenCL looks at, and why it does not load.")
@click.option("--report", is_flag=True, help="Print what a bug report should hold: versions, system, devices, drivers, "
              "what is known of their checks; no paths, no names of users.")
@click.option("--json", "as_json", is_flag=True, help="Print the same as one JSON object.")
def devices(check, why, report, as_json):
    """List the OpenCL devices: what to give --device, and which one is taken without it.

    With --check, the exit code is 1 if a device fails.
    """
    asked = [name for name, given in {"--check": check, "--why": why, "--report": report}.items() if given]
    if len(asked) > 1:
        raise click.UsageError(f"{' and '.join(asked)} are {len(asked)} questions: ask one at a time")
    if report:
        return _report(as_json)
    if why:
        return _why(as_json)
    vendors.prepare()   # here, so that what it makes stays as long as the command
    found = survey()
    for note in caches.notes:
        click.echo(f"clfur: warning: {note}", err=True)
    failures = _check(found) if check else {}
    if as_json:
        print(json.dumps(found))
    else:
        _list(found)
    return int(bool(failures))


def survey(stop=None):
    """`device.survey` from a process of its own: a driver that crashes while it loads must not end the command.

    ``stop``: as for `isolated`."""
    outcome = isolated("clfur.device.selection:survey", seconds=LOADING, stop=stop)
    if outcome.status == "error":
        raise Error(outcome.message)
    if outcome.status != "ok":
        raise Error(f"OpenCL does not start: {outcome.message}; clfur devices --why tells of each driver")
    if not any(platform["devices"] for platform in outcome.value["platforms"]):
        raise Error(f"there is no OpenCL device; {vendors.advice()}; clfur devices --why tells of each driver")
    return outcome.value


_asked: list[Future] = []   # within `asking_drivers`: what `ask_drivers` waits for


@contextlib.contextmanager
def asking_drivers():
    """Within the block another process finds out, for `ask_drivers`, whether a driver crashes while it loads: this one
    does meanwhile what needs none.  Once for each set of drivers, and then it is remembered."""
    listed = vendors.vendors()[0]
    state = [(v, os.stat(v.library).st_mtime_ns if os.path.isfile(v.library) else None) for v in listed]
    name, over = hashlib.sha256(repr(state).encode()).hexdigest()[:16], threading.Event()
    try:
        known = (cache.folder("loaded") / name).is_file()
    except Error:   # no cache folder: ask each time
        known = False
    with ThreadPoolExecutor(1) as pool:
        if known:
            _asked.append(Future())
            _asked[0].set_result(None)
        else:
            endings.half_done[:] = over.set, pool.shutdown   # which waits till it is over
            _asked.append(pool.submit(_load, name, over.is_set))
        try:
            yield
        finally:
            over.set()
            _asked.clear()
            endings.half_done.clear()


def _load(name, stop):
    survey(stop)
    with contextlib.suppress(Error):   # asked again next time
        cache.write(cache.folder("loaded") / name, b"")


def ask_drivers():
    """Raise `clfur.Error` if a driver crashes while it loads: before OpenCL starts in this process, which would die of
    it without a word."""
    with contextlib.nullcontext() if _asked else asking_drivers():
        while wait(_asked, 0.1).not_done:   # on Windows nothing interrupts what waits without an end
            pass
        _asked[0].result()


def _each(found):
    return [device for platform in found["platforms"] for device in platform["devices"]]


def _check(found):
    """Check each device, remember it, and update what was found -> {identity: verdict} of those that fail."""
    from ..judge.report import milliseconds  # not above: commands that draw begin with this module, which is light

    failures = {}
    for name, device in [(each["name"], device) for each in found["platforms"] for device in each["devices"]]:
        click.echo(f"{device['device']}: checking {device['description']} ...", err=True)
        verdict, message, notes = _verdict(device["number"], {})
        seconds = None
        if verdict in ("crash", "wrong"):   # perhaps because of kernels that are spoilt
            with caches.temporary() as empty:
                again, _, _ = _verdict(device["number"], caches.in_folder(empty))
            if again == "pass":
                notes.append(f"it is right without the kernels that are kept{caches.where(name)}: these "
                             f"are spoilt, delete them ({verdict}: {message})")
                verdict, message = again, ""
        if verdict == "pass":
            seconds, trouble = _seconds(device["number"])
            notes += [trouble] * bool(trouble)
        device["check"] = {"verdict": verdict, "message": message, "seconds": seconds}
        took = f", {milliseconds(seconds)} ms a frame" if seconds else ""
        for line in [f"{verdict}{took}{message and f': {message}'}", *notes]:
            click.echo(f"{device['device']}: {line}", err=True)
        identity = tuple(device["identity"])
        if identity in failures:   # of two cards of one kind, the one that fails counts
            continue
        if verdict != "pass":
            failures[identity] = verdict
        try:
            cache.remember(device["identity"], verdict, message, seconds)
        except Error as error:
            click.echo(f"{device['device']}: this is not remembered: {error}", err=True)
    # What auto takes may be another device now.
    again = survey()
    found["auto"], found["default"] = again["auto"], again["default"]
    return failures


def _verdict(number, environment):
    """(verdict of the self-test on a device in a process of its own, why it fails or "", [what was warned of])."""
    outcome = isolated("clfur.judge.selftest:check", number, seconds=CHECKING, environment=environment)
    message, notes = outcome.value if outcome.status == "ok" else (outcome.message, [])
    verdict = {"ok": "wrong" if message else "pass", "error": "wrong"}.get(outcome.status, outcome.status)
    return verdict, message, notes


def _seconds(number):
    """(seconds of a frame on a device in a process of its own, "") or (None, why there are none)."""
    outcome = isolated("clfur.judge.speed:measure", number, seconds=CHECKING)
    return (outcome.value, "") if outcome.status == "ok" else (None, f"it was not timed: {outcome.message}")


def _list(found):
    """Print some lines about each device, as wide as the terminal, and which is taken."""
    from ..judge import speed
    from . import bug_report

    for platform in found["platforms"]:
        # What follows the version is how PoCL was built.
        title = f"{platform['name']}, {re.split(',|  ', platform['version'])[0].strip()}"
        if not platform["devices"]:
            say(f"no device: {title}")
            print()
        for d in platform["devices"]:
            numbers = [f"{'' if d[name] else 'no '}{words}" for name, words in (
                ("fp64", "fp64"), ("int64_atomics", "64-bit atomics"))]
            say(f"--device {d['device']}: {d['short_name']}",
                f"{d['type']}, {d['compute_units']} units, {_size(d['memory'])} ({_size(d['largest_allocation'])} an "
                f"array), {', '.join(numbers)}",
                f"{title}, driver {d['driver']}", f"check: {bug_report.checked(d['check'])}")
            print()
    for device in _each(found):
        if device["limit"]:
            print(f"{device['device']} plans with {_size(device['planned'])}: this process may take no more "
                  f"({device['limit']})")
    if timed := {d["device"]: d["check"]["seconds"] for d in _each(found) if d["check"] and d["check"]["seconds"]}:
        print(speed.told(timed))
    print(_sentence(found))


def _sentence(found):
    """Which device is taken without --device, and why."""
    auto, default = found["auto"], found["default"]
    sentence = f"auto takes {auto['device']}: {auto['why']}"
    if default["by"] == "auto":
        return sentence
    taken = f"takes {default['device']}" if default["device"] else "fits no device"
    return f"{default['by']}={default['text']} decides: it {taken}\nwithout it {sentence}"


def _report(as_json):
    if as_json:
        raise click.UsageError("--report is text for people; allowed beside it: nothing")
    from . import bug_report

    rows, notes = _drivers()
    try:
        found, trouble = survey(), ""
    except Error as error:
        found, trouble = None, str(error)
    print(bug_report.report(found, trouble, rows, notes))


def _why(as_json):
    rows, lines = _drivers()
    if as_json:
        print(json.dumps({"drivers": rows, "notes": lines}))
        return
    for row in rows:
        print(f"{row['file']} ({row['origin']})\n    {row['status']}: {row['message']}")
    for line in lines:
        print(line)
    if not rows and sys.platform not in vendors.NOT_BY_FILES:
        print("OpenCL's loader looks at no driver at all")


def _drivers():
    """([{what is known of a driver}], [what else there is to say]), each driver in a process of its own."""
    listed, lines = vendors.vendors()
    rows = []
    for vendor in listed:
        outcome = isolated("clfur.device.selection:probe", vendor, seconds=LOADING,
                           environment={"OCL_ICD_VENDORS": vendor.place})
        status, message = outcome.value if outcome.status == "ok" else (outcome.status, outcome.message)
        rows.append({"file": vendor.place, "library": vendor.library, "origin": vendor.origin,
                     "status": status, "message": message})
    return rows, lines


def _size(number):
    return f"{number / 2**30:.1f} GiB"
