"""How much memory this process may still take: the least of what is free and of what a system's limits leave.

Devices whose memory is the machine's own (processors, their graphics) tell how large that is, not how much of it there
is to be had; in a container or a batch job a process that takes more is ended without a word.
"""

import ctypes
import mmap
from pathlib import Path

import psutil

try:
    import resource
except ImportError:   # Windows has no such limits
    resource = None   # type: ignore[assignment]

BESIDE = 256 << 20   # bytes that compilers and what is on the host take: 100 to 200 MiB beside pictures
THREAD = 64 << 20    # addresses that the C library sets aside for each thread of a driver


def left(threads=1):
    """(bytes that this process may still take, what says so): the least of all that is known here.

    ``threads`` that the driver will start; they take addresses, of which RLIMIT_AS allows so many.
    """
    known = [(psutil.virtual_memory().available, "memory that is free")]
    known += [(limit - used, name) for limit, used, name in cgroups()]
    if resource:
        info = psutil.Process().memory_info()
        for name, used in ("RLIMIT_AS", info.vms + threads * THREAD), ("RLIMIT_DATA", getattr(info, "data", info.rss)):
            soft = resource.getrlimit(getattr(resource, name))[0] if hasattr(resource, name) else -1
            if soft not in (-1, resource.RLIM_INFINITY):
                known.append((soft - used, name))
    bytes_left, name = min(known)
    return max(bytes_left, 0), name


def allowed(threads, shared):
    """(bytes that arrays and pictures may take, what says so) on a device of so many ``threads``; (2^63, "") where its
    memory is not ``shared``: where it is not the machine's own, of which this process has limits.
    """
    if not shared:
        return 1 << 63, ""
    there, name = left(threads)
    return max((there - BESIDE) * 7 // 8, 1), name


def planned(device_bytes, allowance):
    """(bytes that arrays may take on a device, the limit that says so or ""): three quarters of what it has, and no
    more than what `allowed` gives."""
    return min((device_bytes * 3 // 4, ""), allowance)


def in_large_pages(address, nbytes):
    """Ask the system, where it can, to keep memory that nothing has been written into yet in large pages: who reads all
    over it need not look up where each small one lies."""
    advice = getattr(mmap, "MADV_HUGEPAGE", None)   # Linux has it
    first, end = -(-address // mmap.PAGESIZE) * mmap.PAGESIZE, (address + nbytes) // mmap.PAGESIZE * mmap.PAGESIZE
    if advice is not None and end > first:
        ctypes.CDLL(None).madvise(ctypes.c_void_p(first), ctypes.c_size_t(end - first), advice)   # it may say no


def cgroups(root="/"):
    """[(limit, what of it is in use, name)] of the control groups that this process is in, on Linux; bytes.

    ``root``: of the file system.  Version 2 has one tree, version 1 one for memory; the limits of all groups above
    count.  A group's caches of files are not in use: they go when memory is short.
    """
    found = []
    for line in _text(Path(root, "proc/self/cgroup")).splitlines():
        number, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
        if number == "0" and not controllers:
            top, names = Path(root, "sys/fs/cgroup"), ("memory.max", "memory.current", "inactive_file")
        elif "memory" in controllers.split(","):
            top = Path(root, "sys/fs/cgroup/memory")
            names = "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"
        else:
            continue
        group = top / path.lstrip("/")
        # In a container the path may be the host's, and the tree begins at the group itself.
        for place in {folder for folder in (group, *group.parents, top) if folder == top or top in folder.parents}:
            limit, used = (_text(place / name).strip() for name in names[:2])
            if limit.isdecimal() and used.isdecimal() and int(limit) < 1 << 60:   # "max", or 2^63 less a page: none
                spare = sum(int(words[1]) for words in map(str.split, _text(place / "memory.stat").splitlines())
                            if len(words) == 2 and words[0] == names[2] and words[1].isdecimal())
                found.append((int(limit), max(int(used) - spare, 0), f"cgroup {names[0]}"))
    return found


def _text(file):
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
