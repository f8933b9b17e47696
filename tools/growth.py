"""How what a frame takes grows with strands and with pixels: docs/performance.md's chart and table.

    pip install ".[figures]"
    python tools/growth.py                      docs/figures/growth.png, and a table
    python tools/growth.py --strands 100000 300000 --sizes 320x240 640x480

Time is that of the processor, of all threads, around each launch and its end: where the device is the CPU it is what a
stage takes, also where the machine is busy with other things.  The least of some frames, each done anew.
"""

import argparse
import collections
import contextlib
import time

import bench
from matplotlib.figure import Figure

import clfur

STAGES = {   # of kernels' files: what they are called here
    "strands": "growth", "order": "order", "tessellate": "body", "raster": "body", "voxelize": "voxelize",
    "zscan": "voxelize", "strand_light": "light", "shade": "shade"}
DRAW = "tiles", "sort", "pixels"   # of coverage.cl; the others make lists
SETTINGS = clfur.Settings()


@contextlib.contextmanager
def timed_launches(gpu):
    """A Counter that gets the processor's seconds of each stage whose kernels are launched meanwhile."""
    spent, launch = collections.Counter(), gpu.launch

    def timed(name, size, /, **arguments):
        gpu.queue.finish()
        began = time.process_time()
        launch(name, size, **arguments)
        gpu.queue.finish()
        file, kernel = name.split(".")
        stage = STAGES.get(file) or ("tiles" if kernel in DRAW else "lists")
        spent[stage] += time.process_time() - began
    gpu.launch = timed
    try:
        yield spent
    finally:
        del gpu.launch


def frame(gpu, scene, repeat):
    """{stage: least seconds} of a frame, everything done anew, and of the whole of it."""
    least = {}
    for k in range(repeat + 1):
        gpu.forget()
        with timed_launches(gpu) as spent:
            began = time.process_time()
            clfur.draw(scene, gpu, SETTINGS)
            spent["frame"] = time.process_time() - began
        if k:                                # the first builds kernels and gets memory
            least = {name: min(value, least.get(name, value)) for name, value in spent.items()}
    return least


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--strands", type=int, nargs="+", default=[100_000, 300_000, 1_000_000, 2_000_000, 5_000_000])
    parser.add_argument("--sizes", nargs="+", default=["320x240", "640x480", "1280x960", "1920x1080", "3840x2160"])
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--device")
    parser.add_argument("-o", "--output", default="docs/figures/growth.png")
    arguments = parser.parse_args()
    gpu = clfur.Scheduler(arguments.device)
    sizes = [tuple(map(int, size.split("x"))) for size in arguments.sizes]
    charts = {
        "strand at 640x480": {n: each(n, frame(gpu, bench.canonical(n, "grown", (640, 480)), arguments.repeat))
                              for n in arguments.strands},
        "pixel with 100,000 strands": {
            width * height: each(width * height, frame(gpu, bench.canonical(100_000, "grown", (width, height)),
                                                       arguments.repeat)) for width, height in sizes}}
    for what, rows in charts.items():
        print(table(what, rows), end="\n\n")
    chart(arguments.output, charts)


def each(n, seconds):
    """Nanoseconds of each of n."""
    return {stage: 1e9 * value / n for stage, value in seconds.items()}


def stages_of(rows):
    """Names of stages, the dearest first."""
    dearest = collections.Counter()
    for row in rows.values():
        dearest |= collections.Counter(row)
    return [name for name, _ in dearest.most_common()]


def table(what, rows):
    """Markdown: a row a stage, a column a count."""
    lines = [f"| ns a {what} | " + " | ".join(f"{n:,}" for n in rows) + " |", "|---|" + "--:|" * len(rows)]
    for stage in stages_of(rows):
        lines.append(f"| {stage} | " + " | ".join(f"{row.get(stage, 0):,.0f}" for row in rows.values()) + " |")
    return "\n".join(lines)


def chart(path, charts):
    """Nanoseconds a thing against how many there are, for each stage."""
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    colors = {stage: f"C{k}" for k, stage in enumerate(dict.fromkeys([*STAGES.values(), "tiles", "lists"]))}
    for axes, (what, rows) in zip(figure.subplots(1, len(charts)), charts.items(), strict=True):
        for stage in stages_of(rows):
            axes.loglog(list(rows), [row.get(stage) for row in rows.values()], marker="o", label=stage,
                        linewidth=2.5 if stage == "frame" else 1.2, color=colors.get(stage, "black"))
        axes.set_xlabel(f"{what.split()[0]}s")
        axes.set_ylabel(f"ns of the processor a {what}")
        axes.grid(True, which="both", alpha=.25)
        axes.legend(fontsize=8)
    figure.savefig(path, dpi=100)


if __name__ == "__main__":
    main()
