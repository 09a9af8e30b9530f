"""What the tests of a surface's maps share: maps written and read, and places that are known."""

from __future__ import annotations

from pathlib import Path

import bpy
import mathutils
import numpy as np
import OpenEXR

from tests.blender.material_cases import plane

SIZE = 128


def written(
    material: bpy.types.Material,
    folder: Path,
    *,
    uv_map="",
    used=((0, 0),),
    alike=False,
    size=SIZE,
):
    from tvbrdf.tvbrdf_addon.material.reading.tiles import Tiles
    from tvbrdf.tvbrdf_addon.material.surface_maps.maps import write_surface

    scene = bpy.context.scene
    return write_surface(
        *(material, scene, 1),
        uv_map=uv_map,
        tiles=Tiles(used),
        kept=folder / "kept",
        alike=alike,
        size=size,
    )


def read_map(folder: Path, name: str) -> np.ndarray:
    channels = OpenEXR.File(str(folder / f"{name}.exr")).channels()
    pixels = next(iter(channels.values())).pixels
    assert pixels.dtype == np.float32
    return pixels


def maps_of(material: bpy.types.Material, folder: Path, **settings) -> dict[str, np.ndarray]:
    maps = written(material, folder, **settings)
    assert maps.folder is not None, maps.notes
    names = ("position", "normal", "ao", "edge", "sky")
    return {name: read_map(maps.folder, name) for name in names}


def cube(material: bpy.types.Material, **settings) -> bpy.types.Object:
    """A cube of 2 x 2 x 2, unwrapped to a cross."""
    bpy.ops.mesh.primitive_cube_add(**settings)
    bpy.context.object.data.materials.append(material)
    return bpy.context.object


def unwrap(*objects: bpy.types.Object) -> None:
    """Smart UV Project of all together."""
    bpy.ops.object.select_all(action="DESELECT")
    for obj in objects:
        obj.select_set(True)
    bpy.context.view_layer.objects.active = objects[0]
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(island_margin=0.02)
    bpy.ops.object.mode_set(mode="OBJECT")


def surface_points(
    obj: bpy.types.Object, count: int = 2000, uv_map: str = ""
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random places on an object as the view shows it, their UVs, and their faces' normals."""
    seen = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = seen.to_mesh()
    mesh.calc_loop_triangles()
    layer = mesh.uv_layers[uv_map] if uv_map else mesh.uv_layers.active
    rng = np.random.default_rng(0)
    triangles = list(mesh.loop_triangles)
    areas = np.array([each.area for each in triangles])
    places, uvs, normals = [], [], []
    turn = seen.matrix_world.to_3x3().inverted().transposed()
    for index in rng.choice(len(triangles), count, p=areas / areas.sum()):
        each, weights = triangles[index], rng.dirichlet((1, 1, 1))
        corners = [seen.matrix_world @ mesh.vertices[i].co for i in each.vertices]
        places.append(
            sum((c * w for c, w in zip(corners, weights, strict=True)), mathutils.Vector((0, 0, 0)))
        )
        uvs.append(
            sum(
                (layer.data[i].uv * w for i, w in zip(each.loops, weights, strict=True)),
                mathutils.Vector((0, 0)),
            )
        )
        normals.append((turn @ each.normal).normalized())
    seen.to_mesh_clear()
    return np.array(places), np.array(uvs), np.array(normals)


def texels(pixels: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """What a map shows at UVs [N, 2]."""
    height, width = pixels.shape[:2]
    column = (uv[:, 0] * width).astype(int).clip(0, width - 1)
    return pixels[((1 - uv[:, 1]) * height).astype(int).clip(0, height - 1), column]


def errors(maps: dict[str, np.ndarray], obj: bpy.types.Object, **settings) -> np.ndarray:
    """How far the position map is from the places themselves, in the world's units."""
    places, uv, _ = surface_points(obj, **settings)
    found = texels(maps["position"], uv)
    assert (found[:, 3] == 1).all(), "each place of the surface has a texel"
    return np.linalg.norm(found[:, :3] - places, axis=1)


def monkey(material) -> bpy.types.Object:
    bpy.ops.mesh.primitive_monkey_add()
    bpy.context.object.data.materials.append(material)
    unwrap(bpy.context.object)
    return bpy.context.object


def tiled(material) -> list[bpy.types.Object]:
    obj = plane(material)
    for corner in obj.data.uv_layers[0].data:
        corner.uv *= 5
    return [obj]


def without_uvs(material) -> list[bpy.types.Object]:
    obj = cube(material)
    obj.data.uv_layers.remove(obj.data.uv_layers[0])
    return [obj]


def everything() -> dict[str, object]:
    """What a person or a script could see of the file's data."""
    kinds = ("objects", "meshes", "materials", "scenes", "images", "node_groups", "collections")
    seen: dict[str, object] = {
        kind: [each.name for each in getattr(bpy.data, kind)] for kind in kinds
    }
    for mesh in bpy.data.meshes:
        seen[mesh.name] = [each.name for each in mesh.attributes]
        seen[f"{mesh.name} places"] = [tuple(vertex.co) for vertex in mesh.vertices]
        seen[f"{mesh.name} UVs"] = [tuple(c.uv) for layer in mesh.uv_layers for c in layer.data]
    return seen
