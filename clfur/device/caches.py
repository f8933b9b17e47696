"""Where drivers keep the kernels that they build: folders that can be written, and that no crash has left spoilt.

Drivers read these variables as they load, so `prepare` comes before.
"""

import atexit
import contextlib
import hashlib
import os
import platform
import shutil
import signal
import stat
import tempfile
import threading
import time
from pathlib import Path

import psutil

from .. import cache
from ..errors import Error

try:
    import fcntl
except ImportError:   # Windows: folders that killed processes have left stay there
    fcntl = None   # type: ignore[assignment]

# What PoCL is called, and the variable that names its folder.  Without a folder that it can write it shows no device.
# Other drivers do without: so Mesa does, which checks what it reads, and Intel's for CPUs keeps nothing.
POCL, VARIABLE = "Portable Computing Language", "POCL_CACHE_DIR"
ROOM = 16 << 20   # bytes: the kernels of a driver take 2 MiB
SAME = 5.0        # seconds: when a process began is told by the system's clock, which may be set meanwhile
OTHERS = 8        # folders of clfur's own that are tried, one after the other, where processes died
OURS = b"clfur made this folder, and removes it\n"   # in the file that locks one
UNHEARD = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
YOUNG = 60.0      # seconds in which a process has long locked the folder that it has made

notes: list[str] = []                       # what `prepare` has to say, a line each
_taking: list[Path | None] = []             # the mark of each thread that is within `taking_kernels`
_marked = threading.Lock()
_private: list[tuple[Path, int]] = []       # the folder that `private` has made, and the process that did


def prepare():
    """Point PoCL to another folder where its own cannot be written or may be spoilt, and say so in `notes`."""
    place, new = folder(), None
    why = trouble(place)
    if not why and _died(place):
        why, new = "a process died while PoCL took kernels from there, so it may be spoilt: delete it", _another(place)
    if not why:
        return
    said = f"kernels are not kept in {place}: {why}"
    try:
        new = new or private() / "pocl"
        new.mkdir(exist_ok=True)
        os.environ[VARIABLE] = str(new)
        said += f"; this process keeps them in {new}"
    except OSError as error:
        said += f"; nor is there a temporary folder: {error.strerror or error}"
    if said not in notes:
        notes.append(said)


def _another(place):
    """A folder of clfur's own in place of one that may be spoilt, there already, so that kernels are kept all the same;
    None if there is none."""
    with contextlib.suppress(Error, OSError):   # no cache, or it cannot be written
        for number in range(OTHERS):
            new = cache.folder("kernels") / f"{_marks(place).name}-{number}"
            new.mkdir(parents=True, exist_ok=True)
            if trouble(new):
                return None
            if not _died(new):
                return new
    return None


def folder():
    """Path of the folder in which PoCL keeps its kernels, there or not: what POCL_CACHE_DIR says, or PoCL's own."""
    home = os.environ.get("HOME")
    usual = os.environ.get("XDG_CACHE_HOME") or (f"{home}/.cache" if home else tempfile.gettempdir())
    return Path(os.environ.get(VARIABLE) or Path(usual, "pocl", "kcache"))


def in_folder(place):
    """{variable: text} of the environment in which all drivers, and clfur, keep kernels in this folder."""
    return dict.fromkeys((VARIABLE, "MESA_SHADER_CACHE_DIR", "CUDA_CACHE_PATH", "XDG_CACHE_HOME"), str(place))


def trouble(place):
    """Why nothing can be written to a folder, there or not, in a few words, or "": read-only, full, no folder."""
    there = next((each for each in (place, *place.parents) if os.path.lexists(each)), place)
    try:
        # A test by writing: root may write everywhere, and a full disk or quota shows in nothing else.
        with tempfile.TemporaryFile(dir=there) as file:
            file.write(bytes(1 << 16))
            file.flush()
        free = shutil.disk_usage(there).free
    except OSError as error:
        return error.strerror or str(error)
    return "" if free >= ROOM else f"{free / 2**20:.1f} MiB are free there; allowed: {ROOM >> 20} or more"


def trouble_of(platform_name):
    """What is wrong by now with the folder of a platform's driver, as a text to put behind an error, or ""."""
    why = platform_name == POCL and trouble(folder())
    return f"; it keeps kernels{where(platform_name)}: {why}" if why else ""


def where(platform_name):
    """" in" and the folder in which a platform's driver keeps kernels, or "" where that is not known."""
    return f" in {folder()}" if platform_name == POCL else ""


def private():
    """A temporary folder of this process, which is removed at its end; raises OSError where none can be made."""
    if not _private or _private[-1][1] != os.getpid() or not _private[-1][0].is_dir():
        _remove_left()
        _private.append((Path(tempfile.mkdtemp(prefix="clfur-")), os.getpid()))
        atexit.register(remove_private)
        _lock(_private[-1][0])   # to the end of the process
    return _private[-1][0]


def remove_private():
    """Remove the folders that `private` has made in this process."""
    for made, process in _private:
        if process == os.getpid():
            shutil.rmtree(made, ignore_errors=True)


