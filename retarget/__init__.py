"""From a performer's sensors to safe goals for a servo humanoid.

In: motion files, streams, YAML. Out: checked goals, recordings, reports. Public names load on first use. Folders import
as `ARROWS` in `tests/test_house.py` says; all may import `hardware`, and `cli` alone imports `sim`.
"""

import importlib
import os
import sys

TYPE_CHECKING = False  # that of `typing`, which takes longer to import than all else here
if TYPE_CHECKING:
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
    """Raise ImportError, with the place of the other package, if Python finds another `hardware` or `sim`: short names
    that others use too. Neither is imported."""
    home = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))  # noqa: PTH120 - `pathlib` takes 10 ms
    for name in ("hardware", "sim"):
        # As `importlib.util.find_spec`, which takes 10 ms to import.
        found_by = (finder.find_spec(name, None) for finder in sys.meta_path)
        loaded = sys.modules.get(name)
        spec: Any = loaded.__spec__ if loaded else next((spec for spec in found_by if spec is not None), None)
        places = [os.path.realpath(place) for place in (spec.submodule_search_locations or ())] if spec else []
        if os.path.join(home, name) in places[:1]:  # noqa: PTH118
            continue
        origin = spec.origin if spec and spec.origin else ", ".join(places)
        found = f"Python finds another one at {origin}" if spec else "Python finds none"
        raise ImportError(
            f"retarget needs its own package {name!r} from {home}/{name}, but {found}. Install retarget in a virtual "
            f"environment of its own, and run it from a folder that holds no file or folder named {name!r}.",
            name=name,
        )


_verify_siblings()


def __getattr__(name: str) -> "Any":
    """Import a public name on first use (PEP 562), so that `import retarget` is quick."""
    if name not in _HOMES:
        raise AttributeError(f"module 'retarget' has no attribute {name!r}; public names: {', '.join(sorted(_HOMES))}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
