"""`python -m benchmarks.same_bits`: the same runs as if by other processors, compared to the bit.

One process a run and side. Every side but the first makes one thing as it is on another machine: the kernels of
OpenBLAS, the loops of NumPy, the C library's functions, the crate's copies for AVX2; `--aarch64` adds a whole other
processor, under qemu (Debian's `qemu-user`; packages for it are fetched with apt and pip into out/same_bits). A side
also computes products and functions with NumPy and the C library, and it is said whether those have other bits there:
where they have none, the side shows nothing here.

`--short` plays the golden runs that `make test` holds against stored values. Exit code 0: all goals are equal.
"""

import argparse
import os
import platform
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.golden.compare import array_difference
from benchmarks.golden.matrix import ROBOTS, Run, found_sources, small_matrix
from benchmarks.golden.play import Outcome, play
from benchmarks.golden.tree import Tree

ROOT = Path(__file__).resolve().parent.parent
OUT = ROOT / "out" / "same_bits"
CLIPS = ("mocap/cmu_asfamc/02_05.amc", "mocap/cmu_asfamc/02_06.amc")
END_S = "5"
"""s of each clip that are followed."""
HIDDEN = "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F,-AVX512VL,-AVX512BW,-AVX512DQ,-AVX512CD"
"""What the C library is not to find (its names from 2.33 on)."""
CONTROL = """
import ctypes, ctypes.util, hashlib, numpy as np
libm = ctypes.CDLL(ctypes.util.find_library("m") or "libm.so.6")
libm.exp.restype, libm.exp.argtypes = ctypes.c_double, [ctypes.c_double]
numbers = np.random.default_rng(0).normal(size=(200, 200))
row, other = numbers[:2]
products = numbers @ numbers, numbers @ row, row @ other, numbers[:3, :3] @ row[:3]
functions = [f(numbers) for f in (np.sin, np.exp, np.arctan, np.cbrt, np.tanh)]
for parts in (products, functions, [libm.exp(x) for x in row]):
    print(hashlib.sha256(np.concatenate([np.ravel(part) for part in parts])).hexdigest()[:8])
"""
ARM64 = "aarch64-unknown-linux-gnu"
PYTHON_OF_DEBIAN = ("python3-minimal", "libpython3-stdlib", "libc6", "zlib1g", "libexpat1", "libffi8", "libgcc-s1")
PYTHON_OF_DEBIAN += ("libstdc++6", "libssl3", "libbz2-1.0", "liblzma5", "libuuid1", "libsqlite3-0", "libcrypt1")


@dataclass(frozen=True)
class Side(Tree):
    """A version that is run as on another machine. variables: of its processes. before: words before `python`."""

    variables: dict[str, str] = field(default_factory=dict)
    before: tuple[str, ...] = ()

    def environment(self, config: Path) -> dict[str, str]:
        """Variables of its processes."""
        return super().environment(config) | self.variables


