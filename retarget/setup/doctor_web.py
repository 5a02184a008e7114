"""The doctor serves the page of `web://`, waits for a performer, and reports on the browser and on what it sends."""

from collections.abc import Callable
from contextlib import closing
from typing import Any

import numpy as np

from hardware.clock import Clock
from retarget.live.address import StreamAddress
from retarget.live.open_stream import open_stream, stream_kinds
from retarget.schema.performer import Performer
from retarget.setup.doctor_machine import Finding, finding, findings
from retarget.setup.doctor_sensors import capture_stream
from retarget.setup.doctor_stream import judge, named_for
from retarget.web.link import PoseReceiver
from retarget.web.runtime import runtime_folder

PATIENCE_S = 120.0
"""So long a performer may take to open the page and choose an input, s."""
LOOK_S = 0.05
"""Time between two looks, s."""


def web_findings(
    address: StreamAddress,
    performer: Performer,
    receiver: PoseReceiver,
    heard: Callable[[], list[dict[str, Any]]],
    *,
    clock: Clock,
    seconds: float,
) -> list[Finding]:
    """Findings on the page, the browser and the poses, after a performer was there for `seconds`. heard: what browsers
    have said of themselves so far."""
    found = findings("page/runtime", installed=runtime_folder() is not None)
    convention = stream_kinds()["web"].roles
    stream = open_stream(address, named_for(performer, convention), receiver=receiver)
    with closing(receiver):
        end = clock.now() + PATIENCE_S
        while not heard() and clock.now() < end:
            clock.sleep_until(clock.now() + LOOK_S)
        capture = capture_stream(stream, clock=clock, seconds=seconds)
    said = heard()
    if not said:
        return [*found, finding("page/no performer", seconds=PATIENCE_S)]
    return found + page_findings(said) + judge(address, performer, convention, capture, kind="web")


def page_findings(said: list[dict[str, Any]]) -> list[Finding]:
    """Findings on what a performer's page said of itself, oldest first."""
    last = said[-1]
    facts = {key: _median(said, key) for key in ("fps", "infer_ms", "rtt_ms", "send_ms")}
    facts |= {key: int(last.get(key) is True) for key in ("secure", "wasm")}
    texts = {key: str(last.get(key) or "not said")[:60] for key in ("agent", "camera", "permission")}
    names = ["browser", "browser/secure", "browser/wasm", "camera/permission"]
    names += [f"camera/{key}" for key in ("fps", "infer_ms") if np.isfinite(facts[key])]
    names += ["network/latency"] if np.isfinite(facts["rtt_ms"]) else []
    found = findings(*names, granted=int(last.get("permission") != "denied"), **facts, **texts)
    if trouble := str(last.get("trouble") or "")[:200]:
        found.append(finding("page/trouble", trouble=trouble))
    return found


def _median(said: list[dict[str, Any]], key: str) -> float:
    """The median of a number that a page said again and again; NaN where it never did."""
    values = [one[key] for one in said if isinstance(one.get(key), int | float)]
    return float(np.median(values)) if values else float("nan")
