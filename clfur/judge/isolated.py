"""Calls a function in a process of its own, so that a driver's crash or hang costs no more than that call."""

import contextlib
import importlib
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..device.caches import remove_private, takes_kernels, temporary
from ..errors import Error, go_on

GRACE = 1.0   # seconds for what takes kernels when it is to end


@dataclass(frozen=True)
class Outcome:
    """What became of the call.

    status: "ok", "error" (it raised), "crash" (its process died) or "hang" (it took longer than allowed).
    value: what it returned, or None.  message: one line of why there is no value, or "".
    """

    status: str
    value: Any = None
    message: str = ""


def isolated(function, *arguments, seconds, receive=None, environment=None, stop=None):
    """Call ``function`` ("package.module:name") with ``arguments`` in a fresh process -> `Outcome`.

    ``receive``: called here with each object that the function there sends by ``isolated.send(object)``.  ``seconds``:
    it may take, from one such object to the next.  ``environment``: variables to change there, {name: text}.
    ``stop``: a function that is asked again and again; once it says True, `clfur.Stopped` is raised.
    The process and what it started are gone when this returns, or raises.  Raises `clfur.Error` for arguments that
    cannot be sent to it.
    """
    try:
        call = pickle.dumps((function, arguments, sys.path))
    except Exception as error:   # pickle raises whatever it met
        raise Error(f"cannot be sent to another process: {' '.join(str(error).split())}") from error
    with temporary() as folder:
        answers, errors = Path(folder, "answers"), Path(folder, "stderr")
        Path(folder, "call").write_bytes(call)
        answers.touch()
        with errors.open("wb") as stderr:
            child = subprocess.Popen(
                [sys.executable, "-c", "import sys; sys.path[:0] = sys.argv[2:]; "
                 "from clfur.judge.isolated import _serve; _serve(sys.argv[1])",
                 folder, str(Path(__file__).parents[2])],
                stdin=subprocess.PIPE, stdout=stderr, stderr=stderr, start_new_session=True,
                env={**os.environ, **(environment or {})})
        try:
            value, status = _listen(child, answers, seconds, receive, stop)
        finally:
            end(child)
        if status == "hang":
            return Outcome("hang", None, f"no answer in {seconds:g} s")
        if status == "ok":
            return Outcome("ok", value)
        if status == "error":
            return Outcome("error", None, value)
        last = errors.read_text(encoding="utf-8", errors="replace").split("\n")
        said = next((" ".join(line.split()) for line in reversed(last) if line.strip()), "")
        return Outcome("crash", None, f"the process {_death(child.returncode)}" + (f": {said}" if said else ""))


def end(child):
    """End the child and what it started; Windows has no groups of processes, and there it ends alone."""
    if hasattr(os, "killpg"):
        asked = time.monotonic()
        while time.monotonic() - asked < GRACE and takes_kernels(child.pid):
            time.sleep(0.02)
        with contextlib.suppress(ProcessLookupError, PermissionError):   # gone; gone, as macOS says it
            os.killpg(child.pid, signal.SIGKILL)
    else:
        child.kill()
    child.wait()
    child.stdin.close()


def _death(code):
    """How a process ended, by its exit code: a signal's is negative, and an exception's of Windows is large."""
    if code < 0:
        return f"died of {signal.Signals(-code).name}"
    return f"ended with code {code}" if code < 1 << 16 else f"ended with code 0x{code:08x}"


def _listen(child, answers, seconds, receive, stop):
    """(value, status) of the child: what it writes to the file ``answers``, until it has written all or has died."""
    heard = time.monotonic()
    with answers.open("rb") as stream:
        while True:
            ended = child.poll() is not None   # asked before reading: what it wrote last is not missed
            place = stream.tell()
            try:
                kind, value = pickle.load(stream)
            except (EOFError, pickle.UnpicklingError):   # nothing new, or half of it
                stream.seek(place)
                if ended:
                    return None, "crash"
                if time.monotonic() - heard > seconds:
                    return None, "hang"
                go_on(stop)
                time.sleep(0.02)
                continue
            heard = time.monotonic()
            if kind != "sent":
                return value, kind
            if receive:
                receive(value)


_stream = None   # of the process that serves a call


def send(value):
    """Send an object to the process that called `isolated`; there it reaches ``receive``."""
    _send("sent", value)


def _send(kind, value):
    if _stream:
        _stream.write(pickle.dumps((kind, value)))
        _stream.flush()


def end_with_parent():
    """End this process and what it started once the parent's end of stdin is closed, however the parent ended."""
    sys.stdin.buffer.read(1)
    if hasattr(os, "killpg") and os.getpgrp() == os.getpid():
        os.killpg(os.getpid(), signal.SIGKILL)
    os._exit(1)


def _serve(folder):
    """Do the call that lies in a folder."""
    global _stream
    threading.Thread(target=end_with_parent, daemon=True).start()
    function, arguments, path = pickle.loads(Path(folder, "call").read_bytes())
    sys.path[:] = path
    _stream = Path(folder, "answers").open("ab")   # noqa: SIM115, open to the end
    module, name = function.split(":")
    try:
        _send("ok", getattr(importlib.import_module(module), name)(*arguments))
    except Error as error:
        _send("error", str(error))
    except Exception as error:
        _send("error", f"{type(error).__name__}: {' '.join(str(error).split())[:500]}")
    remove_private()
    os._exit(0)   # drivers may crash at exit, after all is done
