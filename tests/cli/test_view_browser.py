"""The page in a real browser: it draws, its timeline moves, its button stops a robot at once, no other page gets in.

Without a graphics card the browser draws on the processor, and takes all there is of it. So its window is small where
time is measured, and it leaves out the painting itself; the run keeps virtual time, which a slow machine cannot hurt.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recordings import STAMP, saved_run
from retarget.cli.exit import STOPPED

pytestmark = pytest.mark.long

ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+/\S+/")
STOPPED_WITHIN_S = 0.1
QUIET = 'echo {niceness} 2>/dev/null >/proc/self/autogroup; exec "$@"'
"""At a higher priority, where that is allowed: a session has a niceness of its own (autogroups)."""
RUN_NICENESS, BROWSER_NICENESS = -15, -10
PANEL = 330
"""Its width, pixels."""
UNPAINTED = """for (const kind of [WebGLRenderingContext, WebGL2RenderingContext])
    for (const name of ['drawElements', 'drawArrays', 'drawRangeElements',
            'drawElementsInstanced', 'drawArraysInstanced'])
        if (kind.prototype[name]) kind.prototype[name] = () => {};"""
"""Leaves out of a page what a graphics card would do; all else of it is as ever."""
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        pytest.skip("Chromium is not installed: apt install chromium")
    slow = tmp_path_factory.mktemp("browser") / "chromium"
    slow.write_text(f'#!/bin/sh\nset -- {found} "$@"\n{QUIET.format(niceness=BROWSER_NICENESS)}\n')
    slow.chmod(0o755)
    with api.sync_playwright() as driver:
        opened = driver.chromium.launch(
            executable_path=slow, args=["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
        )
        yield opened
        opened.close()


def started(*words: str | Path, by: tuple[str, ...] = ("-m", "retarget")) -> tuple["subprocess.Popen[str]", str]:
    """A command, and the address that it prints."""
    process = subprocess.Popen(
        ["sh", "-c", QUIET.format(niceness=RUN_NICENESS), "sh", sys.executable, *by, *map(str, words)],
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"PYTHONUNBUFFERED": "1", "PYTHONPATH": str(ROOT)},
    )
    assert process.stdout is not None
    for line in process.stdout:
        found = ADDRESS.search(line)
        if found:
            return process, found.group()
    raise AssertionError("no address was printed")


def drawn(page: Any, folder: Path) -> int:
    """How many colours a picture of the scene has: of an empty one few."""
    from matplotlib.image import imread

    path, width = folder / "scene.png", page.viewport_size["width"] - PANEL
    page.screenshot(path=path, timeout=120000)
    return len(np.unique((imread(path)[:, :width, :3] * 15).astype(int).reshape(-1, 3), axis=0))


def test_a_recording_is_drawn_and_played(browser: Any, tmp_path: Path) -> None:
    process, address = started("view", saved_run(tmp_path / "run.npz", robot="op3"), "--port", "0")
    try:
        page = browser.new_page(viewport={"width": 700, "height": 400})
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(address)
        page.get_by_text(re.compile("APPROACHING|FOLLOWING|STOPPING")).wait_for(timeout=60000)
        page.get_by_text("play / pause").wait_for()
        page.wait_for_timeout(3000)
        assert drawn(page, tmp_path) > 100
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
        page.close()
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(timeout=20.0)


def test_the_button_stops_the_emulated_servos_in_a_tenth_of_a_second(browser: Any, shared: Path) -> None:
    """From the moment in which the page feels the press to the first stopping goal on the bus, by the wall clock."""
    source = shared / "mocap" / "cmu_asfamc" / "02_06.amc"
    words = ("run", "--robot", "op3", "--source", source, "--bus", "emulator", "--loop", "--view", "0")
    process, address = started(*words, by=(str(ROOT / "tests/support/recordings.py"),))
    lines: list[str] = []
    reader = threading.Thread(target=lambda: lines.extend(process.stdout or ()))
    reader.start()
    try:
        page = browser.new_page(viewport={"width": 420, "height": 320})
        page.add_init_script(UNPAINTED)
        page.goto(address)
        page.get_by_text("FOLLOWING").wait_for(timeout=120000)
        page.evaluate("() => addEventListener('pointerdown', () => { window.pressed = Date.now() / 1000; }, true)")
        page.get_by_text("STOP THE ROBOT").click(timeout=60000, force=True)
        pressed = page.evaluate("() => window.pressed")
        assert process.wait(timeout=60.0) == STOPPED
        reader.join(timeout=10.0)
        assert any("end" in line and "stopped on the web page" in line for line in lines), lines
        stopped = next(float(line.rsplit(" ", 1)[1]) for line in lines if line.startswith(STAMP))
        assert 0.0 < stopped - pressed < STOPPED_WITHIN_S, f"{stopped - pressed:.3f} s"
    finally:
        process.kill()
