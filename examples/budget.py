"""As right as need be: the cheapest settings below an error, and the best within a time."""

from pathlib import Path

import clfur


def main(folder=".", size=(640, 480), max_error=.06, seconds=.5):
    scene = clfur.Scene(mesh=clfur.load_mesh("teapot"), camera=clfur.Camera(eye=(.8, .7, 2.2), size=size),
                        fur=clfur.Strands(roots=40_000, types=clfur.HairType(segment_length=.012)))
    gpu = clfur.Scheduler()   # kept, so that it chooses once for a scene, a light and a distance
    for name, settings in ("error", clfur.Settings(max_error=max_error)), ("seconds", clfur.Settings(seconds=seconds)):
        frame = clfur.draw(scene, gpu, settings)
        print(f"{name}: {frame.seconds:.2f} s, error about {frame.error}, {frame.why}")
        clfur.save(Path(folder) / f"budget-{name}.png", frame.images["color"])


if __name__ == "__main__":
    main()
