"""Jobs drawn by the workers of a cluster (Dask distributed): whoever dies or may not take part costs no job."""

import contextlib
import itertools
import logging
import queue
import re
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from ..device.scheduler import sources
from ..errors import Error, go_on, shown
from ..scene import Environment, Mesh
from . import worker
from .local import local_cluster
from .parcels import Parcels

TRIES = 3        # workers that may die of a job, before it is given up
CONNECT = 10     # seconds in which a scheduler must answer
PATIENCE = 60    # seconds without any worker
SETTLE = 10      # seconds in which workers that are still being greeted may end that, once all is drawn
LOOK = 0.3       # seconds between two looks at who is there
LOGGERS = "distributed", "distributed.client", "distributed.scheduler", "tornado.application", "asyncio"
ADDRESS = re.compile(r"local(:[1-9]\d{0,3})?|(tcp|tls)://[^\s/]+:\d{1,5}")


def on_cluster(jobs: Iterable, address: str, device: Any = None,
               stop: Callable[[], bool] | None = None) -> Iterator[tuple[int, bytes]]:
    """Draw jobs by the workers at an address -> (number, bytes of the frame's file) of each, as they are done.

    address: "local": workers on this machine, one a device; "local:N": N of them, that share its devices and cores;
    "tcp://host:port" or "tls://host:port": of a Dask scheduler. device: of "local", as for `clfur.draw`; else each
    worker has its own. See docs/cluster.md. stop: as for `clfur.film`.

    Raises Error for another address, without Dask, if nobody is there, or, once all others are done, for jobs that
    cannot be drawn, by number: those whose drawing raised one, and those of which three workers died.
    """
    for job, value in drawn(jobs, address, device, (Mesh, Environment), "frame", stop):
        yield job.number, value


def check_address(address: Any) -> str:
    """The address of a cluster, as a user gives it; raises Error for another text, and without Dask."""
    if not isinstance(address, str) or not ADDRESS.fullmatch(address):
        raise Error(f"cluster is {shown(address)}; allowed: local, local:N, tcp://host:port or tls://host:port")
    try:
        import distributed  # noqa: F401 takes long, and is an extra
    except ImportError:
        raise Error('a cluster needs Dask distributed: pip install "clfur[cluster]"') from None
    return address


def drawn(jobs, address, device, kinds, what, stop=None):
    """(job, what its ``draw`` gives) of each; kinds: of objects that go to each worker once; what: jobs are called;
    stop: as for `clfur.film`."""
    check_address(address)
    jobs = iter(jobs)
    for first in jobs:
        parcels = Parcels(first, kinds)
        with _connected(address, device) as (client, trouble):
            crew = Crew(client, parcels, what, trouble, address)
            yield from crew.draw(itertools.chain([first], jobs), stop)
            if address.startswith("local"):
                crew.settle()


@contextlib.contextmanager
def _connected(address, device):
    """Within the block: (a client of the cluster, why no worker can come any more as a function, or "")."""
    import dask
    from distributed import Client, Security

    with contextlib.ExitStack() as stack:
        stack.enter_context(_quiet())
        # Moved points of a frame are more than what Dask warns of.
        stack.enter_context(dask.config.set({"distributed.admin.large-graph-warning-threshold": "1TB"}))
        trouble = str
        own = address.startswith("local")   # here, and there for certain, however busy this machine is
        if own:
            count = int(address[6:]) if ":" in address else None
            address, trouble = stack.enter_context(local_cluster(count, device))
        try:
            # Asked first: a client that fails without them tries to close for 20 seconds.
            if address.startswith("tls") and not Security().get_connection_args("client").get("ssl_context"):
                raise OSError("no certificates are set; docs/cluster.md tells how")
            client = stack.enter_context(Client(address, timeout=PATIENCE if own else CONNECT, set_as_default=False))
        except (OSError, ValueError, RuntimeError) as error:
            why = " ".join(str(error).split()) or type(error).__name__
            raise Error(f"cluster {address}: {why}") from None
        yield client, trouble


@contextlib.contextmanager
def _quiet():
    """Within the block Dask does not log what ends as it should."""
    loggers = [logging.getLogger(name) for name in LOGGERS]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


@dataclass(eq=False)
class _Worker:
    """A worker as it is seen from here. job: what it draws; call: what it was asked last, None if it is idle."""

    address: str
    name: str
    ready: bool = False
    refused: bool = False
    job: Any = None
    call: Any = None

    @property
    def host(self):
        return self.address.rpartition(":")[0]


