"""The chart of speed against accuracy that `clfur.frontier` found, as a picture or a page; needs the extra "report"."""


import numpy as np

from ..files.output import check_writable, output_path, whole
from .nameless import nameless
from .report import INK, chart, page, require, svg

SUFFIXES = ".html", ".htm", ".png", ".svg"
COLORS = "#1f83c4", "#d55e00", "#009e73", "#cc79a7", "#e69f00"   # after Okabe and Ito: for the colour-blind too
SHAPES = {1: "^", 4: "o", 16: "s"}
LABELLED = 0.02    # a point of the frontier has its label where the error falls by this share or more
LINE = 13          # points of the page from one label to the next


def check_chart(path):
    """Raise `clfur.Error` unless a chart could be written to this path; leaves nothing behind."""
    path = output_path(path, SUFFIXES)
    check_writable(path, SUFFIXES)
    require(f"{path}: a chart", "matplotlib", *["jinja2"] * (path.suffix.lower() in SUFFIXES[:2]))


def save_chart(path, found, title, command=""):
    """Write what `clfur.frontier` found to an .html, .png or .svg file: all of it or nothing.

    ``title``: what was drawn, in a word.  ``command``: the line of the shell that made it, if one did.
    Raises `clfur.Error` where it cannot be written, or without the extra.
    """
    check_chart(path)
    path = output_path(path, SUFFIXES)
    with whole(path) as temporary:
        if path.suffix.lower() in SUFFIXES[:2]:
            picture = svg(draw_chart(found), "chart")
            text = page("chart.html", found=found, title=title, picture=picture, numbers=numbers,
                        command=command)
            temporary.write_text(text, encoding="utf-8")
        else:
            figure = draw_chart(found, nameless(f"{title} on {found.device}"))
            figure.savefig(temporary, format=path.suffix[1:].lower(), dpi=150, facecolor="white",
                           metadata={"Date": None} if path.suffix.lower() == ".svg" else None)


def numbers(point):
    """Texts of what a point of the chart gives, {"error": ..., "flip": ...}; "–" where it is not known."""
    forms = {"error": ".4f", "flip": ".4f", "bias": "+.4f", "area": ".1%", "flicker": ".4f"}
    values = {name: getattr(point, name) for name in forms}
    return {name: "–" if value is None else format(value, forms[name]) for name, value in values.items()}


def draw_chart(found, title=""):
    """The matplotlib figure of all points, the frontier among them with its labels."""
    from matplotlib.lines import Line2D
    from matplotlib.ticker import LogLocator, NullFormatter

    figure, axes = chart(11, 6.6)
    points = [point for point in found.points if np.isfinite(point.error) and point.error > 0]
    color_of, legend = _colors(points)
    for point in points:
        style = {"marker": SHAPES[point.settings.samples], "ls": "", "color": color_of(point)}
        if point.best:
            axes.plot([1e3 * point.seconds.min, 1e3 * point.seconds.max], [point.error] * 2, color=style["color"],
                      lw=1, alpha=.5, zorder=2)
            axes.plot(1e3 * point.seconds.median, point.error, ms=9, mec=INK, mew=.8, zorder=4, **style)
        else:
            axes.plot(1e3 * point.seconds.median, point.error, ms=7, mec="none", alpha=.45, zorder=1, **style)
    best = [point for point in points if point.best]
    axes.step([1e3 * p.seconds.median for p in best], [p.error for p in best], where="post", color=INK, lw=1, zorder=3)
    axes.set(xscale="log", yscale="log", xlabel="milliseconds a frame, everything done anew",
             ylabel="error: root mean square, of sRGB values from 0 to 1")
    for axis in axes.xaxis, axes.yaxis:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
    axes.grid(alpha=.25, lw=.5)
    axes.set_axisbelow(True)
    if title:
        axes.set_title(title, loc="left", fontsize=10)
    if points:
        _limits(axes, points, found.noise)
        axes.axhline(found.noise, color=INK, lw=.8, ls=(0, (4, 4)), alpha=.6, zorder=0)
        axes.annotate("noise of the truth", (1, found.noise), (-3, -3), ("axes fraction", "data"),   # below all points
                      "offset points", ha="right", va="top", fontsize=8, alpha=.7, annotation_clip=True)
        _names(axes, points)
    shapes = [Line2D([], [], marker=SHAPES[n], ls="", color="#808080", ms=7, label=f"{n} sample{'s' * (n > 1)}")
              for n in sorted({p.settings.samples for p in points})]
    lines = [Line2D([], [], color=INK, lw=1, label="frontier")]
    figure.legend(handles=[Line2D([], [], marker="o", ls="", color=color, ms=7, label=text) for text, color in legend]
                  + shapes + lines, loc="outside upper left", ncols=9, fontsize=9, frameon=False, labelcolor=INK,
                  handletextpad=.4, columnspacing=1.4)
    _labels(figure, axes, [point for place, point in enumerate(best) if place == 0 or point.error < (1 - LABELLED) *
                           min(other.error for other in best[:place])])
    return figure


