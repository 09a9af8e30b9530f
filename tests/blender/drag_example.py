"""Takes the library's materials into an empty file as a drag does, without extension and scripts.

python drag_example.py LIBRARY.blend append|link

An appended material ages by its own Age, a linked one by the Age of the object that shows it.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from small_scene import pixels_of

SIZE = 16


def plane() -> bpy.types.Object:
    """A plane without the UV map or the size of what the materials were made on, in light."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.mesh.primitive_plane_add(size=3)
    thing = bpy.context.object
    thing.data.uv_layers[0].name = "Another"
    scene = bpy.context.scene
    lamp = bpy.data.objects.new("Light", bpy.data.lights.new("Light", "SUN"))
    lamp.data.energy, lamp.rotation_euler = 3.0, (0.5, 0.2, 0.0)
    camera = scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (0, 0, 4)
    for each in (lamp, camera):
        scene.collection.objects.link(each)
    scene.render.engine, scene.cycles.samples = "CYCLES", 4
    scene.cycles.use_denoising, scene.cycles.max_bounces = False, 0
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.image_settings.file_format = "OPEN_EXR"
    return thing


def picture(folder: Path) -> np.ndarray:
    path = folder / "picture.exr"
    bpy.context.scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return pixels_of(path).reshape(SIZE, SIZE, 4)[..., :3]


def look(library: Path, name: str, *, link: bool, folder: Path) -> None:
    thing = plane()
    with bpy.data.libraries.load(str(library), link=link) as (_, wanted):
        wanted.materials = [name]
    (material,) = wanted.materials
    thing.data.materials.append(material)
    assert material["Age"] == 0.5
    assert not material.animation_data, "an asset has a slider, not keys"
    assert all(each.packed_file and each.size[0] for each in bpy.data.images if each.users)
    drivers = material.node_tree.animation_data.drivers
    assert drivers
    assert all(each.driver.is_simple_expression for each in drivers)
    owner = thing if link else material
    seen = []
    for age in (0.0, 0.5, 1.0):
        owner["Age"] = age
        owner.update_tag()
        seen.append(picture(folder))
    young, half, old = seen
    steps = [float(np.abs(a - b).mean() / young.mean()) for a, b in ((young, half), (half, old))]
    print(f"{name}: {'linked' if link else 'appended'}, changes {steps[0]:.2f} and {steps[1]:.2f}")
    assert min(steps) > 0.03
    # Pink is what Blender shows for an image that is lost.
    assert not (np.abs(np.stack(seen) / np.stack(seen).max() - (1, 0, 1)) < 0.01).all(-1).any()


def main() -> None:
    library, how = Path(sys.argv[1]), sys.argv[2]
    assert not hasattr(bpy.types.Material, "tvbrdf")
    assert not bpy.context.preferences.filepaths.use_scripts_auto_execute
    bpy.ops.wm.open_mainfile(filepath=str(library), use_scripts=False)
    offered = {each.name: each.asset_data for each in bpy.data.materials if each.asset_data}
    assert len(offered) == 3
    for name, data in offered.items():
        assert data.description, name
        assert (data.author, data.license) == ("Age Material", "CC0-1.0")
        assert len(data.tags) >= 3
        assert tuple(bpy.data.materials[name].preview.image_size) == (256, 256)
    with tempfile.TemporaryDirectory() as folder:
        for name in list(offered):
            look(library, name, link=how == "link", folder=Path(folder))


main()
