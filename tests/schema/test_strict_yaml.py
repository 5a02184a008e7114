"""The strict YAML reader: what it takes, what it refuses, and where it says the fault is."""

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from messages import refuses, shows
from retarget.errors import ConfigError
from retarget.schema.strict_yaml import MAX_BYTES, MAX_DEPTH, MAX_PROBLEMS, MAX_VALUES, Document, read_text, scan

HERE = Path("robot.yaml")


def read(text: str, path: Path = HERE) -> Document:
    document = scan(text, path)
    if document.problems:
        raise ConfigError.from_problems(document.problems)
    return document


def load(path: Path) -> Document:
    return read(read_text(path), path)


def refused(text: str) -> ConfigError:
    with pytest.raises(ConfigError) as caught:
        read(text)
    return caught.value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("no", "no"),
        ("yes", "yes"),
        ("off", "off"),
        ("1:30", "1:30"),
        ("0o17", 15),
        ("0x1F", 31),
        ("1_000", "1_000"),
        ("-7", -7),
        ("1e3", 1000.0),
        (".5", 0.5),
        ("5.", 5.0),
        ("2001-01-01", "2001-01-01"),
        ("true", True),
        ("True", True),
        ("tRue", "tRue"),
        ("~", None),
        ("", None),
        ("'12'", "12"),
        ('"true"', "true"),
        ("0b1", "0b1"),
        ("٣", "٣"),
        ("=", "="),
    ],
)
def test_scalars_follow_the_core_schema(text: str, value: object) -> None:
    found = read(f"key: {text}").data["key"]
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("a: 1\na: 2", 2, "duplicate key"),
        ("a: 1\nb: [012]", 2, "a number that begins with 0"),
        ("a: -00", 1, "a number that begins with 0"),
        ("a:\n  b: 1\n  c: 2\n  b: 3", 4, "duplicate key"),
        ("a: &x 1", 1, "anchor"),
        ("a: 1\nb: *x", 2, "alias"),
        ("a: !!int 3", 1, "tag"),
        ("a: !mine {}", 1, "tag"),
        ("a: ! x", 1, "tag"),
        ("%YAML 1.1\n---\na: 1", 1, "directives are not used"),
        ("a: 1\n---\nb: 2", 2, "second document"),
        ("1: x", 1, "not text"),
        ("true: x", 1, "not text"),
        ("? [a, b]\n: x", 1, "not text"),
        ("a: .nan", 1, "not finite"),
        ("a: -.inf", 1, "not finite"),
        ("a: 1e999", 1, "not finite"),
        ("a: 99999999999999999", 1, "out of range"),
        ("a: " + "9" * 5000, 1, "not finite"),
        ("a: 0x" + "f" * 5000, 1, "not finite"),
        ("a: [1", 1, "not valid YAML"),
        ("a: 1\n b: 2", 2, "not valid YAML"),
        ("a: b: c", 1, "not valid YAML"),
        ("a: @x", 1, "not valid YAML"),
        ("- 1\n- 2", 1, "not a mapping"),
        ("just text", 1, "not a mapping"),
        ("", 1, "empty file"),
        ("# only a comment", 1, "empty file"),
    ],
)
def test_refused_with_its_line(text: str, line: int, what: str) -> None:
    error = refused(text)
    assert any(what in problem.render() and problem.line == line for problem in error.problems), str(error)
    assert str(HERE) in str(error)


def test_an_alias_bomb_is_refused_without_growing() -> None:
    rows = ['a: &a ["lol","lol","lol","lol","lol","lol","lol","lol","lol"]']
    for name, before in zip("bcdefghi", "abcdefgh", strict=True):
        rows.append(f"{name}: &{name} [{','.join(['*' + before] * 9)}]")
    error = refused("\n".join(rows))
    shows(str(error))
    assert len(str(error)) < 5000


def test_depth_is_bounded() -> None:
    fits = "a: " + "[" * (MAX_DEPTH - 1) + "]" * (MAX_DEPTH - 1)
    assert read(fits)
    shows(str(refused("a: " + "[" * MAX_DEPTH + "]" * MAX_DEPTH)))
    shows(str(refused("[" * 50)))
    assert refused("[" * 100_000).problems  # by the parser itself, from PyYAML 6.0.4 on
    shows(str(refused("\n".join(" " * i + "a:" for i in range(200)))))


def test_number_of_values_is_bounded() -> None:
    """A flood of problems ends the reading."""
    assert read("a: [" + "1, " * (MAX_VALUES // 2) + "]")
    shows(str(refused("a: [" + "1, " * MAX_VALUES + "]")))
    assert len(refused("a: 1\n" * 20_000).problems) == MAX_PROBLEMS


def test_size_is_bounded(tmp_path: Path) -> None:
    path = tmp_path / "big.yaml"
    path.write_text("a: 1\n" + "#" * MAX_BYTES)
    with refuses(ConfigError):
        load(path)
    path.write_text("a: 1\n" + "#" * (MAX_BYTES - 5))
    assert load(path).data == {"a": 1}


def test_what_is_no_file_or_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "latin.yaml").write_bytes(b"a: 1\nb: \xe9t\xe9\n")
    with refuses(ConfigError, "UTF-8", where="latin.yaml:2", found="0xe9"):
        load(tmp_path / "latin.yaml")
    for name in ("gone.yaml", "."):
        with refuses(ConfigError, where=tmp_path / name):
            load(tmp_path / name)


def test_every_key_and_item_has_its_line_with_either_parser_of_pyyaml(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "a: 1\nb:\n  c: [1,\n    2]\n  d:\n    - {e: 3, f: 'x y'}\nc: |\n  t\nd: {e: 1.5, f: no}\n"
    fast = read(text)
    assert [fast.lines[key] for key in (("b", "c", 1), ("b", "d", 0, "e"), ("b",))] == [4, 6, 2]
    monkeypatch.setattr("retarget.schema.strict_yaml._Loader", yaml.SafeLoader)
    slow = read(text)
    assert (fast.data, fast.lines) == (slow.data, slow.lines)


class _Quoting(yaml.SafeDumper):
    """Quotes every text: of 0E0 and its like, YAML 1.1 and 1.2 are of two minds."""


_Quoting.add_representer(str, lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"'))

names = st.text("abcdefg_", min_size=1, max_size=6)
leaves = st.one_of(
    st.integers(-(2**53), 2**53), st.floats(allow_nan=False, allow_infinity=False), st.booleans(), st.none(), st.text()
)
nodes = st.recursive(leaves, lambda node: st.lists(node, max_size=4) | st.dictionaries(names, node, max_size=4))


@pytest.mark.long
@given(st.dictionaries(names, nodes, min_size=1))
def test_what_is_written_is_read_back(data: dict[str, object]) -> None:
    text = yaml.dump(data, Dumper=_Quoting, default_flow_style=None, allow_unicode=False).replace("!!", "")
    try:
        found = read(text).data
    except ConfigError as error:
        shows(str(error))
        return
    assert found == data


@given(st.one_of(st.text(), st.text("[]{}:,-&*!|>'\"%@`#?\n\t ab1.~")))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        document = read(text)
    except ConfigError as error:
        assert error.problems
        assert len(str(error)) < 20_000
    else:
        assert all((key,) in document.lines for key in document.data)


@given(st.binary(max_size=300))
def test_any_bytes_are_read_or_refused(tmp_path_factory: pytest.TempPathFactory, raw: bytes) -> None:
    path = tmp_path_factory.getbasetemp() / "fuzz.yaml"
    path.write_bytes(raw)
    try:
        load(path)
    except ConfigError as error:
        assert str(path) in str(error)
