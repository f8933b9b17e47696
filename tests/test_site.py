"""The site: it builds without a warning, has every public name, and what it shows runs."""

import inspect
import os
import pickle
import re
import shlex
import subprocess
import sys
import zlib
from pathlib import Path

import click
import pytest
from docutils import nodes
from sphinx import addnodes

import clfur
from clfur.command.main import clfur as command

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
GUIDES = "first", "strands", "maps", "speed", "trouble"   # whose blocks of Python run as they stand


def sphinx(folder, builder):
    """Build the site, or run its examples, with warnings as errors; pages are read once for both."""
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", builder, "-d", str(folder / "read"),
         str(ROOT / "docs"), str(folder / builder)],
        capture_output=True, text=True, timeout=500, cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)})
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    sphinx(folder, "html")
    return folder


def entries(site):
    """{name: its entry in the reference, as docutils has read it}."""
    trees = [pickle.loads(path.read_bytes()) for path in (site / "read" / "reference").glob("*.doctree")]
    return {desc[0]["ids"][0]: desc for tree in trees for desc in tree.findall(addnodes.desc) if desc[0]["ids"]}


def lacks(entry, public):
    """What is missing of an entry: an example, or parameters that are not told of."""
    told = {strong.astext() for strong in entry.findall(addnodes.literal_strong)}
    try:
        names = list(inspect.signature(public).parameters) if callable(public) else []
    except ValueError:   # an exception has no signature
        names = []
    return ([] if any(entry.findall(nodes.doctest_block)) else ["example"]) + sorted(set(names) - told)


def test_every_public_name_has_an_entry(site):
    """An anchor that others can link to, an example, and a line for each parameter."""
    packed = (site / "html" / "objects.inv").read_bytes().split(b"\n", 4)[4]
    anchors = {line.split(" ")[0] for line in zlib.decompress(packed).decode().splitlines()}
    there = entries(site)
    for name in clfur.__all__:
        assert f"clfur.{name}" in anchors, (
            f"docs/reference/ has no clfur.{name}: add '.. autofunction:: {name}' (autoclass, py:data) and an example "
            "to the page of its subject")
        if not inspect.ismodule(getattr(clfur, name)):
            missing = lacks(there[f"clfur.{name}"], getattr(clfur, name))
            assert not missing, f"clfur.{name} in docs/reference/ and its docstring do not tell: {missing}"


def test_what_an_entry_lacks_is_found(site):
    entry = entries(site)["clfur.over"]
    assert lacks(entry, clfur.over) == [] and lacks(entry, lambda image, other: 0) == ["other"]
    for block in list(entry.findall(nodes.doctest_block)):
        block.parent.remove(block)
    assert lacks(entry, clfur.over) == ["example"]


def test_no_page_has_an_empty_navigation_beside_it(site):
    """A page of the first level with none below it is in html_sidebars of docs/conf.py."""
    beside = {path.name: nav for path in (site / "html").rglob("*.html")
              for nav in re.findall(r'<nav class="bd-docs-nav.*?</nav>', path.read_text(), re.S)}
    assert len(beside) > 30 and [name for name, nav in beside.items() if "<li" not in nav] == []


def test_the_command_is_told_of(site):
    """Each option of each command, under a name that others can link to."""
    page = (site / "html" / "reference" / "command.html").read_text()
    for name in command.list_commands(None):
        for option in command.get_command(None, name).params:
            if isinstance(option, click.Option) and not option.hidden:
                assert f'id="cmdoption-clfur-{name}-{option.opts[0].strip("-")}"' in page


def test_the_examples_of_the_reference_run(site):
    sphinx(site, "doctest")
    assert int(re.search(r"(\d+) tests\n", (site / "doctest" / "output.txt").read_text())[1]) > 80


@pytest.mark.parametrize("page", GUIDES)
def test_the_python_of_a_guide_runs(page, tmp_path, monkeypatch):
    """Its blocks as they stand, one after the other."""
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"^```python\n(.*?)^```", (ROOT / "docs" / f"{page}.md").read_text(), re.S | re.M)
    assert blocks
    names: dict = {}
    for block in blocks:
        exec(compile(block, f"{page}.md", "exec"), names)
    assert all(path.stat().st_size for path in tmp_path.iterdir())


def commands(text):
    """[arguments] of each line that begins with clfur in a page's blocks for the shell."""
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.S | re.M)
    lines = "\n".join(blocks).replace("\\\n", " ").splitlines()
    split = [shlex.split(part, comments=True) for line in lines for part in line.split(" && ")]
    return [words[1:] for words in split if words[:1] == ["clfur"]]


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page.read_text())], ids=lambda page: page.name)
def test_commands_have_these_options(page):
    """Every `clfur ...` of a page is understood; nothing is drawn."""
    for name, *arguments in commands(page.read_text()):
        try:
            command.get_command(None, name).make_context(f"clfur {name}", arguments)
        except click.BadParameter as error:   # of an option that reads its file at once
            assert "no such file" in error.message


def test_a_wrong_command_is_found():
    text = "```sh\nclfur render teapot \\\n  -o a.png   # comment\npip install a && clfur devices --wy\n```\n"
    (render, *rest), (devices, *wrong) = commands(text)
    assert rest == ["teapot", "-o", "a.png"] and command.get_command(None, render).make_context("clfur", rest)
    with pytest.raises(click.UsageError, match="--wy"):
        command.get_command(None, devices).make_context("clfur", wrong)


def dead(page, text):
    """Links of a page to files that are not there."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    links = re.findall(r"\]\((?!https?:|#|mailto:)([^)\s#]+)", text)
    return [link for link in links if not (page.parent / link).exists()]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_relative_links_lead_somewhere(page):
    assert dead(page, page.read_text()) == []


def test_a_dead_link_is_found():
    assert dead(ROOT / "README.md", "[a](docs/light.md#sky) [b](https://a.b/c) ![c](docs/no.png)") == ["docs/no.png"]
