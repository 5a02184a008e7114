"""`python -m benchmarks.wheels FOLDER`: wheels and sdist of this checkout, tried as a user would (`make wheels`).

* Each wheel holds every file of the packages in this checkout and no other, an extension for its processor, and the
  extras of pyproject.toml. The sdist holds the crate too.
* The wheel of this machine is installed by the README's line, as typed, and then its extras, into a new environment
  that has no compiler and not this checkout, and the first lines of the README run there.
* The same lines run with a wheel that pip builds of the sdist, in an environment of its own.
* The wheel for the other processor, which cannot run here, can be installed there: pip finds every package it needs
  as a wheel. Whether it computes the same is shown by `make same-bits BITS="--short --aarch64"`.
* The plug-in for LeRobot builds, holds its files, and takes this version.

Imports the standard library alone. Exit code 0: all of it holds.
"""

import argparse
import os
import platform
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
import zipfile
from email import message_from_bytes
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PLUGIN = ROOT / "plugins/lerobot_robot_retarget"
PROCESSORS = {"x86_64": 62, "aarch64": 183}
"""Machine -> `e_machine` of an ELF file's head, at byte 18."""
EXTENSION = "retarget/_solver.abi3.so"
EXTRAS = "record,view"
"""Those of the README's first lines."""
WHEEL_LINE = re.compile(r"^ {4}(pip install wheels/.*\.whl)$", re.MULTILINE)
"""The line of the README that installs a wheel."""
PIPELINE = """
import sys, retarget
assert retarget.__file__.startswith(sys.prefix), retarget.__file__
pipeline = retarget.Pipeline("op3", performer="five", rate_hz=100)
print(len(pipeline.joint_names), "joints")
"""
LINES = (
    "retarget inspect sample",
    "retarget run --robot op3 --source sample",
    "retarget run --robot op3 --source sample --report report --save run.npz --record run.mcap",
    "retarget replay run.mcap",
    "retarget export run.npz --to parquet",
)
"""Lines of the README that end by themselves and make what the next ones need."""


