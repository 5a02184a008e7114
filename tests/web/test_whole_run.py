"""Whole runs over `web://` in real time, as a user starts them: poses of a page, and a camera in a real browser."""

import json
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen
from typing import Any
from urllib.parse import urlsplit

import pytest

from hardware.clock import MonotonicClock
from retarget.web.runtime import runtime_folder

client = pytest.importorskip("websockets.sync.client", reason="the extra web is not installed")
from websockets.exceptions import ConnectionClosed  # noqa: E402  (where it is installed)

sys.path.append(str(Path(__file__).resolve().parents[2] / "examples"))
import send_poses  # type: ignore[import-not-found]  # noqa: E402  (an example of the repository, which is no package)

pytestmark = [pytest.mark.long, pytest.mark.timeout(300)]
FLAGS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-sync"]
FLAGS += ["--disable-component-update", "--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream"]


@contextmanager
def run(folder: Path, *options: str) -> Iterator[tuple[Popen[str], str]]:
    """`retarget run --robot op3 --source web://` with a report in a folder, and the address that it prints."""
    command = [sys.executable, "-m", "retarget", "run", "--robot", "op3", "--source", "web://:8890", *options]
    with Popen([*command, "--report", str(folder / "run.json")], stdin=DEVNULL, stderr=PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            line = next(line for line in process.stderr if line.startswith("Open "))
            yield process, line.split()[1]
        finally:
            process.terminate()


def test_poses_of_a_page_move_a_robot(tmp_path: Path) -> None:
    """What `examples/send_poses.py` sends, on the page's socket instead of UDP."""
    clock = MonotonicClock()
    with run(tmp_path, "--countdown", "1", "--end", "4") as (process, address):
        where = urlsplit(address)
        with client.connect(f"ws://{where.netloc}{where.path}ws", origin=f"http://{where.netloc}") as page:
            page.send(json.dumps({"type": "hello", "input": "headset", "id": "test"}))
            begin = clock.now()
            with suppress(ConnectionClosed):  # the run is over
                for number in range(60 * send_poses.RATE_HZ):
                    if process.poll() is not None:
                        break
                    page.send(send_poses.message(number).decode())
                    clock.sleep_until(begin + (number + 1) / send_poses.RATE_HZ)
        process.wait(60)
    report = json.loads((tmp_path / "run.json").read_text())
    assert process.returncode == 0 and report["live"]["address"] == "web://:8890"
    assert report["live"]["frames"] > 300 and report["live"]["latency_ms"]["goal"]["p50"] < 100.0
    assert report["tracking_mm"]["l_hand"]["p95"] < 150.0


def performance(folder: Path) -> Path:
    """A film of a performer who stands, raises the left arm to the front, waves and crouches."""
    rendered = pytest.importorskip("rendered")
    import numpy as np

    person = rendered.performer(1.75)
    parts = [
        rendered.standing(person, 9.0),
        rendered.raising(person, "l", seconds=7.0, swing=60.0),
        rendered.waving(person),
        rendered.crouching(person),
    ]
    every = 2  # each picture twice: 15 a second are drawn
    motion = rendered.Motion(
        person, np.concatenate([part.q for part in parts])[::every], np.concatenate([part.joints for part in parts])
    )
    path = folder / "film.mjpeg"
    rendered.write_video(path, (picture for picture in rendered.drawn(motion) for _ in range(every)))
    return path


def test_a_camera_moves_a_robot(tmp_path: Path) -> None:
    """A rendered performer before the fake camera of a real browser: landmarks, calibration, sides, and the robot."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None or shutil.which("ffmpeg") is None:
        pytest.skip("Chromium or ffmpeg is not installed: apt install chromium ffmpeg")
    if runtime_folder() is None:
        pytest.skip("what finds a body in a picture is not installed: retarget web install")
    film = f"--use-file-for-fake-video-capture={performance(tmp_path)}"
    with run(tmp_path, "--end", "12") as (process, address), api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=[*FLAGS, film])
        page: Any = browser.new_page(viewport={"width": 1280, "height": 800})
        hosts, sent = set[str](), list[str]()
        page.on("request", lambda request: hosts.add(urlsplit(request.url).netloc))
        page.on("websocket", lambda socket: socket.on("framesent", lambda text: sent.append(text)))
        page.goto(address)
        page.click("[data-input=camera]")
        page.wait_for_function("() => document.getElementById('state').textContent === 'Ended'", timeout=120e3)
        browser.close()
        process.wait(60)
    report = json.loads((tmp_path / "run.json").read_text())
    assert process.returncode == 0 and hosts == {urlsplit(address).netloc}
    latency = report["live"]["latency_ms"]
    times = [json.loads(text)["time"] for text in sent if '"landmarks"' in text]
    best = max(sum(begin <= time < begin + 10.0 for time in times) for begin in times)
    assert best >= 180, "18 landmarks a second, in the best ten seconds: others use this machine, too"
    assert "page" in latency, "from picture to page"
    assert latency["network"]["p50"] + latency["goal"]["p50"] < 25.0, "from page to goal bytes"
    assert report["limit_violations"] == {"position": 0, "velocity": 0, "acceleration": 0}
    assert report["hand_path_ratio"] > 0.5, "the robot waves"
