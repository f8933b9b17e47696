"""What is told while something takes longer than people like to wait without a word."""

import sys
import threading
from contextlib import contextmanager

from ..device import caches

PATIENCE = 2.0   # seconds


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
