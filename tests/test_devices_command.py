"""`clfur devices`: what it lists, checks and explains, on made-up machines and on this one."""

import json
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import platformdirs
import pytest

import clfur
from clfur import cache
from clfur.command import bug_report
from clfur.command import devices as cli_devices
from clfur.command.main import main
from clfur.device import caches, vendors
from clfur.device import selection as device
from clfur.judge import speed
from clfur.judge.isolated import Outcome

EPYC, LONG = "[bold]EPYC[/bold] :smile:", "Processor-" * 9   # names that are markup to rich, or too long
DRIVER = "2026.22.10.0.01_160000-very-long"
SPEED = "clfur.judge.speed:measure"
ROOT = Path(__file__).resolve().parents[1]


def made(handle, number, name, type="CPU", driver="1.2"):
    return {"device": handle, "number": number, "name": name, "short_name": name, "type": type, "driver": driver,
            "compute_units": 108, "memory": 80 << 30, "planned": 60 << 30, "limit": "",
            "largest_allocation": 20 << 30, "fp64": True,
            "int64_atomics": False, "description": f"driver · {name}", "identity": [name, driver], "check": None}


def machine():
    return {
        "auto": {"device": "pocl", "why": "no GPU"}, "default": {"by": "auto", "text": "auto", "device": "pocl"},
        "platforms": [
            {"name": "Portable Computing Language", "version": "OpenCL 3.0 PoCL 3.1  Linux, LLVM 15, SLEEF",
             "vendor": "x", "devices": [made("pocl", "0:0", EPYC), made("pocl:1", "0:1", "Xeon")]},
            {"name": "A platform with an awfully long name, longer than any table (TM)", "version": "OpenCL 3.0",
             "vendor": "y", "devices": [made("a", "1:0", LONG, "other", DRIVER)]},
            {"name": "Clover", "version": "OpenCL 1.1 Mesa", "vendor": "z", "devices": []}]}


