"""Cameras of other programs, poses on a sphere, and frames from many cameras."""

import struct

import numpy as np
import pytest

import clfur
from clfur import Camera, Curves, Error, Scene

K = np.array([[520.0, 0.0, 290.25], [0.0, 470.0, 205.75], [0.0, 0.0, 1.0]])   # off centre, pixels not square
SIZE = 560, 420


def turned(vector):
    """The rotation matrix of a rotation vector [3], radians."""
    angle = np.linalg.norm(vector)
    x, y, z = np.asarray(vector) / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


R, T = turned([0.4, -2.5, 0.3]), np.array([0.1, -0.2, 4.0])
# Points of the world and where cv2.projectPoints (OpenCV 5.0.0) has them by K, R, T: tools are not asked in tests.
POINTS = np.array([[0.0, 0, 0], [0.7, -0.4, 0.3], [-0.5, 0.9, -0.8], [0.2, 0.3, 1.1]])
PIXELS = np.array([[303.25, 182.25], [232.9439825354, 115.1425356095], [362.6618987440, 314.7263655944],
                   [172.0755748249, 162.6620286515]])
SKEWED = K + [[0, 30, 0], [0, 0, 0], [0, 0, 0]]


def seen(points, k):
    """Where OpenCV's own formula has points [n, 3]."""
    x = (k @ (points @ R.T + T).T).T
    return x[:, :2] / x[:, 2:]


def test_the_formula_is_opencvs():
    assert np.abs(seen(POINTS, K) - PIXELS).max() < 1e-8


def middle_of(alpha):
    """The middle between both ends of what covers a row or column of a picture, in pixels from the centre of the first:
    at its ends lie pixels that it covers in part."""
    there = np.flatnonzero(alpha)
    assert len(there) > 4 and (alpha[there[1:-1]] == 1).all()
    return (there[0] + 0.5 - alpha[there[0]] + there[-1] - 0.5 + alpha[there[-1]]) / 2


@pytest.mark.parametrize("k, places", [(K, PIXELS), (SKEWED, seen(POINTS, SKEWED))], ids=["K", "skewed"])
def test_a_point_lands_where_opencv_has_it(k, places, gpu):
    """A strand that lies across the view, along its rows, covers a rectangle around the image of its middle."""
    along = 0.05 * R[0]
    for point, place in zip(POINTS, places):
        fur = Curves([[point - along, point + along]], width=0.06, alpha=0.0)
        image = clfur.render(Scene(fur=fur, camera=Camera.from_opencv(k, R, T, SIZE)), gpu,
                             clfur.Settings(shadows="off", shadow_map=0))
        alpha, (column, row) = image[..., 3].astype(float), np.rint(place).astype(int)
        assert np.abs(np.subtract((middle_of(alpha[row]), middle_of(alpha[:, column])), place)).max() < 1e-3


@pytest.mark.parametrize("k", [[[50, 0, 4], [0, 50, 24], [0, 0, 1]], [[50, 9, 4], [0, 42, 20], [0, 0, 1]]])
def test_a_picture_off_centre_is_the_truths(k, gpu):
    """Measured: root mean squares of .032 to .039, as of centred cameras; a pixel aside twice as much."""
    hair = clfur.HairType(segments=3, segment_length=.1, width=.03, direction_variation=.3)
    camera = Camera.calibrated(Camera(eye=(.5, .9, 3)).pose, k, (24, 18))
    scene = Scene(clfur.load_mesh("sphere"), clfur.Strands(roots=600, types=hair), camera)
    image, true = clfur.render(scene, gpu), clfur.truth.picture(scene, 8)
    assert .2 < true[..., 3].mean() < .6 and abs((image - true)[..., 3].mean()) < .006
    assert rms(image - true) < .05
    for axis in (0, 1):
        assert rms(np.roll(image, 1, axis) - true) > .1


def rms(difference):
    return np.sqrt((difference**2).mean())


def test_opencv_and_back():
    camera = Camera.from_opencv(K, R, T.reshape(3, 1), SIZE, dist=np.zeros((1, 5)))
    for told, given in zip(camera.to_opencv(), (K, R, T, SIZE)):
        assert np.abs(np.subtract(told, given)).max() < 1e-12
    usual = Camera(eye=(1, 2, 3), fov=30, size=(64, 48))
    again = Camera.from_opencv(*usual.to_opencv())
    assert np.abs(again.pose - usual.pose).max() < 1e-14 and again.size == usual.size
    assert np.abs(again.intrinsics - usual.intrinsics).max() < 1e-12
    # What is drawn lies in the centre of the picture, which is between OpenCV's pixels.
    assert np.array_equal(usual.to_opencv()[0][:2, 2], (31.5, 23.5))


