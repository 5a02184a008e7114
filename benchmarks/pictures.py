"""`python -m benchmarks.pictures [NAME ...]` (`make pictures`): the pictures of the documentation, made anew.

Pages are those of real runs of OP3 on mock servos in headless Chromium, `terminal.svg` has what such a run prints, and
bodies are drawn as in a report. The performer of `web://` is rendered, and its landmarks are those that are known: the
real body tracker and a browser without a graphics card are too much for two cores. `wiring.svg` is drawn by hand.
Look at `live-page.webp` afterwards: it is of a run in real time, which lags on a busy machine.
"""

import base64
import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from subprocess import DEVNULL, PIPE, STDOUT, Popen, run
from tempfile import mkdtemp
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent / "tests/support"))
import numpy as np
from PIL import Image, ImageEnhance

import rendered
from benchmarks.drawings import axes, imported, observer, terminal
from benchmarks.table import ROOT
from camera_people import landmarks
from hardware.clock import MonotonicClock, VirtualClock
from page_stand_in import StandIn, running
from retarget.run.options import RunOptions
from retarget.run.prepare import prepare
from retarget.run.table import RunTable
from retarget.sources.open import open_source
from retarget.web.shown import Cast, live_tracks
from sim.mock_bus import mock_bus

IMAGES = ROOT / "docs" / "images"
SIZE, SHARPNESS = (960, 600), 4.0 / 3.0
"""Of a page's window, and pixels to one of its own: letters can be read where a picture is 720 pixels wide."""
REPORT_SIZE, VIEW_SIZE, LIVE_SIZE = (960, 1150), (960, 868), (960, 655)
"""With the verdict above the motion, with the plot of a joint, and with the legend."""
QUALITY, MOST_BYTES = 80, 1_200_000
"""Of WebP in percent, and bytes of all pictures together."""
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--use-fake-ui-for-media-stream")
ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+/\S+/")
WAIT_MS = 120_000
"""For a state of a run, at most."""


# Runs, as they are typed.


def retarget(*words: str) -> str:
    """What a command prints. Its files are in `folder`."""
    command = [sys.executable, "-P", "-m", "retarget", *words]
    done = run(command, cwd=folder(), env=environment(), stdout=PIPE, stderr=STDOUT, text=True, check=True)
    return done.stdout


@cache
def folder() -> Path:
    """Where runs write."""
    return Path(mkdtemp(prefix="pictures-"))


def environment() -> dict[str, str]:
    """Of a command: this checkout's code."""
    return os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1", "COLUMNS": "200"}


@cache
def recorded() -> tuple[str, str]:
    """The run that pages and terminal show: its command, and what it prints."""
    line = "run --robot op3 --source sample --report report --save run.npz"
    return line, retarget(*line.split())


@contextmanager
def served(*words: str) -> Iterator[str]:
    """The address that a command prints; it runs as long."""
    command = [sys.executable, "-P", "-m", "retarget", *words]
    with Popen(command, cwd=folder(), env=environment(), stdin=DEVNULL, stdout=PIPE, stderr=STDOUT) as process:
        assert process.stdout is not None
        try:
            yield next(found.group() for line in process.stdout if (found := ADDRESS.search(line.decode())))
        finally:
            process.terminate()
            process.communicate()


# Pages.


