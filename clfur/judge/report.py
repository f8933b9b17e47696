"""Pages for people: one HTML file each, with charts and pictures inside; needs the extra "report"."""

import base64
import importlib
import io
import platform
import re
import time
from importlib.resources import files

import numpy as np

from .._version import __version__
from ..color import srgb_to_linear
from ..errors import Error
from ..files.images import png_bytes
from ..files.output import check_writable, output_path, whole
from .nameless import nameless

SUFFIXES = ".html", ".htm"
FAINTEST = 1e-7        # difference that a picture of differences begins to show
INK = "#010203"       # in charts: the colour that becomes that of the page's text


def check_report(path):
    """Raise `clfur.Error` unless a page could be written to this path; leaves nothing behind."""
    check_writable(path, SUFFIXES)
    require(f"{path}: a report", "matplotlib", "jinja2")


def require(what, *names):
    """Raise `clfur.Error` unless ``what`` finds the libraries of the extra "report" that it needs."""
    for name in names:
        try:
            importlib.import_module(name)
        except ImportError:
            raise Error(f'{what} needs {name}: pip install "clfur[report]"') from None


def save_report(path, comparison, title, command=""):
    """Write the page of a `clfur.Comparison` to an .html file: all of it or nothing.

    ``title``: what was drawn, in a word.  ``command``: the line of the shell that made it, if one did.
    Raises `clfur.Error` where it cannot be written, or without the extra.
    """
    check_report(path)
    path = output_path(path, SUFFIXES)
    with whole(path) as temporary:
        temporary.write_text(page("report.html", **_of(comparison), title=title, command=command), encoding="utf-8")


def page(template, **values):
    """The text of a page: a template of this package filled with values; what is not Markup is escaped and `nameless`,
    as messages of drivers hold paths."""
    import jinja2

    environment = jinja2.Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True,
                                     undefined=jinja2.StrictUndefined, loader=jinja2.FunctionLoader(_template),
                                     finalize=lambda value: nameless(value) if type(value) is str else value)
    environment.filters |= {"ms": milliseconds, "spread": spread, "mib": mebibytes, "count": "{:,.0f}".format,
                            "small": "{:.2g}".format}
    return environment.get_template(template).render(
        **values, now=time.strftime("%Y-%m-%d %H:%M"), version=__version__, system=system())


def system():
    """System and Python in a line: "Linux 6.1.0 x86_64, Python 3.11.7"."""
    return (f"{platform.system()} {platform.release()} {platform.machine()}, "
            f"{platform.python_implementation().replace('CPython', 'Python')} {platform.python_version()}")


def _template(name):
    return files(__package__).joinpath(name).read_text(encoding="utf-8")


def milliseconds(seconds):
    """Text of a time: three digits of it, as far as they are whole milliseconds or more."""
    value = 1e3 * seconds
    return f"{value:,.{0 if value >= 99.95 else 1 if value >= 9.995 else 2}f}"


def spread(seconds):
    """Text of a `clfur.compare.Spread` in milliseconds: the median (least–most)."""
    return f"{milliseconds(seconds.median)} ({milliseconds(seconds.min)}–{milliseconds(seconds.max)})"


def mebibytes(size):
    """Text of a number of bytes, in MiB; "–" for None."""
    return "–" if size is None else f"{size / 2**20:,.0f}"


def chart(width, height, **options):
    """An empty matplotlib figure with one pair of axes, in inches -> (figure, axes)."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({"text.color": INK, "axes.edgecolor": INK, "axes.labelcolor": INK,
                                "xtick.color": INK, "ytick.color": INK, "hatch.color": INK, "hatch.linewidth": 0.4,
                                "axes.spines.top": False, "axes.spines.right": False, "font.size": 10}):
        figure = Figure((width, height), layout="constrained")
        return figure, figure.subplots(**options)


def svg(figure, name):
    """A matplotlib figure as <svg> to stand in a page, its ink of the colour of the page's text (Markup)."""
    import matplotlib
    from markupsafe import Markup

    stream = io.StringIO()
    # Text as text: it can be searched and read aloud.  The salt: ids of two charts in one page must differ.
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": name, "svg.id": name}):
        figure.savefig(stream, format="svg", transparent=True)
    text = stream.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg"):], flags=re.S)
    return Markup(text.replace(INK, "currentColor"))


