"""From a sensor to a goal every machine computes the same bits: which calls are not on that way, and the functions that
are. `make same-bits` runs whole robots as if by other processors."""

import ast
import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retarget import arithmetic

WAY = (
    *(
        f"retarget/{folder}"
        for folder in ("schema", "sources", "live", "model", "ik", "human", "robot", "safety", "run")
    ),
    *(f"retarget/{name}.py" for name in ("arithmetic", "rotations", "frames", "types", "pipeline")),
    *("hardware", "sim/emulator", "sim/performer.py", "sim/servo_model.py", "retarget/recording/goal_playback.py"),
)
"""What computes something between a file or packet and a goal, simulated servos without mass included. The files of a
robot are written once, by `import`: how is not on the way."""
NOT_ON_IT = {
    "retarget/model/meshes.py": "pictures",
    "retarget/model/thinning.py": "pictures",
    "retarget/live/stream_report.py": "numbers about a stream",
    "hardware/servo.py": "a check of a profile",
    "hardware/dynamixel/bus.py": "numbers about a bus",
    "hardware/imu.py": "measured angles: a recording holds what came of them",
    "hardware/bno08x.py": "the same",
    "hardware/heat.py": "words for the operator",
}
ALLOWED = {("retarget/sources/files.py", "sum"), ("hardware/servo_health.py", "np.exp")}
"""A sum that only says whether all numbers are finite, and the range in which a servo's error is judged."""
EXACT = {"sqrt", "fsum", "isfinite", "isnan", "isinf", "floor", "ceil", "trunc", "fabs", "copysign", "frexp", "ldexp"}
EXACT |= {"fmod", "isclose", "radians", "degrees", "nan", "inf", "pi", "tau", "prod"}
"""Of the module `math`: rounded once, or no function of the C library. `math.prod` multiplies in order."""
OF_BLAS = {"dot", "matmul", "inner", "outer", "vdot", "einsum", "tensordot", "kron", "linalg", "convolve", "polyfit"}
OF_THE_PROCESSOR = {
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh", "exp", "exp2", "expm1"),
    *("log", "log2", "log10", "log1p", "power", "float_power", "hypot", "cbrt", "sinc", "interp", "percentile"),
    *("partition", "argpartition"),  # the order of what is equal
}


def on_the_way(root: Path) -> Iterator[Path]:
    for place in WAY:
        path = root / place
        yield from sorted(path.rglob("*.py")) if path.is_dir() else [path]


def offences(text: str) -> Iterator[tuple[int, str]]:
    """Line and name of each thing in a module whose bits a processor, a C library or a BLAS decides."""
    tree, of_math = ast.parse(text), set[str]()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module in ("math", "cmath", "numpy.linalg", "statistics"):
            of_math |= {one.asname or one.name for one in node.names if one.name not in EXACT}
    for node in ast.walk(tree):
        found = ""
        match node:
            case ast.BinOp(op=ast.MatMult()) | ast.AugAssign(op=ast.MatMult()):
                found = "@"
            case ast.BinOp(left=ast.Constant(value=int() | 2.0), op=ast.Pow()):
                pass  # exact, to whole powers
            case ast.BinOp(op=ast.Pow()) | ast.AugAssign(op=ast.Pow()):
                found = "**"
            case ast.Attribute(value=ast.Name(id="np"), attr=name) if name in OF_BLAS | OF_THE_PROCESSOR:
                found = f"np.{name}"
            case ast.Attribute(value=ast.Name(id="math"), attr=name) if name not in EXACT:
                found = f"math.{name}"
            case ast.Call(func=ast.Attribute(attr="dot")):
                found = ".dot"
            case ast.Call(func=ast.Attribute(attr="argsort"), keywords=keywords) if "kind" not in {
                keyword.arg for keyword in keywords
            }:
                found = "argsort without kind='stable'"
            case ast.Name(id=name, ctx=ast.Load()) if name in of_math:
                found = name
            case ast.Call(func=ast.Name(id="sum"), args=[argument, *_]) if not counts(argument):
                found = "sum"
            case ast.ImportFrom(module=str(name)) if name.startswith("scipy"):
                found = name
            case ast.Import(names=names) if any(one.name.startswith("scipy") for one in names):
                found = "scipy"
        if found:
            yield getattr(node, "lineno", 0), found


def counts(argument: ast.expr) -> bool:
    """True where a built-in sum adds lengths, which are whole numbers."""
    return any(isinstance(node, ast.Name) and node.id == "len" for node in ast.walk(argument))


