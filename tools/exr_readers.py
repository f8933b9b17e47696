"""Whether other programs read and convert what clfur saves: OpenImageIO, and two readers of Cryptomatte.

    pip install OpenImageIO kriptomatte cryptomatte-api
    python tools/exr_readers.py

Prints the table of docs/data.md.
"""

import importlib.metadata
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

import clfur

SPACES = "lin_rec709", "srgb_texture"
WAYS = {"read (ImageBuf)": None, "copied (-a)": ["-a"],
        "converted (-a --tocolorspace)": ["-a", "--tocolorspace", SPACES[1]],
        "converted (-a --colorconvert:subimages=0)": ["-a", "--colorconvert:subimages=0", *SPACES],
        "all parts as colours (-a --colorconvert)": ["-a", "--colorconvert", *SPACES]}


def channels(path):
    """{channel: its array, of its own dtype} of all parts."""
    file, found, part = oiio.ImageInput.open(str(path)), {}, 0
    while file.seek_subimage(part, 0):
        spec = file.spec()
        for k, name in enumerate(spec.channelnames):
            kind = spec.channelformats[k] if spec.channelformats else spec.format
            found[name] = file.read_image(part, 0, k, k + 1, kind)[..., 0]
        part += 1
    return found


def buffered(path):
    """The same by ImageBuf, which has one dtype for each part."""
    found = {}
    for part in range(oiio.ImageBuf(str(path)).nsubimages):
        image = oiio.ImageBuf(str(path), part, 0)
        pixels = image.get_pixels(image.spec().format)
        found |= {name: pixels[..., k] for k, name in enumerate(image.spec().channelnames)}
    return found


def images():
    mesh = clfur.load_mesh("sphere")
    scene = clfur.Scene(mesh, clfur.Strands(roots=3000, types=clfur.HairType(width=.02)), clfur.Camera(size=(96, 64)))
    names = "color", "depth", "id", "normal", "matte_id", "matte_alpha"
    return clfur.render(scene, outputs=names)


def main():
    made = images()
    wanted = {"Z": made["depth"], "id": made["id"].astype(np.float32), "normal.X": made["normal"][..., 0],
              "A": made["color"][..., 3], "R": made["color"][..., 0]}
    print(f"OpenImageIO {oiio.__version__}\n\n| what it did | {' | '.join(wanted)} | Cryptomatte |\n|---|"
          + "---|" * (len(wanted) + 1))
    with tempfile.TemporaryDirectory() as folder:
        path, other = Path(folder) / "a.exr", Path(folder) / "b.exr"
        clfur.save(path, made)
        before = channels(path)
        for name, arguments in WAYS.items():
            if arguments is not None:
                subprocess.run(["oiiotool", path, *arguments, "-o", other], check=True, capture_output=True)
            found = buffered(path) if arguments is None else channels(other)
            same = [name in found and found[name].dtype == array.dtype and np.array_equal(found[name], array)
                    for name, array in wanted.items()]
            same.append(all(np.array_equal(found[name].view(np.uint32), array.view(np.uint32))
                            for name, array in before.items() if name.startswith("Crypto")))
            print(f"| {name} | {' | '.join('same' if each else 'changed' for each in same)} |")
        mattes(Path(folder) / "c.exr", made)


def mattes(path, made):
    """Compare masks of readers of Cryptomatte."""
    import cryptomatte_api

    clfur.save(path, {name: made[name] for name in ("matte_id", "matte_alpha")})
    masks = cryptomatte_api.Cryptomatte.load(str(path))[0].masks()
    worst = max(np.abs(mask - share_of(name, made)).max() for name, mask in masks.items())
    print(f"\ncryptomatte-api {importlib.metadata.version('cryptomatte-api')}: {len(masks)} masks, off by {worst:g}")
    import kriptomatte as other
    import OpenEXR

    file = OpenEXR.InputFile(str(path))
    (key, about), = other.Get_Cryptomattes_From_Header(file.header()).items()
    _, names, _ = other.parse_manifest({key: about}, key, str(path))
    layers, _ = other.identify_channels(file.header(), about["name"])
    size = other.Get_Window_Shape("dataWindow", file.header())
    layers = other.Get_Names_for_ALl_Sub_Crypto_channel(layers)
    planes = other.read_all_channels_in_list(file, layers, file.header(), size)
    worst = max(np.abs(other.get_mask_for_id(code, np.stack(planes, 2), 6) / 255 - share_of(name, made)).max()
                for name, code in names.items())
    print(f"kriptomatte {importlib.metadata.version('kriptomatte')}: {len(names)} masks of 8 bits, off by {worst:.4f}")


def share_of(name, made):
    """The share [h, w] of each pixel that was told of what has a name."""
    number = {"body": -2, "shells": -3, "ground": -4}.get(name)
    number = int(name.removeprefix("strand_")) if number is None else number
    return np.where(made["matte_id"] == number, made["matte_alpha"], 0).sum(2)


if __name__ == "__main__":
    main()
