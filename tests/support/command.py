"""What the command says."""


def wrong(result, *words):
    """The user got something wrong: exit code 2, and one line that holds these words."""
    code, out, err = result
    assert (code, out) == (2, "")
    assert err.startswith("clfur: error: ") and err.count("\n") == 1 and err.endswith("\n"), err
    for word in words:
        assert word in err
