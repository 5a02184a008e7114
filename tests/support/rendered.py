"""A performer before a camera, as a video, with the truth beside it: our virtual human as capsules in clothes, with
hair, eyes, nose and mouth, drawn by MuJoCo without a screen (MUJOCO_GL=egl or osmesa).

The performer stands at the origin and faces x; the camera stands on x, `DISTANCE` away, and looks back at them.
"""

import os
import subprocess
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

os.environ.setdefault("MUJOCO_GL", "egl")  # before mujoco is imported

import mujoco

from retarget.model.human import Human, PostureReader, build_human
from retarget.model.human_dimensions import POINTS, kind_of, proportional_dimensions
from retarget.types import FloatArray

Image = NDArray[np.uint8]
"""(height, width, 3), RGB."""

WIDTH, HEIGHT, RATE = 640, 480, 30.0
DISTANCE, CAMERA_HEIGHT, FIELD_DEG = 3.0, 1.0, 48.0
"""m, m, and degrees from the lowest to the highest line of the picture: a laptop's camera."""
SKIN, HAIR, DARK, WHITE, LIPS = "0.85 0.62 0.5", "0.16 0.1 0.06", "0.05 0.05 0.06", "0.95 0.95 0.95", "0.65 0.25 0.25"
SHIRT, TROUSERS, SHOES = "0.15 0.35 0.7", "0.2 0.2 0.24", "0.3 0.18 0.1"
CLOTHES = {
    **dict.fromkeys(("pelvis", "hip", "knee"), TROUSERS),
    "ankle": SHOES,
    **dict.fromkeys(("neck", "head", "elbow", "wrist"), SKIN),
}
"""Kind of link -> its colour; all else is the shirt's."""
STOUTER = {"arm": 1.6, "hand": 1.5, "leg": 1.8, "trunk": 1.4}
"""The body's capsules are those of its observers, inside of the flesh: drawn thicker by this. Drawn as they are, the
tracker takes the arms of one who stands for folded, or sees a back."""
PARTS = {
    **dict.fromkeys(("shoulder", "elbow"), "arm"),
    "wrist": "hand",
    **dict.fromkeys(("hip", "knee", "ankle"), "leg"),
    **dict.fromkeys(("pelvis", "spine", "chest", "collar"), "trunk"),
}
"""Kind of link -> the part of the body that it is drawn as."""
NOISE = 3.0
"""Standard deviation of a camera's noise, of 255."""


@dataclass(frozen=True, eq=False)
class Motion:
    """Postures of a performer. human; q (T, nq): at RATE; joints (T, 23, 3) m: centres of POINTS, the truth."""

    human: Human
    q: FloatArray
    joints: FloatArray

    def of(self, name: str) -> FloatArray:
        """Track (T, 3) m of a point."""
        return self.joints[:, POINTS.index(name)]

    @property
    def time(self) -> FloatArray:
        """(T,) s."""
        return np.arange(len(self.q)) / RATE


RELAXED = (("shoulder_elevation", 18.0), ("shoulder_swing", -18.0), ("elbow_flexion", 20.0))
"""Degrees: arms hang a little aside, elbows a little bent, as people stand."""


def performer(stature: float = 1.75) -> Human:
    """A person of average proportions."""
    return build_human(proportional_dimensions(stature))


def moving(human: Human, angles_deg: dict[str, FloatArray | float], *, pitch: FloatArray | float = 0.0) -> Motion:
    """A motion from tracks (T,) of joints by their names, degrees, the feet where they stand.

    pitch (T,): forward lean of the pelvis, degrees. Joints' limits are not kept.
    """
    frames = max(np.size(track) for track in angles_deg.values())
    q = np.tile(human.posture_from([*RELAXED, ("hip_abduction", 4.0)]), (frames, 1))
    _, address = human.body.scalar_joints()
    for motion, track in angles_deg.items():
        for name in [motion] if motion in human.body.dof_names else [f"l_{motion}", f"r_{motion}"]:
            q[:, address[human.body.dof_index(name)]] = np.deg2rad(track)
    lean = 0.5 * np.deg2rad(np.broadcast_to(pitch, frames))
    q[:, 3:7] = np.stack([np.cos(lean), 0.0 * lean, np.sin(lean), 0.0 * lean], axis=1)
    return planted(human, q)


