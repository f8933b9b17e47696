"""`clfur view` without a browser: who may ask, how it starts and ends, what is drawn when, and how fast."""

import asyncio
import base64
import http.client
import io
import itertools
import math
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
import warnings

import attrs
import numpy as np
import psutil
import pytest
from PIL import Image
from support.browser import serving, until
from support.pages import Page, fur

import clfur
from clfur.budget import PRESETS
from clfur.command.main import main
from clfur.command.view import view
from clfur.settings import RASTERS

pytest.importorskip("nicegui", reason='clfur view needs pip install "clfur[view]"')

from clfur.viewer import coding, pace, server
from clfur.viewer.document import Document
from clfur.viewer.drawing import Drawing
from clfur.viewer.guard import Guard
from clfur.viewer.orbit import Orbit
from clfur.viewer.windows import PIXELS, REST, Window

# ---------------------------------------------------------------------------------------------- who may ask


def asked(guard, kind="http", path="/", query="", **headers):
    """The status that a request gets, and whether what is guarded was reached; a websocket's: 101 where it is."""
    sent = []

    async def app(scope, receive, send):
        sent.append({"status": 101 if kind == "websocket" else 200, "reached": True})

    async def send(message):
        sent.append(message)
    guard.app = app
    listed = [(name.encode(), each.encode()) for name, value in headers.items()
              for each in ([value] if isinstance(value, str) else value)]
    asyncio.run(guard({"type": kind, "path": path, "query_string": query.encode(), "headers": listed}, None, send))
    status = 403 if sent[0].get("type") == "websocket.close" else sent[0]["status"]
    return status, any("reached" in each for each in sent)


COOKIE = "clfur-view-8000=secret"
OURS = {"host": "127.0.0.1:8000", "cookie": COOKIE}


@pytest.mark.parametrize("kind, given, status", [
    ("http", OURS, 200), ("http", OURS | {"host": "localhost:8000"}, 200),
    ("http", OURS | {"origin": "http://127.0.0.1:8000"}, 200),
    ("http", OURS | {"cookie": f"other=1; {COOKIE}"}, 200),
    ("http", OURS | {"cookie": f'prefs={{"a":1}}; {COOKIE}'}, 200), ("http", OURS | {"cookie": f"a=b c;{COOKIE}"}, 200),
    ("http", OURS | {"cookie": f"a; b=ü; {COOKIE}; c=("}, 200), ("http", OURS | {"cookie": ["a;=;", COOKIE]}, 200),
    ("http", OURS | {"cookie": f"clfur-view-8000=old; {COOKIE}"}, 200),
    ("http", OURS | {"cookie": f"other={COOKIE}"}, 403), ("http", OURS | {"cookie": "secret"}, 403),
    ("http", OURS | {"host": "LocalHost:8000", "origin": "http://localhost:8000"}, 200),
    ("http", OURS | {"host": "[::1]:8000"}, 200),
    ("http", OURS | {"host": "example.org:8000"}, 400), ("http", OURS | {"host": "127.0.0.1"}, 400),
    ("http", OURS | {"host": "127.0.0.1:8001"}, 400), ("http", OURS | {"host": "192.168.0.7:8000"}, 400),
    ("http", OURS | {"host": ["127.0.0.1:8000", "example.org:8000"]}, 400), ("http", {"cookie": COOKIE}, 400),
    ("http", OURS | {"origin": "http://example.org"}, 403), ("http", OURS | {"origin": "null"}, 403),
    ("http", OURS | {"origin": "http://localhost:8000"}, 403),
    ("http", OURS | {"origin": "https://127.0.0.1:8000"}, 403),
    ("http", {"host": "127.0.0.1:8000"}, 403), ("http", OURS | {"cookie": "clfur-view-8000=secre"}, 403),
    ("http", OURS | {"cookie": "clfur-view-8001=secret"}, 403), ("http", OURS | {"cookie": "clfur-view-8000="}, 403),
    ("websocket", OURS | {"origin": "http://127.0.0.1:8000"}, 101), ("websocket", OURS, 403),
    ("websocket", OURS | {"origin": "http://example.org"}, 403),
    ("websocket", OURS | {"host": "example.org:8000", "origin": "http://example.org:8000"}, 403),
    ("websocket", {"host": "127.0.0.1:8000", "origin": "http://127.0.0.1:8000"}, 403)])
