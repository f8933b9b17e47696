"""Names that modules had before: they still lead to what they were, with a warning."""

import importlib
import subprocess
import sys
import warnings

import pytest

import clfur
from clfur._moved import MOVED, PUBLIC


@pytest.mark.parametrize("old", MOVED)
def test_a_module_is_found_under_its_old_name(old, monkeypatch):
    monkeypatch.delitem(sys.modules, f"clfur.{old}", raising=False)
    new = f"clfur.{MOVED[old]}"
    with pytest.warns(DeprecationWarning, match=f"clfur.{old} is {new} now"):
        module = importlib.import_module(f"clfur.{old}")
    assert module is importlib.import_module(new) and module.__spec__.name == module.__name__ == new


@pytest.mark.parametrize("name", PUBLIC)
def test_public_names_stay_without_a_word(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        module = importlib.import_module(f"clfur.{name}")
    assert module.__name__ == f"clfur.judge.{name}" and callable(getattr(clfur, name, None)) == (name != "truth")


def test_an_unknown_name_is_an_import_error():
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("clfur.furs")


def test_old_imports_in_a_fresh_process():
    code = ("import clfur.compare, clfur.fur\nfrom clfur.fur import Curves\nfrom clfur.files.meshes import load_mesh\n"
            "from clfur.compare import Spread\nfrom clfur.scene import Scene, frame\nfrom clfur.device import choose\n"
            "import clfur\nassert callable(clfur.compare) and clfur.Curves is Curves and clfur.truth.picture")
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], check=True)