def main() -> int:
    """The command. Returns its exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.same_bits", description=__doc__)
    parser.add_argument("--short", action="store_true", help="the stored golden runs; a minute")
    parser.add_argument("--aarch64", action="store_true", help="one more side, under qemu; with --short")
    parser.add_argument("--only", default="", metavar="TEXT", help="only runs with this in their name")
    parser.add_argument("--jobs", type=int, default=2, help="processes side by side")
    asked = parser.parse_args()
    OUT.mkdir(parents=True, exist_ok=True)
    here = Side("as it is", ROOT, Path(sys.executable))
    sides = [here, *_other_kernels(), _portable(), *([_aarch64()] if asked.aarch64 else [])]
    runs = small_matrix(OUT / "sources") if asked.short else _runs()
    runs = [run for run in runs if asked.only in run.name]
    controls = [_control(side) for side in sides]
    with ThreadPoolExecutor(asked.jobs) as pool:
        played = [
            [pool.submit(play, run, side, OUT / "runs" / side.name / run.name, before=side.before) for run in runs]
            for side in sides
        ]
        first = [one.result() for one in played[0]]
        bad = sum(bool(outcome.problem) for outcome in first)
        for run, outcome in zip(runs, first, strict=True):
            goals = len(outcome.arrays.get("time", ()))
            print(f"{run.name}: {outcome.problem or f'{goals} ticks'}", flush=True)
        shown = set[str]()
        for side, control, results in zip(sides[1:], controls[1:], played[1:], strict=True):
            kinds = ("products", "functions of NumPy", "functions of the C library")
            other = [kind for kind, ours, theirs in zip(kinds, controls[0], control, strict=True) if ours != theirs]
            shown |= {*other}
            differ = [
                f"{run.name}: {text}"
                for run, ours, theirs in zip(runs, first, results, strict=True)
                for text in _differences(ours, theirs.result())
            ]
            bad += len(differ)
            shows = f"other bits of {', '.join(other)} there" if other else "products and functions as here"
            print(f"{side.name}: {'; '.join(differ) or 'all goals are equal to the bit'}; {shows}", flush=True)
    if platform.machine() == "x86_64" and "products" not in shown:
        print("no side has other bits of products: nothing was shown")
        bad += 1
    return 1 if bad else 0


def _differences(ours: Outcome, theirs: Outcome) -> Iterable[str]:
    """What is not the same, a sentence each; of names and texts nothing."""
    if theirs.problem:
        yield theirs.problem
    for name, values in ours.arrays.items() if not theirs.problem else ():
        if values.dtype.kind != "U":
            found = array_difference(name, values, theirs.arrays.get(name, np.zeros(0)))
            if found is not None:
                yield f"{name} from row {found.first} on: {found.text}"
    if not theirs.problem and any(not np.array_equal(ours.wire[name], theirs.wire[name]) for name in ours.wire):
        yield "other bytes on the wire"


def _runs() -> list[Run]:
    """Four robots with two clips, the synthetic performer and a stream."""
    sources = found_sources(OUT / "sources", ROOT)
    for note in sources.notes:
        print(f"note: {note}")
    shared = Path(os.environ.get("RETARGET_SHARED", str(ROOT.parent / "shared"))).resolve()
    clips = {Path(clip).stem: ("--source", str(shared / clip), "--end", END_S) for clip in CLIPS}
    words = {name: clip for name, clip in clips.items() if Path(clip[1]).is_file()} or {"clip": sources.clip}
    words["sample"] = ("--source", "sample", "--end", END_S)
    return [
        Run(f"{robot} {name}", ("run", "--robot", robot, "--bus", "mock", *source))
        for robot in ROBOTS
        for name, source in {**words, "stream": sources.streams[robot]}.items()
    ]


def _other_kernels() -> Iterable[Side]:
    """The same files with other kernels of what they stand on, as far as this processor can run them."""
    flags = Path("/proc/cpuinfo").read_text(encoding="utf-8") if Path("/proc/cpuinfo").is_file() else ""
    kernels = (("Haswell", "avx2"), ("Zen", "avx2"), ("SkylakeX", "avx512f"), ("Prescott", ""))
    found = [(f"OpenBLAS {name}", {"OPENBLAS_CORETYPE": name}) for name, flag in kernels if flag in flags]
    kinds = np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])
    found.append(("NumPy's baseline", {"NPY_DISABLE_CPU_FEATURES": " ".join(kinds)}))
    found.append(("C library without FMA", {"GLIBC_TUNABLES": HIDDEN}))
    return [Side(name, ROOT, Path(sys.executable), variables) for name, variables in found]


def _portable() -> Side:
    """The crate without its copies for AVX2."""
    return Side("crate without AVX2", _wheel("portable", "--features", "python,portable"), Path(sys.executable))


def _wheel(name: str, *words: str) -> Path:
    """The folder with what a wheel of this checkout holds, built with more words for maturin."""
    folder, wheels = OUT / name, OUT / f"{name}_wheel"
    for one in (folder, wheels):
        shutil.rmtree(one, ignore_errors=True)
    tools = Path(sys.executable).parent
    environment = dict(os.environ) | {"PATH": f"{tools}{os.pathsep}{os.environ['PATH']}"}
    build = [str(tools / "maturin"), "build", "--release", "--locked", "--quiet", "--out", str(wheels)]
    _do([*build, "--interpreter", sys.executable, *words], environment)
    for wheel in wheels.glob("*.whl"):
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(folder)
    return folder


def _aarch64() -> Side:
    """A Python of Debian's for aarch64 under qemu, with the packages of this environment and a wheel built for it."""
    qemu = shutil.which("qemu-aarch64")
    if qemu is None:
        raise SystemExit("qemu-aarch64 is missing; Debian, Ubuntu: apt install qemu-user")
    root = OUT / "aarch64_root"
    if not (root / "usr/bin").is_dir():
        _debian_python(root)
    python = next(root.glob("usr/bin/python3.[0-9]*"))
    _do(["rustup", "target", "add", ARM64])
    _do([sys.executable, "-m", "pip", "install", "--quiet", "ziglang>=0.13"])
    folder = _wheel("aarch64", "--zig", "--target", ARM64, "--compatibility", "manylinux2014")
    freeze = subprocess.run(
        [sys.executable, "-m", "pip", "list", "--format=freeze", "--exclude-editable"],
        capture_output=True,
        text=True,
        check=True,
    )
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    needed = {re.split("[<>=]", one)[0] for one in asked}
    pinned = [line for line in freeze.stdout.split() if line.lower().split("==")[0] in needed]
    platforms = [word for name in ("2_28", "2_17") for word in ("--platform", f"manylinux_{name}_aarch64")]
    version = ["--python-version", python.name.removeprefix("python"), "--implementation", "cp"]
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--target", str(folder), "--only-binary=:all:"]
    _do([*pip, *platforms, "--platform", "manylinux2014_aarch64", *version, *pinned])
    return Side("aarch64 under qemu", folder, python, before=(qemu, "-L", str(root)))


