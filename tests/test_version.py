"""The version and the names that `clfur` has: the same in a checkout, without installing, and in the command."""

import importlib
import os
import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import clfur

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize("name", ["compare", "frontier", "truth"])
def test_public_modules_have_their_names_without_a_word(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        module = importlib.import_module(f"clfur.{name}")
    assert module.__name__ == f"clfur.judge.{name}" and callable(getattr(clfur, name, None)) == (name != "truth")


@pytest.mark.parametrize("name", ["furs", "fur", "mesh", "cli", "selftest"])
def test_other_names_are_an_import_error(name):
    """Also those that modules had before 0.2."""
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module(f"clfur.{name}")


def test_imports_in_a_fresh_process():
    code = ("import clfur.compare\nfrom clfur.compare import Spread\nfrom clfur.truth import picture\n"
            "from clfur.scene import Scene, frame\nfrom clfur.device import choose, survey\n"
            "from clfur.files import output_path\nimport clfur\n"
            "assert callable(clfur.compare) and callable(clfur.frontier) and clfur.truth.picture is picture")
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)


def test_the_version_stands_once():
    """In a file that needs nothing else; no other text of the sources tells one."""
    told = re.fullmatch(r'"""[^"]*"""\n\n__version__ = "(\d+\.\d+\.\d+)"\n', (ROOT / "clfur/_version.py").read_text())
    assert clfur.__version__ == told[1]
    assert "version = attr: clfur._version.__version__\n" in (ROOT / "setup.cfg").read_text(encoding="utf-8")
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines()
    releases = [line for line in changes if line.startswith("## ") and line != "## Unreleased"]
    assert releases[0].startswith(f"## {told[1]} (")


def test_the_command_tells_the_version(tmp_path):
    """Of a checkout that is not installed, too: by its path alone."""
    done = subprocess.run([sys.executable, "-m", "clfur", "--version"], cwd=tmp_path, capture_output=True, text=True,
                          env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert (done.returncode, done.stdout) == (0, f"clfur, version {clfur.__version__}\n"), done.stderr
