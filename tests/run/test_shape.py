"""The size of what a reader of one tick has to know."""

import ast
import sys
from pathlib import Path
from types import FrameType

import pytest

from retarget.run.loop import Loop
from retarget.types import RunState
from sim.faults.bench import Bench
from sim.faults.sender import FakeSender
from sim.imu import STILL

ROOT = Path(__file__).resolve().parents[2]
MOST_MODULES = 55
"""With the check of standing, the governor of the stop, heat, the phases of the performer's support, where posture and
support are told apart, and three modules of the IMU: sample, board and tipping;
a tick in which a stop begins plants the root."""
RECEIVER = {"retarget/live/receivers.py"}
"""What the simulated sender of the test stands for."""
MOST_ATTRIBUTES = 15
SMALL_CLASSES = ("retarget/run", "retarget/robot", "retarget/safety")
DATA = {"RunTable", "RunOptions"}
"""Lists of fields, which are data: files, command line and docs are made from them."""


def test_a_tick_passes_few_modules(monkeypatch: pytest.MonkeyPatch) -> None:
    """From a datagram to goal bytes on the emulated wire, with all that looks on."""
    passed: set[str] = set()
    ticks = 0

    def see(frame: FrameType, event: str, argument: object) -> None:
        passed.add(frame.f_code.co_filename)

    tick = Loop.tick

    def profiled(loop: Loop) -> None:
        nonlocal ticks
        if bench.machine.supervisor.state is not RunState.FOLLOW:
            tick(loop)
            return
        ticks += 1
        sys.setprofile(see)
        try:
            tick(loop)
        finally:
            sys.setprofile(None)

    monkeypatch.setattr(Loop, "tick", profiled)
    monkeypatch.setattr("sim.imu.PlantedMotion.__call__", lambda motion: STILL)  # what an emulated IMU works out
    bench = Bench(FakeSender(), duration=1.0)
    trace = bench.run()
    ours = {
        str(Path(name).relative_to(ROOT))
        for name in passed
        if name.startswith((f"{ROOT}/retarget", f"{ROOT}/hardware"))
    }
    assert not trace.error and ticks > 50
    assert {"retarget/run/loop.py", "retarget/ik/hierarchy.py", "hardware/guard.py"} <= ours
    modules = sorted(ours | RECEIVER)
    assert len(modules) <= MOST_MODULES, "\n".join(modules)


def attributes(node: ast.ClassDef) -> set[str]:
    """Names that a class or its methods assign on an instance, fields of a dataclass among them."""
    found = {one.target.id for one in node.body if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name)}
    for one in ast.walk(node):
        if isinstance(one, ast.Attribute) and isinstance(one.ctx, ast.Store) and ast.unparse(one.value) == "self":
            found.add(one.attr)
    return found


@pytest.mark.parametrize("folder", SMALL_CLASSES)
def test_a_class_keeps_few_things(folder: str) -> None:
    large = {
        f"{path.name}: {node.name}": len(attributes(node))
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef) and node.name not in DATA and len(attributes(node)) > MOST_ATTRIBUTES
    }
    assert not large


ON_ITS_WAY = [
    *(path for room in ("run", "robot", "human", "safety", "ik") for path in (ROOT / "retarget" / room).rglob("*.py")),
    ROOT / "retarget/live/performer.py",
    ROOT / "retarget/pipeline.py",
]
"""Where the way of a tick leads, from sample to goal."""
OUTSIDE = {"loop.py: run", "loop.py: _give_up", "loop.py: _release", "prepare.py: _open"}
"""What catches any exception before the first tick of a run or after the last."""
OF_THE_USER = {"own_bus.py: own_bus_class", "own_bus.py: __init__", "own_bus.py: _call"}
"""What names the exceptions of a bus that the user wrote."""
ANY = {"Exception", "BaseException"}


def catches_any(node: ast.AST) -> bool:
    """Whether it is a handler of all exceptions, or suppresses them."""
    if isinstance(node, ast.ExceptHandler):
        return node.type is None or bool({one.id for one in ast.walk(node.type) if isinstance(one, ast.Name)} & ANY)
    if not isinstance(node, ast.Call) or not ast.unparse(node.func).endswith("suppress"):
        return False
    return bool({ast.unparse(one) for one in node.args} & ANY)


def test_one_place_catches_exceptions_in_a_tick() -> None:
    found = [
        f"{path.name}: {function.name}"
        for path in ON_ITS_WAY
        for function in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(function, ast.FunctionDef)
        for node in ast.walk(function)
        if catches_any(node)
    ]
    assert sorted(found) == sorted({*OUTSIDE, *OF_THE_USER, "tick.py: caught"})
