"""What ends the command: Ctrl-C, SIGTERM (Slurm, Kubernetes, `timeout`) and SIGHUP.  No other process is touched."""

import _thread
import os
import signal
import sys
import threading
import time
from contextlib import suppress

SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
ONE = 1.0     # seconds: signals that come closer are one; `timeout` sends two
AGAIN = 0.2   # seconds, after which one is raised again that something has swallowed

_heard: list[tuple[int, float]] = []   # (number, time) of each signal that counted


class Ended(BaseException):
    """A signal came: raised wherever the command is, so that all that is half done is undone.

    Destructors, imports that let go of their locks and libraries that catch all swallow it: it is raised again and
    again, till it has left `run`.
    """


def watch_imports():
    """If this process is the command, a signal ends it in one line: for all that comes before and after `run`."""
    if is_command(sys.argv, sys.orig_argv):
        _handle(_leave)


def is_command(arguments, original):
    """Whether a process with this sys.argv and sys.orig_argv is `clfur ...` or `python -m clfur ...`.

    While Python looks for the module of -m, "-m" is all that sys.argv starts with.
    """
    name = os.path.basename(arguments[0]) if arguments else ""
    return name in ("clfur", "clfur.exe", "clfur-script.py") or (
        name == "-m" and not {"clfur", "-mclfur"}.isdisjoint(original))


def run(command):
    """Call command() -> what it returns, or the exit code of what ended it.

    Meanwhile signals raise `Ended`; those that are ignored (nohup) stay ignored.
    """
    _heard.clear()
    over, done = [], threading.Event()
    # Started before a signal can be heard: no handler needs anything that another signal could find half done.
    again = threading.Thread(target=_raise_again, args=(done,), daemon=True)
    again.start()
    hook = sys.unraisablehook
    sys.unraisablehook = lambda lost: None if lost.exc_type is Ended else hook(lost)
    before = {}
    try:
        before = _handle(lambda number, _: _raise(number, over))
        return command()
    except Ended:   # a second one, ere `over` is set, finds this one being handled
        over.append(True)
        return say()
    finally:
        over.append(True)
        done.set()
        again.join()
        sys.unraisablehook = hook
        for number, handler in before.items():
            signal.signal(number, handler)


def say():
    """Tell on stderr what ended the command, in one line -> its exit code, 130 for Ctrl-C, 143 for SIGTERM."""
    number = _heard[0][0] if _heard else signal.SIGINT
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


def _raise(number, over):
    if over or _is_raised(sys.exc_info()[1]):   # what is half done is being undone
        return
    _heard.append((number, time.monotonic()))
    raise Ended


def _is_raised(error):
    """Whether `Ended` is, or led to, what is handled just now."""
    return error is not None and (isinstance(error, Ended) or _is_raised(error.__context__))


def _raise_again(done):
    while not done.wait(AGAIN):
        if _heard:
            _thread.interrupt_main(_heard[0][0])


def _leave(number, frame):
    if _counts(number):   # nothing is there to be undone
        os._exit(say())
