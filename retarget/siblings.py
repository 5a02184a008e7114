"""`hardware` and `sim` are short names that others use too: makes sure that Python finds ours."""

import importlib.util
from pathlib import Path

SIBLINGS = ("hardware", "sim")


def verify() -> None:
    """Raise ImportError, naming the shadow, unless Python finds the packages next to this one. Imports neither."""
    home = Path(__file__).resolve().parent.parent
    for name in SIBLINGS:
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