def main() -> int:
    """The command. Returns its exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.wheels", description=__doc__)
    parser.add_argument("folder", type=Path, help="where `make wheels` put them")
    folder = parser.parse_args().folder.resolve()
    machine = platform.machine()
    wheels = {machine: _only(folder, f"*_{machine}.whl") for machine in PROCESSORS}
    sdist = _only(folder, "*.tar.gz")
    for processor, wheel in wheels.items():
        _check_wheel(wheel, processor)
        print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB, every file of the packages is there", flush=True)
    _check_sdist(sdist)
    print(f"{sdist.name}: {sdist.stat().st_size / 1e6:.1f} MB, every file of packages and crate is there", flush=True)
    with tempfile.TemporaryDirectory(prefix="retarget-wheels-") as name:
        place = Path(name)
        shutil.copy(ROOT / "examples" / "own_loop.py", place)
        _try_plugin(place)
        for processor, wheel in wheels.items():
            if processor != machine:
                _try_resolving(wheel, processor, place)
        tools = _new_environment(place, wheels[machine])
        _try_lines(place, tools, "wheel")
        built = _built_of(sdist, place)
        _check_wheel(built, machine)
        pip = [str(tools / "python"), "-m", "pip", "install", "--quiet"]
        _timed("install it", [*pip, "--force-reinstall", "--no-deps", str(built)], place, PATH=str(tools))
        _try_lines(place, tools, "sdist")
    return 0


# Contents.


def _only(folder: Path, pattern: str) -> Path:
    found = sorted(folder.glob(pattern))
    if len(found) != 1:
        names = ", ".join(path.name for path in found) or "none"
        raise SystemExit(f"{folder}/{pattern}: one file is needed, found {names}; make wheels builds them")
    return found[0]


def _packaged() -> set[str]:
    """Every file that a wheel of this checkout has to hold, beside extension and metadata."""
    words = ["git", "ls-files", "-z", "--", "retarget", "hardware", "sim", "configs"]
    listed = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    kept = {name for name in listed if name and not name.startswith("retarget/solver/")} - {"retarget/configs"}
    return {f"retarget/{name}" if name.startswith("configs/") else name for name in kept}


def _compare(archive: Path, found: set[str], needed: set[str]) -> None:
    """End the program unless both hold the same names."""
    for what, names in (("lacks", needed - found), ("holds what is not in the checkout", found - needed)):
        if names:
            raise SystemExit(f"{archive.name} {what}: {', '.join(sorted(names)[:10])} ({len(names)} files)")


def _check_wheel(wheel: Path, processor: str) -> None:
    """End the program unless its files, extension, tags and metadata are as they should be."""
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if not name.endswith("/")}
        info = f"retarget-{PROJECT['version']}.dist-info/"
        _compare(wheel, {name for name in names if not name.startswith(info)}, _packaged() | {EXTENSION})
        head = archive.read(EXTENSION)[:20]
        metadata = message_from_bytes(archive.read(f"{info}METADATA"))
        tags = message_from_bytes(archive.read(f"{info}WHEEL")).get_all("Tag", [])
        scripts = archive.read(f"{info}entry_points.txt").decode()
    if head[:4] != b"\x7fELF" or int.from_bytes(head[18:20], "little") != PROCESSORS[processor]:
        raise SystemExit(f"{wheel.name}: the extension is not for {processor}")
    if not tags or not all(re.fullmatch(rf"cp311-abi3-(many)?linux\w*_{processor}", tag) for tag in tags):
        raise SystemExit(f"{wheel.name}: found tags {tags}")
    extras = set(metadata.get_all("Provides-Extra", []))
    if extras != set(PROJECT["optional-dependencies"]) or metadata["Requires-Python"] != PROJECT["requires-python"]:
        raise SystemExit(f"{wheel.name}: extras or Python are not those of pyproject.toml")
    if "retarget=retarget.cli:main" not in scripts.replace(" ", ""):
        raise SystemExit(f"{wheel.name}: the command `retarget` is missing")


def _check_sdist(sdist: Path) -> None:
    words = ["git", "ls-files", "-z", "--", "retarget/solver"]
    crate = set(subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")) - {""}
    with tarfile.open(sdist) as archive:
        names = {member.name.partition("/")[2] for member in archive.getmembers() if member.isfile()}
    beside = {"PKG-INFO", "pyproject.toml", "README.md", "LICENSE", *crate}
    _compare(sdist, names, _packaged() | beside)


# Installing, and the first lines of the README.


def _timed(what: str, words: list[str], place: Path, **variables: str) -> str:
    """Run a command in `place`, with nothing of this checkout's around. Returns what it printed; ends the program if
    it fails."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL", "RETARGET"))}
    environment = kept | {"XDG_CONFIG_HOME": str(place / "config"), "PIP_DISABLE_PIP_VERSION_CHECK": "1"} | variables
    began = time.monotonic()
    done = subprocess.run(words, cwd=place, env=environment, capture_output=True, text=True, check=False)
    print(f"  {what}: {time.monotonic() - began:.1f} s", flush=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}: exit code {done.returncode}\n{done.stdout[-1500:]}{done.stderr[-1500:]}")
    return done.stdout + done.stderr


def wheel_line() -> str:
    """The line of the README that installs a wheel, as it is typed."""
    found = WHEEL_LINE.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    if len(found) != 1:
        raise SystemExit(f"README.md: one line that installs a wheel is needed, found {len(found)}")
    return str(found[0])


def _new_environment(place: Path, wheel: Path) -> Path:
    """Install a wheel, as the README has it, and its extras into an environment without a compiler, in `place`.
    Returns the folder of its programs."""
    tools = place / "environment" / "bin"
    print("a new environment:", flush=True)
    _timed("make it", [sys.executable, "-m", "venv", str(tools.parent)], place)
    (place / "wheels").symlink_to(wheel.parent)
    (tools / "uname").symlink_to(str(shutil.which("uname")))
    _timed(wheel_line(), ["/bin/sh", "-c", wheel_line()], place, PATH=str(tools), PIP_ONLY_BINARY=":all:")
    pip = [str(tools / "python"), "-m", "pip", "install", "--quiet", "--only-binary=:all:"]
    _timed("install its extras", [*pip, f"{wheel}[{EXTRAS}]"], place, PATH=str(tools))
    return tools


