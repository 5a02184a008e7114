"""MJCF and URDF files as compiled MuJoCo models, for solver, physics and pictures.

Functions import MuJoCo, as its import takes 0.25 s.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

from retarget.errors import ConfigError, InputError, install_step
from retarget.model.body_xml import BODY_HELP, body_xml, read_body
from retarget.model.compile_limits import try_in_child
from retarget.schema.catalogue import shipped_folder

Root = Literal["free", "fixed", "suspended"]
"""Root of a body: `free` floats, `fixed` is bolted down, `suspended` hangs from a stand."""

_EMPTY_GEOM = re.compile(r"size \d must be positive in geom Element name '.*', id (\d+)")


@dataclass(frozen=True, eq=False)
class BodyFile:
    """A compiled body. model: `mujoco.MjModel`; spec: its `mujoco.MjSpec`; notes: for the user, on changes and unused
    parts."""

    source: str
    model: Any
    spec: Any
    root: Root
    notes: tuple[str, ...]


def engine() -> Any:
    """Import `mujoco` with its warnings off, as it logs them to a file in the working folder. Raises ConfigError if it
    is missing or broken."""
    try:
        import mujoco
    except ImportError as error:
        raise ConfigError(
            "MuJoCo is missing, which reads robots and simulates them",
            found=str(error),
            next_step=install_step("mujoco"),
        ) from error
    mujoco.set_mju_user_warning(ignore_warning)
    return mujoco


def ignore_warning(text: str) -> None:
    """Ignore a warning of MuJoCo."""


def compile_body(path: Path, *, root: Root | None = None) -> BodyFile:
    """Read and compile an MJCF or URDF file, by its content.

    Every link is kept. root: "free" adds a free joint if there is none, "fixed" and "suspended" remove it; None leaves
    the file as it is. Untrusted files are compiled in a child process first; see `try_in_child`. Raises InputError.
    """
    mujoco, urdf, content = engine(), *_checked(path)
    if not path.resolve().is_relative_to(shipped_folder()):
        _try(path, sha256(content).digest(), urdf=urdf)
    return _compile(lambda: mujoco.MjSpec.from_file(str(path)), urdf=urdf, source=str(path), root=root)


def body_spec(path: Path, *, root: Root) -> Any:
    """The `mujoco.MjSpec` of a file that `compile_body` has read."""
    mujoco, urdf, _ = engine(), *_checked(path)
    spec, _, _ = _prepared(lambda: mujoco.MjSpec.from_file(str(path)), urdf=urdf, source=str(path), root=root)
    return spec


def compile_body_text(text: str, *, source: str, root: Root | None = None, own: bool = False) -> BodyFile:
    """Compile a body from MJCF or URDF text; `source` names it in messages. own: made by this program."""
    mujoco = engine()
    content = text.encode(errors="replace")  # for half of a surrogate pair
    urdf = body_xml(content, source=source, folder=Path()).kind == "urdf"

    def compiled(root: Root | None = None) -> BodyFile:
        return _compile(lambda: mujoco.MjSpec.from_string(content.decode()), urdf=urdf, source=source, root=root)

    if not own:
        try_in_child(compiled, source=source)
    return compiled(root)


def _checked(path: Path) -> tuple[bool, bytes]:
    """True for a URDF, and the content. Raises InputError."""
    content = read_body(path)
    return body_xml(content, source=str(path), folder=path.parent).kind == "urdf", content


@lru_cache(maxsize=64)
def _try(path: Path, digest: bytes, *, urdf: bool) -> None:
    """Compile a file in a child process, once for a content. Raises InputError."""
    mujoco, source = engine(), str(path)
    parse = partial(mujoco.MjSpec.from_file, source)
    try_in_child(partial(_compile, parse, urdf=urdf, source=source, root=None), source=source)


def _compile(parse: Callable[[], Any], *, urdf: bool, source: str, root: Root | None) -> BodyFile:
    spec, found, notes = _prepared(parse, urdf=urdf, source=source, root=root)
    while True:
        try:
            model = spec.compile()
            break
        except (ValueError, RuntimeError) as error:
            if not (urdf and _drop_meshes(spec, notes)):
                raise refusal(source, error, spec) from error
    _check(model, source=source)
    for kind, parts in (("equality constraints", spec.equalities), ("tendons", spec.tendons)):
        names = [part.name or "unnamed" for part in parts]  # not in a kinematic tree
        if names:
            shown = ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")
            notes.append(f"{len(names)} {kind} not used, their joints move independently: {shown}")
    return BodyFile(source=source, model=model, spec=spec, root=found, notes=tuple(notes))


def _prepared(parse: Callable[[], Any], *, urdf: bool, source: str, root: Root | None) -> tuple[Any, Root, list[str]]:
    notes: list[str] = []
    try:
        spec = parse()
        spec.compiler.fusestatic = False
        if urdf:
            # Kinematics needs no inertias, and URDF files often have links without mass and invalid inertias.
            spec.compiler.balanceinertia = True
            spec.compiler.boundmass = max(spec.compiler.boundmass, 1e-9)
            spec.compiler.boundinertia = max(spec.compiler.boundinertia, 1e-12)
        for key in list(spec.keys):  # these have the size of the file's own root
            spec.delete(key)
        return spec, _set_root(spec, root, source=source, notes=notes), notes
    except (ValueError, RuntimeError) as error:
        raise refusal(source, error) from error


def refusal(source: str, error: Exception, spec: Any = None) -> InputError:
    """The error for a body that MuJoCo refuses. spec: gives link and line of a geom of size 0."""
    reason = " ".join(str(error).split())[:500]
    if "ould not allocate memory" in reason or "unknown exception" in reason:  # of C++ without memory
        raise MemoryError(reason) from error
    empty = _EMPTY_GEOM.search(reason)
    if spec is None or empty is None:
        return InputError("not a usable body", where=source, found=reason, next_step=BODY_HELP)
    geom = next(geom for geom in spec.geoms if geom.id == int(empty[1]))
    link = geom.parent.name
    line = geom.info.removeprefix("line ")
    if not line and Path(source).is_file():  # MuJoCo keeps no lines of URDF, so that of the link is given
        urdf = Path(source).read_text(encoding="utf-8", errors="replace")
        begun = re.search(rf"<link\s[^>]*\bname\s*=\s*(['\"]){re.escape(link)}\1", urdf)
        line = "" if begun is None else str(urdf.count("\n", 0, begun.start()) + 1)
    return InputError(
        "a shape of size 0",
        where=f"{source}:{line}" if line else source,
        found=f"on link {link!r}",
        allowed="sizes above 0",
        next_step="Give it a size, or remove it",
    )


def _set_root(spec: Any, root: Root | None, *, source: str, notes: list[str]) -> Root:
    """Add or remove the free joint for a root; returns the root."""
    import mujoco

    free = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    if len(free) > 1:
        names = ", ".join(joint.parent.name or "unnamed" for joint in free)
        raise InputError(
            "more than one free body", where=source, found=names, allowed="one", next_step="Keep the robot only"
        )
    if root is None:
        return "free" if free else "fixed"
    if root != "free":
        for joint in free:
            notes.append(f"free joint of '{joint.parent.name}' removed: the root is {root}")
            spec.delete(joint)
        return root
    if not free:
        base = _single_base(spec, source=source)
        base.add_freejoint(name="root")
        notes.append(f"free joint added to '{base.name}'")
    return "free"


def _single_base(spec: Any, *, source: str) -> Any:
    bases = list(spec.worldbody.bodies)
    if len(bases) != 1:
        names = ", ".join(body.name or "unnamed" for body in bases) or "none"
        raise InputError("no single root link to set free", where=source, found=names, allowed="one link on the world")
    if list(bases[0].joints):
        raise InputError(
            "the root link cannot be set free",
            where=source,
            found=f"'{bases[0].name}' already moves on joint '{bases[0].joints[0].name}'",
            allowed="a root link without joints, or with a free joint",
        )
    return bases[0]


def _drop_meshes(spec: Any, notes: list[str]) -> bool:
    """Remove mesh shapes of a URDF, whose masses are in <inertial>. Returns False without any."""
    import mujoco

    shapes = [geom for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH]
    for geom in shapes:
        spec.delete(geom)
    for mesh in list(spec.meshes):
        spec.delete(mesh)
    if shapes:
        notes.append(f"{len(shapes)} mesh shapes left out: their files cannot be read")
    return bool(shapes)


def _check(model: Any, *, source: str) -> None:
    if model.nbody < 2:
        raise InputError("the body has no links", where=source, next_step=BODY_HELP)
    if model.nv == 0:
        raise InputError("nothing moves", where=source, found="no joints", allowed="at least one joint")
    try:
        model.names.decode()
    except UnicodeDecodeError as error:
        raise refusal(source, error) from error
    check_numbers(model, source=source)


def check_numbers(model: Any, *, source: str) -> None:
    """Raise InputError for `nan` or `inf` in a compiled `mujoco.MjModel`, with links and joints."""
    broken = _without_numbers(model)
    if broken:
        raise InputError(
            "places, axes, sizes or masses that are no finite numbers",
            where=source,
            found=", ".join(broken[:5]) + (", ..." if len(broken) > 5 else ""),
            next_step="Look there for 'nan' and 'inf', also in the files of meshes",
        )


def _without_numbers(model: Any) -> list[str]:
    import numpy as np

    def of(owners: Any, *arrays: Any) -> list[int]:
        finite = np.all([np.isfinite(array).all(axis=tuple(range(1, array.ndim))) for array in arrays], axis=0)
        return sorted({int(owner) for owner in np.asarray(owners)[~finite]})

    every = np.arange(model.nbody)
    placed = of(every, model.body_pos, model.body_quat, model.body_ipos, model.body_mass, model.body_inertia)
    shaped = of(model.geom_bodyid, model.geom_pos, model.geom_quat, model.geom_size)
    turned = of(np.arange(model.njnt), model.jnt_pos, model.jnt_axis, model.jnt_range)
    found = [("link", model.body(index)) for index in sorted({*placed, *shaped})]
    found += [("joint", model.joint(index)) for index in turned]
    return [f"{kind} {part.name or part.id}" for kind, part in found]
