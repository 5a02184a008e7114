"""The page in a real browser: it draws, its timeline moves, its button stops a robot at once, no other page gets in."""

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from retarget.cli.boundary import STOPPED
from saved_runs import saved_run

pytestmark = pytest.mark.long

ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+/\S+/")
STOPPED_WITHIN_S = 0.1


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        pytest.skip("Chromium is not installed: apt install chromium")
    slow = tmp_path_factory.mktemp("browser") / "chromium"  # without a graphics card it takes all there is
    slow.write_text(f'#!/bin/sh\nexec nice -n 19 {found} "$@"\n')
    slow.chmod(0o755)
    with api.sync_playwright() as driver:
        opened = driver.chromium.launch(
            executable_path=slow, args=["--no-sandbox", "--use-gl=swiftshader", "--enable-unsafe-swiftshader"]
        )
        yield opened
        opened.close()


def started(*words: str | Path) -> tuple["subprocess.Popen[str]", str]:
    """A command, and the address that it prints."""
    process = subprocess.Popen(
        [sys.executable, "-m", "retarget", *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    for line in process.stdout:
        found = ADDRESS.search(line)
        if found:
            return process, found.group()
    raise AssertionError("no address was printed")


def _read(process: "subprocess.Popen[str]", told: list[str], heard: list[float]) -> None:
    """All that is said, and when the stop was."""
    assert process.stdout is not None
    for line in process.stdout:
        told.append(line)
        if "stopped on the web page: stopping" in line:
            heard.append(datetime.now(UTC).timestamp())


def drawn(page: Any) -> int:
    """How many colours a picture of the scene has: of an empty one few."""
    import numpy as np
    from matplotlib.image import imread

    picture = page.locator("canvas").first.screenshot()
    path = Path(page.context._folder) / "scene.png"
    path.write_bytes(picture)
    return len(np.unique((imread(path)[..., :3] * 15).astype(int).reshape(-1, 3), axis=0))


def test_a_recording_is_drawn_and_played(browser: Any, tmp_path: Path) -> None:
    process, address = started("view", saved_run(tmp_path / "run.npz", robot="op3"), "--port", "0")
    try:
        page = browser.new_page(viewport={"width": 900, "height": 600})
        page.context._folder = tmp_path
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(address)
        page.get_by_text(re.compile("APPROACHING|FOLLOWING|STOPPING")).wait_for(timeout=60000)
        page.get_by_text("play / pause").wait_for()
        page.wait_for_timeout(3000)
        assert drawn(page) > 100
        shown = page.get_by_text(re.compile(r"^-?\d+\.\d\d s$"))
        before = shown.inner_text()
        page.wait_for_timeout(1500)
        assert shown.inner_text() != before, "it plays"
        page.get_by_text("play / pause").click()
        page.wait_for_timeout(500)
        still = shown.inner_text()
        page.wait_for_timeout(1000)
        assert shown.inner_text() == still, "it stands"
        for _ in range(3):
            page.get_by_text("+1", exact=True).click()
        page.wait_for_timeout(500)
        assert 0.01 < float(shown.inner_text()[:-2]) - float(still[:-2]) < 0.04
        assert not errors
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(timeout=20.0)


def test_the_button_stops_the_robot_and_another_page_cannot(browser: Any, shared: Path) -> None:
    source = shared / "mocap" / "cmu_asfamc" / "02_06.amc"
    process, address = started(
        "run", "--robot", "op3", "--source", source, "--bus", "emulator", "--loop", "--view", "0"
    )
    try:
        page = browser.new_page(viewport={"width": 500, "height": 400})
        other = browser.new_page()
        other.goto("data:text/html,<p>another page</p>")
        opened = other.evaluate(
            """address => new Promise(done => {
                const link = new WebSocket(address.replace('http', 'ws'), ['viser-v1.1.1']);
                link.onopen = () => done('open'); link.onerror = () => done('refused');
            })""",
            address,
        )
        assert opened == "refused"
        page.goto(address)
        page.get_by_text("STOP THE ROBOT").wait_for(timeout=60000)
        page.get_by_text("FOLLOWING").wait_for(timeout=60000)
        heard: list[float] = []
        told: list[str] = []
        reader = threading.Thread(target=lambda: _read(process, told, heard))
        reader.start()
        pressed = page.evaluate(
            """() => { const button = [...document.querySelectorAll('button')].find(
                one => one.innerText.includes('STOP THE ROBOT'));
                const at = Date.now(); button.click(); return at / 1000; }"""
        )
        reader.join(timeout=60.0)
        assert process.wait(timeout=10.0) == STOPPED
        assert heard and heard[0] - pressed < STOPPED_WITHIN_S, heard[0] - pressed
        assert any("end" in line and "stopped on the web page" in line for line in told)
    finally:
        process.kill()