def planted(human: Human, q: FloatArray) -> Motion:
    """The motion of postures q (T, nq), moved so that the ankles' middle stays over the origin at standing height."""
    reader = PostureReader(human)
    ankles = [POINTS.index("l_ankle"), POINTS.index("r_ankle")]
    height = human.dimensions.pelvis_height + human.dimensions.standing()[ankles[0], 2]
    q = q.copy()
    q[:, :3] += [0.0, 0.0, height] - reader.joints(q)[:, ankles].mean(axis=1)
    return Motion(human, q, reader.joints(q))


def _rise(seconds: float, *, begin: float, last: float) -> FloatArray:
    """0, then smoothly up to 1 in `last` s from `begin`, and down again before the end, at RATE."""
    time = np.arange(round(seconds * RATE)) / RATE
    return np.asarray(_step((time - begin) / last) * _step((seconds - begin - time) / last))


def _step(share: FloatArray) -> FloatArray:
    share = np.clip(share, 0.0, 1.0)
    return np.asarray(share * share * (3.0 - 2.0 * share))


def standing(human: Human, seconds: float) -> Motion:
    """Standing still, arms hanging."""
    return moving(human, {"elbow_flexion": np.full(round(seconds * RATE), 20.0)})


def raising(human: Human, sides: str, *, seconds: float = 5.0, swing: float = 35.0) -> Motion:
    """Arms of these sides ("l", "r", "lr") up to shoulder height and down again; swing: 45 straight to the front, -45
    to the side."""
    rise = _rise(seconds, begin=1.0, last=1.2)
    tracks: dict[str, FloatArray | float] = {}
    tracks |= {f"{side}_shoulder_elevation": 18.0 + 72.0 * rise for side in sides}
    tracks |= {f"{side}_shoulder_swing": -18.0 + (18.0 + swing) * rise for side in sides}
    return moving(human, tracks)


def waving(human: Human, *, hz: float = 0.5, seconds: float = 10.0, side: str = "l") -> Motion:
    """One arm held aside, its forearm waving in the plane of the picture."""
    time = np.arange(round(seconds * RATE)) / RATE
    begin = _step(time / 1.0)
    tracks: dict[str, FloatArray | float] = {
        f"{side}_shoulder_elevation": 18.0 + (52.0 + 20.0 * np.sin(2.0 * np.pi * hz * time)) * begin,
        f"{side}_shoulder_swing": -18.0 - 22.0 * begin,
        f"{side}_elbow_flexion": 20.0 + 10.0 * begin,
    }
    return moving(human, tracks)


def crouching(human: Human, depth: float = 0.3, *, seconds: float = 6.0) -> Motion:
    """Down by `depth` m at the pelvis and up again, feet planted, leaning a little forward."""
    thigh, shank = human.dimensions.length("l_knee"), human.dimensions.length("l_ankle")
    angles = np.linspace(0.0, np.pi / 2.0, 500)  # of the thigh; the shank leans half as far
    drop = thigh * (1.0 - np.cos(angles)) + shank * (1.0 - np.cos(0.5 * angles))
    leg = np.rad2deg(np.interp(depth * _rise(seconds, begin=1.0, last=1.5), drop, angles))
    lean = 0.3 * leg
    tracks = {"hip_flexion": leg + lean, "knee_flexion": 1.5 * leg, "ankle_dorsiflexion": 0.5 * leg}
    return moving(human, {**tracks}, pitch=lean)


def stepping(human: Human, *, seconds: float = 5.0, lift: float = 40.0) -> Motion:
    """The left foot lifted by bending hip and knee, the right one planted."""
    rise = _rise(seconds, begin=1.0, last=0.8)
    motion = moving(human, {"l_hip_flexion": lift * rise, "l_knee_flexion": 2.0 * lift * rise})
    q = motion.q.copy()
    q[:, :3] -= motion.of("r_ankle") - motion.of("r_ankle")[0]
    return Motion(human, q, PostureReader(human).joints(q))