def test_who_may_ask(kind, given, status):
    for path in ("/", "/pictures", "/_nicegui_ws/socket.io/", "/_nicegui/3/static/x.js"):
        assert asked(Guard(None, 8000, "secret"), kind, path, **given) == (status, status in (200, 101))


def test_the_token_becomes_a_cookie():
    bare = {"host": "127.0.0.1:8000"}
    assert asked(Guard(None, 8000, "secret"), query="token=secret", **bare) == (303, False)
    assert asked(Guard(None, 8000, "secret"), query="token=other", **bare) == (403, False)
    assert asked(Guard(None, 8000, "secret"), query="token=%FF", **bare) == (403, False)
    assert asked(Guard(None, 8000, "secret"), path="/pictures", query="token=secret", **bare) == (403, False)
    assert asked(Guard(None, 8000, "secret"), query="token=secret", host="example.org:8000") == (400, False)


def test_a_browser_that_is_opened_gets_a_token_for_once():
    guard, bare = Guard(None, 8000, "secret"), {"host": "127.0.0.1:8000"}
    one, other = guard.once(), guard.once()
    assert one != other and asked(guard, query=f"token={other}", **bare)[0] == 303
    assert asked(guard, query=f"token={other}", **bare)[0] == 403   # a second time
    assert asked(guard, query=f"token={one}", host="example.org:8000")[0] == 400
    assert asked(guard, query=f"token={one}", **bare)[0] == 303
    assert asked(guard, "websocket", cookie=f"clfur-view-8000={one}", origin="http://127.0.0.1:8000", **bare)[0] == 403


@pytest.mark.parametrize("host, served", [
    ("192.168.0.7:8000", True), ("[fe80::1]:8000", True), (f"{socket.gethostname()}:8000", True),
    ("127.0.0.1:8000", True), ("192.168.0.7:8001", False), ("192.168.0.7.example.org:8000", False),
    ("Fur.Example:8000", True), ("a.fur.example:8000", False), ("fur.example", False)])
def test_at_every_address_no_foreign_name_counts(host, served):
    assert Guard(None, 8000, "secret", "fur.example").is_ours(host) == served


def test_browsers_leave_port_80_out():
    for host in ("127.0.0.1", "127.0.0.1:80", "LOCALHOST", "[::1]"):
        assert Guard(None, 80, "secret").is_ours(host) and not Guard(None, 8000, "secret").is_ours(host)
    assert not any(map(Guard(None, 80, "secret").is_ours, ("example.org", "::1", "127.0.0.1:8000", "127.0.0.1:", "")))


@pytest.mark.parametrize("host, shown", [
    ("127.0.0.1", "127.0.0.1"), ("LocalHost", "127.0.0.1"), ("0.0.0.0", "127.0.0.1"), ("::", "[::1]"),
    ("::1", "[::1]"), ("192.168.0.7", "192.168.0.7"), ("Fur.Example", "Fur.Example")])
def test_the_address_that_is_printed_is_answered(host, shown):
    assert server._shown(host) == shown and Guard(None, 8000, "secret", host).is_ours(f"{shown}:8000")


@pytest.mark.parametrize("host, said", [
    ("", "at '' as the host; allowed: 127.0.0.1, or another"),
    ("192.0.2.1", "192.0.2.1, port any: .*; allowed: an address or name of this machine"),
    ("a..b", "a..b, port any: .*; allowed: an address or name of this machine")])
def test_a_host_that_cannot_be_is_told_as_such(host, said):
    with pytest.raises(clfur.Error, match=said), server._listening(host, None):
        pytest.fail("it listens")


@pytest.fixture(scope="module")
def served():
    with serving("sphere", "--roots", 500, "--fur", "strands") as server:
        yield server


def request(served, path="/", method="GET", **headers):
    """(status, headers, body) of a request to it."""
    connection = http.client.HTTPConnection("127.0.0.1", served.port, timeout=20)
    try:
        connection.putrequest(method, path, skip_host=True)
        for name, value in ({"Host": f"127.0.0.1:{served.port}"} | headers).items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
    finally:
        connection.close()


