"""A parting: guides that are combed by code to both sides of a line on a ball, and 150,000 strands between them."""

from pathlib import Path

import numpy as np

import clfur

SIZE, LENGTH, STEPS = np.array([.8, 1, .9]), 1.5, 40


def combed(n):
    """Guides [.., STEPS, 3] on the upper part of a ball: away from a parting, then down."""
    k = np.arange(n)
    y = .1 + .9 * (k + .5) / n
    way = np.sqrt(1 - y * y)
    place = np.stack([way * np.cos(2.399963 * k), y, way * np.sin(2.399963 * k)], 1)
    place = place[(place[:, 2] < .3) | (place[:, 1] > .6)]   # but not on the face
    side, line = np.where(place[:, 0] > .15, 1, -1), []
    for step in np.arange(STEPS) / (STEPS - 1):
        line.append(place * SIZE * (1 + .1 * np.sqrt(min(6 * step, 1)) + .02 * step))
        flow = (0, -.9, -.25) + 1.2 * np.maximum(place[:, 1:2], 0) * np.stack([side, 0 * side, 0 * side], 1)
        flow = flow - (flow * place).sum(1, keepdims=True) * place
        place = place + LENGTH / STEPS * flow / np.linalg.norm(flow, axis=1, keepdims=True)
        place = np.where(place[:, 1:2] > -.15, place / np.linalg.norm(place, axis=1, keepdims=True), place)
    return np.stack(line, 1)


def main(folder=".", size=(640, 560), guides=900):
    ball = clfur.load_mesh("sphere")
    scalp = (ball.positions[ball.faces].mean(1) * (0, 1, -.4)).sum(1) > .05
    uv = np.repeat(np.where(scalp, .25, .75)[:, None, None], 3, 1) * np.ones(2)   # which tells where hair stands
    head = clfur.Mesh(ball.positions * SIZE, uv=uv, faces=ball.faces)
    hair = clfur.HairType(segments=32, width=.004, tip_width=.05, taper=.3, color=(.35, .19, .08), key=(255, 255, 255),
                          root_color=(.16, .08, .03), tip_color=(.5, .3, .13), length_variation=.12, color_variation=.2)
    where = np.array([[(255, 255, 255), (0, 0, 0)]], np.uint8)
    fur = clfur.Strands(types=[hair, clfur.HairType(segments=0, key=(0, 0, 0))], type_map=where, roots=150_000,
                        guides=clfur.Curves(combed(guides)))
    scene = clfur.Scene(mesh=head, fur=fur, camera=clfur.Camera(eye=(.4, 2.2, 3), size=size),
                        light=clfur.Light(direction=(-.5, -1, -.7)), body_color=(.55, .36, .26))
    clfur.save(Path(folder) / "parting.png", clfur.render(scene, settings=clfur.Settings(masks=4)))


if __name__ == "__main__":
    main()
