"""The body file of a drafted profile: a copy where it stands by itself, else MJCF with simple shapes and no files."""

import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from retarget import rotations
from retarget.errors import InputError
from retarget.model.body_file import check_numbers, engine, refusal
from retarget.model.compile_limits import try_in_child
from retarget.model.scene_shapes import ShapeKind
from retarget.setup.robot_file import Source, listed, ready_urdf
from retarget.setup.shape_fit import NAME, LinkGeometry, Zones, canonical_shape, link_geometries, propose
from retarget.types import FloatArray

# Meshes of a body as capsules and boxes: what is left of them in a body file that stands by itself.

ZONES = Zones(influence=0.03, margin=0.005)
"""Distances, m, that `propose` wants for an observer: it fits the shapes around meshes, too."""


def replace_meshes(spec: Any, model: Any, geometries: tuple[LinkGeometry, ...]) -> int:
    """Put one shape around the geometry of each link that has a mesh, in place of all its geoms; how many."""
    import mujoco

    mesh = mujoco.mjtGeom.mjGEOM_MESH
    meshes = [geom for geom in range(model.ngeom) if model.geom_type[geom] == mesh]
    links = {model.body(int(model.geom_bodyid[geom])).name for geom in meshes}
    proposals = propose(tuple(one for one in geometries if one.name in links), ZONES)
    for proposal in proposals:
        body = spec.body(proposal.link_name)
        for geom in list(body.geoms):
            spec.delete(geom)
        kind, size, pos, quat = canonical_shape(proposal.shape)
        name = "SPHERE" if kind is ShapeKind.CAPSULE and not size[1] else kind.name
        geom_type = getattr(mujoco.mjtGeom, f"mjGEOM_{name}")
        body.add_geom(name=f"{proposal.link_name}_shell", type=geom_type, size=size, pos=pos, quat=quat)
    for geom in list(spec.geoms):  # of links that no profile can name
        if geom.type == mesh:
            spec.delete(geom)
    return len(proposals)


_THIN = re.compile(r"mesh volume is too small: (\S+)")


@dataclass(frozen=True, eq=False)
class BodyDraft:
    """spec, model: `mujoco.MjSpec` and `mujoco.MjModel` of the whole source, meshes and all, with the names of the body
    that is written. file, content: that body. notes: what was changed, for the user."""

    spec: Any
    model: Any
    file: str
    content: bytes
    notes: tuple[str, ...]


def draft_body(source: Source, *, no_meshes: bool = False) -> BodyDraft:
    """The body that is written next to the profile. no_meshes: leave out meshes that cannot be read.

    Raises InputError: the body cannot be used, or takes too much to be compiled, see `try_in_child`.
    """
    engine()
    work = partial(_drafted, source, no_meshes=no_meshes)
    try_in_child(work, source=str(source.path))
    return work()


def _drafted(source: Source, *, no_meshes: bool) -> BodyDraft:
    mujoco = engine()
    notes: list[str] = []
    spec = None
    try:
        if source.kind == "urdf":
            text, meshes = ready_urdf(source, notes, no_meshes=no_meshes)
            spec = mujoco.MjSpec.from_string(text, assets=meshes)
            spec.compiler.balanceinertia, spec.compiler.discardvisual = True, False
            spec.compiler.boundmass = max(spec.compiler.boundmass, 1e-9)
            spec.compiler.boundinertia = max(spec.compiler.boundinertia, 1e-12)
            rewrite = any(True for _ in source.root.iter("visual"))
        else:
            spec = mujoco.MjSpec.from_file(str(source.path))
            _leave_out_absent_meshes(spec, source, notes, no_meshes=no_meshes)
            _freeze_passive(spec, notes)
            rewrite = _unpainted(spec) or source.included or bool(list(spec.hfields) or list(spec.skins))
        spec.compiler.fusestatic = False
        _rename(spec, notes)
        rewrite |= bool(notes or list(spec.meshes))
        model = _compiled(spec)
        check_numbers(model, source=str(source.path))
        if not rewrite:
            file = "body.urdf" if source.kind == "urdf" else "body.xml"
            return BodyDraft(spec, model, file, source.content, tuple(notes))
        content = _rewritten(spec.copy(), model, notes)
        return BodyDraft(spec, model, "body.xml", content, tuple(notes))
    except (ValueError, RuntimeError) as error:
        raise refusal(str(source.path), error, spec) from error


