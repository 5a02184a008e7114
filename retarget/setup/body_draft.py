"""The body file of a drafted profile: MJCF with simple shapes that needs no other file."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from retarget import rotations
from retarget.errors import InputError
from retarget.model.body import geoms_of
from retarget.model.body_file import check_numbers, engine, refusal
from retarget.model.compile_limits import try_in_child
from retarget.model.meshes import Mesh, link_looks
from retarget.model.scene_shapes import ShapeKind
from retarget.setup.robot_file import MeshFiles, ReadyUrdf, Source, listed, missing_meshes, ready_urdf
from retarget.setup.shape_fit import NAME, LinkShape, fitted_shapes
from retarget.types import FloatArray

FAR_TOO_LARGE = 5.0
"""A mesh larger than this multiple of the distance between the joints is in another unit."""
WHOLE_TURN = 2.0 * np.pi + 1e-3
"""Greatest limit in rad. Greater ones may be in degrees."""
MOST_LOOKS, LEAST_VERTICES, LOOK_DECIMALS = 11_000, 4, 5
"""Triangles of all visual meshes, about (`meshes.MOST_TRIANGLES` shows them all), fewest vertices of a mesh in MuJoCo,
and decimals of vertices in m."""
_THIN = re.compile(r"mesh volume is too small: (\S+)")

Looks = dict[tuple[str, tuple[float, float, float] | None], Mesh]
"""Visual meshes by link and colour."""


@dataclass(frozen=True, eq=False)
class BodyDraft:
    """A drafted body. spec, model: `mujoco.MjSpec` and `mujoco.MjModel` of the source, with its meshes. content: the
    written MJCF. shapes: in place of meshes. notes: changes. limits: joint -> change. speeds: joint -> rad/s in the
    file. welded: True if its torso is fixed to a link `world`. hints: names of meshes, which may name servos.
    too_large: a sentence on meshes in another unit, or ""."""

    spec: Any
    model: Any
    content: bytes
    shapes: tuple[LinkShape, ...] = ()
    notes: tuple[str, ...] = ()
    limits: dict[str, str] = field(default_factory=dict)
    speeds: dict[str, float] = field(default_factory=dict)
    welded: bool = False
    hints: tuple[str, ...] = ()
    too_large: str = ""
    looks: Looks = field(default_factory=dict)


def draft_body(source: Source, *, no_meshes: bool = False) -> BodyDraft:
    """Draft the body of a profile. no_meshes: leave out unreadable meshes. Raises InputError if the body cannot be
    used, or takes too much to compile, see `try_in_child`."""
    engine()
    work = partial(_drafted, source, no_meshes=no_meshes)
    try_in_child(work, source=str(source.path))
    return work()


def _drafted(source: Source, *, no_meshes: bool) -> BodyDraft:
    try:
        return _read_and_written(source, no_meshes=no_meshes, sees=True)
    except InputError as error:
        if source.root.find("link/visual") is None:
            raise
        # Faulty visual meshes do not refuse a body.
        draft = _read_and_written(source, no_meshes=no_meshes, sees=False)
        return replace(draft, notes=(*draft.notes, f"its <visual> meshes are left out: {error.problems[0].what}"))


def _read_and_written(source: Source, *, no_meshes: bool, sees: bool) -> BodyDraft:
    """Draft a body. sees: also keep <visual> shapes of links with <collision> shapes."""
    mujoco = engine()
    meshes, spec = MeshFiles(source.path, leaves_out=no_meshes), None
    ready = ReadyUrdf("", [])
    try:
        if source.kind == "urdf":
            ready = ready_urdf(source, meshes, no_meshes=no_meshes, looks=sees)
            spec = mujoco.MjSpec.from_string(ready.text)
            for joint in spec.joints:  # MuJoCo does not distinguish no limits from limits that it drops
                joint.limited = joint.name in ready.limited
            spec.compiler.balanceinertia = True
            spec.compiler.boundmass = max(spec.compiler.boundmass, 1e-9)
            spec.compiler.boundinertia = max(spec.compiler.boundinertia, 1e-12)
        else:
            spec = mujoco.MjSpec.from_file(str(source.path))
            _read_meshes(spec, source, meshes, ready.notes, no_meshes=no_meshes)
            _freeze_passive(spec, ready.notes)
        notes = ready.notes
        spec.assets = {**spec.assets, **meshes.contents}
        spec.compiler.fusestatic = False
        _strip(spec)
        renamed = _rename(spec, notes)
        limits = _mend_limits(spec, source, notes)
        model = _compiled(spec)
        check_numbers(model, source=str(source.path))
        shapes = fitted_shapes(model, source=str(source.path))
        looks = _looks(spec, model, shapes, notes)
        written = _written(spec, model, shapes, looks)
        return BodyDraft(
            spec,
            model,
            written,
            shapes,
            tuple(notes),
            limits,
            {renamed.get(name, name): speed for name, speed in ready.speeds.items()},
            ready.welded,
            hints=tuple(meshes.names.values()),
            too_large=_far_too_large(model, meshes),
            looks=looks,
        )
    except (ValueError, RuntimeError) as error:
        raise refusal(str(source.path), type(error)(meshes.in_words(str(error))), spec) from error


def facing_x(body: BodyDraft, forward: FloatArray) -> BodyDraft:
    """Rotate a body about the vertical so that `forward` (3,) is along x (REP-103)."""
    turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), -np.arctan2(forward[1], forward[0]))
    for base in body.spec.worldbody.bodies:
        base.pos = rotations.rotate(turn, base.pos)
        base.quat = rotations.multiply(turn, base.quat)
    model, notes = _compiled(body.spec), list(body.notes)
    content = _written(body.spec, model, body.shapes, body.looks)
    notes.append("the body is turned about the vertical, to face along x")
    return replace(body, model=model, content=content, notes=tuple(notes))


def _compiled(spec: Any) -> Any:
    """Compile the model, with meshes without volume as shells."""
    shell = engine().mjtMeshInertia.mjMESH_INERTIA_SHELL
    while True:
        try:
            return spec.compile()
        except ValueError as error:
            thin = _THIN.search(str(error))
            mesh = None if thin is None else spec.mesh(thin.group(1))
            if mesh is None or mesh.inertia == shell:
                raise
            mesh.inertia = shell  # a plate or an open surface has no volume


def _strip(spec: Any) -> None:
    """Delete parts that only a simulation or a picture needs. Materials stay, since default classes may name them."""
    hfield = engine().mjtGeom.mjGEOM_HFIELD
    for kind in ("keys", "sensors", "equalities", "tendons", "skins", "lights", "cameras"):
        for part in list(getattr(spec, kind)):
            spec.delete(part)
    for geom in list(spec.worldbody.geoms):
        spec.delete(geom)
    for geom in list(spec.geoms):
        if geom.type == hfield:
            spec.delete(geom)
    for part in list(spec.hfields):
        spec.delete(part)
    for material in (*spec.materials, spec.default.material):
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)


def _looks(spec: Any, model: Any, shapes: tuple[LinkShape, ...], notes: list[str]) -> Looks:
    """Return coarse meshes of links that have some, one for each colour, for pictures."""
    mesh = engine().mjtGeom.mjGEOM_MESH
    meshed = {shape.link_name for shape in shapes if shape.around_mesh}
    shown = {
        body.name
        for body in spec.bodies[1:]
        for geom in body.geoms
        if body.name in meshed or (geom.type == mesh and not _collides(geom))
    }
    if shown - meshed:
        notes.append(f"pictures keep the visual meshes of {len(shown - meshed)} links, coarser")
    if meshed:
        notes.append(f"meshes of {len(meshed)} links are capsules and boxes around them; pictures keep them, coarser")
    links = {model.body(name).id: name for name in shown}
    found = link_looks(geoms_of(model), links, most=MOST_LOOKS) if links else {}
    return {(links[link], colour): mesh for (link, colour), mesh in found.items()}


def _written(spec: Any, model: Any, shapes: tuple[LinkShape, ...], looks: Looks) -> bytes:
    """Return MJCF with the same joints and masses. One simple shape replaces all colliding ones of a link with a
    mesh."""
    mujoco = engine()
    spec, mesh = spec.copy(), mujoco.mjtGeom.mjGEOM_MESH
    meshed = {shape.link_name for shape in shapes if shape.around_mesh}
    for body in spec.bodies[1:]:
        number = model.body(body.name).id
        body.explicitinertial = True
        body.mass, body.inertia = float(model.body_mass[number]), model.body_inertia[number]
        body.ipos, body.iquat = model.body_ipos[number], model.body_iquat[number]
        body.fullinertia = np.full(6, np.nan)
        for geom in list(body.geoms):
            if geom.type == mesh or geom.meshname or (body.name in meshed and _collides(geom)):
                spec.delete(geom)
    for shape in shapes:
        if shape.link_name in meshed:
            name = "SPHERE" if shape.kind is ShapeKind.CAPSULE and not shape.size[1] else shape.kind.name
            kind = getattr(mujoco.mjtGeom, f"mjGEOM_{name}")
            place = {"size": shape.size, "pos": shape.pos, "quat": shape.quat}
            spec.body(shape.link_name).add_geom(name=f"{shape.link_name}_shell", type=kind, **place)
    for part in list(spec.meshes):
        spec.delete(part)
    _add_looks(spec, looks)
    spec.meshdir, spec.texturedir = "", ""
    spec.compile()
    return str(spec.to_xml()).encode()


def _collides(geom: Any) -> bool:
    return bool(geom.contype or geom.conaffinity)


def _add_looks(spec: Any, looks: Looks) -> None:
    if not looks:
        return
    mujoco = engine()
    spec.compiler.discardvisual = False  # of a URDF
    numbers = dict.fromkeys((link for link, _ in looks), 0)
    for (link, colour), mesh in looks.items():
        places, corner = np.unique(mesh.vertices.round(LOOK_DECIMALS), axis=0, return_inverse=True)
        if len(places) < LEAST_VERTICES:
            continue
        numbers[link] += 1
        name = f"{link}_look{numbers[link] if numbers[link] > 1 else ''}"
        spec.add_mesh(
            name=name,
            uservert=places.ravel(),
            userface=corner.reshape(-1)[mesh.faces].ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        kind = mujoco.mjtGeom.mjGEOM_MESH
        look = spec.body(link).add_geom(name=name, type=kind, meshname=name, contype=0, conaffinity=0, group=2)
        if colour is not None:
            look.rgba = (*colour, 1.0)


def _far_too_large(model: Any, meshes: MeshFiles) -> str:
    """A note on meshes that are far larger than the distances between joints, and so in another unit; "" for none."""
    mujoco = engine()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    spread = float(np.linalg.norm(np.ptp(data.xanchor, axis=0))) if model.njnt else 0.0
    found = {}
    for mesh in range(model.nmesh):
        first = int(model.mesh_vertadr[mesh])
        points = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])]
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        if spread > 0.0 and size > FAR_TOO_LARGE * spread:
            found[meshes.in_words(f"'{model.mesh(mesh).name}'").strip("'")] = size
    if not found:
        return ""
    return (
        f"meshes of up to {max(found.values()):.3g} m, where all joints are within {spread:.2g} m: are they in mm? "
        f'Then write scale="0.001 0.001 0.001" into <mesh>: {listed(list(found))}'
    )


def _rename(spec: Any, notes: list[str]) -> dict[str, str]:
    """Give every link and joint a valid name. Returns the new names of joints by their old ones."""
    changed, renamed = [], dict[str, str]()
    for kind, parts in (("link", list(spec.bodies)[1:]), ("joint", list(spec.joints))):
        taken = {part.name for part in parts}
        for number, part in enumerate(parts, 1):
            if NAME.fullmatch(part.name):
                continue
            name = re.sub(r"[\s/\\]+", "_", part.name)[:80] or f"{kind}_{number}"
            while name in taken:
                name += "_"
            for actuator in spec.actuators if kind == "joint" and part.name else ():
                if actuator.target == part.name:
                    actuator.target = name
            changed.append(f"{part.name!r} is now {name}" if part.name else name)
            renamed |= {part.name: name} if kind == "joint" else {}
            part.name = name
            taken.add(name)
    if changed:
        notes.append(f"names that a profile cannot hold were changed: {listed(changed)}")
    return renamed


def _mend_limits(spec: Any, source: Source, notes: list[str]) -> dict[str, str]:
    """Fix limits that MuJoCo would drop, without widening a range. Returns joint -> change.

    If at least half of the limits are beyond a whole turn, all are in degrees. Raises InputError if fewer are, for
    limits that are not numbers, and if no joint has a range.
    """
    mujoco = engine()
    hinges = {joint.name: joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE}
    limited = mujoco.mjtLimited
    read = {
        name: joint.range.tolist()
        for name, joint in hinges.items()
        if joint.limited == limited.mjLIMITED_TRUE or (joint.limited == limited.mjLIMITED_AUTO and joint.range.any())
    }

    def shown(names: Iterable[str]) -> str:
        return listed([f"{name} ({read[name][0]:g} to {read[name][1]:g})" for name in names])

    rigid = [name for name, (low, high) in read.items() if low == high]
    ranges = {name: both for name, both in read.items() if both[0] != both[1]}
    beyond = [name for name, both in ranges.items() if not spec.compiler.degree and max(map(abs, both)) > WHOLE_TURN]
    in_degrees = 0 < len(ranges) <= 2 * len(beyond)
    swapped = [name for name, (low, high) in ranges.items() if low > high]
    if wrong := [name for name, both in read.items() if not np.isfinite(both).all()]:
        step = "Write numbers, the lower one first"
        raise InputError("limits that are no numbers", where=str(source.path), found=shown(wrong), next_step=step)
    if beyond and not in_degrees:
        raise InputError(
            "limits beyond a whole turn, among others that are not: are some, or all, in degrees?",
            where=str(source.path),
            found=shown(beyond),
            allowed="limits of one unit",
            next_step="Write all of them in rad; limits of a joint that makes more turns: at most 6.28",
        )
    if rigid and len(rigid) == len(hinges):
        step = "Write a lower and an upper limit for each joint that a servo turns"
        raise InputError("no joint has a range", where=str(source.path), found=shown(rigid), next_step=step)
    kinds = {
        "look like degrees": (
            list(ranges) if in_degrees else [],
            "limits that look like degrees, and are taken for that",
        ),
        "swapped": (swapped, "limits with the upper one first, exchanged"),
        "": (rigid, "joints whose lower limit is their upper one, made rigid; write a range where a servo turns them"),
    }
    notes += [f"{words}: {shown(names)}" for names, words in kinds.values() if names]
    changed = {}
    for name, both in ranges.items():
        if what := " and ".join(kind for kind, (names, _) in kinds.items() if name in names):
            hinges[name].range = np.radians(sorted(both)) if in_degrees else sorted(both)
            hinges[name].limited = limited.mjLIMITED_TRUE
            changed[name] = f"{what} in the file, {both[0]:g} to {both[1]:g}"
    _make_rigid(spec, [hinges[name] for name in rigid])
    return changed


def _read_meshes(spec: Any, source: Source, meshes: MeshFiles, notes: list[str], *, no_meshes: bool) -> None:
    """Read the meshes of an MJCF. Raises InputError for missing ones, without --no-meshes."""
    absent = {}
    for mesh in list(spec.meshes):
        if not mesh.file:
            continue
        name, mesh.name = str(Path(spec.meshdir, mesh.file)), mesh.name or Path(mesh.file).stem
        key = meshes.read(name)
        if key is None:
            absent[mesh.name] = mesh.file
            spec.delete(mesh)
        else:
            mesh.file = key
    spec.meshdir = ""
    problems = [missing_meshes(list(absent.values()), source)] if absent and not no_meshes else []
    if problems or meshes.problems:
        raise InputError.from_problems([*problems, *meshes.problems])
    for geom in list(spec.geoms):
        if geom.meshname in absent:
            spec.delete(geom)
    if absent:
        notes.append(f"{len(absent)} meshes that cannot be read are left out: {listed(list(absent.values()))}")


def _freeze_passive(spec: Any, notes: list[str]) -> None:
    """Make rigid all joints without a servo of their own: sliding and ball joints, joints coupled by an equality, and
    those without an actuator if others have one."""
    mujoco = engine()
    driven = {actuator.target for actuator in spec.actuators if actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT}
    coupled = {item.name1 for item in spec.equalities if item.type == mujoco.mjtEq.mjEQ_JOINT and item.name2}
    hinge, free = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_FREE
    names = {joint.name for joint in spec.joints} - coupled
    alone = names & driven if driven else names
    moving = [joint for joint in spec.joints if joint.type != free]
    stuck = [joint for joint in moving if joint.type != hinge or joint.name not in alone]
    if not stuck:
        return
    stuck_names = [joint.name or "without a name" for joint in stuck]
    for kind in ("sensors", "equalities", "tendons"):
        for part in list(getattr(spec, kind)):
            spec.delete(part)
    _make_rigid(spec, stuck)
    notes.append(f"joints made rigid, as no servo of their own turns them: {listed(stuck_names)}")


def _make_rigid(spec: Any, joints: list[Any]) -> None:
    names = {joint.name for joint in joints}
    for actuator in list(spec.actuators):
        if actuator.target in names:
            spec.delete(actuator)
    for joint in joints:
        spec.delete(joint)
