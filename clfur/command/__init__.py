"""The `clfur` command."""