@pytest.mark.parametrize("wrong, words", [
    ({"R": np.diag([1.0, 1, -1])}, "Camera.from_opencv R is no rotation"),
    ({"R": (0.1, 0, 0)}, "Camera.from_opencv R is"), ({"t": (0, 0)}, "Camera.from_opencv t is"),
    ({"K": np.diag([0.0, 1, 1])}, "Camera.from_opencv K is"), ({"size": (0, 4)}, "Camera.size"),
    ({"dist": (0.1, 0, 0, 0)}, "undistort"), ({"dist": (np.nan,)}, "undistort")])
def test_opencv_refuses(wrong, words):
    with pytest.raises(Error, match="allowed: ") as caught:
        Camera.from_opencv(**{"K": K, "R": R, "t": T, "size": SIZE, **wrong})
    assert words in str(caught.value)


# --- COLMAP ---

CAMERAS = {7: ("PINHOLE", SIZE, (520.0, 470.0, 290.75, 206.25)), 2: ("SIMPLE_PINHOLE", (32, 24), (30.0, 16.0, 12.0)),
           5: ("OPENCV", SIZE, (520.0, 470.0, 290.75, 206.25, 0.0, 0.0, 0.0, 0.0))}
NUMBERS = {"SIMPLE_PINHOLE": 0, "PINHOLE": 1, "SIMPLE_RADIAL": 2, "OPENCV": 4, "OPENCV_FISHEYE": 5}
HALF = np.array([0.2, -1.25, 0.15])   # of a rotation vector
ANGLE = np.linalg.norm(HALF)
Q = 1.7 * np.array([np.cos(ANGLE), *np.sin(ANGLE) * HALF / ANGLE])   # COLMAP normalizes
IMAGES = {"a one.jpg": (Q, (0.1, -0.2, 4.0), 7, 2), "sub/b.png": ((0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 3.0), 2, 0),
          "c.jpg": (Q, (0.0, 0.0, 4.0), 5, 1)}


def write(folder, suffix, cameras=CAMERAS, images=IMAGES):
    """Write a model as COLMAP's documents have it."""
    if suffix == ".txt":
        text = "# Camera list\n" + "".join(
            f"{number} {model} {size[0]} {size[1]} {' '.join(map(str, numbers))}\n"
            for number, (model, size, numbers) in cameras.items())
        (folder / "cameras.txt").write_text(text)
        text = "# Image list\r\n" + "".join(
            f"{number} {' '.join(map(str, (*q, *t)))} {camera} {name}\r\n{' '.join(['1.5 2 -1'] * points)}\r\n"
            for number, (name, (q, t, camera, points)) in enumerate(images.items()))
        (folder / "images.txt").write_bytes(text.encode())
        return
    (folder / "cameras.bin").write_bytes(struct.pack("<Q", len(cameras)) + b"".join(
        struct.pack(f"<IiQQ{len(numbers)}d", number, NUMBERS.get(model, model), *size, *numbers)
        for number, (model, size, numbers) in cameras.items()))
    (folder / "images.bin").write_bytes(struct.pack("<Q", len(images)) + b"".join(
        struct.pack("<I7dI", number, *q, *t, camera) + name.encode() + b"\0"
        + struct.pack("<Q", points) + points * struct.pack("<ddq", 1.5, 2, -1)
        for number, (name, (q, t, camera, points)) in enumerate(images.items())))


@pytest.mark.parametrize("suffix", [".bin", ".txt"])
def test_a_model_of_colmap(suffix, tmp_path):
    write(tmp_path, suffix)
    found = clfur.load_colmap(tmp_path)
    assert list(found) == list(IMAGES)
    camera = found["a one.jpg"]
    k, rotation, place, size = camera.to_opencv()
    assert size == SIZE and np.abs(rotation - turned(2 * HALF)).max() < 1e-12 and np.abs(place - T).max() < 1e-12
    # The corner of the top-left pixel is at (0, 0) there, and at (-0.5, -0.5) in OpenCV.
    assert np.abs(k - [[520, 0, 290.25], [0, 470, 205.75], [0, 0, 1]]).max() < 1e-12
    assert np.abs(found["sub/b.png"].to_opencv()[1] - np.diag([1, -1, -1])).max() < 1e-12
    assert np.array_equal(found["sub/b.png"].intrinsics, [[30, 0, 16], [0, 30, 12], [0, 0, 1]])


