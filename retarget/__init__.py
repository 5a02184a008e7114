"""From a performer's sensors to safe goals for a servo humanoid. Public names load on first use."""

import importlib
from typing import Any

from retarget import siblings

__version__ = "0.2.0"

_HOMES = {
    "Pipeline": "retarget.pipeline",
    "RetargetError": "hardware.errors",
    "RunOptions": "retarget.run.options",
    "SensorFrames": "retarget.frames",
    "SensorSample": "retarget.frames",
    "load_performer": "retarget.schema.performer",
    "load_robot": "retarget.model.robot",
    "measure": "retarget.report.measure",
    "open_source": "retarget.sources.open",
    "read_run": "retarget.recording.read_run",
}

__all__ = ["__version__", *sorted(_HOMES)]

siblings.verify()


def __getattr__(name: str) -> Any:
    """Import a public name from its home on first use (PEP 562), so that `import retarget` stays light."""
    if name not in _HOMES:
        raise AttributeError(f"module 'retarget' has no attribute {name!r}; public names: {', '.join(sorted(_HOMES))}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
