"""Scenes far from the world's origin: they keep their shape, and draw the picture that they draw at 0."""

import attrs
import numpy as np
import pytest

import clfur
from clfur.scene import extent, seen_from

PLACES = [(431250, 55, 5411800), (-1e6, 1e6, 1e6), (0, 2.0**26, 0)]   # the last: as far as float64 keeps 1e-8
SETTINGS = clfur.Settings(samples=4, grid=64, shadow_map=256)
TOLERANCE = 1e-5   # rms; float64 gives the places back to 1e-9 to 1e-8, and few ends are snapped elsewhere for that


def hairs(n=400):
    """Points [n, 4, 3] of strands around a ball."""
    random = np.random.default_rng(1)
    root = random.normal(size=(n, 3))
    root /= np.linalg.norm(root, axis=1)[:, None]
    return root[:, None] * (1 + .06 * np.arange(4)[None, :, None]) + random.normal(size=(n, 4, 3)) * .01


def moved(mesh, by):
    return clfur.Mesh(mesh.positions + np.asarray(by, float), mesh.normals, mesh.uv, mesh.faces)


def scene(kind, by):
    """One kind of scene at a place; all lie around it."""
    at = np.asarray(by, float)
    ball = moved(clfur.load_mesh("sphere"), at)
    fur = {
        "strands": clfur.Strands(inner=1, outer=1, types=[clfur.HairType(segments=4, width=.02, curl=(.02, 2))],
                                 point_forces=[clfur.PointForce(at + (0, 2, 0), -1.5)]),
        "curves": clfur.Curves(hairs() + at, width=.02, color=(.8, .5, .2)),
        "cells": clfur.Shells(length=.15, frequency=8, layers=8, force=(0, -.5, 0)),
        "sine": clfur.Shells(length=.15, frequency=8, layers=8, pattern="sine", density=.5),
    }
    lights = [clfur.Light(direction=(-1, -2, -.5), color=(.5, .5, .5)),
              clfur.Light(direction=(-1, -1, -1), position=at + (2, 2.5, 2.2), angle=70, color=(.5, .4, .9))]
    return clfur.Scene(None if kind == "alone" else ball, fur["curves" if kind == "alone" else kind],
                       clfur.Camera(at + (.3, .7, 3), at, size=(64, 48)), lights)


@pytest.mark.parametrize("kind", ["strands", "curves", "alone", "cells", "sine"])
def test_a_scene_draws_the_same_picture_wherever_it_is(gpu, kind):
    for raster in ("coverage", "samples"):
        settings = attrs.evolve(SETTINGS, raster=raster)
        here = clfur.render(scene(kind, (0, 0, 0)), gpu, settings)
        assert here[..., 3].any()
        for place in PLACES:
            there = clfur.render(scene(kind, place), gpu, settings)
            assert np.sqrt(((there - here) ** 2).mean()) < TOLERANCE


def test_the_truth_knows_it_too():
    here, there = (clfur.truth.picture(scene("curves", place), samples=1) for place in ((0, 0, 0), PLACES[0]))
    assert (np.abs(there - here) > 1e-4).mean() < .01   # rays that pass an edge by a hair


def test_strands_that_grew_far_away_come_back_where_they_were(gpu):
    here, there = scene("strands", (0, 0, 0)), scene("strands", PLACES[0])
    grown, away = clfur.grow(here, gpu), clfur.grow(there, gpu)
    assert not grown.origin.any() and (away.origin == PLACES[0]).all()
    np.testing.assert_allclose(away.points + away.origin - PLACES[0], grown.points, atol=1e-6)
    np.testing.assert_allclose(away.bounds.center - PLACES[0], grown.bounds.center, atol=1e-6)
    again = attrs.evolve(there, fur=away)
    np.testing.assert_array_equal(clfur.render(again, gpu, SETTINGS), clfur.render(there, gpu, SETTINGS))


def test_a_file_with_such_coordinates_keeps_all_faces(tmp_path):
    pot = clfur.load_mesh("teapot")
    places = pot.positions.astype(float) + PLACES[0]
    file = tmp_path / "far.obj"
    file.write_text("".join([*(f"v {x!r} {y!r} {z!r}\n" for x, y, z in places.tolist()),
                             *(f"f {a} {b} {c}\n" for a, b, c in (pot.faces.astype(int) + 1).tolist())]))
    mesh = clfur.load_mesh(file)
    assert len(mesh.faces) == len(pot.faces) and mesh.positions.dtype == np.float32
    corners = (mesh.positions + mesh.origin)[mesh.faces] - PLACES[0]
    np.testing.assert_allclose(corners, pot.positions[pot.faces], atol=1e-6)
    np.testing.assert_allclose(mesh.bounds[0] - PLACES[0], pot.bounds[0], atol=1e-6)


def test_what_is_near_keeps_its_bits_and_what_is_stored_can_be_given_again():
    ball = clfur.load_mesh("sphere")
    near, far = moved(ball, (60, 0, 0)), moved(ball, (70, 0, 0))
    assert not near.origin.any() and (near.positions == ball.positions + np.float32((60, 0, 0))).all()
    assert (far.origin == (70, 0, 0)).all() and (attrs.evolve(far).origin == far.origin).all()
    assert (attrs.evolve(far).positions == far.positions).all()
    curves = clfur.Curves(hairs() + (1e5, 0, 0))
    again = attrs.evolve(curves, points=curves.points.reshape(-1, 4, 3), counts=None)
    assert curves.origin.any() and (again.points == curves.points).all() and (again.origin == curves.origin).all()
    stray = hairs() + (1e5, 0, 0)
    stray[0, 0] = 0                     # one wrong point does not take the others' places
    assert abs(clfur.Curves(stray).origin[0] - 1e5) < 2
    two = np.concatenate([hairs(100), hairs(400) + (1e5, 0, 0)])
    assert not clfur.Curves(two).origin.any()     # of two heaps none is left behind


def test_a_scene_has_one_origin():
    ball = moved(clfur.load_mesh("sphere"), PLACES[0])
    curves = clfur.Curves(hairs() + PLACES[0] + (.9, .9, .9))
    there = clfur.Scene(ball, curves)
    assert (there.origin == ball.origin).all() and not there.local.origin.any()
    np.testing.assert_allclose(there.local.strands.points + there.origin, curves.points + curves.origin, atol=1e-6)
    assert there.local is there.local and there.local.strands is clfur.Scene(ball, curves).local.strands
    center, radius = extent(there.mesh, there.fur)
    assert np.abs(center - PLACES[0]).max() < 1 and radius < 3
    near = clfur.Scene(clfur.load_mesh("sphere"))
    assert near.local is near and seen_from(None, near.origin) is None


def test_places_beyond_all_numbers_are_refused():
    allowed = r"Mesh.positions are around \[2000000000.0, 0.0, 0.0\]; allowed: at most 1e\+09"
    with pytest.raises(clfur.Error, match=allowed):
        moved(clfur.load_mesh("sphere"), (2e9, 0, 0))