def _debian_python(root: Path) -> None:
    """Unpack a Python for aarch64 into `root`, with lists and packages of apt's kept beside it."""
    state = OUT / "apt"
    for name in ("lists/partial", "cache/archives/partial", "debs"):
        (state / name).mkdir(parents=True, exist_ok=True)
    (state / "status").touch()
    apt = ["apt-get", "-qq", "-o", "APT::Architecture=arm64", "-o", "APT::Architectures=arm64"]
    apt += ["-o", f"Dir::State::lists={state}/lists", "-o", f"Dir::State::status={state}/status"]
    apt += ["-o", f"Dir::Cache={state}/cache", "-o", "APT::Sandbox::User=root"]
    _do([*apt, "update"])
    names = subprocess.run(
        ["apt-cache", *apt[2:], "depends", "python3-minimal"], capture_output=True, text=True, check=True
    ).stdout
    version = next(word for word in names.split() if word.startswith("python3.") and word.endswith("-minimal"))
    version = version.removesuffix("-minimal")
    packages = [f"{version}-minimal", f"lib{version}-minimal", f"lib{version}-stdlib", *PYTHON_OF_DEBIAN[2:]]
    _do([*apt, "download", *packages], cwd=state / "debs")
    for deb in (state / "debs").glob("*.deb"):
        _do(["dpkg-deb", "-x", str(deb), str(root)])


def _control(side: Side) -> list[str]:
    """Hashes of products and functions of NumPy and of the C library there."""
    config = OUT / "config"
    config.mkdir(exist_ok=True)
    done = subprocess.run(
        [*side.before, str(side.python), "-P", "-c", CONTROL],
        env=side.environment(config),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(f"{side.name} does not run: {done.stderr.strip()[-500:]}")
    return done.stdout.split()


def _do(words: list[str], environment: dict[str, str] | None = None, cwd: Path = ROOT) -> None:
    done = subprocess.run(words, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(words[:3])}: {done.stderr.strip()[-1000:]}")


if __name__ == "__main__":
    raise SystemExit(main())
