"""COLLADA meshes (.dae) as triangles, read with pycollada, and triangles as binary STL."""

import re
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retarget.errors import InputError, install_step
from retarget.types import FloatArray

COLLADA = ".dae"
_ENTITY = re.compile(rb"<!(?:DOCTYPE|ENTITY)")


def collada_triangles(content: bytes, *, source: str) -> FloatArray:
    """The triangles (t, 3, 3), m, of all geometry of the scene of a COLLADA file, as its nodes place it, in the file's
    unit and axes: `up_axis` turns nothing, as in ROS (rviz, Gazebo), for which such URDF are written.

    Raises InputError: pycollada is missing, or the file is none that it can read.
    """
    try:
        import collada
    except ImportError:
        what = "COLLADA meshes (.dae) need pycollada"
        raise InputError(
            what, next_step=install_step("pycollada") + ", or give --no-meshes to leave them out"
        ) from None
    try:
        if _ENTITY.search(content):
            raise ValueError("entities, which no mesh needs")
        # What is wrong with materials and pictures does not matter here.
        file = collada.Collada(BytesIO(content), ignore=[collada.common.DaeError])
        metres = float(file.assetInfo.unitmeter or 1.0)
        placed = [] if file.scene is None else [*file.scene.objects("geometry")]
        found = [_corners(part) for one in placed for part in one.primitives()]
    except Exception as error:
        reason = str(error).strip().splitlines() or [type(error).__name__]
        step = "Export it again, or convert it to .stl beside it"
        raise InputError("a mesh that cannot be read", where=source, found=reason[0][:200], next_step=step) from error
    return metres * np.concatenate([np.zeros((0, 3, 3)), *found])


def _corners(primitive: Any) -> FloatArray:
    """Corners (t, 3, 3) of a bound primitive of triangles or polygons; none of lines."""
    if hasattr(primitive, "triangleset"):
        primitive = primitive.triangleset()
    index = primitive.vertex_index
    if index is None or index.ndim != 2 or index.shape[1] != 3:
        return np.zeros((0, 3, 3))
    corners: FloatArray = np.asarray(primitive.vertex, dtype=float)[index]
    return corners


def binary_stl(corners: NDArray[np.floating[Any]]) -> bytes:
    """Triangles (t, 3, 3) as a binary STL file."""
    rows = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    rows["corners"] = corners
    return bytes(80) + len(corners).to_bytes(4, "little") + rows.tobytes()
