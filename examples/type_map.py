"""A mesh of one's own whose hair types are painted: red of the map grows a mane, green a short coat, blue nothing."""

from pathlib import Path

import numpy as np

import clfur

N = 48   # faces along each side of a saddle


def saddle():
    u, v = np.meshgrid(np.linspace(0, 1, N + 1), np.linspace(0, 1, N + 1))
    x, y = 2 * u - 1, 2 * v - 1
    first = (np.arange(N)[:, None] * (N + 1) + np.arange(N)).ravel()
    faces = first[:, None, None] + [[0, 1, N + 2], [0, N + 2, N + 1]]
    return clfur.Mesh(positions=np.stack([x, y, .4 * (x**2 - y**2)], -1).reshape(-1, 3),
                      uv=np.stack([u, v], -1).reshape(-1, 2), faces=faces.reshape(-1, 3))


def main(folder=".", size=(640, 480)):
    painted = np.zeros((64, 64, 3), np.uint8)
    painted[:, :, 1] = 255
    painted[:, 26:38] = 255, 0, 0
    painted[24:40, 44:60] = 0, 0, 255   # row 0 is at the top, where v is 1
    coat = clfur.HairType(key=(0, 255, 0), color=(.55, .35, .2), segments=6, segment_length=.015, length_variation=.4,
                          direction_variation=.3)
    mane = clfur.HairType(key=(255, 0, 0), color=(.9, .75, .4), segments=14, segment_length=.03, force_weight=.3,
                          length_variation=.3, direction_variation=.3)
    bald = clfur.HairType(key=(0, 0, 255), segments=0)
    scene = clfur.Scene(mesh=saddle(), body_color=(.45, .3, .25), camera=clfur.Camera(eye=(.6, -1.4, 2.6), size=size),
                        fur=clfur.Strands(roots=60_000, types=[coat, mane, bald], type_map=painted, force=(0, -1, 0)))
    clfur.save(Path(folder) / "type_map.png", clfur.render(scene))


if __name__ == "__main__":
    main()