@contextmanager
def browser() -> Iterator[Any]:
    """A headless Chromium."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    with sync_playwright() as driver:
        opened = driver.chromium.launch(executable_path=chromium, args=FLAGS)
        yield opened
        opened.close()


def page(opened: Any, address: str, size: tuple[int, int] = SIZE) -> Any:
    """A page of a browser."""
    window = {"width": size[0], "height": size[1]}
    found = opened.new_page(viewport=window, device_scale_factor=SHARPNESS, color_scheme="light")
    found.set_default_timeout(WAIT_MS)
    found.goto(address)
    return found


def shot(found: Any) -> Image.Image:
    """What a page shows."""
    return Image.open(BytesIO(found.screenshot(timeout=WAIT_MS))).convert("RGB")


PLAYED = """([time, top]) => { const bar = document.getElementById('scrub');
    const times = JSON.parse(document.getElementById('motion').textContent).time;
    bar.value = times.findIndex((one) => one >= 1000 * time);
    bar.dispatchEvent(new Event('input'));
    document.querySelector(top).scrollIntoView(); }"""
"""Moves the timeline of a player to a time, s, and the window to an element."""
WAVES_S = 2.3
"""A moment of the sample at which the performer waves."""


def played(found: Any, *, top: str) -> Image.Image:
    """A player at WAVES_S. top: the element that the picture begins with."""
    found.wait_for_function("() => document.getElementById('clock').textContent")
    if "Pause" in found.inner_text("#play"):
        found.click("#play")
    found.evaluate(PLAYED, [WAVES_S, top])
    found.wait_for_timeout(1000.0)
    return shot(found)


def report_page() -> Image.Image:
    """The page of a run."""
    recorded()
    with browser() as opened:
        return played(page(opened, (folder() / "report" / "report.html").as_uri(), REPORT_SIZE), top="header")


def view_page() -> Image.Image:
    """`retarget view` of its recording."""
    recorded()
    with served("view", "run.npz", "--port", "0") as address, browser() as opened:
        found = page(opened, address, VIEW_SIZE)
        found.wait_for_selector("#joint select")
        found.select_option("#joint select >> nth=0", label="r_el")
        return played(found, top="#player")


FOLLOWS = "() => document.getElementById('state').textContent === 'Following'"
CYCLE_S, RAISED_S = 12.0, 10.3
"""Of the performer of `examples/send_poses.py`, and when in it the right arm is up."""


def live_page() -> Image.Image:
    """The page of a live run, whose performer raises an arm."""
    sender = [sys.executable, str(ROOT / "examples" / "send_poses.py")]
    words = ("run", "--robot", "op3", "--source", "json://:14150", "--yes", "--view", "0")
    clock = MonotonicClock()
    began = clock.now()
    with Popen(sender) as process, served(*words) as address, browser() as opened:
        found = page(opened, address, LIVE_SIZE)
        found.wait_for_function(FOLLOWS)
        found.wait_for_timeout(3000.0)
        found.wait_for_timeout(1e3 * ((RAISED_S - (clock.now() - began)) % CYCLE_S))
        made = shot(found)
        process.terminate()
    return made


# The page that a performer sees: its camera has one picture, and its tracker knows who is in it.

AWAY_M, BRIGHTER = 2.5, 1.2
"""From the camera, and how much lighter than the renderer a camera makes the room."""
CAMERA = """const picture = Object.assign(new Image(), { src: PICTURE });
const canvas = Object.assign(document.createElement('canvas'), { width: 640, height: 480 });
const draw = () => canvas.getContext('2d').drawImage(picture, 0, 0);
navigator.mediaDevices.getUserMedia = async () => { setInterval(draw, 50); return canvas.captureStream(); };"""
TRACKER = """const points = POINTS;
const landmarks = [points.map(([x, y, , , , visibility]) => ({ x, y, z: 0, visibility }))];
const worldLandmarks = [points.map(([, , x, y, z, visibility]) => ({ x, y, z, visibility }))];
const found = () => ({ landmarks, worldLandmarks });
export const FilesetResolver = { forVisionTasks: async (base) => ({ wasmLoaderPath: `${base}/loader.js` }) };
export const PoseLandmarker = { createFromOptions: async () => ({ detectForVideo: found, detect: found }) };"""


def web_page() -> Image.Image:
    """The page of `web://` at WAVES_S of the sample, as its server has it from a run."""
    with prepare(
        partial(open_source, "sample"), RunOptions(robot="op3"), clock=VirtualClock(), make_bus=mock_bus
    ) as prepared:
        made = prepared.run()
    record, robot = made.record, made.robot
    assert robot is not None
    tick = int(np.searchsorted(record.time, WAVES_S))
    motion = rendered.planted(made.human, record.human_q[[tick]])
    names = tuple(robot.profile.landmarks)
    cast = Cast(
        human=made.human.solid, robot=robot.solid, profile=robot, joints=robot.joint_map.joints, landmarks=names
    )
    known = {name: record.known[name][tick] for name in ("q", "human_q", "present", "landmarks_asked", "sensors")}
    stand_in = StandIn(
        files={
            "runtime/vision_bundle.mjs": TRACKER.replace(
                "POINTS", json.dumps(landmarks(motion, distance=AWAY_M)[0].tolist())
            ).encode(),
            "runtime/wasm/loader.js": b"export default 0;",
        },
        state={"state": "following", "why": "", "sensors": dict.fromkeys(made.sensors, True)},
        scene=json.loads(json.dumps(cast.as_json())),
        tracks=live_tracks(cast, RunTable(time=record.time[tick], **known)),
    )
    with running(stand_in), browser() as opened:
        found = page(opened, stand_in.address)
        found.evaluate(CAMERA.replace("PICTURE", json.dumps(_jpeg(next(rendered.drawn(motion, distance=AWAY_M))))))
        found.click("[data-input=camera]:enabled")
        found.wait_for_function(FOLLOWS)
        found.wait_for_function("() => human.width > 100 && overlay.width > 100")
        # How fast its pictures come is no matter of a browser without a graphics card.
        found.evaluate("() => { trouble.style.display = numbers.style.display = 'none'; }")
        found.wait_for_timeout(4000.0)
        return shot(found)


def _jpeg(picture: rendered.Image) -> str:
    made = BytesIO()
    ImageEnhance.Brightness(Image.fromarray(picture)).enhance(BRIGHTER).save(made, "JPEG", quality=90)
    return f"data:image/jpeg;base64,{base64.b64encode(made.getvalue()).decode()}"


# All of them.

DRAWN: dict[str, Callable[[], Image.Image | bytes]] = {
    "terminal.svg": lambda: terminal(dict([recorded()])),
    "axes.svg": axes,
    "import.webp": imported,
    "observer.webp": observer,
    "report-page.webp": report_page,
    "view-page.webp": view_page,
    "live-page.webp": live_page,
    "web-page.webp": web_page,
}
BY_HAND = ("wiring.svg",)


def pictures() -> list[Path]:
    """Paths of all pictures that a page of the documentation shows and that MOST_BYTES counts."""
    return [IMAGES / name for name in (*DRAWN, *BY_HAND)]


def main(*names: str) -> None:
    """Write the pictures of these names, all without one. Raises SystemExit where they are too large together."""
    for name in names or DRAWN:
        made = DRAWN[name]()
        path = IMAGES / name
        if isinstance(made, bytes):
            path.write_bytes(made)
        else:
            made.save(path, quality=QUALITY, method=6)
        print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1e3:.0f} kB")
    shutil.rmtree(folder())
    total = sum(path.stat().st_size for path in pictures() if path.exists())
    if total > MOST_BYTES:
        raise SystemExit(f"the pictures have {total} bytes, allowed: {MOST_BYTES}")


if __name__ == "__main__":
    main(*sys.argv[1:])
