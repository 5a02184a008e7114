"""Pictures through the real body tracker in a headless browser: frames of landmarks as the page of `web://` sends them.

The pictures go in one by one with the times they were drawn for, so nothing depends on how fast the machine is.
"""

import base64
import gzip
import io
import json
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from PIL import Image as Picture

from rendered import HEIGHT, RATE, WIDTH, Image

PAGE = """<!doctype html><script type="module">
import {FilesetResolver, PoseLandmarker} from '/runtime/vision_bundle.mjs';
const files = await FilesetResolver.forVisionTasks('/runtime/wasm');
const model = {modelAssetPath: '/runtime/pose_landmarker_lite.task', delegate: 'CPU'};
const make = () => PoseLandmarker.createFromOptions(files, {baseOptions: model, runningMode: 'VIDEO', numPoses: 2});
let tracker = null;
window.begin = async () => { tracker?.close(); tracker = await make(); };
window.look = async (jpeg, ms) => {
  const picture = await createImageBitmap(await (await fetch('data:image/jpeg;base64,' + jpeg)).blob());
  const found = tracker.detectForVideo(picture, ms);
  if (found.landmarks.length > 1) return null;
  const round = number => Math.round(number * 1e4) / 1e4;
  return (found.landmarks[0] ?? []).map((at, i) => { const world = found.worldLandmarks[0][i];
    return [at.x, at.y, world.x, world.y, world.z, at.visibility].map(round); });
};
window.ready = true;
</script>"""
"""No part of the page of `web://`: it feeds pictures to the tracker and gives back what the page would send."""


@contextmanager
def tracker(runtime: Path) -> Iterator[Any]:
    """A page with the body tracker; skips the test without a browser. runtime: see `retarget.web.runtime`."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install playwright")
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        pytest.skip("Chromium is not installed: apt install chromium")
    with api.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=found, args=["--no-sandbox"])
        page = browser.new_page()

        def serve(route: Any) -> None:
            name = route.request.url.partition("/runtime/")[2]
            kind = {"mjs": "text/javascript", "js": "text/javascript", "wasm": "application/wasm"}
            if name:
                body, content = (
                    (runtime / name).read_bytes(),
                    kind.get(name.rpartition(".")[2], "application/octet-stream"),
                )
            else:
                body, content = PAGE.encode(), "text/html"
            route.fulfill(body=body, content_type=content)

        page.route("http://localhost/**", serve)
        page.goto("http://localhost/")
        page.wait_for_function("window.ready")
        yield page
        browser.close()


def seen(page: Any, pictures: Iterable[Image], *, rate: float = RATE, start: float = 1.0) -> list[dict[str, Any]]:
    """The frames of a camera that sees these pictures, as the page sends them, from `start` s on."""
    page.evaluate("begin()")
    frames = []
    for number, picture in enumerate(pictures):
        time, jpeg = start + number / rate, io.BytesIO()
        Picture.fromarray(picture).save(jpeg, "JPEG", quality=90)
        points = page.evaluate(
            "([jpeg, ms]) => look(jpeg, ms)", [base64.b64encode(jpeg.getvalue()).decode(), 1e3 * time]
        )
        if points is not None:
            head = {"axes": "camera", "time": round(time, 4), "frame": number, "size": [WIDTH, HEIGHT]}
            frames.append(head | {"landmarks": points})
    return frames


def write_frames(path: Path, frames: list[dict[str, Any]]) -> None:
    """One frame a line, packed; the same frames give the same bytes."""
    lines = "".join(json.dumps(frame, separators=(",", ":")) + "\n" for frame in frames)
    path.write_bytes(gzip.compress(lines.encode(), mtime=0))


def read_frames(path: Path) -> list[bytes]:
    """The datagrams of a recording."""
    return gzip.decompress(path.read_bytes()).splitlines()
