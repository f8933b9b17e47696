"""`python -m clfur` is the `clfur` command."""

from .cli import main

main()
