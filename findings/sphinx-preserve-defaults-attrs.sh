#!/usr/bin/env bash
# Packages: Sphinx 9.0.4 (PyPI), with attrs 26.1.0; Python 3.11 or newer.
# Input: a class of attrs and a dataclass, each with the fields color = (0.5, 0.3, 0.1) and segments = 8, as autoclass.
# Seen: without autodoc_preserve_defaults both signatures are (color: tuple = (0.5, 0.3, 0.1), segments: int = 8). With it the
#   dataclass's is as before, but attrs' is (color: tuple = attr_dict['color'].default, segments: int =
#   attr_dict['segments'].default): the text of the __init__ that attrs generates, not of the class. No warning, also with -W.
# Why it matters: the option is there so that constants keep their names, and projects set it for the whole reference. Of each
#   class of attrs no reader sees a default any more. Leave it off where classes are of attrs.
set -euo pipefail
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv venv
venv/bin/pip install -qq --disable-pip-version-check Sphinx==9.0.4 attrs==26.1.0

cat > groom.py <<'PY'
import dataclasses

import attrs


@attrs.frozen
class Hair:
    """Hair."""

    color: tuple = (0.5, 0.3, 0.1)
    segments: int = 8


@dataclasses.dataclass
class Fur:
    """Fur."""

    color: tuple = (0.5, 0.3, 0.1)
    segments: int = 8
PY
mkdir docs
printf '.. autoclass:: groom.Hair\n.. autoclass:: groom.Fur\n' > docs/index.rst
for preserve in 0 1; do
  PYTHONPATH=. venv/bin/python -m sphinx -qWEC -b text -D extensions=sphinx.ext.autodoc -D autodoc_preserve_defaults=$preserve docs out
  echo "autodoc_preserve_defaults = $preserve"
  grep '^class' out/index.txt | tee $preserve.txt
done

written="(color: tuple = (0.5, 0.3, 0.1), segments: int = 8)"
generated="(color: tuple = attr_dict['color'].default, segments: int = attr_dict['segments'].default)"
printf 'class groom.Hair%s\nclass groom.Fur%s\n' "$written" "$written" | cmp - 0.txt &&
  printf 'class groom.Hair%s\nclass groom.Fur%s\n' "$generated" "$written" | cmp - 1.txt ||
  { echo "changed: other signatures than before" >&2; exit 1; }