def test_nothing_on_the_way_to_a_goal_depends_on_the_processor(root: Path) -> None:
    found = [
        f"{place}:{line}: {what}"
        for path in on_the_way(root)
        for place in [path.relative_to(root).as_posix()]
        if place not in NOT_ON_IT
        for line, what in offences(path.read_text(encoding="utf-8"))
        if (place, what) not in ALLOWED and not (what == "sum" and place.startswith("hardware/"))  # of whole numbers
    ]
    assert not found, f"use retarget.arithmetic, or math.fsum: {found}"


def test_what_is_left_out_is_there_and_would_be_found(root: Path) -> None:
    assert all(any(offences((root / place).read_text(encoding="utf-8"))) for place in NOT_ON_IT)
    for place, what in ALLOWED:
        assert what in [found for _, found in offences((root / place).read_text(encoding="utf-8"))]


@pytest.mark.parametrize(
    "text",
    [
        "a @ b",
        "a @= b",
        "x ** 2",
        "x **= 0.5",
        "np.sin(x)",
        "np.linalg.norm(x)",
        "x.dot(y)",
        "import math\nmath.hypot(x, y)",
        "from math import atan2\natan2(y, x)",
        "sum(x for x in y)",
        "np.argsort(x)",
        "x.argsort(axis=0)",
        "np.interp(x, y, z)",
        "math.exp(x)",
        "from scipy.optimize import minimize",
        "import scipy",
    ],
)
def test_each_kind_of_offence_is_seen(text: str) -> None:
    assert list(offences(text))


@pytest.mark.parametrize(
    "text", ["2.0**-20", "2**done", "sum(len(x) for x in y)", "sum(map(len, y))", "math.fsum(y)", "np.sqrt(x)"]
)
def test_what_is_exact_is_allowed(text: str) -> None:
    assert not list(offences(text))


NUMBERS = np.random.default_rng(1).uniform(-6.0, 6.0, size=400)
SHARES = np.random.default_rng(2).uniform(-1.0, 1.0, size=400)
FUNCTIONS = {
    "sin": (NUMBERS, "251577e8"),
    "cos": (NUMBERS, "a47ddc0c"),
    "arcsin": (SHARES, "4db2209a"),
    "arccos": (SHARES, "809215fa"),
    "exp": (NUMBERS, "c4a9bf4d"),
    "expm1": (NUMBERS, "cb755abf"),
    "log": (np.abs(NUMBERS), "3081c4b6"),
}
"""Arguments, and a hash of the bits that every machine finds."""


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_are_right_to_the_last_bits_and_the_same_everywhere(name: str) -> None:
    numbers, bits = FUNCTIONS[name]
    ours, numpys = getattr(arithmetic, name), getattr(np, name)
    found = ours(numbers)
    np.testing.assert_array_max_ulp(found, numpys(numbers), maxulp=2)
    assert [ours(x) for x in numbers.tolist()] == found.tolist()
    assert digest(found) == bits


