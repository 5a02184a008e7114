"""`use` in the solver's crate runs one way: no file of it uses another that, in the end, uses the first.

A name that a folder hands on (`pub use`) counts as that of the file it comes from. A method counts as used, too,
where another file of the same structure defines it.
"""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

SOURCES = Path(__file__).resolve().parent.parent / "retarget/solver/src"
Graph = dict[str, set[str]]


def module_of(path: Path, root: Path) -> str:
    """`a::b` of a/b.rs and of a/b/mod.rs; empty for lib.rs."""
    parts = path.relative_to(root).with_suffix("").parts
    return "::".join(parts[:-1] if parts[-1] in {"mod", "lib"} else parts)


def without_comments(text: str) -> str:
    return re.sub(r"//[^\n]*", "", text)


def leaves(tree: str) -> Iterator[tuple[str, str]]:
    """Paths of a `use` tree such as `a::{b, c::{self, d as e}}`, each with the name it gets."""
    head, brace, rest = tree.partition("{")
    if not brace:
        path, _, name = tree.strip().partition(" as ")
        yield path.strip(), (name or path.rpartition("::")[2]).strip()
        return
    depth, start, inner = 0, 0, rest.rpartition("}")[0]
    for place, letter in enumerate(f"{inner},"):
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            for path, name in leaves(inner[start:place]) if inner[start:place].strip() else ():
                yield (head.strip() + path).removesuffix("::self"), name if path != "self" else path
            start = place + 1


def absolute(path: str, module: str, modules: Iterable[str]) -> str | None:
    """A path from the crate's root on; None for one that leads out of the crate."""
    parts, here = path.split("::"), module.split("::") if module else []
    if "::".join([*here, parts[0]]) in modules:
        return "::".join([*here, *parts])
    if parts[0] not in {"crate", "super", "self"}:
        return None
    if parts[0] == "crate":
        return "::".join(parts[1:])
    while parts and parts[0] in {"super", "self"}:
        here = here[:-1] if parts.pop(0) == "super" else here
    return "::".join(here + parts)


def graph(root: Path) -> Graph:
    texts = {module_of(path, root): without_comments(path.read_text(encoding="utf-8")) for path in root.rglob("*.rs")}
    handed_on: dict[str, str] = {}
    for module, text in texts.items():
        for tree in re.findall(r"\bpub(?:\([a-z]+\))? use ([^;]+);", text):
            for path, name in leaves(tree):
                source = absolute(path, module, texts)
                if source is not None:
                    handed_on[f"{module}::{name}".removeprefix("::")] = source

    def home(path: str) -> str:
        """The file in which the thing of a path is written."""
        while path in handed_on and handed_on[path] != path:
            path = handed_on[path]
        while path not in texts:
            path = path.rpartition("::")[0]
        return path

    edges: Graph = {module: set() for module in texts}
    for module, text in texts.items():
        found = {path for tree in re.findall(r"\buse ([^;]+);", text) for path, _ in leaves(tree)}
        found |= set(re.findall(r"(?<!::)\b\w+(?:::\w+)+", re.sub(r"\buse [^;]+;", "", text)))
        places = (absolute(path, module, texts) for path in found)
        edges[module] |= {home(place) for place in places if place is not None} - {module}
    for module, used in methods(texts):
        edges[module] |= used - {module}
    return edges


def methods(texts: dict[str, str]) -> Iterator[tuple[str, set[str]]]:
    """Each file with those that define the methods which it calls on `self`."""
    defined: dict[tuple[str, str], str] = {}
    blocks: list[tuple[str, str, str]] = []
    for module, text in texts.items():
        for kind, body in re.findall(
            r"^impl(?:<[^>]*>)? (\w+)(?:<[^>]*>)? \{\n(.*?)^\}", text, re.MULTILINE | re.DOTALL
        ):
            blocks.append((module, kind, body))
            defined |= {(kind, name): module for name in re.findall(r"\bfn (\w+)", body)}
    for module, kind, body in blocks:
        calls = re.findall(r"\bself\s*\.\s*(\w+)(?:::<[^>]*>)?\(", body)
        yield module, {defined[kind, name] for name in calls if (kind, name) in defined}


def cycle(edges: Graph) -> list[str]:
    """Files each of which uses the next, and the last the first; empty where there are none."""
    done: set[str] = set()

    def walk(module: str, way: list[str]) -> list[str]:
        if module in way:
            return way[way.index(module) :]
        if module in done:
            return []
        found = next((c for other in sorted(edges[module]) if (c := walk(other, [*way, module]))), [])
        done.add(module)
        return found

    return next((found for module in sorted(edges) if (found := walk(module, []))), [])


def test_use_runs_one_way() -> None:
    edges = graph(SOURCES)
    assert len(edges) > 60 and sum(map(len, edges.values())) > 200
    assert not cycle(edges)
