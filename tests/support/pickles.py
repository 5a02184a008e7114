"""Pickles of others, written and converted by programs of their own, as this project reads none."""

import subprocess
import sys
from pathlib import Path

from retarget.errors import InputError

STAND_INS = {
    "joblib": "from pickle import *\ndef load(path):\n    return Unpickler(open(path, 'rb')).load()\n",
    "torch": "from joblib import *\nfrom joblib import load as read\ndef load(path, map_location): return read(path)\n"
    "class Tensor:\n    def __init__(self, values): self.values = values\n    def numpy(self): return self.values\n",
}
"""Modules of the names of large ones, with what the lines call of them."""


def run_python(code: str, folder: Path) -> None:
    """Run lines of Python in a folder."""
    for name, text in STAND_INS.items():
        (folder / f"{name}.py").write_text(text)
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60, cwd=folder)


def convert(error: InputError, folder: Path) -> None:
    """Run the lines of Python in the message of an error, as the user sees them."""
    run_python("\n".join(str(error).splitlines()[1:-1]), folder)
