"""Lines of text as wide as the terminal."""

import os
import shutil
import sys
import textwrap


def say(first, *others):
    """Print a line, and others under it, indented; what is too long for the terminal goes on in the next one.

    No word is cut. What is no terminal has no width either, but where COLUMNS tells one.
    """
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() or os.environ.get("COLUMNS") else sys.maxsize
    for line, indent in [(first, ""), *[(other, "    ") for other in others]]:
        print(textwrap.fill(line, width, initial_indent=indent, subsequent_indent=indent + "  ",
                            break_on_hyphens=False, break_long_words=False))
