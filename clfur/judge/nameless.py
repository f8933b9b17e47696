"""Texts that go to others, without names of people or their folders."""

import os
import re

# A path: how it begins; folders, whose names may have all but colons and quotes; and its last name, which ends at
# a space where it is not somebody's.
BEGINS = r"""(?: (?<![\w.~/\\]) (?: [A-Za-z]:[\\/] | ~[\w.-]*/ | \.{0,2}/ | \.{1,2}\\ | \\\\ )
    | (?<=\s-[A-Z]) / | (?<=\w) [\\/] (?=(?i:homes?|users)[\\/]) )"""
PATH = re.compile(BEGINS + r"""(?=\S) (?: [^\\/:;'"\n]*[^\s\\/:;'"][\\/]+ | [\\/]+ )*
    (?: (?: (?<=[\\/](?i:home)[\\/]) | (?<=[\\/](?i:homes)[\\/]) | (?<=[\\/](?i:users)[\\/]) ) [^:;,'"()\\/\n]*
    | [^\s:;,'"()\\/]* )""", re.X)
QUOTED = re.compile(rf"""(?<=(['"])) {BEGINS} [^'"\n]* (?=\1)""", re.X)


def nameless(text: str) -> str:
    """Return a text whose paths are cut to their last names, as folders tell who works there."""
    home = os.path.expanduser("~")
    if len(home) > 1:
        text = re.sub(re.escape(home) + r"(?![\w.-])", "~", text)
    return PATH.sub(_cut, QUOTED.sub(_cut, text))


def _cut(path):
    """What is told of a path, given as a match."""
    *folders, last = re.split(r"[\\/]+", path[0].rstrip("\\/"))
    return "..." if not folders or folders[-1].lower() in ("home", "homes", "users") else f".../{last}"
