"""What is told while something takes longer than people like to wait without a word."""

import sys
import threading
import time
from contextlib import contextmanager
from itertools import pairwise

from ..device import caches

PATIENCE = 2.0   # seconds
FEW, LAST = 2, 20   # of what is counted: by which the time left is told, at least and at most


@contextmanager
def waiting(doing):
    """Within the block: after `PATIENCE` seconds a line on the terminal says what is done and for how long, and goes at
    the end.  -> a function that takes the next thing that is done.  Nothing where stderr is no terminal.
    """
    now, over = [doing], threading.Event()
    teller = threading.Thread(target=_tell, args=(now, over), daemon=True)
    if sys.stderr.isatty():
        teller.start()
    try:
        yield lambda words: now.append(words)
    finally:
        over.set()
        if teller.ident:
            teller.join()


@contextmanager
def counting():
    """Within the block: a bar on the terminal.  -> a function that takes (what is counted, how many are done, of how
    many), and shows with it how long the others will take.  Nothing where stderr is no terminal."""
    from rich.console import Console  # takes long to import
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    with Progress(TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(),
                  TimeElapsedColumn(), TextColumn("{task.fields[left]}"), console=Console(stderr=True), transient=True,
                  disable=not sys.stderr.isatty()) as progress:
        task, counted = progress.add_task("starting", total=None, left=""), []

        def show(what, done, of):
            now = time.monotonic()
            if counted and counted[-1][0] != what:
                counted.clear()
            counted.append((what, now))
            progress.update(task, description=what, completed=done, total=of, left=_left(counted, of - done))
        yield show


def _left(counted, others):
    """How long so many others will take, in words, by the median of the last ones: the first, of which kernels are
    built, has no say."""
    times = [moment for _, moment in counted[1:][-LAST:]]
    spent = sorted(two - one for one, two in pairwise(times))
    if len(spent) < FEW or not others:
        return ""
    seconds = round(spent[len(spent) // 2] * others)
    return f"about {seconds // 60}:{seconds % 60:02} left"


def _tell(now, over):
    """Tell the last of what is done ``now``, until it is ``over``."""
    if over.wait(PATIENCE):
        return
    from rich.console import Console  # takes long to import
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    with Progress(SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn(),
                  console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(now[-1])
        while not over.wait(0.1):
            progress.update(task, description=now[-1] + ", building kernels" * caches.are_taken())