def _colors(points):
    """(colour of a point, [(text, colour)]): by the first that differs of raster, filter and shadows."""
    ways = [lambda s: f"raster: {s.raster}",
            lambda s: "filtered" if s.filtered else "unfiltered",
            lambda s: "no shadows" if s.shadows == "off" else f"shadows: {s.shadows}"]
    text_of = next((way for way in ways if len({way(point.settings) for point in points}) > 1), ways[-1])
    texts = sorted({text_of(point.settings) for point in points})
    color = dict(zip(texts, COLORS))
    return lambda point: color[text_of(point.settings)], list(color.items())


def _limits(axes, points, noise):
    """Room around the points, and for the noise of the truth if it is not far below."""
    times = np.log10([1e3 * point.seconds.median for point in points])
    errors = np.log10([point.error for point in points])
    wide, tall = max(np.ptp(times), .3), max(np.ptp(errors), .3)
    axes.set_xlim(10 ** (times.min() - .06 * wide), 10 ** (times.max() + .1 * wide))
    low = errors.min() - .15 * tall
    if noise > 0 and np.log10(noise) > errors.min() - .35 * tall:
        low = min(low, np.log10(noise) - .06 * tall)
    axes.set_ylim(10**low, 10 ** (errors.max() + .08 * tall))


def _labels(figure, axes, points):
    """Labels of the frontier, each left of its point and below the one before: where no point can be."""
    from matplotlib.text import Text

    texts = [axes.annotate(point.label, (1e3 * point.seconds.median, point.error), (-14, 0), textcoords="offset points",
                           ha="right", va="center", fontsize=8.5, color=INK, zorder=5,
                           arrowprops={"arrowstyle": "-", "color": INK, "lw": .6, "alpha": .6, "shrinkA": 1,
                                       "shrinkB": 5, "relpos": (1, .5)}) for point in points]
    figure.draw_without_rendering()   # so that places on the page are known
    inch, box = figure.dpi / 72, axes.get_window_extent()
    # How far left the axis must begin so that no label sticks out there.
    low, high = np.log10(axes.get_xlim())
    for text in texts:
        share = (Text.get_window_extent(text).width + 24 * inch) / box.width   # not with its line
        low = min(low, (np.log10(text.xy[0]) - share * high) / (1 - share))
    axes.set_xlim(10**low)
    for _ in range(20):   # as long as labels stick out below
        top = np.inf
        for text in texts:
            y = axes.transData.transform(text.xy)[1] / inch
            top = min(y - 9, top - LINE)
            text.set_position((-14, top - y))
        if top > box.y0 / inch + LINE:
            break
        low, high = np.log10(axes.get_ylim())
        axes.set_ylim(10 ** (low - .06 * (high - low)))


def _names(axes, points):
    """Rings around the settings that have a name."""
    written = []   # where, in points
    for point in points:
        if point.name:
            place = 1e3 * point.seconds.median, point.error
            axes.plot(*place, "o", ms=16, mfc="none", mec=INK, mew=1.3, zorder=5)
            x, y = axes.transData.transform(place) * 72 / axes.figure.dpi
            above = 12
            while any(abs(x - a) < 54 and abs(y + above - b) < 12 for a, b in written):
                above += 12
            written.append((x, y + above))
            axes.annotate(point.name, place, (0, above), textcoords="offset points", ha="center", weight="bold",
                          color=INK, zorder=6, fontsize=10)