def knocking(served, path, **headers):
    """The status that a websocket gets there: 101 where it is accepted."""
    key = base64.b64encode(os.urandom(16)).decode()
    return request(served, path, Connection="Upgrade", Upgrade="websocket", Sec_WebSocket_Key=key,
                   Sec_WebSocket_Version="13", **headers)[0]


def test_it_lets_in_who_has_the_token(served):
    """By a cookie that scripts cannot read and no other site's page sends along."""
    status, headers, _ = request(served, f"/?token={served.token}")
    flags = {part.strip().lower() for part in headers["set-cookie"].split(";")}
    assert (status, headers["location"]) == (303, "/") and {"httponly", "samesite=strict", "path=/"} <= flags
    cookie = headers["set-cookie"].split(";")[0]
    status, headers, body = request(served, Cookie=cookie)
    assert status == 200 and b"/pictures?window=" in body and served.token.encode() not in body
    assert headers["referrer-policy"] == "no-referrer"
    assert request(served)[0] == request(served, "/?token=x")[0] == request(served, "/nowhere")[0] == 403
    assert served.token not in served.said()


def test_it_refuses_other_hosts_and_origins(served):
    """For the page, for our socket and for NiceGUI's, over HTTP and as websockets; the token helps nobody there."""
    cookie, there = f"clfur-view-{served.port}={served.token}", f"http://127.0.0.1:{served.port}"
    paths = "/", "/pictures?window=0", "/_nicegui_ws/socket.io/?EIO=4&transport=polling"
    for path in paths:
        assert request(served, path, Host=f"example.org:{served.port}", Cookie=cookie)[0] == 400
        assert request(served, path, Origin="http://example.org", Cookie=cookie)[0] == 403
    for path in (paths[1], paths[2].replace("polling", "websocket")):
        assert knocking(served, path, Origin="http://example.org", Cookie=cookie) == 403
        assert knocking(served, path, Host="example.org", Origin="http://example.org", Cookie=cookie) == 403
        assert knocking(served, path, Origin=there) == knocking(served, path, Cookie=cookie) == 403
    assert request(served, paths[2], Origin=there, Cookie=cookie)[0] == 200


def test_it_listens_to_this_machine_alone(served):
    process = psutil.Process(served.process.pid)
    places = [each.laddr for each in process.net_connections("inet") if each.status == psutil.CONN_LISTEN]
    assert [tuple(place) for place in places] == [("127.0.0.1", served.port)]


def test_a_taken_port_is_told(served, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["view", "sphere", "--no-browser", "--port", str(served.port)])
    said = capsys.readouterr().err
    assert ended.value.code == 2 and said.count("\n") == 1
    assert f"127.0.0.1, port {served.port}: address already in use; allowed: a free port" in said


@pytest.mark.skipif(os.name == "nt", reason="signals")
@pytest.mark.parametrize("name, line", [("SIGINT", "ended"), ("SIGTERM", "ended by SIGTERM")])
def test_a_signal_ends_it(name, line):
    """At once, in a line, and with exit code 0: that is how a server should end."""
    with serving("sphere", "--roots", 100) as server:
        began = time.monotonic()
        server.process.send_signal(getattr(signal, name))
        assert server.process.wait(20) == 0
        seconds = time.monotonic() - began
        assert server.said() == f"clfur: {line}\n"
        assert seconds < 1 + psutil.getloadavg()[0] / psutil.cpu_count()   # others may have the processor


def test_another_address_is_warned_of(monkeypatch):
    """Before anything is read or served."""
    monkeypatch.setattr("clfur.command.view.waiting", lambda _: pytest.fail("it goes on"))
    with pytest.warns(UserWarning, match=r"at 0\.0\.0\.0.*can see and change"), pytest.raises(pytest.fail.Exception):
        view(["sphere", "--host", "0.0.0.0"], standalone_mode=False)
    for host in ("127.0.0.1", "LOCALHOST", "::1"):
        with warnings.catch_warnings(), pytest.raises(pytest.fail.Exception, match="it goes on"):
            warnings.simplefilter("error")
            view(["sphere", "--host", host], standalone_mode=False)