def digest(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    return hashlib.sha256(values.tobytes()).hexdigest()[:8]


def test_functions_of_two_numbers_are_broadcast() -> None:
    y, x = NUMBERS[:12].reshape(3, 1, 4), NUMBERS[20:28].reshape(2, 4)
    np.testing.assert_array_max_ulp(arithmetic.arctan2(y, x), np.arctan2(y, x), maxulp=2)
    np.testing.assert_array_max_ulp(arithmetic.hypot(y, x), np.hypot(y, x), maxulp=2)
    assert digest(arithmetic.arctan2(y, x)) + digest(arithmetic.hypot(y, x)) == "b03fcc655d6a38d4"
    assert arithmetic.arctan2(1.0, 0.0) == np.pi / 2.0 and arithmetic.hypot(3.0, -4.0) == 5.0
    assert arithmetic.hypot(np.array([3.0]), 4.0).tolist() == [5.0]
    assert arithmetic.arctan2(0.0, np.array([-1.0])).tolist() == [np.pi]
    with pytest.raises(ValueError, match=r"\[2\].*\[3\]"):
        arithmetic.hypot(np.zeros(2), np.zeros(3))


@pytest.mark.parametrize(
    ("a", "b"),
    [((3,), (3, 4)), ((5, 3), (3,)), ((5, 3), (3, 4)), ((2, 5, 3), (3, 4)), ((0, 3), (3, 2)), ((2, 0), (0, 3))],
)
def test_products_add_in_the_order_of_their_indices(a: tuple[int, ...], b: tuple[int, ...]) -> None:
    random = np.random.default_rng(3)
    one, other = random.uniform(-1.0, 1.0, size=a), random.uniform(-1.0, 1.0, size=b)
    found = arithmetic.matmul(one, other)
    np.testing.assert_allclose(found, one @ other, rtol=1e-13, atol=1e-15)
    expected = np.zeros(found.shape)
    for k in range(a[-1]):
        expected += one[..., k] * other[k] if len(b) == 1 else one[..., k, None] * other[k]
    assert found.tobytes() == expected.tobytes()


def test_products_of_what_does_not_fit_are_refused() -> None:
    for a, b in (((2, 3), (2, 3)), ((3,), (2,)), ((3,), (3, 1, 1))):
        with pytest.raises(ValueError, match=re.escape(f"{[*a]} and {[*b]}")):
            arithmetic.matmul(np.zeros(a), np.zeros(b))
    with pytest.raises(ValueError, match=r"\[2\] and \[3\]"):
        arithmetic.dot(np.zeros(2), np.zeros(3))
    with pytest.raises(ValueError, match="vectors"):
        arithmetic.norms(np.array(1.0))


@given(st.lists(st.floats(-1e6, 1e6), min_size=0, max_size=9))
def test_lengths_are_roots_of_squares_added_in_order(numbers: list[float]) -> None:
    total = 0.0
    for x in numbers:
        total += x * x
    v = np.array(numbers, dtype=np.float64)
    assert arithmetic.norm(v) == np.sqrt(total) and arithmetic.dot(v, v) == total
    stack = np.array([[v, v]])
    assert arithmetic.norms(stack).tolist() == [[np.sqrt(total)] * 2]
    assert arithmetic.squares(stack).tolist() == [[total] * 2]


def test_an_array_of_one_number_stays_an_array() -> None:
    one = np.array([0.5])
    assert [arithmetic.sin(one).shape, arithmetic.arctan2(one, one).shape, arithmetic.hypot(one, 1.0).shape] == [
        (1,)
    ] * 3
    assert isinstance(arithmetic.sin(np.float64(0.5)), float) and isinstance(arithmetic.sin(one[0]), float)


def test_arrays_of_any_layout_give_the_same() -> None:
    a = np.random.default_rng(4).uniform(size=(4, 3))
    turned = np.asfortranarray(a)
    assert arithmetic.matmul(turned, turned.T).tolist() == arithmetic.matmul(a, np.ascontiguousarray(a.T)).tolist()
    assert arithmetic.norms(turned[::-1]).tolist() == arithmetic.norms(a)[::-1].tolist()
    assert arithmetic.sin(turned).tolist() == arithmetic.sin(a).tolist()


@pytest.mark.parametrize("seed", range(20))
def test_a_dwell_is_the_time_since_the_condition_failed_last(seed: int) -> None:
    random = np.random.default_rng(seed)
    steps, holds = random.uniform(1e-3, 0.02, 200), random.random(200) < 0.9
    dwell = arithmetic.Dwell()
    for tick in range(200):
        held = dwell.step(float(steps[tick]), holds=bool(holds[tick]))
        began = next((before + 1 for before in range(tick, -1, -1) if not holds[before]), 0)
        assert held == dwell.held == pytest.approx(float(steps[began : tick + 1].sum()), abs=1e-12)


def test_a_dwell_begins_anew_from_what_it_is_set_to() -> None:
    dwell = arithmetic.Dwell()
    dwell.step(1.0, holds=True)
    dwell.held = 0.0
    assert dwell.step(0.5, holds=True) == 0.5
    dwell.held = -np.inf  # never, until it has failed once
    assert dwell.step(1e9, holds=True) == -np.inf
    assert [dwell.step(0.5, holds=holds) for holds in (False, True)] == [0.0, 0.5]


@pytest.mark.parametrize("seed", range(20))
def test_a_low_pass_is_the_solution_of_its_equation_in_steps_of_any_length(seed: int) -> None:
    random = np.random.default_rng(seed)
    start, to, settle = random.normal(), random.normal(), random.uniform(0.01, 2.0)
    value, time = float(start), 0.0
    for dt in random.uniform(0.0, 0.1, 100):
        value, time = arithmetic.low_pass(value, float(to), dt / settle), time + dt
        assert value == pytest.approx(to + (start - to) * np.exp(-time / settle), abs=1e-12)
        assert min(start, to) - 1e-12 <= value <= max(start, to) + 1e-12, "it overshoots"


def test_a_low_pass_stays_in_no_time_and_is_there_after_any_time() -> None:
    assert arithmetic.low_pass(1.5, -2.25, 0.0) == 1.5
    assert arithmetic.low_pass(1.5, -2.25, np.inf) == -2.25


def test_a_low_pass_of_a_vector_is_that_of_each_part() -> None:
    start, to = np.array([0.3, -1.7, 2.0]), np.array([1.1, 0.4, 2.0])
    parts = [arithmetic.low_pass(a, b, 0.4) for a, b in zip(start.tolist(), to.tolist(), strict=True)]
    assert arithmetic.low_pass(start, to, 0.4).tolist() == parts
    assert arithmetic.low_pass(complex(*start[:2]), complex(*to[:2]), 0.4) == complex(*parts[:2])
