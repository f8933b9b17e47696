"""What ends the command: Ctrl-C, SIGTERM (Slurm, Kubernetes, `timeout`) and SIGHUP.  No other process is touched."""

import os
import signal
import sys
import threading
import time
from contextlib import contextmanager, suppress

SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
ONE = 1.0     # seconds: signals that come closer are one; `timeout` sends two
SOON = 0.05   # seconds, after which one is sent again that got lost

_heard: list[tuple[int, float]] = []   # (number, time) of each signal that counted


class Ended(BaseException):
    """A signal came: raised wherever the command is, so that all that is half done is undone."""


def watch_imports():
    """If this process is the command, a signal ends it in one line: for all that comes before and after `raised`."""
    if is_command(sys.argv, sys.orig_argv):
        _handle(_leave)


def is_command(arguments, original):
    """Whether a process with this sys.argv and sys.orig_argv is `clfur ...` or `python -m clfur ...`.

    While Python looks for the module of -m, "-m" is all that sys.argv starts with.
    """
    name = os.path.basename(arguments[0]) if arguments else ""
    return name in ("clfur", "clfur.exe", "clfur-script.py") or (
        name == "-m" and not {"clfur", "-mclfur"}.isdisjoint(original))


@contextmanager
def raised():
    """Within the block, signals raise `Ended`; those that are ignored (nohup) stay ignored."""
    _heard.clear()
    before, hook = _handle(_raise), sys.unraisablehook
    sys.unraisablehook = lambda lost: _again() if lost.exc_type is Ended else hook(lost)
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)


def say():
    """Tell on stderr what ended the command, in one line -> its exit code, 130 for Ctrl-C, 143 for SIGTERM."""
    number = _heard[-1][0] if _heard else signal.SIGINT
    line = "interrupted" if number == signal.SIGINT else f"ended by {signal.Signals(number).name}"
    with suppress(OSError):   # the terminal may be gone
        os.write(2, f"clfur: {line}\n".encode())
    return 128 + number


def _handle(handler):
    """Set a handler for all signals that are not ignored -> {signal: what it was}."""
    try:
        return {number: signal.signal(number, handler) for number in SIGNALS
                if signal.getsignal(number) not in (signal.SIG_IGN, None)}
    except ValueError:   # not the main thread, which alone hears signals
        return {}


def _counts(number):
    """Whether this signal is not the last one once more."""
    now = time.monotonic()
    if _heard and now - _heard[-1][1] < ONE:
        return False
    _heard.append((number, now))
    return True


def _raise(number, frame):
    if _counts(number):
        raise Ended


def _again():
    """Send the last signal once more: what is raised in a destructor, or as imports let go of their locks, is lost."""
    number, _ = _heard.pop()
    again = threading.Timer(SOON, os.kill, (os.getpid(), number))
    again.daemon = True
    again.start()


def _leave(number, frame):
    if _counts(number):   # nothing is there to be undone
        os._exit(say())