def test_without_nicegui_a_line_says_what_to_install():
    """And clfur itself does without it: the command asks for it when it is to view."""
    code = "import sys; sys.modules['nicegui'] = None; from clfur.command.main import main; main(['view', 'sphere'])"
    done = subprocess.run([sys.executable, "-c", code], timeout=60, capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == 'clfur: error: clfur view needs NiceGUI: pip install "clfur[view]"\n'


# ------------------------------------------------------------------------------------------ how fast it goes


def going(costs, frames, noise=0.0, seed=1):
    """The way that each of so many pictures went, of which each way takes its seconds, but for noise."""
    now, chance, steps = pace.Pace(len(costs)), random.Random(seed), []
    for _ in range(frames):
        steps.append(now.step)
        now.took(costs[now.step] * (1 + noise * chance.uniform(-1, 1)))
    return steps


@pytest.mark.parametrize("costs, best", [
    ((0.02, 0.015, 0.01, 0.005, 0.003), 0),         # a fast device: the final's own settings
    ((0.120, 0.100, 0.075, 0.025, 0.012), 3),       # two cores, 100,000 strands
    ((0.240, 0.200, 0.150, 0.050, 0.024), 3), ((0.600, 0.500, 0.400, 0.120, 0.060), 4), ((9, 8, 6, 3, 2), 4)])
def test_pictures_are_as_good_as_there_is_time_for(costs, best):
    for seed in range(5):
        steps = going(costs, 400, 0.2, seed)
        assert steps[-1] == best and steps[100:].count(best) > 0.9 * 300
        assert np.count_nonzero(np.diff(steps[100:])) <= 6   # they do not flicker


def test_moving_pictures_keep_the_finals_light():
    """Whatever its settings; and none of the ways there has a goal, a blur or masks."""
    for settings in (clfur.Settings(), clfur.Settings(lod=2, masks=4, samples=16), clfur.Settings(shadows="deep"),
                     clfur.Settings(scattering="grid"), clfur.Settings(seconds=0.5), clfur.Settings(samples=1),
                     clfur.Settings(raster="samples", shadows="off")):
        for shells in (False, True):
            ways = pace.ways(settings, shells)
            assert len(ways) >= 3 and ways[0][1] == 1
            for way, _ in ways:
                assert not way.goal and way.blur == "off" and not way.masks and way.lod >= settings.lod
                assert (way.method, way.grid, way.shadow_map, way.pcf, way.scattering) == (
                    settings.method, settings.grid, settings.shadow_map, settings.pcf, settings.scattering)
                if settings.raster == "samples" or way.scattering == "grid":
                    assert way.raster == settings.raster
                if way.raster == "samples" and settings.raster == "coverage":
                    assert way.lod and way.samples == 4   # else strands are too wide


def test_no_moving_picture_is_tried_twice():
    """The way that is tried first is the last but one, also where there are fewer ways than before."""
    others = [clfur.Settings(raster=raster, samples=samples) for raster in RASTERS for samples in (1, 4, 16)]
    for settings in (*PRESETS.values(), *others, clfur.Settings(scattering="grid"), clfur.Settings(lod=2)):
        for shells in (False, True):
            ways, going = pace.ways(settings, shells), pace.Pace(5)
            assert all(one != other for one, other in itertools.pairwise(ways)), settings
            assert going.of(ways) == ways[-2] and going.of(ways[-3:]) == ways[-2]


@pytest.fixture(scope="module")
def furry():
    """A small ball with strands of half a pixel, alone and over shells."""
    strands = clfur.Strands(roots=6_000, types=clfur.HairType(
        length=.2, width=.008, tip_width=.3, root_color=(.15, .08, .03), color=(.5, .3, .15), direction_variation=.3,
        length_variation=.4))
    scene = clfur.Scene(mesh=clfur.load_mesh("sphere"), fur=strands,
                        camera=clfur.Camera(eye=(0, 1, 3.2), target=(0, 0, 0), size=(192, 144)))
    return scene, attrs.evolve(scene, fur=(clfur.Shells(length=.08, hairs=20_000, color=(.35, .2, .1)), strands))


def test_moving_pictures_are_as_bright_as_the_final(furry, device):
    """All ways within 8 %, which were up to 1.9 times as bright; shadows are made once for all of a camera's places."""
    for scene in furry:
        final, turned, means = clfur.Settings(grid=48, samples=1), Orbit.of(scene, scene.camera.size).turned(.5, .1), []
        clfur.draw(scene, device, final)
        for way, divided in [(final, 1), *pace.ways(final, scene.shells is not None)]:
            camera = turned.resized([each // divided for each in scene.camera.size]).camera()
            frame = clfur.draw(attrs.evolve(scene, camera=camera), device, way)
            means.append(frame.images["color"][..., :3].mean())
            assert "voxelize" not in frame.stages
        ratios = np.array(means[1:]) / means[0]
        assert ratios == pytest.approx(1, abs=.08), ratios


# -------------------------------------------------------------------------------------------- what is drawn


def test_jpeg_lies_over_the_pages_background():
    image = np.zeros((32, 48, 4), np.float32)
    image[:, 16:] = (0.25, 0.5, 0.125, 0.5)
    image[:, 32:] = (0.25, 0.5, 0.125, 1)
    shown = np.asarray(Image.open(io.BytesIO(coding.jpeg(image)))).astype(float)[16]
    behind = np.array(coding.BACKGROUND)
    assert np.abs(shown[5] - behind).max() <= 1
    straight = clfur.to_uint8(image)[0]
    assert np.abs(shown[40] - straight[40, :3]).max() <= 4
    assert np.abs(shown[24] - (straight[24, :3] + behind) / 2).max() <= 4
    assert coding.background() == "#26272b"


@pytest.fixture(scope="module")
def device():
    return clfur.Scheduler()


@pytest.fixture
def drawing(device):
    drawing = Drawing(Document(fur()), [device])
    drawing.start()
    yield drawing
    assert drawing.close(60)


def test_first_a_fast_picture_then_the_final_one(drawing, device):
    page = Page(drawing).connect()
    page.settled()
    assert [header["final"] for header, _ in page.got] == [False, True]
    header, data = page.got[-1]
    camera = Orbit(**header["orbit"]).camera()
    image = clfur.render(attrs.evolve(drawing.document.scene, camera=camera), clfur.Scheduler())
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(data))), clfur.to_uint8(image))
    assert header["size"] == (48, 36) and header["strands"] == 200 and page.got[0][1][:2] == b"\xff\xd8"
    time.sleep(2 * REST)
    assert len(page.got) == 2   # nothing changes, and nothing is drawn


