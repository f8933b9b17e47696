"""Makes fields of the prose of clfur's docstrings, and a page of the help of its command."""

import contextlib
import inspect
import re

import click

import clfur
from clfur.command.main import clfur as command

LINKED = re.compile(rf"(?<!`)`((?:clfur\.)?({'|'.join(clfur.__all__)})(?:\.\w+)*)`(?!`)")
RAISES = re.compile(r"(?:^|(?<=[.;] ))Raises (?:`(?:clfur\.)?Error`|Error\b),? *")
AS_FOR = re.compile(r"rguments[\w ]* (as for `[\w.]+`)")


def fields(app, what, name, obj, options, lines):
    """Lists what a docstring tells of parameters, as "name: what it is. other, third: ...", behind its prose."""
    text = "\n".join(lines)
    with contextlib.suppress(TypeError, ValueError):   # of what has no signature
        names = [each for each in inspect.signature(obj).parameters if each not in ("self", "cls")]
        prose, told = taken_apart(text, names)
        for each in [each for each in names if each not in told]:   # told in passing
            named = re.compile(rf"\b{each}\b")
            places = AS_FOR.findall(text) + ["see above"] * bool(prose and named.search(prose[0].lower()))
            places += [f"see ``{other}``" for other in names if named.search(told.get(other, ""))]
            places += ["see above" for block in prose if named.search(block)]
            told |= {each: places[0]} if places else {}
        listed = [f":param {each}: {told[each]}" for each in names if each in told]
        listed += [f":raises Error: {told['Error']}"] if "Error" in told else []
        text = "\n\n".join([*prose, "\n".join(listed)])
    lines[:] = LINKED.sub(r":py:obj:`\1 <clfur.\2>`\\ ", text).replace("|", r"\|").splitlines()


def taken_apart(docstring, names):
    """([paragraphs that tell of none of these names], {name: what is told of it, "Error": when it is raised})."""
    prose, told, last = [], {}, None
    name = f"`{{0,2}}(?:{'|'.join(names) or '$'})`{{0,2}}"
    head = re.compile(rf"(?:^|(?<=[.;] ))({name}(?:, {name})*)(?: ([<>]=? \d+))?(?:: |(?<=``) (?=is |that ))")
    for block in docstring.split("\n\n"):
        if block.lstrip().startswith("- ") and last:   # a list belongs to the sentence above it
            told[last] += "\n\n" + re.sub("(?m)^", "   ", block) + "\n"
            continue
        text, *raised = RAISES.split(block if block.lstrip().startswith("- ") else " ".join(block.split()), 1)
        told |= {"Error": raised[0]} if raised else {}
        before, *parts = head.split(text)
        prose += [before] if before else []
        for called, bound, what in zip(parts[::3], parts[1::3], parts[2::3]):
            first, *others = re.findall(r"\w+", called)
            told[first] = f"{bound}: {what}" if bound else what
            told |= {other: what if len(what) < 120 else f"see ``{first}``" for other in others}
            last = first if what.rstrip().endswith(":") else None
    return prose, told


class Options(click.HelpFormatter):
    """Writes the lists of a command's help as options of the site."""

    def __init__(self):
        super().__init__()
        self.text = ""

    @contextlib.contextmanager
    def section(self, name):
        self.text += f"\n.. rubric:: {name}\n\n"
        yield

    def write_dl(self, rows, *_, **__):
        for option, told in rows:
            self.text += f".. option:: {option}\n\n   {plain(told)}\n\n"


def plain(text):
    """Words of a help in reST, where nothing is markup but code: what is in backticks, and options."""
    return re.sub(r"`(.*?)`|(--[a-z-]+)", r"``\1\2``", re.sub(r"([*|_\\])", r"\\\1", " ".join(text.split())))


def shorter(app, what, name, obj, options, signature, result):
    """A signature whose defaults are written as one would: HairType(), not all of its fields."""
    within = r"\((?:[^()]|\((?:[^()]|\([^()]*\))*\))*\)"
    if signature:
        signature = re.sub(rf"\b(HairType|Light){within}", r"\1()", signature)
        return re.sub(r"array\(\[(.*?)\]\)", r"(\1)", signature), result


def commands(app, docname, source):
    """The page of the command: what `--help` tells."""
    if docname != "reference/command":
        return
    for name in command.list_commands(None):
        each = command.get_command(None, name)
        context, options = click.Context(each, info_name=f"clfur {name}"), Options()
        each.format_options(context, options)
        usage = " ".join(each.collect_usage_pieces(context))
        told = "\n\n".join(plain(block) for block in inspect.cleandoc(each.help).split("\n\n"))
        source[0] += (f"\n\nclfur {name}\n{'-' * 40}\n\n.. program:: clfur {name}\n\n.. code-block:: sh\n\n"
                      f"   clfur {name} {usage}\n\n{told}\n{options.text}")


def plain_links(app, docname, source):
    """Leaves out links to what is beside docs/, which are not in the site."""
    source[0] = re.sub(r"\[([^]]*)\]\(\.\./[^)]*\)", r"\1", source[0])