@pytest.mark.parametrize("suffix", [".bin", ".txt"])
@pytest.mark.parametrize("model, numbers", [
    ("OPENCV", (520.0, 470.0, 290.75, 206.25, 0.0, 0.0, 1e-9, 0.0)), ("SIMPLE_RADIAL", (520.0, 280.0, 210.0, -0.1)),
    ("OPENCV_FISHEYE", (520.0, 470.0, 290.75, 206.25, 0.0, 0.0, 0.0, 0.0))])
def test_models_of_colmap_that_bend_lines_are_refused(suffix, model, numbers, tmp_path):
    write(tmp_path, suffix, {**CAMERAS, 5: (model, SIZE, numbers)})
    with pytest.raises(Error, match=f"images{suffix}: image 'c.jpg': its camera is of the model {model}, which bends"):
        clfur.load_colmap(tmp_path)
    write(tmp_path, suffix, {**CAMERAS, 5: (model, SIZE, numbers)}, {"a": IMAGES["a one.jpg"]})
    assert list(clfur.load_colmap(tmp_path)) == ["a"]   # of the others one need not see anything


def refused(folder):
    with pytest.raises(Error) as caught:
        clfur.load_colmap(folder)
    told = str(caught.value)
    assert "\n" not in told and str(folder) in told and len(told) - len(str(folder)) < 300
    return told


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_every_cut_of_a_model_is_told(name, tmp_path):
    write(tmp_path, ".bin")
    path = tmp_path / name
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        refused(tmp_path)
    path.write_bytes(whole + b"\0")
    assert "1 bytes more" in refused(tmp_path)
    path.write_bytes(struct.pack("<Q", 2**64 - 1) + whole[8:])
    assert "cut short" in refused(tmp_path)


@pytest.mark.parametrize("cameras, images, words", [
    (CAMERAS, {"a": (Q, T, 3, 0)}, "camera 3"), (CAMERAS, {"a": ((0, 0, 0, 0), T, 7, 0)}, "quaternion"),
    (CAMERAS, {"a": (Q, (np.nan, 0, 0), 7, 0)}, "from_opencv t"), (CAMERAS, {"a": (Q, T, 7, 0), "b": ((np.inf, 0, 0, 0),
     T, 7, 0)}, "image 'b'"), ({7: ("PINHOLE", (10**6, 2), (1.0, 1.0, 1.0, 1.0))}, {"a": (Q, T, 7, 0)}, "Camera.size"),
    ({7: ("PINHOLE", SIZE, (-1.0, 1.0, 1.0, 1.0))}, {"a": (Q, T, 7, 0)}, "from_opencv K"),
    ({7: (99, SIZE, (1.0, 1.0, 1.0, 1.0))}, {"a": (Q, T, 7, 0)}, "model")])
@pytest.mark.parametrize("suffix", [".bin", ".txt"])
def test_models_of_colmap_that_cannot_be(suffix, cameras, images, words, tmp_path):
    write(tmp_path, suffix, cameras, images)
    assert words in refused(tmp_path)


@pytest.mark.parametrize("name, text", [
    ("cameras.txt", "7 PINHOLE 4 4 1 1 1"), ("cameras.txt", "7 PINHOLE 4"), ("cameras.txt", "7 PINHOLE 4 x 1 1 1 1"),
    ("cameras.txt", "7 PINHOLE 4 4 1 1 1 1 1"), ("images.txt", "1 1 0 0 0 0 0 3 7"),
    ("images.txt", "1 1 0 a 0 0 0 3 7 b")])
def test_texts_of_colmap_that_cannot_be(name, text, tmp_path):
    write(tmp_path, ".txt")
    (tmp_path / name).write_text(text)
    refused(tmp_path)


def test_a_folder_without_a_model(tmp_path):
    assert "allowed: a folder with cameras.bin" in refused(tmp_path)
    (tmp_path / "cameras.bin").mkdir()
    (tmp_path / "images.bin").mkdir()
    assert "folder" in refused(tmp_path)
    with pytest.raises(Error, match="load_colmap folder is 3"):
        clfur.load_colmap(3)


# --- poses on a sphere, and frames from many cameras ---


