"""From a performer's sensors to safe goals for a servo humanoid. Public names load on first use."""

import importlib
from typing import Any

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


def _verify_siblings() -> None:
    """Raise ImportError, naming the shadow, unless Python finds the packages next to this one. Imports neither.

    `hardware` and `sim` are short names that others use too.
    """
    import importlib.util
    from pathlib import Path

    home = Path(__file__).resolve().parent.parent
    for name in ("hardware", "sim"):
        spec = importlib.util.find_spec(name)
        places = [Path(place).resolve() for place in (spec.submodule_search_locations or ())] if spec else []
        if home / name in places[:1]:
            continue
        origin = spec.origin if spec and spec.origin else ", ".join(map(str, places))
        found = f"Python finds another one at {origin}" if spec else "Python finds none"
        raise ImportError(
            f"retarget needs its own package {name!r} from {home / name}, but {found}. Install retarget in a virtual "
            f"environment of its own, and run it from a folder that holds no file or folder named {name!r}.",
            name=name,
        )


_verify_siblings()


def __getattr__(name: str) -> Any:
    """Import a public name from its home on first use (PEP 562), so that `import retarget` stays light."""
    if name not in _HOMES:
        raise AttributeError(f"module 'retarget' has no attribute {name!r}; public names: {', '.join(sorted(_HOMES))}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
