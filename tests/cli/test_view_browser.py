"""The pages of `retarget view` and `--view` in a real browser: they draw, the timeline moves, STOP stops at once.

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
from contextlib import contextmanager
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


def sides(page: Any, canvas: str, folder: Path) -> tuple[int, int]:
    """Pixels of a canvas that are orange, as the left side of a body is, and blue, as its right side."""
    from matplotlib.image import imread

    path = folder / "canvas.png"
    page.locator(canvas).screenshot(path=path, timeout=120000)
    red, green, blue = np.moveaxis(imread(path)[..., :3], -1, 0)
    orange = (red > 1.5 * green) & (green > 2.0 * blue) & (red > 0.4)
    return int(orange.sum()), int(((blue > 1.3 * green) & (green > 2.0 * red) & (blue > 0.3)).sum())


def seconds(page: Any) -> float:
    return float(page.inner_text("#clock").removesuffix(" s"))


def plotted(page: Any) -> int:
    """Points of the plot that are drawn on."""
    count: int = page.evaluate(
        """() => { const canvas = document.querySelector('#joint canvas');
        const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
        return data.filter((value, i) => i % 4 === 3 && value > 100).length; }"""
    )
    return count


@contextmanager
def opened(browser: Any, *words: str | Path) -> Iterator[Any]:
    """The page of a command; at the end it had no error and asked no other host for anything."""
    process, address = started(*words)
    try:
        page, wrong, hosts = browser.new_page(viewport={"width": 900, "height": 800}), list[str](), set[str]()
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("console", lambda line: wrong.append(line.text) if line.type == "error" else None)
        page.on("request", lambda request: hosts.add(request.url.split("/")[2]))
        page.goto(address)
        yield page
        page.close()
        assert not wrong and hosts == {address.split("/")[2]}
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(timeout=20.0)


def test_a_recording_is_drawn_and_played(browser: Any, tmp_path: Path) -> None:
    with opened(browser, "view", saved_run(tmp_path / "run.npz", robot="op3"), "--port", "0") as page:
        page.wait_for_function("() => /Approaching|Following|Stopping/i.test(doing.textContent)")
        before = seconds(page)
        page.wait_for_function("(before) => clock.textContent !== `${before.toFixed(2)} s`", arg=before)
        page.click("#play")
        for canvas in ("#view-performer", "#view-robot"):
            orange, blue = sides(page, canvas, tmp_path)
            assert orange > 300 and blue > 300, canvas
        still = seconds(page)
        for _ in range(3):
            page.click(".step[value='1']")
        assert 0.01 < seconds(page) - still < 0.04, "tick by tick"
        for _ in range(3):
            page.click(".step[value='-1']")
        assert seconds(page) == still
        assert plotted(page) > 500
        page.select_option("#joint select >> nth=0", label="l_knee")
        page.locator("#layers label", has_text="desired").locator("input").uncheck()
        assert page.eval_on_selector_all("#speed option", "all => all.map((one) => one.value)") == [
            *("0.1", "0.25", "0.5", "1", "2", "4")
        ]


def test_the_page_saves_what_it_shows_as_a_video(browser: Any, tmp_path: Path) -> None:
    with opened(browser, "view", saved_run(tmp_path / "run.npz", robot="op3"), "--port", "0") as page:
        with page.expect_download(timeout=120000) as saved:
            page.select_option("#speed", "0.1")
            page.click("#film")
        assert saved.value.suggested_filename in ("op3-run.mp4", "op3-run.webm")
        saved.value.save_as(tmp_path / "film")
        assert (tmp_path / "film").stat().st_size > 5000


def test_a_run_that_goes_on_is_drawn(browser: Any, tmp_path: Path) -> None:
    words = ("run", "--robot", "op3", "--source", "sample", "--loop", "--scene", "table", "--view", "0")
    with opened(browser, *words) as page:
        page.wait_for_function("() => /^(Approaching|Following)$/.test(state.textContent)", timeout=60000)
        page.wait_for_function("() => joint.querySelector('canvas').width > 300 && !joint.hidden", timeout=60000)
        for canvas in ("#human", "#robot"):
            orange, blue = sides(page, canvas, tmp_path)
            assert orange > 300 and blue > 300, canvas
        assert "obstacle" in page.inner_text("#layers") and page.locator("#stop").is_visible()
        assert not page.locator("#pause").is_visible(), "it can only stop"
        assert "✓" in page.inner_text("#sensors")


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
        page.wait_for_function("() => state.textContent === 'Following'", timeout=120000)
        page.evaluate("() => addEventListener('pointerdown', () => { window.pressed = Date.now() / 1000; }, true)")
        page.click("#stop", timeout=60000, force=True)
        pressed = page.evaluate("() => window.pressed")
        assert process.wait(timeout=60.0) == STOPPED
        reader.join(timeout=10.0)
        assert any("stopped on the web page" in line for line in lines), lines
        stopped = next(float(line.rsplit(" ", 1)[1]) for line in lines if line.startswith(STAMP))
        assert 0.0 < stopped - pressed < STOPPED_WITHIN_S, f"{stopped - pressed:.3f} s"
    finally:
        process.kill()