class Crew:
    """The workers at a scheduler, and what each of them is doing: one job at a time, so that a job of which one dies
    is known, and no other is blamed."""

    def __init__(self, client: Any, parcels: Parcels, what: str, trouble: Callable[[], str], address: str) -> None:
        self.client, self.parcels, self.what, self.trouble, self.address = client, parcels, what, trouble, address
        self.workers: dict[str, _Worker] = {}
        self.again: deque = deque()              # jobs whose worker died
        self.deaths: dict[Any, int] = {}         # by number of a job, and by name of a worker that died when greeted
        self.failed: dict[int, str] = {}         # why, by number
        self.refused: dict[str, str] = {}        # why, by name
        self.answers: queue.SimpleQueue = queue.SimpleQueue()
        self.keys = itertools.count()
        self.told: set[str] = set()              # warnings of workers
        self.empty_since = time.monotonic()

    def draw(self, jobs: Iterator, stop: Callable[[], bool] | None = None) -> Iterator[tuple]:
        """(job, what it gives) of each; stop: asked a few times a second."""
        looked = float("-inf")
        while go_on(stop):
            if time.monotonic() - looked > LOOK:
                self.look()
                looked = time.monotonic()
            self.greet()
            more = self.send(jobs)
            if not more and not self.again and not any(worker.job for worker in self.workers.values()):
                break
            with contextlib.suppress(queue.Empty):
                yield from self.hear(*self.answers.get(timeout=LOOK))
        if self.failed:
            raise Error("; ".join(f"{self.what} {number} {why}" for number, why in sorted(self.failed.items())))

    def settle(self) -> None:
        """Wait a little for workers that build kernels: killed meanwhile, they would leave the kernels suspect."""
        until = time.monotonic() + SETTLE
        for each in self.workers.values():
            while each.call and not each.call.done() and time.monotonic() < until:
                time.sleep(0.02)

    def look(self) -> None:
        """See who has come and who is gone."""
        if self.client.status != "running":
            raise Error(f"cluster {self.address}: its scheduler is gone")
        try:
            there = self.client.scheduler_info(n_workers=-1)["workers"]
        except (OSError, RuntimeError) as error:
            raise Error(f"cluster {self.address}: its scheduler does not answer: {error}") from None
        for gone in self.workers.keys() - there.keys():
            self.lose(self.workers.pop(gone))
        for address in there.keys() - self.workers.keys():
            self.workers[address] = _Worker(address, str(there[address]["name"]))
        if any(not worker.refused for worker in self.workers.values()):
            self.empty_since = time.monotonic()
        elif self.workers:
            raise Error(f"cluster {self.address}: no worker may take part: " + "; ".join(
                f"{worker.name}: {self.refused[worker.name]}" for worker in self.workers.values()))
        elif (why := self.trouble()) or time.monotonic() - self.empty_since > PATIENCE:
            why = why or "docs/cluster.md tells how to start one"
            raise Error(f"cluster {self.address}: no worker is there; {why}")

    def greet(self) -> None:
        """Ask workers whether they can take part; of each machine's one after the other until one is ready: that
        builds the kernels, which the others find."""
        for worker_ in self.workers.values():
            if worker_.name in self.refused:
                worker_.refused = True
            elif not worker_.ready and not worker_.call:
                same = [other for other in self.workers.values() if other.host == worker_.host]
                if any(other.ready for other in same) or not any(other.call for other in same):
                    self.ask(worker_, worker.greet, sources(), self.parcels.name, self.parcels.parts)

    def send(self, jobs: Iterator) -> bool:
        """Give each idle worker a job -> whether there may be more."""
        for each in self.workers.values():
            if each.ready and not each.call:
                job = self.again.popleft() if self.again else next(jobs, None)
                if job is None:
                    return False
                each.job = job
                self.ask(each, worker.work, self.parcels.name, self.parcels.pack(job))
        return True

    def ask(self, who: _Worker, function: Callable, *arguments: Any) -> None:
        """Let a worker call a function; what comes of it is in `answers`."""
        number = "hello" if who.job is None else f"{who.job.number:04d}"
        key = f"{self.what}-{self.parcels.name}-{number}-{next(self.keys)}"
        who.call = future = self.client.submit(function, *arguments, key=key, pure=False, workers=[who.address])

        def wait():
            try:
                answer = future.result()
            except BaseException as error:   # a worker without clfur raises what it likes
                answer = error
            self.answers.put((who, future, answer))
        threading.Thread(target=wait, daemon=True).start()

    def hear(self, who: _Worker, future: Any, answer: Any) -> Iterator[tuple]:
        """Take an answer: (job, what it gives) if it is one that is done."""
        if who.call is not future:   # it was gone by then
            return
        from distributed import KilledWorker

        if isinstance(answer, KilledWorker):   # one that had the same address came and went as well
            self.lose(who)
            return
        job, who.job, who.call = who.job, None, None
        if isinstance(answer, BaseException):
            answer = ("error", f"{type(answer).__name__}: {' '.join(str(answer).split())}", [])
            if job is None:
                answer = answer[1], 0.0
        if job is None:
            who.ready = not answer[0]
            if answer[0]:
                self.refuse(who, answer[0])
            return
        kind, value, said = answer
        for text in {*said} - self.told:
            self.told.add(text)
            warnings.warn(text, RuntimeWarning, stacklevel=2)
        if kind == "unknown":
            who.ready = False
            self.again.append(job)
        elif kind == "error":
            self.failed[job.number] = f"cannot be drawn: {value}"
        else:
            yield job, value

    def lose(self, who: _Worker) -> None:
        """A worker is gone, or has been started anew: its job is for another one, but not for ever."""
        if who.call is None:
            return
        who.call.cancel()
        job, who.job, who.call, who.ready = who.job, None, None, False
        blamed = who.name if job is None else job.number
        self.deaths[blamed] = self.deaths.get(blamed, 0) + 1
        if self.deaths[blamed] < TRIES:
            self.again.extend([job] if job else [])
        elif job is None:
            self.refuse(who, f"it died {TRIES} times before its first job")
        else:
            self.failed[job.number] = f"cannot be drawn: {TRIES} workers died of it"

    def refuse(self, who: _Worker, why: str) -> None:
        """A worker gets no jobs, and all hear of it."""
        who.refused, self.refused[who.name] = True, why
        warnings.warn(f"the worker {who.name} takes no part: {why}", RuntimeWarning, stacklevel=2)
