"""The text of a kernel file, as the compiler of a device gets it."""

import re
from importlib.resources import files
from pathlib import Path

_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
_LARGE = re.compile(r"^LARGE (.*?)__kernel void (\w+)\(([^{]*)\n\{\n(#if LANES > 1\n)?    WORK_ITEM\((\w+)\);",
                    re.MULTILINE)


def kernel_dir():
    """Folder of the .cl files: the installed package clfur.cl, or cl/ beside clfur/ in a checkout."""
    try:
        return files("clfur.cl")
    except ModuleNotFoundError:
        return Path(__file__).resolve().parents[2] / "cl"


def read(stem):
    """A kernel file and all that it includes, each line under the name and number that it has in its own file."""
    return _read("common.h") + _read(f"{stem}.cl")


def _read(file):
    lines = [f'#line 1 "{file}"']
    for number, line in enumerate(kernel_dir().joinpath(file).read_text(encoding="utf-8").splitlines(), 1):
        if include := re.match(r'#include "(\w+\.(?:h|cl))"$', line):
            line = f'{_read(include[1])}#line {number + 1} "{file}"'
        lines.append(line)
    return "\n".join(lines) + "\n"


def once(text):
    """A kernel file in which kernels that are LARGE only call a function that does what each of them did.

    PoCL compiles all that is inlined into a kernel three times, what it calls once.  Lines keep their numbers.
    """
    return _LARGE.sub(_called, text)


def _called(kernel):
    marks, name, inside, condition, item = kernel.groups(default="")
    arguments = " ".join(_COMMENT.sub("", inside).split()).removesuffix(")")
    given = ", ".join(re.findall(r"(\w+)(?:,|$)", arguments))
    function = f"static __attribute__((noinline)) void {name}_of(const size_t {item}, "
    return (f"{function}{arguments}); {marks}__kernel void {name}({arguments}) {{ WORK_ITEM({item}); "
            f"{name}_of({item}, {given}); }} {function}{inside}\n{{\n{condition}")