def facing_x(body: BodyDraft, forward: FloatArray) -> BodyDraft:
    """Turn a body about the vertical so that `forward` (3,) is along x (REP-103), as MJCF."""
    turn = rotations.from_axis_angle(np.array([0.0, 0.0, 1.0]), -np.arctan2(forward[1], forward[0]))
    spec = body.spec
    for base in spec.worldbody.bodies:
        base.pos = rotations.rotate(turn, base.pos)
        base.quat = rotations.multiply(turn, base.quat)
    model = _compiled(spec)
    notes = [*body.notes, "the body is turned about the vertical, to face along x"]
    return BodyDraft(spec, model, "body.xml", _rewritten(spec.copy(), model, notes), tuple(dict.fromkeys(notes)))


def _compiled(spec: Any) -> Any:
    """The model, without keys of the file's own size, and with meshes of no volume as shells."""
    for key in list(spec.keys):  # of the size of the file's own root
        spec.delete(key)
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


def _rewritten(spec: Any, model: Any, notes: list[str]) -> bytes:
    """MJCF of the same joints, masses and simple shapes, without what only a simulation or a picture needs."""
    for body in spec.bodies[1:]:
        number = model.body(body.name).id
        body.explicitinertial = True
        body.mass, body.inertia = float(model.body_mass[number]), model.body_inertia[number]
        body.ipos, body.iquat = model.body_ipos[number], model.body_iquat[number]
        body.fullinertia = np.full(6, np.nan)
    count = replace_meshes(spec, model, link_geometries(model)[0]) if model.nmesh else 0
    if count:
        notes.append(f"meshes of {count} links are capsules and boxes around them in the body that is written")
    for kind in ("sensors", "equalities", "tendons", "meshes", "hfields", "skins", "lights", "cameras"):
        for part in list(getattr(spec, kind)):
            spec.delete(part)
    for geom in list(spec.worldbody.geoms):
        spec.delete(geom)
    _unpainted(spec)  # of a URDF
    spec.meshdir, spec.texturedir = "", ""
    spec.compile()
    return str(spec.to_xml()).encode()


def _unpainted(spec: Any) -> bool:
    """Leave out textures; materials stay, as default classes may name them. Returns whether one was a file."""
    files = any(texture.file or any(texture.cubefiles) for texture in spec.textures)
    for material in (*spec.materials, spec.default.material):
        material.textures = [""] * len(material.textures)
    for texture in list(spec.textures):
        spec.delete(texture)
    return files


def _rename(spec: Any, notes: list[str]) -> None:
    """Give every link and joint a name that a profile can hold."""
    changed = []
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
            part.name = name
            taken.add(name)
    if changed:
        notes.append(f"names that a profile cannot hold were changed: {listed(changed)}")


def _leave_out_absent_meshes(spec: Any, source: Source, notes: list[str], *, no_meshes: bool) -> None:
    """Leave out meshes whose files are missing. Raises InputError without the option --no-meshes."""
    import mujoco

    folder = source.path.parent / spec.meshdir
    absent = {mesh.name or Path(mesh.file).stem: mesh.file for mesh in spec.meshes if mesh.file}
    absent = {name: file for name, file in absent.items() if not (folder / file).is_file()}
    if not absent:
        return
    if not no_meshes:
        raise InputError(
            "meshes that cannot be read, without which soles and hands cannot be found",
            where=str(source.path),
            found=listed(list(absent.values())),
            allowed=f"files in {folder}",
            next_step="Put them there, or give --no-meshes to leave them out",
        )
    for geom in list(spec.geoms):
        if geom.type == mujoco.mjtGeom.mjGEOM_MESH and geom.meshname in absent:
            spec.delete(geom)
    for mesh in list(spec.meshes):
        if (mesh.name or Path(mesh.file).stem) in absent:
            spec.delete(mesh)
    notes.append(f"{len(absent)} meshes that cannot be read are left out: {listed(list(absent.values()))}")


def _freeze_passive(spec: Any, notes: list[str]) -> None:
    """Make rigid what no servo of its own turns: joints that slide, balls, joints coupled by an equality, and those
    without an actuator among joints with one."""
    import mujoco

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
    for actuator in list(spec.actuators):
        if actuator.target in stuck_names:
            spec.delete(actuator)
    for kind in ("sensors", "equalities", "tendons"):
        for part in list(getattr(spec, kind)):
            spec.delete(part)
    for joint in stuck:
        spec.delete(joint)
    notes.append(f"joints made rigid, as no servo of their own turns them: {listed(stuck_names)}")
