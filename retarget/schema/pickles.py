"""Pickles can run any code, so none is read. The error has lines of Python that convert a trusted one to NPZ."""

import re
import zipfile
from collections.abc import Mapping
from pathlib import Path

from retarget.errors import InputError

LOAD = {
    "torch": 'import numpy, torch\np = torch.load({name!r}, map_location="cpu")',
    "joblib": "import numpy, joblib\np = joblib.load({name!r})",
    "pickle": 'import numpy, pickle\np = pickle.load(open({name!r}, "rb"))',
    "npy": "import numpy\np = numpy.load({name!r}, allow_pickle=True).item()",
}
"""Lines that load a pickle, by its writer."""
SUFFIXES = {".pt": "torch", ".pth": "torch", ".joblib": "joblib", ".pkl": "pickle", ".pickle": "pickle"}
NPY = b"\x93NUMPY"  # first bytes of a .npy file
_PICKLE = re.compile(rb"\x80[\x02-\x05]")  # first bytes, by protocol


def refuse_pickle(path: Path, head: bytes, make: Mapping[str, str], *, made: str, allowed: str = "") -> None:
    """Raise InputError for a pickle, by its first bytes (head: 4 KiB) or its suffix.

    make: part of a file's name, "" at the end for any -> lines that make of `p`, the loaded object, the NPZ {made!r}.
    """
    if not (kind := _kind(path, head)):
        return
    lines = next(lines for part, lines in make.items() if part in path.name.lower())
    code = f"{LOAD[kind]}\n{lines}".format(name=path.name, made=made)
    raise InputError(
        "a pickle can run any code, so none is read",
        where=str(path)[:200],
        found=f"a {kind} file",
        allowed=allowed,
        next_step=f"If you trust it, convert it in Python:\n{code}\nThen give {made!r}",
    )


def _kind(path: Path, head: bytes) -> str:
    """The writer of a pickle, a key of LOAD, or ""."""
    suffix = SUFFIXES.get(path.suffix.lower(), "")
    if head[:2] == b"PK":
        return "torch" if suffix == "torch" or _has_pickle(path) else ""
    if head.startswith(NPY):
        return "npy" if b"'|O'" in head[:128] else ""
    if b"joblib" in head or (suffix == "pickle" and head[:1] == b"x"):  # compressed by zlib
        return "joblib"
    return suffix or ("pickle" if _PICKLE.match(head) else "")


def _has_pickle(path: Path) -> bool:
    try:
        with zipfile.ZipFile(path) as archive:
            return any(name.rpartition("/")[2] == "data.pkl" for name in archive.namelist())
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, RuntimeError):
        return False