def drawn(
    motion: Motion, *, face: bool = True, stout: bool = True, distance: float = DISTANCE, noise: float = NOISE
) -> Iterator[Image]:
    """The pictures of a motion. face: without one, all in the colour of skin, a tracker sees a back.
    stout: see STOUTER. distance: of the camera, m. noise: of each pixel, of 255."""
    model = _model(motion.human, face=face, stout=stout, distance=distance)
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
        for q in motion.q:
            data.qpos[:] = q
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, camera="camera")
            picture = renderer.render() + noise * random.standard_normal((HEIGHT, WIDTH, 3), np.float32)
            yield np.clip(picture, 0.0, 255.0).astype(np.uint8)


def write_video(path: Path, pictures: Iterable[Image]) -> None:
    """A film for Chromium's fake camera: .y4m, or .mjpeg, which is smaller."""
    kind = ["-pix_fmt", "yuv420p"] if path.suffix == ".y4m" else ["-c:v", "mjpeg", "-q:v", "3", "-pix_fmt", "yuvj420p"]
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{WIDTH}x{HEIGHT}", "-r", f"{RATE:g}", "-i", "-"]
    command = ["ffmpeg", "-y", "-loglevel", "error", *raw, *kind, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE) as process:
        assert process.stdin is not None
        for picture in pictures:
            process.stdin.write(picture.tobytes())
    assert process.returncode == 0, f"ffmpeg ended with {process.returncode}"


def _model(human: Human, *, face: bool, stout: bool, distance: float) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(human.mjcf)
    spec.visual.global_.offwidth, spec.visual.global_.offheight = WIDTH, HEIGHT
    spec.add_texture(
        name="wall",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.75, 0.74, 0.7],
        rgb2=[0.6, 0.6, 0.6],
        width=64,
        height=64,
    )
    world = spec.worldbody
    _shape(world, "plane", (0.0, 0.0, 0.0), (5.0, 5.0, 0.1), "0.5 0.42 0.34")
    lamp = {"type": mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, "diffuse": [0.6, 0.6, 0.6]}
    world.add_light(pos=[2.0, 1.5, 3.5], dir=[-0.5, -0.35, -0.8], castshadow=True, **lamp)
    towards_them = [0.5, 0.5, 0.5, 0.5]  # image right is the world's y, image up its z
    world.add_camera(name="camera", pos=[distance, 0.0, CAMERA_HEIGHT], quat=towards_them, fovy=FIELD_DEG)
    for geom in spec.geoms:
        if geom.name:
            kind = kind_of(geom.name)
            geom.rgba = [*map(float, (CLOTHES.get(kind, SHIRT) if face else SKIN).split()), 1.0]
            geom.size = [(STOUTER[PARTS[kind]] if stout and kind in PARTS else 1.0) * geom.size[0], *geom.size[1:]]
    if face:
        _add_face(spec, human)
    return spec.compile()


def _add_face(spec: mujoco.MjSpec, human: Human) -> None:
    """Hair, eyes, nose, mouth and ears on the head's sphere."""
    sphere = next(geom for geom in spec.geoms if geom.name == "head")
    neck, centre, radius = spec.body("neck"), np.array(sphere.pos), float(sphere.size[0])

    def add(kind: str, at: tuple[float, float, float], size: tuple[float, ...], colour: str) -> None:
        _shape(neck, kind, centre + radius * np.array(at), tuple(radius * np.array(size)), colour)

    add("sphere", (-0.14, 0.0, 0.14), (1.02,), HAIR)
    for side in (1.0, -1.0):
        add("ellipsoid", (0.9, 0.34 * side, 0.16), (0.1, 0.17, 0.1), WHITE)
        add("sphere", (0.97, 0.34 * side, 0.16), (0.08,), DARK)
        add("ellipsoid", (0.88, 0.34 * side, 0.36), (0.08, 0.2, 0.04), HAIR)
        add("ellipsoid", (-0.05, 1.0 * side, 0.0), (0.2, 0.08, 0.26), SKIN)
    add("ellipsoid", (1.02, 0.0, -0.08), (0.16, 0.1, 0.2), SKIN)
    add("ellipsoid", (0.86, 0.0, -0.44), (0.08, 0.28, 0.06), LIPS)


def _shape(body: mujoco.MjsBody, kind: str, at: Iterable[float], size: tuple[float, ...], colour: str) -> None:
    body.add_geom(
        type=getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}"),
        pos=list(at),
        size=[*size, 0.0, 0.0][:3],
        rgba=[*map(float, colour.split()), 1.0],
        contype=0,
        conaffinity=0,
        mass=0.0,
    )
