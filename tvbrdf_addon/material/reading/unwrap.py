"""Whether a mesh is unwrapped so that it can be baked to, or aged by its UVs."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np
from numpy.typing import NDArray

from ...errors import MaterialError
from .evaluated import Evaluated

__all__ = (
    "active_uv_map",
    "check_unwrapped",
    "covered",
    "flat_share",
    "overlaps",
    "require_faces",
    "require_uv_map",
    "shows",
    "slots_with",
    "squares",
    "triangles",
)

Array = NDArray[np.float32]

# UV area, of the square from 0 to 1, below which a triangle has none.
_NO_AREA = 1e-9
# Of a square, how far UVs may reach beyond it before they lie on another: rounding, half texels.
_BEYOND = 0.05
# What is infinite, or nearly, lies here: outside of everything.
_FARTHEST = 1e6


def active_uv_map(mesh: bpy.types.Mesh) -> str | None:
    """The UV map that is used for rendering; None where there is none."""
    layers = mesh.uv_layers
    return next((each.name for each in layers if each.active_render), None)


def shows(look: Evaluated, material: bpy.types.Material) -> bool:
    """Whether any face of an object shows `material`."""
    look.mesh.calc_loop_triangles()
    return bool(_shown(look.mesh, slots_with(look.mesh, material)).any())


def require_faces(look: Evaluated, material: bpy.types.Material, frame: int) -> None:
    """Raises `MaterialError` where the object has nothing to bake to, which Cycles can die of."""
    mesh, name = look.mesh, f"“{look.obj.name}”"
    if not mesh.polygons:
        raise MaterialError(
            f"{name} has no faces at frame {frame}: its modifiers leave none.",
            "Start at a frame on which it has some, or select another object.",
        )
    corners = _corners(mesh, slots_with(mesh, material))
    if not shows(look, material):
        raise MaterialError(
            f"No face of {name} shows “{material.name}”.",
            "Assign the material to some faces, or select another object.",
        )
    if not _areas(corners).any():
        raise MaterialError(
            f"The faces of {name} that show “{material.name}” have no area at frame {frame}.",
            "Start at a frame on which they have, or select another object.",
        )


def require_uv_map(look: Evaluated, *, needed: bool) -> None:
    """Raises `MaterialError` where the faces of an object have no UV map to render with.

    Unless it is `needed` for more, a start everywhere at once is another way out.
    """
    if look.mesh.polygons and active_uv_map(look.mesh) is None:
        raise MaterialError(
            f"The modifiers of “{look.obj.name}” leave no UV map.",
            "Apply them (Object > Convert > Mesh) and unwrap the result (UV > Smart UV Project)"
            + (".", ", or set Start to Everywhere at Once.")[not needed],
        )


def check_unwrapped(look: Evaluated, material: bpy.types.Material, uv_map: str, size: int) -> None:
    """Raises `MaterialError` where the material's faces leave the unit square by half a texel, or
    have no area in it.
    """
    _, uv = triangles(look.mesh, slots_with(look.mesh, material), uv_map)
    if uv.min() < -0.5 / size or uv.max() > 1 + 0.5 / size:
        raise MaterialError(
            f"The UV map “{uv_map}” of “{look.obj.name}” reaches outside the square from 0 to 1, "
            f"and “{material.name}” has to be baked.",
            "Give the mesh a second UV map that fits (UV > Smart UV Project), mark it for "
            "rendering, and name the old one in UV Map nodes.",
        )
    if not (_areas(uv) > _NO_AREA).any():
        raise MaterialError(
            f"The UV map “{uv_map}” of “{look.obj.name}” has no area, and “{material.name}” has to "
            "be baked.",
            "Unwrap the mesh (UV > Smart UV Project).",
        )


def overlaps(
    look: Evaluated,
    material: bpy.types.Material,
    uv_map: str,
    coverage: Array,
    tiles: int = 1,
) -> bool:
    """Whether the material's faces cover more of UV space than they leave marked in `coverage`,
    which shows so many `tiles` of it.

    A tenth is allowed for the texels that borders cut.
    """
    _, uv = triangles(look.mesh, slots_with(look.mesh, material), uv_map)
    marked = tiles * np.count_nonzero(coverage) / coverage.size
    return bool(_areas(uv).sum() > 1.1 * marked + 1e-3)


def flat_share(look: Evaluated, material: bpy.types.Material, uv_map: str) -> float:
    """The share of the material's surface that lies on points or lines of the UV map."""
    corners, uv = triangles(look.mesh, slots_with(look.mesh, material), uv_map)
    area = _areas(corners)
    return float(area[_areas(uv) <= _NO_AREA].sum() / max(area.sum(), 1e-30))