@contextlib.contextmanager
def temporary():
    """Within the block: path of an empty folder; it is removed then, or by a later process if this one is killed."""
    _remove_left()
    folder = tempfile.TemporaryDirectory(prefix="clfur-")
    try:
        with folder as made:
            lock, empty = _lock(Path(made)), Path(made, "empty")
            empty.mkdir()
            try:
                yield str(empty)
            finally:
                if lock is not None:
                    os.close(lock)
    except BaseException:   # one more signal may have cut the removal short
        shutil.rmtree(folder.name, ignore_errors=True)
        raise


def _lock(made):
    """Lock a folder of this process till it ends, however it does -> the open file; None where files have no locks."""
    with contextlib.suppress(OSError):
        if fcntl:
            lock = _locked(made, os.O_CREAT)
            os.write(lock, OURS)
            return lock
    return None


def _locked(made, flags=0):
    """The open file that locks a folder; raises OSError if another process has it, or if it was never locked."""
    lock = os.open(made / "lock", os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | flags, 0o600)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BaseException:
        os.close(lock)
        raise
    return lock


def _remove_left():
    """Remove the temporary folders of processes that were killed: what clfur has made, and nothing else of its name."""
    for lock in list(Path(tempfile.gettempdir()).glob("clfur-*/lock")) if fcntl else []:
        with contextlib.suppress(OSError):   # another user's, or locked: its process lives
            made, there = os.lstat(lock.parent), os.lstat(lock)
            if (stat.S_ISDIR(made.st_mode) and stat.S_ISREG(there.st_mode) and made.st_uid == os.getuid()
                    and time.time() - there.st_mtime > YOUNG):
                ours = _locked(lock.parent)
                if os.read(ours, len(OURS) + 1) == OURS:
                    shutil.rmtree(lock.parent, ignore_errors=True)
                os.close(ours)


@contextlib.contextmanager
def unheard():
    """Signals wait: for threads and programs that a driver starts here for good, for this thread till the end.

    Ctrl-C goes to all of a terminal's processes. It would end the linker that PoCL starts, and PoCL then ends the
    process; and it cuts PoCL's compiler short.  That compiler puts handlers of its own before Python's, through which
    a second signal at the same time ends the process at once: Python's are put back.
    """
    if not hasattr(signal, "pthread_sigmask"):   # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, UNHEARD)
    try:
        yield
    finally:
        for number in UNHEARD if threading.current_thread() is threading.main_thread() else ():
            if callable(handler := signal.getsignal(number)):
                signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def taking_kernels(platform_name):
    """While a driver builds kernels or runs them for the first time: if the process dies of it, later ones know."""
    mark, place = None, folder()
    with contextlib.suppress(Error, OSError, psutil.Error):   # no cache to leave a mark in
        if platform_name == POCL:
            mark = _marks(place) / f"{os.getpid()} {psutil.Process().create_time()} {_number(place)}"
            mark.parent.mkdir(parents=True, exist_ok=True)
    with _marked:   # one mark for all threads
        _taking.append(mark)
        if mark:
            with contextlib.suppress(OSError):
                mark.touch()
    try:
        with unheard():
            yield
    finally:
        with _marked:
            _taking.remove(mark)
            if mark and mark not in _taking:
                with contextlib.suppress(OSError):
                    mark.unlink()


def are_taken():
    """Whether a driver is building kernels in this process."""
    return bool(_taking)


def takes_kernels(group):
    """Whether a process of a group, by number, is taking kernels: killed now, it would leave them suspect."""
    with contextlib.suppress(Error, OSError, ValueError):   # no cache; of what is no mark
        for mark in list(cache.folder("taking").glob("*/*")):
            process, began, _, *old = mark.name.split()
            with contextlib.suppress(ProcessLookupError):
                if not old and os.getpgid(int(process)) == group and _lives(int(process), float(began)):
                    return True
    return False


def _died(place):
    """Whether a process of this machine has died while its driver took kernels from this folder, which is still it.

    One death may have had another cause: it is told once.  After a second one the folder is spoilt till it is deleted.
    """
    dead, told = [], False
    with contextlib.suppress(Error, OSError, ValueError):   # of what is no mark
        for mark in list(_marks(place).iterdir()):
            process, began, number, *old = mark.name.split()
            if _lives(int(process), float(began)):
                continue
            if int(number) != _number(place):
                mark.unlink()   # that folder was deleted
            elif old:
                told = True
            else:
                dead.append(mark)
        if dead and not told:
            dead[0].rename(f"{dead[0]} told")
            for mark in dead[1:]:
                mark.unlink()
    return bool(dead)


def _lives(process, began):
    """Whether the process of this number, begun at this time, is still there."""
    try:
        return abs(psutil.Process(process).create_time() - began) < SAME
    except psutil.AccessDenied:
        return True
    except psutil.Error:
        return False


def _marks(place):
    """Folder of the marks for a folder of kernels; of this machine alone, since numbers of processes are."""
    name = hashlib.sha256(f"{platform.node()}\n{place}".encode()).hexdigest()[:16]
    return cache.folder("taking") / name


def _number(place):
    """What tells a folder from one that is made anew in its place."""
    try:
        return os.stat(place).st_ino
    except OSError:
        return 0