@pytest.mark.parametrize("up", [(0, 1, 0), (0, 0, 1), (1, 2, -1)])
def test_poses_are_spread_evenly(up):
    center, n = np.array([3.0, -1, 2]), 4000
    cameras = Camera.on_sphere(n, center, 2.5, seed=5, up=up, elevation=(-90, 60))
    away = np.array([camera.eye for camera in cameras]) - center
    assert np.abs(np.linalg.norm(away, axis=1) - 2.5).max() < 1e-12
    above = away / 2.5 @ (np.array(up) / np.linalg.norm(up))
    assert -1 <= above.min() < -0.99 and 0.99 * np.sin(np.radians(60)) < above.max() <= np.sin(np.radians(60)) + 1e-12
    # By Archimedes heights are uniform; four standard deviations of the mean of n of them, 0 but once in 16,000 seeds.
    width = 1 + np.sin(np.radians(60))
    assert abs(above.mean() - (np.sin(np.radians(60)) - 1) / 2) < 4 * width / np.sqrt(12 * n)
    level = away - 2.5 * above[:, None] * np.array(up) / np.linalg.norm(up)
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    assert np.linalg.norm(level.mean(0)) < 4 / np.sqrt(n)   # all around
    for camera in cameras[:20]:
        assert np.allclose(-camera.pose[:3, 2] * 2.5, center - camera.eye)   # looks at the middle,
        assert camera.pose[:3, 1] @ up > 0 and abs(camera.pose[:3, 0] @ up) < 1e-12   # and up is up


def test_poses_of_one_seed_begin_alike():
    few, many = Camera.on_sphere(3, seed=8), Camera.on_sphere(9, seed=8, size=(4, 3), fov=20)
    assert all(np.array_equal(a.eye, b.eye) for a, b in zip(few, many)) and many[0].size == (4, 3)
    assert not np.array_equal(few[0].eye, Camera.on_sphere(1, seed=9)[0].eye)
    assert all(np.allclose(camera.eye, (0, 3.2, 0)) for camera in Camera.on_sphere(3, elevation=(90, 90)))
    with pytest.raises(Error, match="lower angle first"):
        Camera.on_sphere(1, elevation=(30, 20))


@pytest.fixture(scope="module")
def furry():
    fur = clfur.Strands(roots=3000, types=clfur.HairType(segments=4, segment_length=0.08, width=0.01))
    return Scene(clfur.load_mesh("sphere"), fur)


def test_frames_are_those_of_each_camera(gpu, furry):
    cameras = [*Camera.on_sphere(2, radius=4, size=(40, 30)), Camera.from_opencv(
        [[60, 0, 5], [0, 50, 20], [0, 0, 1]], np.diag([1.0, -1, -1]), (0, 0, 2), (32, 24))]
    outputs = "color", "depth", "id"
    found = list(clfur.frames(furry, iter(cameras), gpu, outputs=outputs))
    assert len(found) == 3
    for camera, frame in zip(cameras, found):
        alone = clfur.render(Scene(furry.mesh, furry.fur, camera=camera), gpu, outputs=outputs)
        assert all(np.array_equal(frame.images[name], alone[name]) for name in outputs)
        assert (alone["id"] >= 0).any()


def test_a_principal_point_aside_is_a_region(gpu, furry):
    """A picture cut out of a larger one has the larger one's K, its origin moved: float32's last bits differ."""
    scene, (x, y, *size) = Scene(furry.mesh, furry.fur, Camera(size=(80, 60))), (47, 5, 30, 40)
    k, rotation, place, _ = scene.camera.to_opencv()
    k[:2, 2] -= x, y
    image = clfur.render(Scene(furry.mesh, furry.fur, Camera.from_opencv(k, rotation, place, size)), gpu)
    part = clfur.render(scene, gpu, region=(x, y, *size))
    assert .2 < part[..., 3].mean() < .9 and np.abs(image - part).max() < 2e-3


def test_frames_keep_what_hangs_on_no_camera(gpu, furry, monkeypatch):
    """Nothing grows, and no light's grid is filled, for the second camera that sees all."""
    launched = []
    launch = type(gpu).launch

    def told(self, name, *args, **known):
        launched.append(name)
        return launch(self, name, *args, **known)
    monkeypatch.setattr(type(gpu), "launch", told)
    gpu.forget()
    frames = clfur.frames(furry, Camera.on_sphere(2, radius=6, size=(32, 24)), gpu)
    next(frames)
    first = set(launched)
    launched.clear()
    next(frames)
    files = {name.partition(".")[0] for name in launched}
    assert {"strands.grow", "tessellate.tessellate"} & first and any(name.startswith("voxelize") for name in first)
    assert not files & {"strands", "tessellate", "voxelize", "zscan"} and "coverage" in files


@pytest.mark.parametrize("cameras", [None, 3, "x", Camera(), {"a": Camera()}])
def test_frames_refuse(cameras, gpu, furry):
    with pytest.raises(Error, match="cameras is .*allowed: "):
        clfur.frames(furry, cameras, gpu)
    with pytest.raises(Error, match=r"cameras\[1\] is 3; allowed: "):
        list(clfur.frames(furry, [Camera(size=(8, 6)), 3], gpu))
