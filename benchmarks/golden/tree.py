"""A version of this project that can be run: this checkout, or a commit unpacked beside it with its own extension."""

import hashlib
import io
import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

BUILD_S, LOOK_S = 900.0, 60.0
"""Longest build, and longest look at what is there, s."""


class TreeError(Exception):
    """A version cannot be run; says why."""


@dataclass(frozen=True)
class Tree:
    """name: for messages. folder: its root, first on PYTHONPATH. python: whose packages it uses."""

    name: str
    folder: Path
    python: Path

    def environment(self, config: Path) -> dict[str, str]:
        """Variables of its processes: its own packages, one thread, and no settings of the user's.

        config: an empty folder, for robots and calibrations of a user.
        """
        kept = {
            name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "XDG_", "RETARGET"))
        }
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        return kept | threads | {"PYTHONPATH": str(self.folder), "XDG_CONFIG_HOME": str(config), "COLUMNS": "200"}

    def verify(self, config: Path) -> None:
        """Raise TreeError unless a process of this version finds its own packages and its own extension."""
        look = "import hardware, sim, retarget, retarget._solver as solver\n"
        look += "for one in (hardware, sim, retarget, solver): print(one.__file__)"
        done = subprocess.run(
            [str(self.python), "-P", "-c", look],
            cwd=config,
            env=self.environment(config),
            capture_output=True,
            text=True,
            timeout=LOOK_S,
            check=False,
        )
        if done.returncode:
            raise TreeError(f"{self.name} cannot be imported: {done.stderr.strip()[-500:]}")
        strange = [line for line in done.stdout.split("\n") if line and not Path(line).is_relative_to(self.folder)]
        if strange:
            raise TreeError(f"{self.name} would run foreign code: {', '.join(strange)}")


def this_tree(root: Path) -> Tree:
    """The checkout as it stands, uncommitted changes included."""
    commit = _git(root, "rev-parse", "--short", "HEAD")
    changed = " and uncommitted changes" if _git(root, "status", "--porcelain", "--untracked-files=no") else ""
    return Tree(f"this checkout ({commit}{changed})", root, Path(sys.executable))


def resolved(root: Path, commit: str) -> str:
    """The whole hash of a commit. Raises TreeError if there is none."""
    try:
        return _git(root, "rev-parse", "--verify", "--quiet", "--end-of-options", f"{commit}^{{commit}}")
    except TreeError:
        raise TreeError(
            f"no such commit: {commit!r}; allowed: whatever `git rev-parse` knows, HEAD for example"
        ) from None


def other_tree(root: Path, sha: str, *, cache: Path) -> Tree:
    """A commit, unpacked and built below `cache`; a second call finds it there. Raises TreeError.

    It uses this environment, and therefore has to ask for the same packages.
    """
    folder = cache / sha
    asked = tomllib.loads(_git(root, "show", f"{sha}:pyproject.toml"))
    if _dependencies(asked) != _dependencies(_pyproject(root)):
        raise TreeError(f"{sha[:12]} asks for other packages than this checkout")
    whole = folder / ".whole"
    if not whole.exists():
        shutil.rmtree(folder, ignore_errors=True)
        _unpack(root, sha, folder)
        _copy_extension(root, sha, folder, cache)
        whole.touch()
    return Tree(sha[:12], folder, Path(sys.executable))


def _unpack(root: Path, sha: str, folder: Path) -> None:
    done = subprocess.run(["git", "archive", "--format=tar", sha], cwd=root, capture_output=True, check=False)
    if done.returncode:
        raise TreeError(f"git archive: {done.stderr.decode(errors='replace').strip()}")
    folder.mkdir(parents=True)
    with tarfile.open(fileobj=io.BytesIO(done.stdout)) as archive:
        archive.extractall(folder, filter="tar")


def _dependencies(project: dict[str, Any]) -> list[str]:
    return sorted(project["project"]["dependencies"])


def _pyproject(folder: Path) -> dict[str, Any]:
    return tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))


def _copy_extension(root: Path, sha: str, folder: Path, cache: Path) -> None:
    """Build the crate as `make` does; commits that share its sources and their build share the result."""
    crate = Path(_pyproject(folder)["tool"]["maturin"]["manifest-path"]).parent
    environment = dict(os.environ)
    made_of = [_git(root, "rev-parse", f"{sha}:{crate}"), _checked(["rustc", "--version"], cwd=folder, env=environment)]
    made_of += [str(_pyproject(folder)["tool"]["maturin"]), sys.version]
    built = cache / "extensions" / hashlib.sha256("\n".join(made_of).encode()).hexdigest()[:16]
    if not any(built.glob("*.so")):
        print("building its extension", flush=True)
        _build(folder, cache, built)
    for file in built.glob("*.so"):
        shutil.copy2(file, folder / "retarget" / file.name)


def _build(folder: Path, cache: Path, built: Path) -> None:
    wheels = built.with_suffix(".wheel")
    shutil.rmtree(wheels, ignore_errors=True)
    environment = dict(os.environ) | {"CARGO_TARGET_DIR": str(cache / "target")}
    maturin = str(Path(sys.executable).parent / "maturin")
    words = [maturin, "build", "--release", "--locked", "--interpreter", sys.executable, "--out", str(wheels)]
    _checked(words, cwd=folder, env=environment)
    built.mkdir(parents=True, exist_ok=True)
    for wheel in wheels.glob("*.whl"):
        with zipfile.ZipFile(wheel) as archive:
            for name in archive.namelist():
                if name.endswith(".so"):
                    (built / Path(name).name).write_bytes(archive.read(name))
    shutil.rmtree(wheels)
    if not any(built.glob("*.so")):
        raise TreeError("its wheel holds no extension")


def _git(root: Path, *words: str) -> str:
    return _checked(["git", *words], cwd=root, env=dict(os.environ))


def _checked(words: list[str], *, cwd: Path, env: dict[str, str]) -> str:
    """What a command prints. Raises TreeError if it fails."""
    try:
        done = subprocess.run(words, cwd=cwd, env=env, capture_output=True, text=True, timeout=BUILD_S, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise TreeError(f"{' '.join(words[:2])}: {error}") from None
    if done.returncode:
        raise TreeError(f"{' '.join(words[:2])}: {done.stderr.strip()[-2000:] or f'exit code {done.returncode}'}")
    return done.stdout.strip()