def test_the_newest_camera_wins(drawing):
    """Whatever was told meanwhile is in the next picture, and no picture is drawn for each."""
    page = Page(drawing, at_once=False).connect()
    until(lambda: page.got)
    for n in range(2, 60):
        page.tell(n=n, turn=[0.01, 0])
        time.sleep(0.002)
    assert len(page.got) <= 2   # of which none was drawn
    page.at_once = True
    for _ in page.got[:]:
        page.drawn()
    page.settled()
    told = [header["gesture"] for header, _ in page.got]
    assert told == sorted(told) and told[-1] == 59 and len(told) < 20
    assert page.last["orbit"]["azimuth"] == pytest.approx(math.remainder(
        Orbit.of(drawing.document.scene).azimuth - 58 * 3.6, 360))


def test_nothing_is_drawn_for_who_does_not_look(drawing):
    page = Page(drawing).connect(hidden=True)
    time.sleep(3 * REST)
    assert not page.got
    page.tell(hidden=False)
    page.settled()
    page.tell(hidden=True)
    count = len(page.got)
    page.tell(n=9, turn=[0.1, 0])
    time.sleep(3 * REST)
    assert len(page.got) == count
    drawing.disconnect(page.window, page.link)
    page.tell(hidden=False)
    time.sleep(3 * REST)
    assert len(page.got) == count


