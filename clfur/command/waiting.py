"""What is told while something takes longer than people like to wait without a word."""

import sys
import threading
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

PATIENCE = 2.0   # seconds


@contextmanager
def waiting(doing):
    """Within the block: after `PATIENCE` seconds a line on the terminal says what is done and for how long, and goes at
    the end.  -> a function that takes the next thing that is done.  Nothing where stderr is no terminal.
    """
    progress = Progress(SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn(),
                        console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty())
    task = progress.add_task(doing)
    timer = threading.Timer(PATIENCE, progress.start)
    timer.daemon = True
    timer.start()
    try:
        yield lambda words: progress.update(task, description=words)
    finally:
        timer.cancel()
        timer.join()
        progress.stop()
