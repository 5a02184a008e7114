"""`python -m benchmarks.pictures [NAME ...]` (`make pictures`): the pictures of the documentation, made anew.

Pages are those of real runs of OP3 on mock servos in headless Chromium, `terminal.svg` has what such a run prints, and
bodies are drawn as in a report. The performer of `web://` is rendered, and tracked by what is known of it: the real
body tracker would take the processor that draws the page. `wiring.svg` is drawn by hand.
"""

import base64
import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import cache, partial
from io import BytesIO
from pathlib import Path
from subprocess import DEVNULL, PIPE, STDOUT, Popen, run
from tempfile import mkdtemp
from typing import Any

import numpy as np
from PIL import Image

from benchmarks.docs_diagrams import axes, observer, shapes, terminal
from benchmarks.table import ROOT

IMAGES = ROOT / "docs" / "images"
SIZE, SHARPNESS = (960, 600), 4.0 / 3.0
"""Of a page's window, and pixels to one of its own: letters can be read where a picture is 720 pixels wide."""
QUALITY, MOST_BYTES = 82, 1_200_000
"""Of WebP in percent, and bytes of all pictures together."""
FLAGS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--use-fake-ui-for-media-stream")
ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+/\S+/")
WAIT_MS = 120_000
"""For a state of a run, at most."""
FOLDER = Path(mkdtemp(prefix="pictures-"))


# Runs, as they are typed.


def retarget(*words: str) -> str:
    """What a command prints. Its files are in FOLDER."""
    command = [sys.executable, "-P", "-m", "retarget", *words]
    done = run(command, cwd=FOLDER, env=environment(), stdout=PIPE, stderr=STDOUT, text=True, check=True)
    return done.stdout


def environment() -> dict[str, str]:
    """Of a command: this checkout's code."""
    return os.environ | {"PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1", "COLUMNS": "100"}


@cache
def recorded() -> tuple[str, str]:
    """The run that pages and terminal show: its command without the first word, and what it prints."""
    line = "run --robot op3 --source sample --report report --save run.npz"
    return line, retarget(*line.split())


@contextmanager
def served(*words: str, by: tuple[str, ...] = ("-m", "retarget")) -> Iterator[str]:
    """The address that a command prints while it runs."""
    command = [sys.executable, "-P", *by, *words]
    with Popen(command, cwd=FOLDER, env=environment(), stdin=DEVNULL, stdout=PIPE, stderr=STDOUT, text=True) as process:
        try:
            yield next(found.group() for line in process.stdout or () if (found := ADDRESS.search(line)))
        finally:
            process.terminate()
            with suppress(OSError):
                shutil.copyfileobj(process.stdout, sys.stderr if process.wait() > 1 else StringSink())  # type: ignore


# Pages.


@contextmanager
def page(size: tuple[int, int] = SIZE, script: str = "", **options: Any) -> Iterator[Any]:
    """A page of a browser. script: runs in it first."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=FLAGS)
        options = {"device_scale_factor": SHARPNESS, "color_scheme": "light"} | options
        opened = browser.new_page(viewport={"width": size[0], "height": size[1]}, **options)
        opened.set_default_timeout(WAIT_MS)
        opened.add_init_script(script)
        yield opened
        browser.close()