def test_an_error_leaves_the_picture(drawing):
    """It is told once, and the next change is drawn."""
    page = Page(drawing).connect()
    page.settled()
    count = len(page.got)
    drawing.document.change(settings=clfur.Settings(scattering="grid"))   # which this look cannot
    until(lambda: any("error" in line for line in page.lines))
    time.sleep(3 * REST)
    assert len(page.got) == count and sum("error" in line for line in page.lines) == 1
    assert "Chiang" in next(line["error"] for line in page.lines if "error" in line)
    drawing.document.change(settings=clfur.Settings(samples=1))
    until(lambda: page.last["settings"].startswith("1 sample, cov") and page.last["final"])


def test_windows_have_cameras_of_their_own(drawing):
    one, other = Page(drawing).connect(), Page(drawing).connect()
    one.settled(), other.settled()
    seen = other.last["orbit"]
    one.tell(n=2, turn=[0.2, 0.1])
    one.settled()
    assert one.last["orbit"]["azimuth"] != seen["azimuth"] and other.last["orbit"] == seen
    drawing.document.change(scene=attrs.evolve(drawing.document.scene, body_color=(0.1, 0.5, 0.1)))
    until(lambda: all(page.last["final"] and len(page.got) > 3 for page in (one, other)))
    drawing.disconnect(one.window, one.link)
    again = Page(drawing).connect(before=one.window.key)   # loaded anew
    again.settled()
    assert again.last["orbit"] == one.last["orbit"] and one.window.key not in drawing.windows
    third = Page(drawing).connect(before=other.window.key)   # a copy of one that is there
    third.settled()
    assert third.last["orbit"] == other.last["orbit"] and other.window.key in drawing.windows


def test_a_final_picture_is_given_up_for_who_moves(device, monkeypatch):
    """In its own window or in another one; who rests gets it later."""
    held, stopped = threading.Event(), []

    def slow(scene, devices, settings, stop):
        if settings == clfur.Settings(samples=16):
            held.set()
            until(stop, 60)
            stopped.append(settings)
            raise clfur.Stopped("by a test")
        return clfur.draw(scene, devices, settings, stop=stop)
    monkeypatch.setattr("clfur.viewer.drawing.draw", slow)
    drawing = Drawing(Document(fur(), clfur.Settings(samples=16)), [device])
    drawing.start()
    page, other = Page(drawing).connect(), Page(drawing)
    for n, mover in enumerate((page, other.connect(), page), 2):
        assert held.wait(20)
        held.clear()
        count, there = len(stopped), len(mover.got)
        mover.tell(n=n, turn=[0.1, 0])
        until(lambda: len(stopped) > count and len(mover.got) > there)
        assert not mover.last["final"] and mover.last["gesture"] == n
    drawing.document.change(settings=clfur.Settings(samples=4))
    page.settled(), other.settled()
    assert drawing.close(60)


@pytest.mark.parametrize("message", [{"turn": [1]}, {"turn": 3}, {"pan": ["a", 0]}, {"zoom": float("nan")},
                                     {"zoom": 1e9}, {"size": [0]}, {"size": "ab"}, {"n": None}])
def test_what_no_page_tells_changes_nothing(message):
    window = Window("0", fur())
    before = window.orbit
    with pytest.raises(clfur.Error):
        window.takes(message, fur())
    assert window.orbit == before


def test_sizes_of_windows():
    window = Window("0", fur())
    for given, size in [((640, 480), (640, 480)), ((0.2, 7), (1, 7)), ((10_000, 100), (10_000, 100))]:
        window.takes({"size": given}, fur())
        assert window.orbit.size == size
    window.takes({"size": (8000, 4000)}, fur())
    width, height = window.orbit.size
    assert width == pytest.approx(2 * height, abs=2) and 0.99 * PIXELS < width * height <= PIXELS


def test_another_scene_is_seen_from_its_own_camera(drawing):
    page = Page(drawing).connect(turn=[0.3, 0])
    page.settled()
    drawing.document.change(scene=attrs.evolve(drawing.document.scene, camera=clfur.Camera(eye=(0, 0, 7))))
    until(lambda: page.last["orbit"]["distance"] == 7 and page.last["final"])
    assert page.last["orbit"]["size"] == (48, 36)
    page.tell(n=3, turn=[0.1, 0.1], zoom=3)
    page.settled()
    page.tell(n=4, home=True)
    page.settled()
    assert page.last["orbit"]["distance"] == 7 and page.last["orbit"]["azimuth"] == 0