def squares(look: Evaluated, material: bpy.types.Material, uv_map: str) -> tuple[int, int]:
    """How many squares of UV space, across and up, the material's faces lie on."""
    _, uv = triangles(look.mesh, slots_with(look.mesh, material), uv_map)
    if not len(uv):
        return 1, 1
    across, up = np.ceil(np.ptp(uv, axis=(0, 1)) - _BEYOND).clip(1).astype(int).tolist()
    return across, up


def covered(uv: Array, side: int) -> NDArray[np.bool_]:
    """Where triangles [T, 3, 2] lie in the square from 0 to 1, which repeats: [side, side], row 0
    at the top, and no cell that one touches left out.
    """
    cells = np.zeros((side, side), bool)
    if (_inner_radii(uv) > 0.75).any():  # a whole square lies in it
        return np.ones_like(cells)
    while len(uv) and not cells.all():
        u, v = np.moveaxis(np.floor(uv * side).astype(np.int64) % side, -1, 0)
        cells[side - 1 - v, u] = True
        long = np.ptp(uv, axis=1).max(1) * side > 1
        if np.count_nonzero(long) > 4 * cells.size:
            return np.ones_like(cells)  # so many that hardly any is left
        uv = _quartered(uv[long])
    # A triangle may cross the corner of a cell in which it has no point that was looked at.
    return _grown(cells)


def _inner_radii(uv: Array) -> Array:
    """Of the circles in triangles [T, 3, 2]: [T]."""
    sides = np.linalg.norm(uv - np.roll(uv, 1, axis=1), axis=-1).sum(1)
    return 2 * _areas(uv) / np.maximum(sides, 1e-30)


def _quartered(triangles: Array) -> Array:
    a, b, c = np.moveaxis(triangles, 1, 0)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
    return np.concatenate([np.stack(part, 1) for part in parts])


def _grown(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    for axis in (0, 1):
        cells = cells | np.roll(cells, 1, axis) | np.roll(cells, -1, axis)
    return cells


def slots_with(mesh: bpy.types.Mesh, material: bpy.types.Material) -> list[bool]:
    """Which of a mesh's materials is this one."""
    return [each == material for each in mesh.materials]


def triangles(mesh: bpy.types.Mesh, slots: Sequence[bool], uv_map: str) -> tuple[Array, Array]:
    """The triangles of `mesh` that show one of the materials marked in `slots`.

    Corners in the object's space [T, 3, 3] and UVs [T, 3, 2].
    """
    corners = _corners(mesh, slots)
    uv = np.empty(len(mesh.loops) * 2, np.float32)
    mesh.uv_layers[uv_map].data.foreach_get("uv", uv)
    loops = _of_triangles(mesh, "loops", 3)[_shown(mesh, slots)]
    return corners, uv.reshape(-1, 2)[loops].clip(-_FARTHEST, _FARTHEST)


def _corners(mesh: bpy.types.Mesh, slots: Sequence[bool]) -> Array:
    mesh.calc_loop_triangles()
    places = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.vertices.foreach_get("co", places)
    return places.reshape(-1, 3)[_of_triangles(mesh, "vertices", 3)[_shown(mesh, slots)]]


def _shown(mesh: bpy.types.Mesh, slots: Sequence[bool]) -> NDArray[np.bool_]:
    faces = _of_triangles(mesh, "material_index", 1)[:, 0]
    if not slots:
        return np.zeros(len(faces), bool)
    return np.array(slots)[np.clip(faces, 0, len(slots) - 1)]


def _of_triangles(mesh: bpy.types.Mesh, name: str, width: int) -> NDArray[np.int32]:
    values = np.empty(len(mesh.loop_triangles) * width, np.int32)
    mesh.loop_triangles.foreach_get(name, values)
    return values.reshape(-1, width)


def _areas(corners: Array) -> Array:
    """Of triangles [T, 3, 2 or 3]: [T]."""
    first, second = (corners[:, i].astype(np.float64) - corners[:, 0] for i in (1, 2))
    if corners.shape[-1] == 2:
        return np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / 2
    return np.linalg.norm(np.cross(first, second), axis=1) / 2
