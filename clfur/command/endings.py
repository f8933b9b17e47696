"""What ends the command: Ctrl-C, SIGTERM (Slurm, Kubernetes, `timeout`) and SIGHUP.  No other process is touched."""

import _thread
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable
from contextlib import contextmanager, suppress

SIGNALS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
AGAIN = 0.2   # seconds, after which one is raised again that something has swallowed

half_done: list[Callable[[], object]] = []   # what undoes what has begun before imports: called where these are ended
_heard: list[int] = []   # numbers of signals; the first is what ended the command
_serves = threading.Event()


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


def serves():
    """Tell that the command serves from now on, until a signal ends it: that is no error then, its exit code 0."""
    _serves.set()


def run(command):
    """Call command() -> what it returns, or the exit code of what ended it.

    Meanwhile signals raise `Ended`; those that are ignored (nohup) stay ignored.
    """
    _heard.clear()
    _serves.clear()
    over, done, hook, before = [], threading.Event(), sys.unraisablehook, {}
    ear, mouth = socket.socketpair()
    mouth.setblocking(False)
    # Started before a signal can be heard: no handler needs anything that another signal could find half begun.
    again = threading.Thread(target=_raise_again, args=(ear, done), daemon=True)
    again.start()
    sys.unraisablehook = lambda lost: None if _is_of_signals(lost) else hook(lost)
    with suppress(ValueError):   # not the main thread, which alone hears signals
        signal.set_wakeup_fd(mouth.fileno(), warn_on_full_buffer=False)
    try:
        before = _handle(lambda number, _: _raise(number, over))
        return command()
    except BaseException as error:
        if not _is_raised(error):   # an import that it cuts short may make an ImportError of it
            raise
        over.append(True)   # a second one, ere it is set, finds this one being handled
        return say()
    finally:
        over.append(True)
        done.set()
        with suppress(ValueError):
            signal.set_wakeup_fd(-1)
        mouth.close()
        again.join()
        ear.close()
        for number, handler in before.items():   # Python's own end would let a late one end the process otherwise
            signal.signal(number, signal.SIG_IGN if _heard and handler is _leave else handler)
        sys.unraisablehook = hook


@contextmanager
def importing():
    """Within the block, in `run`, a signal ends the process at once, in its one line: in C++ that is under way, as when
    pyopencl is imported, what is raised would abort it."""
    before = _handle(_leave)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def say():
    """Tell on stderr what ended the command, in one line -> its exit code: 130 for Ctrl-C, 143 for SIGTERM, 0 for
    either where it served."""
    number, served = _heard[0] if _heard else signal.SIGINT, _serves.is_set()
    by_hand = "ended" if served else "interrupted"
    line = by_hand if number == signal.SIGINT else f"ended by {signal.Signals(number).name}"
    with suppress(OSError):   # the terminal may be gone
        os.write(2, f"clfur: {line}\n".encode())
    return 0 if served else 128 + number


def _handle(handler):
    """Set a handler for all signals that are not ignored -> {signal: what it was}."""
    try:
        return {number: signal.signal(number, handler) for number in SIGNALS
                if signal.getsignal(number) not in (signal.SIG_IGN, None)}
    except ValueError:   # not the main thread, which alone hears signals
        return {}


def _raise(number, over):
    if over or _is_raised(sys.exc_info()[1]):   # what is half done is being undone
        return
    _heard.append(number)
    raise Ended


def _is_of_signals(lost):
    """Whether what nobody caught is `Ended`, or Python's word for a signal that came just before it was ignored."""
    return lost.exc_type is Ended or (lost.exc_type is OSError and "ignored due to race" in str(lost.exc_value))


def _is_raised(error):
    """Whether `Ended` is, or led to, what is handled just now."""
    return error is not None and (isinstance(error, Ended) or _is_raised(error.__context__))


def _raise_again(ear, done):
    """Once a signal came, send it to the main thread, which may wait for long and not have heard, till it is done."""
    number = ear.recv(1)
    while number and number[0] not in SIGNALS:
        number = ear.recv(1)
    while number and not done.wait(AGAIN):
        if hasattr(signal, "pthread_kill"):   # which wakes what waits
            signal.pthread_kill(threading.main_thread().ident, number[0])
        else:
            _thread.interrupt_main(number[0])


def _leave(number, frame):
    if not _heard:
        _heard.append(number)
        for undo in half_done:
            undo()
        os._exit(say())
