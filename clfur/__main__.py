"""`python -m clfur` is the `clfur` command."""

from .command.main import main

main()
