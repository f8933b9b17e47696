"""A name in velvet: tubes along the letters, and shells on them."""

import studio
from models.letters import word

import clfur


@studio.picture(studio.backdrop((.24, .21, .16)), settings=clfur.Settings(grid=160))
def letters(size):
    plush = clfur.Shells(length=.085, layers=30, hairs=150_000, density=.85, color=(.03, .28, .3), root_shade=.2,
                         force=(.1, -.35, 0), length_variation=.5, specular=.25, exponent=30.0)
    return studio.stage(word(), plush, (.55, .75, 4.9), (0, .27, 0), size, (.01, .06, .07), 37, height=-.42, key=1.1,
                        rim=1.5)


if __name__ == "__main__":
    letters()
