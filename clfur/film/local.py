"""A cluster on this machine: a scheduler in this process, and workers that end with it."""

import contextlib
import json
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ..device.caches import temporary
from ..device.selection import local_devices
from ..judge.isolated import end, end_with_parent
from .worker import SHARE

HOST = "127.0.0.1"
THREADS = "POCL_MAX_PTHREAD_COUNT", "POCL_CPU_MAX_CU_COUNT"   # how many PoCL takes: up to version 3, and later


@contextlib.contextmanager
def local_cluster(count: int | None, device: Any) -> Iterator[tuple[str, Callable[[], str]]]:
    """Within the block: workers on this machine's loopback -> (the scheduler's address, a function that says why no
    worker can come any more, or "").

    count: of workers, None: one a device. device: as for `clfur.draw`, None: all GPUs, or the device that is taken
    without a name.
    """
    import dask
    from distributed import Scheduler, SpecCluster

    logging.getLogger("distributed.diskutils").addFilter(_is_missed)
    shares = shares_of(local_devices(device), count, cores())
    options = {"host": HOST, "port": 0, "dashboard": False, "dashboard_address": f"{HOST}:0"}
    with temporary() as folder, dask.config.set({"temporary-directory": folder}), \
            SpecCluster(scheduler={"cls": Scheduler, "options": options}, workers={}, silence_logs=False) as cluster:
        errors = Path(folder, "stderr")
        with errors.open("wb") as stderr:
            # In a session of its own, so that Ctrl-C in a terminal reaches this process alone.
            child = subprocess.Popen(
                [sys.executable, "-c", "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
                 "from clfur.film.local import serve; serve(*sys.argv[2:])", json.dumps(_path()),
                 cluster.scheduler_address, folder, json.dumps(shares)],
                stdin=subprocess.PIPE, stdout=stderr, stderr=stderr, start_new_session=True)

        def trouble():
            said = errors.read_text(encoding="utf-8", errors="replace").split("\n")
            last = next((line for line in reversed(said) if line.strip()), "")
            return "" if child.poll() is None else f"they have ended: {last}"
        try:
            yield cluster.scheduler_address, trouble
        finally:
            end(child)


def _is_missed(record):
    """Whether Dask may log this: not that a folder of ours is gone, which it may want to remove after us, at exit."""
    return "clfur-" not in record.getMessage()


def shares_of(devices: list[str], count: int | None, cores: int) -> list[dict[str, str]]:
    """Variables for the environment of each of so many workers: its device, and its share of that and of the cores."""
    given = [devices[number % len(devices)] for number in range(count or len(devices))]
    result = []
    for device in given:
        share = given.count(device)
        threads = {} if share == 1 else dict.fromkeys(THREADS, str(max(cores // share, 1)))
        result.append({"CLFUR_DEVICE": device, SHARE: str(share)} | {
            name: os.environ.get(name, text) for name, text in threads.items()})
    return result


def serve(address: str, folder: str, shares: str) -> None:
    """Keep workers at an address, a process each, that is started anew when it dies, till the parent ends."""
    import asyncio  # takes long, and the command needs none of it
    from threading import Thread

    Thread(target=end_with_parent, daemon=True).start()
    asyncio.run(_workers(address, folder, json.loads(shares)))


async def _workers(address, folder, shares):
    import asyncio

    from distributed import Nanny

    # A limit of memory would end workers that draw; clfur has its own.
    nannies = [Nanny(address, nthreads=1, memory_limit=None, name=f"local-{number}", env=env, host=HOST,
                     local_directory=folder, dashboard=False) for number, env in enumerate(shares)]
    await asyncio.gather(*nannies)
    await asyncio.gather(*(nanny.finished() for nanny in nannies))


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _path():
    """Where Python looks for modules, as another process finds them."""
    return [str(Path(__file__).parents[2]), *(os.path.abspath(each) for each in sys.path)]
