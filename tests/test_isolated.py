"""Calls in a process of their own: what comes back, and what a crash or a hang costs."""

import os
import time
from pathlib import Path

import pytest

import clfur
from clfur.judge.isolated import isolated

HERE = __name__


def call(name, *arguments, **options):
    return isolated(f"{HERE}:{name}", *arguments, **{"seconds": 60, **options})


def add(a, b):
    return a + b


def fail():
    raise ValueError("three\nis too many")


def refuse():
    from clfur import Error
    raise Error("Light.angle is 0")


def die():
    import signal
    print("something went wrong", flush=True)
    os.kill(os.getpid(), signal.SIGSEGV)


def leave():
    os._exit(3)


def sleep(seconds):
    time.sleep(seconds)


def count(n, pause):
    from clfur.judge.isolated import send
    for i in range(n):
        time.sleep(pause)
        send(i)
    return "done"


def variable(name):
    return os.environ.get(name)


def big():
    import numpy as np
    return np.arange(1 << 20)


def child_that_sleeps():
    import subprocess
    import sys

    from clfur.judge.isolated import send
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    send(child.pid)
    time.sleep(600)


def test_value_comes_back():
    outcome = call("add", 2, 3)
    assert (outcome.status, outcome.value, outcome.message) == ("ok", 5, "")
    assert call("big").value[-1] == (1 << 20) - 1


@pytest.mark.parametrize("name, status, words", [
    ("fail", "error", "ValueError: three is too many"), ("refuse", "error", "Light.angle is 0"),
    ("die", "crash", "the process died of SIGSEGV: something went wrong"),
    ("leave", "crash", "the process ended with code 3")])
def test_failures_are_told_apart(name, status, words):
    outcome = call(name)
    assert (outcome.status, outcome.value, outcome.message) == (status, None, words)


def test_what_cannot_be_sent_is_named():
    with pytest.raises(clfur.Error, match="cannot be sent to another process: .*lambda"):
        call("add", lambda: 0, 1)


def test_hang_ends_in_time():
    began = time.monotonic()
    outcome = call("sleep", 600, seconds=3)
    assert outcome.status == "hang" and outcome.message == "no answer in 3 s"
    assert time.monotonic() - began < 10


def test_given_up():
    began, heard = time.monotonic(), []
    with pytest.raises(clfur.Stopped):
        call("child_that_sleeps", receive=heard.append, stop=lambda: bool(heard))
    assert time.monotonic() - began < 10
    check_gone(heard[0])


def test_what_is_told_arrives_in_order_and_extends_the_time():
    heard = []
    outcome = call("count", 5, 1.3, seconds=6, receive=heard.append)   # 6.5 s in all
    assert outcome.value == "done" and heard == [0, 1, 2, 3, 4]


def test_environment():
    assert call("variable", "CLFUR_TEST", environment={"CLFUR_TEST": "7"}).value == "7"


def test_nothing_is_left_running():
    pids = []
    assert call("child_that_sleeps", seconds=6, receive=pids.append).status == "hang"
    check_gone(pids[0])


def check_gone(pid):
    for _ in range(50):
        try:
            state = Path(f"/proc/{pid}/stat").read_text().split(") ")[1][0]
        except (FileNotFoundError, ProcessLookupError):
            return
        if state == "Z":
            return
        time.sleep(0.1)
    pytest.fail(f"process {pid} still runs")