@pytest.fixture
def run(monkeypatch, capfd, tmp_path):
    """Runs `clfur devices` with a cache of its own -> (exit code, stdout, stderr)."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for name in ("CLFUR_DEVICE", "PYOPENCL_CTX", "COLUMNS", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)

    def run(*arguments):
        with pytest.raises(SystemExit) as exit:
            main(["devices", *arguments])
        return exit.value.code, *capfd.readouterr()
    return run


@pytest.fixture
def made_up(run, monkeypatch):
    """The same on a made-up machine; ``checks``: {number: Outcome} of the self-test there, and SPEED: of frames."""
    checks = {"0:0": Outcome("ok", ""), "0:1": Outcome("ok", ""), "1:0": Outcome("ok", ""),
              SPEED: {"0:0": Outcome("ok", .125), "0:1": Outcome("ok", .1), "1:0": Outcome("ok", 1.22)}}

    def isolated(function, *arguments, **_):
        if function == "clfur.device.selection:survey":
            return Outcome("ok", machine())
        if function == SPEED:
            return checks[SPEED][arguments[0]]
        found = checks[arguments[0]]
        return Outcome("ok", (found.value, [])) if found.status == "ok" else found
    monkeypatch.setattr(cli_devices, "isolated", isolated)
    return run, checks


@pytest.mark.parametrize("columns, lines", [(40, 30), (80, 20), (160, 18), (None, 18), ("", 18)])   # these two: a pipe
def test_some_lines_a_device(made_up, monkeypatch, columns, lines):
    """As wide as the terminal, and no word in two lines."""
    if columns is not None:
        monkeypatch.setenv("COLUMNS", str(columns))
    code, out, err = made_up[0]()
    assert (code, err, len(out.splitlines())) == (0, "", lines), out
    assert all(len(line) <= (columns or 1000) or line.split() == [LONG] for line in out.splitlines())
    assert out.splitlines()[-1] == "auto takes pocl: no GPU"
    check = "check: none yet (clfur devices --check)"
    text = (f"--device pocl: {EPYC} CPU, 108 units, 80.0 GiB (20.0 GiB an array), fp64, no 64-bit atomics "
            f"Portable Computing Language, OpenCL 3.0 PoCL 3.1, driver 1.2 {check} "
            "--device pocl:1: Xeon CPU, 108 units, 80.0 GiB (20.0 GiB an array), fp64, no 64-bit atomics "
            f"Portable Computing Language, OpenCL 3.0 PoCL 3.1, driver 1.2 {check} "
            f"--device a: {LONG} other, 108 units, 80.0 GiB (20.0 GiB an array), fp64, no 64-bit atomics "
            "A platform with an awfully long name, longer than any table (TM), OpenCL 3.0, "
            f"driver {DRIVER} {check} "
            "no device: Clover, OpenCL 1.1 Mesa auto takes pocl: no GPU")
    assert out.split() == text.split()


@pytest.mark.parametrize("default, expected", [
    ({"by": "CLFUR_DEVICE", "text": "xeon", "device": "pocl:1"}, "CLFUR_DEVICE=xeon decides: it takes pocl:1"),
    ({"by": "PYOPENCL_CTX", "text": "7", "device": None}, "PYOPENCL_CTX=7 decides: it fits no device")])
def test_a_variable_decides(default, expected):
    found = machine() | {"default": default}
    assert cli_devices._sentence(found) == f"{expected}\nwithout it auto takes pocl: no GPU"


def test_a_limit_is_told(made_up, monkeypatch):
    limited = machine()
    limited["platforms"][0]["devices"][1] |= {"planned": 3 << 29, "limit": "cgroup memory.max"}
    monkeypatch.setattr(cli_devices, "isolated", lambda *_, **__: Outcome("ok", limited))
    lines = made_up[0]()[1].splitlines()
    assert lines[-2] == "pocl:1 plans with 1.5 GiB: this process may take no more (cgroup memory.max)"


def test_json(made_up):
    code, out, err = made_up[0]("--json")
    assert (code, err, json.loads(out)) == (0, "", machine())


def test_check_passes(made_up):
    code, out, err = made_up[0]("--check")
    assert code == 0
    assert err.splitlines() == [line for name, driver, ms in (
        ("pocl", EPYC, "125"), ("pocl:1", "Xeon", "100"),
        ("a", LONG, "1,220"))
        for line in (f"{name}: checking driver · {driver} ...", f"{name}: pass, {ms} ms a frame")]
    assert out.count("    check: pass, ") == 3 and "    check: pass, 100 ms a frame\n" in out
    assert out.splitlines()[-2] == "pocl:1 is fastest, 100 ms a frame; pocl takes 1.2 times as long, a 12.2 times"
    assert cache.recall(["Xeon", "1.2"]) == ("pass", "") and cache.recall_seconds(["Xeon", "1.2"]) == .1


@pytest.mark.parametrize("outcome", [Outcome("error", None, "too little memory"), Outcome("hang", None, "no answer")])
def test_what_cannot_be_timed_passes(made_up, outcome):
    run, checks = made_up
    checks[SPEED]["0:1"] = outcome
    code, out, err = run("--check")
    assert code == 0 and f"pocl:1: it was not timed: {outcome.message}" in err.splitlines()
    assert "pocl:1 " not in out.splitlines()[-2]
    assert cache.recall(["Xeon", "1.2"]) == ("pass", "") and cache.recall_seconds(["Xeon", "1.2"]) is None


@pytest.mark.parametrize("seconds, words", [
    ({"a": .5}, "a takes 500 ms a frame"),
    ({"a": .52, "b": .5}, "b is fastest, 500 ms a frame; a takes about as long"),
    ({"a": 1.4, "b": .02, "c": .0205, "d": .05},
     "b is fastest, 20.0 ms a frame; c takes about as long, d 2.5 times, a 70 times")])
def test_which_is_fastest(seconds, words):
    assert speed.told(seconds) == words


@pytest.mark.parametrize("outcome, verdict, message", [
    (Outcome("ok", "other bits in voxels"), "wrong", "other bits in voxels"),
    (Outcome("error", None, "RuntimeError: clBuildProgram failed"), "wrong", "RuntimeError: clBuildProgram failed"),
    (Outcome("crash", None, "the process died of SIGSEGV"), "crash", "the process died of SIGSEGV"),
    (Outcome("hang", None, "no answer in 180 s"), "hang", "no answer in 180 s")])
def test_check_fails(made_up, outcome, verdict, message):
    run, checks = made_up
    checks["0:1"] = outcome
    code, out, err = run("--check")
    assert code == 1
    assert f"pocl:1: {verdict}: {message}" in err.splitlines()
    assert f"    check: {verdict}: {message}" in out.splitlines()
    assert cache.recall(["Xeon", "1.2"]) == (verdict, message)
    code, out, _ = run("--check", "--json")
    listed = json.loads(out)["platforms"][0]["devices"]
    assert code == 1 and [d["check"]["verdict"] for d in listed] == ["pass", verdict]
    checks["0:1"] = Outcome("ok", "")
    assert run("--check")[0] == 0 and cache.recall(["Xeon", "1.2"]) == ("pass", "")


def test_two_cards_of_one_kind(made_up, monkeypatch):
    """They share what is remembered, and the one that fails counts."""
    run, checks = made_up
    twins = machine()
    twins["platforms"][0]["devices"][0]["identity"] = ["Xeon", "1.2"]
    isolated = cli_devices.isolated
    monkeypatch.setattr(cli_devices, "isolated", lambda function, *a, **k: Outcome("ok", twins)
                        if function == "clfur.device.selection:survey" else isolated(function, *a, **k))
    checks["0:0"] = Outcome("crash", None, "died")
    assert run("--check")[0] == 1 and cache.recall(["Xeon", "1.2"]) == ("crash", "died")


def test_check_without_a_cache(made_up, tmp_path):
    (tmp_path / "clfur").write_text("a file where the folder should be")
    code, out, err = made_up[0]("--check")
    assert code == 0 and out.count("check: pass, ") == 3
    assert "pocl: this is not remembered: cannot write to" in err


@pytest.mark.parametrize("outcome, expected", [
    (Outcome("ok", machine() | {"platforms": machine()["platforms"][2:]}), "there is no OpenCL device"),
    (Outcome("crash", None, "the process died of SIGSEGV"), "OpenCL does not start: the process died of SIGSEGV"),
    (Outcome("error", None, "OpenCL does not start: OUT_OF_HOST_MEMORY"), "OUT_OF_HOST_MEMORY")])
@pytest.mark.parametrize("options", [[], ["--json"], ["--check"]])
def test_no_device(run, monkeypatch, outcome, expected, options):
    monkeypatch.setattr(cli_devices, "isolated", lambda *_, **__: outcome)
    code, out, err = run(*options)
    assert (code, out) == (2, "") and len(err.splitlines()) == 1 and expected in err


@pytest.mark.parametrize("options", [["--check", "--why"], ["--check", "--why", "--report"], ["--report", "--json"]])
def test_one_question_at_a_time(run, options):
    code, out, err = run(*options)
    assert (code, out) == (2, "") and len(err.splitlines()) == 1


SECRET = "/net/secret/karl/icd"


def test_report_for_a_bug(made_up, monkeypatch):
    """Versions, the system, each device, its check and speed, drivers and variables; no folders, no names of users."""
    run, _ = made_up
    checked = machine()
    checked["platforms"][0]["devices"][0]["check"] = {"verdict": "pass", "message": "", "seconds": .1234}
    checked["platforms"][0]["devices"][1]["check"] = {"verdict": "wrong", "message": f"see {SECRET}", "seconds": None}
    driver = vendors.Vendor(f"{SECRET}: karl/a.icd", f"{SECRET}/liba.so", "system")   # which no rule would find
    monkeypatch.setattr(cli_devices, "isolated", lambda function, *_, **__: Outcome(
        "ok", checked if "survey" in function else ("library not found", f"{SECRET}/liba.so: no such file")))
    monkeypatch.setattr(vendors, "vendors", lambda: ([driver], []))
    monkeypatch.setenv("OCL_ICD_VENDORS", SECRET)
    monkeypatch.setenv("CLFUR_DEVICE", "xeon")
    code, out, err = run("--report")
    assert (code, err) == (0, "")
    for words in (f"clfur {clfur.__version__}, {platform.system()}", f"Python {platform.python_version()}",
                  "pyopencl 20", "numpy ", "PoCL 3.1", "- pocl:1 (0:1): Xeon, CPU, driver 1.2, 108 units, 80.0 GiB",
                  "check: pass, 123 ms a frame", "check: wrong: see .../icd", "check: none yet (clfur devices --check)",
                  "platform Clover, OpenCL 1.1 Mesa, no device", "auto takes pocl: no GPU",
                  "- .../a.icd (system): library not found: .../liba.so: no such file",
                  "environment: CLFUR_DEVICE=xeon, ", "OCL_ICD_VENDORS is set"):
        assert words in out, words
    assert "karl" not in out and "/net" not in out and os.path.expanduser("~") + "/" not in out


def test_report_where_opencl_does_not_start(run, monkeypatch):
    monkeypatch.setattr(cli_devices, "isolated", lambda *_, **__: Outcome("crash", None, "the process died of SIGABRT"))
    code, out, _ = run("--report")
    assert code == 0 and "OpenCL does not start: " in out and "SIGABRT" in out and "environment: " in out


@pytest.mark.parametrize("text, expected", [
    ("/srv/karl/x/libpocl.so: no", ".../libpocl.so: no"), ("~/.cache/clfur", ".../clfur"),
    ("and/or 3/4", "and/or 3/4"), ("HOME", "it is ~"),
    (r"C:\Users\Karl\a.dll is missing", ".../a.dll is missing"),
    (r"C:\Users\Karl May\AppData\a.dll failed", ".../a.dll failed"), (r"C:\Users\Karl May: denied", "...: denied"),
    (r"\\server\homes\karl\a.dll", ".../a.dll"), ("/mnt/homes/Karl May/a.so", ".../a.so"),
    ("../karl/secret/liba.so: no", ".../liba.so: no"), (r"..\karl\a.dll", ".../a.dll"), ("~karl/a.so", ".../a.so"),
    ("file:///HOME/karl/a.so", "file:.../a.so"), ("/HOME/karl", "..."), ("/HOME/karl/: denied", "...: denied"),
    ("cannot open '/HOME/karl': denied", "cannot open '...': denied"), ("a=/HOME/karl/x", "a=.../x"),
    ("cannot open '/srv/karl: may/a.so': denied", "cannot open '.../a.so': denied"), ("x/HOME/karl/y", "x.../y"),
    ("/HOME/karl.may,mary/lib/a.so", ".../a.so"), ("/HOME/karl(1)/lib/a.so", ".../a.so"),
    ("(/HOME/karl/My Files/a.so)", "(.../a.so)"), ("-I/HOME/karl/inc", "-I.../inc"),
    ("with -L/srv/karl/lib", "with -L.../lib"), ("either / or, 2 / 3", "either / or, 2 / 3"),
    ("/srv/karl/a.so or /srv/karl/b.so", ".../a.so or .../b.so"),
    ("OpenCL 3.0 PoCL 3.0-rc2  Linux, SLEEF", "OpenCL 3.0 PoCL 3.0-rc2  Linux, SLEEF")])
def test_paths_are_cut_to_their_last_names(text, expected):
    given = f"it is {os.path.expanduser('~')}" if text == "HOME" else text
    assert bug_report.nameless(given) == expected


def test_here(run):
    """On this machine: every device is named, and each handle means its device."""
    code, out, err = run()
    assert (code, err) == (0, "")
    handles = [handle for handle, _ in device.handles(device._platforms())]
    assert re.findall(r"^--device (\S+): ", out, re.MULTILINE) == handles
    assert out.splitlines()[-1].startswith(f"auto takes {handles[device.find().index(device.choose('auto'))]}: ")


def test_check_here(tmp_path):
    """The whole way, in processes of their own; with PoCL's own cache, which takes it long to fill."""
    env = {"POCL_CACHE_DIR": f"{platformdirs.user_cache_dir('pocl')}/kcache", **os.environ, "PYTHONPATH": str(ROOT),
           "XDG_CACHE_HOME": str(tmp_path)}
    done = subprocess.run([sys.executable, "-m", "clfur", "devices", "--check", "--json"], env=env,
                          capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    listed = [d for platform in found["platforms"] for d in platform["devices"]]
    assert len(listed) == len(device.find())
    assert all(d["check"] | {"seconds": 0} == {"verdict": "pass", "message": "", "seconds": 0} for d in listed)
    assert all(1e-4 < d["check"]["seconds"] < 60 for d in listed)
    least = min(listed, key=lambda d: d["check"]["seconds"])
    assert found["auto"]["device"] == least["device"]
    assert len(list((tmp_path / "clfur" / "checks").iterdir())) == len({tuple(d["identity"]) for d in listed})


def test_why(run, monkeypatch, tmp_path):
    folder = tmp_path / "icd"
    folder.mkdir()
    (folder / "text").write_text("hello")
    for name, content in {"missing": "/no/such/lib.so\n", "text": str(folder / "text"), "empty": "",
                          "math": "libm.so.6", "bare": "libnosuch.so"}.items():
        (folder / f"{name}.icd").write_text(content)
    (folder / "other.txt").write_text("libm.so.6")   # the loader reads .icd files only
    monkeypatch.setenv("OCL_ICD_VENDORS", str(folder))
    code, out, err = run("--why", "--json")
    assert (code, err) == (0, "")
    rows = json.loads(out)["drivers"]
    checked = {Path(row["file"]).stem: (row["status"], row["message"])
               for row in rows if Path(row["file"]).parent == folder}
    assert {name: status for name, (status, _) in checked.items()} == {
        "bare": "library not found", "empty": "empty file", "math": "symbol missing",
        "missing": "library not found", "text": "not a library"}
    assert "/no/such/lib.so" in checked["missing"][1] and "clGetExtensionFunctionAddress" in checked["math"][1]
    bundled = [row for row in rows if row["origin"] == "comes with pyopencl" and Path(row["file"]).name == "pocl.icd"]
    assert [row["status"] for row in bundled] == ["loaded"] and "1 device: PoCL" in bundled[0]["message"]
    code, out, _ = run("--why")
    for row in rows:
        assert f"{row['file']} ({row['origin']})\n    {row['status']}: {row['message']}\n" in out


def test_why_without_any_device(run, monkeypatch, tmp_path):
    """PoCL has no device without a folder that it can write to; and a driver may crash."""
    monkeypatch.setenv("OCL_ICD_VENDORS", str(tmp_path / "nothing"))
    code, out, _ = run("--why")
    assert code == 0 and out == (f"OCL_ICD_VENDORS is {tmp_path / 'nothing'}, and there is no such folder or file\n"
                                 "OpenCL's loader looks at no driver at all\n")
    assert run()[0] == 2
    monkeypatch.delenv("OCL_ICD_VENDORS")
    monkeypatch.setattr(vendors, "vendors", lambda: ([vendors.Vendor("a.icd", "liba.so", "system")], []))
    for status in ("crash", "hang"):
        monkeypatch.setattr(cli_devices, "isolated", lambda *_, **__: Outcome(status, None, "words"))
        assert run("--why") == (0, f"a.icd (system)\n    {status}: words\n", "")


def test_why_of_a_cache_that_cannot_be_written(run, monkeypatch):
    """PoCL is given another, and a line says so."""
    monkeypatch.setattr(caches, "notes", [])
    monkeypatch.setenv("POCL_CACHE_DIR", "/dev/null/cache")
    found = json.loads(run("--why", "--json")[1])
    status, message = next((r["status"], r["message"]) for r in found["drivers"] if "pocl.icd" in r["file"])
    assert status == "loaded" and "PoCL" in message
    assert any("kernels are not kept in /dev/null/cache: Not a directory; " in note for note in found["notes"])


def test_a_spoilt_cache_is_not_the_devices_fault(made_up, monkeypatch):
    """A device that fails with the kernels that are kept, and is right with none."""
    run, checks = made_up
    isolated = cli_devices.isolated

    def healed(function, *arguments, environment=None, **keys):
        if environment and "POCL_CACHE_DIR" in environment and arguments == ("0:1",):
            assert not os.listdir(environment["POCL_CACHE_DIR"])
            return Outcome("ok", ("", []))
        return isolated(function, *arguments, **keys)
    monkeypatch.setattr(cli_devices, "isolated", healed)
    monkeypatch.setenv("POCL_CACHE_DIR", "/kernels")
    checks["0:1"] = Outcome("crash", None, "the process died of SIGBUS")
    code, _, err = run("--check")
    assert code == 0 and cache.recall(["Xeon", "1.2"]) == ("pass", "")
    assert err.splitlines()[3:5] == ["pocl:1: pass, 100 ms a frame", (
        "pocl:1: it is right without the kernels that are kept in /kernels: these are spoilt, delete them "
        "(crash: the process died of SIGBUS)")]
    checks["0:1"] = Outcome("hang", None, "no answer in 180 s")   # nobody waits for that twice
    assert run("--check")[0] == 1 and cache.recall(["Xeon", "1.2"])[0] == "hang"