def _try_lines(place: Path, tools: Path, kind: str) -> None:
    """Type the first lines of the README in a folder of their own; end the program unless they do what they say."""
    print(f"README's first lines with the {kind}:", flush=True)
    folder = place / kind
    folder.mkdir()

    def typed(*words: str) -> str:
        shown = " ".join("..." if "\n" in word else word for word in words)
        return _timed(shown, [str(tools / words[0]), *words[1:]], folder, PATH=str(tools))

    if PROJECT["version"] not in typed("retarget", "--version"):
        raise SystemExit("retarget --version names another version")
    robots = {path.name for path in (ROOT / "configs/robots").iterdir()}
    if robots - set(re.findall(r"\w+", typed("retarget", "robots"))):
        raise SystemExit("retarget robots does not list them all")
    typed("retarget", "demo")
    for line in LINES:
        typed(*line.split())
    if "joints" not in typed("python", "-P", "-c", PIPELINE):
        raise SystemExit("retarget.Pipeline printed no joints")
    typed("python", "-P", "../own_loop.py")
    for name in ("out/demo/report.html", "report/report.html", "run.npz", "run.mcap"):
        if not (folder / name).is_file():
            raise SystemExit(f"{kind}: {name} was not written")


# The sdist, the other processor, the plug-in.


def _built_of(sdist: Path, place: Path) -> Path:
    """The wheel that pip builds of the sdist, with the cargo of this machine and build tools of its own."""
    print("the sdist:", flush=True)
    folder = place / "built"
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-cache-dir", "--wheel-dir", str(folder)]
    _timed("build a wheel of it", [*pip, str(sdist)], place)
    return _only(folder, "*.whl")


def _try_resolving(wheel: Path, processor: str, place: Path) -> None:
    """End the program unless pip finds all that a wheel for another processor needs; nothing is installed."""
    print(f"{wheel.name}, which cannot run here:", flush=True)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--only-binary=:all:"]
    places = [f"--platform={name}_{processor}" for name in ("manylinux_2_28", "manylinux_2_17", "manylinux2014")]
    target = ["--implementation=cp", "--python-version=3.11", "--target", str(place / processor)]
    words = [*pip, *places, *target, f"{wheel}[{EXTRAS},web,video]"]
    _timed("find every package that it needs", words, place)


def _try_plugin(place: Path) -> None:
    """Build the plug-in's wheel, and end the program unless it holds its files and takes this version of retarget."""
    print("the plug-in for LeRobot:", flush=True)
    folder = place / "plugin"
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--ignore-requires-python"]
    _timed("build its wheel", [*pip, "--wheel-dir", str(folder), str(PLUGIN)], place)
    wheel = _only(folder, "*.whl")
    needed = {path.relative_to(PLUGIN).as_posix() for path in (PLUGIN / PLUGIN.name).rglob("*.py")}
    with zipfile.ZipFile(wheel) as archive:
        _compare(wheel, {name for name in archive.namelist() if ".dist-info/" not in name}, needed)
        (metadata,) = (name for name in archive.namelist() if name.endswith("/METADATA"))
        named = message_from_bytes(archive.read(metadata))
    series = ".".join(PROJECT["version"].split(".")[:2])
    takes = [one for one in named.get_all("Requires-Dist", []) if one.startswith("retarget")]
    if named["Version"] != PROJECT["version"] or not any(f">={series}" in one for one in takes):
        raise SystemExit(f"{wheel.name} {named['Version']} needs {takes}, and this is retarget {PROJECT['version']}")


if __name__ == "__main__":
    raise SystemExit(main())