def data_uri(color):
    """A float picture as `clfur.save` takes it, as the address of a PNG that holds the picture itself (Markup)."""
    from markupsafe import Markup

    return Markup("data:image/png;base64," + base64.b64encode(png_bytes(color)).decode())


def difference_picture(one, other):
    """The largest linear difference of any channel, float32 [h, w, 3]: magma over the logarithm from 1e-7 to 1."""
    import matplotlib

    apart = np.abs(one.astype(np.float64) - other).max(axis=2)
    level = np.log10(np.maximum(np.nan_to_num(apart, nan=1, posinf=1), FAINTEST)) / -np.log10(FAINTEST) + 1
    return srgb_to_linear(matplotlib.colormaps["magma"](np.clip(level, 0, 1))[..., :3])


def _of(comparison):
    """What report.html shows of a comparison."""
    drawn = [row for row in comparison.rows if row.frame]
    reference = next((row.picture for row in drawn if row.device == comparison.reference), None)
    return {
        "comparison": comparison,
        "drawn": drawn,
        "by_speed": sorted(drawn, key=lambda row: row.frame.median),
        "stages": list(dict.fromkeys(name for row in drawn for name in row.stages or ())),
        "integer_stages": list(dict.fromkeys(name for row in drawn for name in row.difference.same)),
        "charts": [("Where the time goes", _stage_chart(drawn)), ("Every frame", _frame_chart(drawn))] if drawn else [],
        "pictures": [(row, data_uri(row.picture), data_uri(difference_picture(row.picture, reference)))
                     for row in drawn],
        "scale": _scale() if drawn else "",
    }


def _stage_chart(rows):
    """Median seconds of the stages on top of each other, a bar a device, filled up to the median frame."""
    import matplotlib

    figure, axes = chart(11, 1.3 + 0.45 * len(rows))
    colors = matplotlib.colormaps["tab10"].colors
    names = list(dict.fromkeys(name for row in rows for name in row.stages or ()))
    ends = np.zeros(len(rows))
    places = np.arange(len(rows))
    for number, name in enumerate(names):
        widths = [1e3 * row.stages[name].median if row.stages and name in row.stages else 0 for row in rows]
        axes.barh(places, widths, 0.62, ends, color=colors[number % len(colors)], label=name)
        ends += widths
    rest = np.maximum([1e3 * row.frame.median for row in rows] - ends, 0)
    timed = np.array([row.stages is not None for row in rows])
    for mask, label, style in (
            (timed, "rest: host, reading back", {"color": "#9a9a9a"}),
            (~timed, "whole frame: the driver reports no times", {"color": "#9a9a9a66", "hatch": "///"})):
        if mask.any():
            axes.barh(places[mask], rest[mask], 0.62, ends[mask], label=label, **style)
    axes.set_yticks(places, [row.device for row in rows])
    axes.invert_yaxis()
    axes.set_xlabel("milliseconds, median")
    figure.legend(loc="outside upper left", ncols=5, fontsize=9, frameon=False, labelcolor=INK)
    return svg(figure, "stages")


def _frame_chart(rows):
    """Each frame a dot, their range a line, their median a tick; a line a device."""
    figure, axes = chart(11, 0.9 + 0.45 * len(rows))
    for place, row in enumerate(rows):
        axes.plot([1e3 * row.frame.min, 1e3 * row.frame.max], [place, place], color="#1f77b4", lw=5, alpha=0.3,
                  solid_capstyle="round")
        axes.plot(1e3 * np.array(row.frames), [place] * len(row.frames), "o", color="#1f77b4", ms=4)
        axes.plot(1e3 * row.frame.median, place, "|", color=INK, ms=17, mew=2)
    axes.set_yticks(range(len(rows)), [row.device for row in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlim(left=0)
    axes.set_xlabel("milliseconds: every frame, and the median")
    return svg(figure, "frames")


def _scale():
    """The colours of `difference_picture`."""
    figure, axes = chart(5, 0.6)
    axes.imshow(np.linspace(0, 1, 256)[None], cmap="magma", aspect="auto", extent=(np.log10(FAINTEST), 0, 0, 1))
    axes.set_yticks([])
    axes.set_xticks(range(-7, 1), [f"1e{n}" if n else "1" for n in range(-7, 1)])
    return svg(figure, "scale")
