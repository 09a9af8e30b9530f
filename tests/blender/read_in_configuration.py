"""Reads a textured material in the OCIO configuration that the environment names, and shows what
Cycles renders of its color, for `test_configurations`.

Its argument is a folder for files; a line of JSON holds the numbers.  The project's root has to be
on the path.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import bpy
import numpy as np

import tests.conftest  # noqa: F401 (it finds the extension in the working tree)
import tvbrdf
from tests.blender.material_cases import (
    add,
    link,
    new_material,
    plane,
    read_maps,
    render,
    view_from_above,
)
from tvbrdf.tvbrdf_addon.material.reading.read import read


def main(folder: Path) -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    tvbrdf.register()
    material = new_material()
    color = add(material, "ShaderNodeTexImage", image=file_of(folder, "color", (188, 64, 20)))
    rough = add(material, "ShaderNodeTexImage", image=file_of(folder, "rough", (100, 100, 100)))
    rough.image.colorspace_settings.is_data = True
    link(material, color.outputs[0], "Base Color")
    link(material, rough.outputs[0], "Roughness")
    link(material, color.outputs[0], "Metallic")
    obj, scene = plane(material), bpy.context.scene
    read(material=material, obj=obj, scene=scene, folder=folder, size=4)
    maps = {name: values[0, 0].tolist() for name, values in read_maps(folder).items()}
    tree = material.node_tree
    emission = add(material, "ShaderNodeEmission")
    tree.links.new(color.outputs[0], emission.inputs[0])
    tree.links.new(emission.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
    view_from_above()
    # Written as they are in the scene's own colors, whatever these are called.
    scene.render.image_settings.color_management = "FOLLOW_SCENE"
    shown = render(folder / "shown" / "shown.exr", size=8)[4, 4]
    print(json.dumps({"maps": maps, "shown": shown.tolist()}))


def file_of(folder: Path, name: str, code: tuple[int, int, int]) -> bpy.types.Image:
    """A PNG of one color, with the color space that Blender presets for it."""
    image = bpy.data.images.new(name, 4, 4)
    image.pixels.foreach_set(np.tile(np.array((*code, 255), np.float32) / 255, 16))
    image.filepath_raw, image.file_format = str(folder / f"{name}.png"), "PNG"
    image.save()
    return bpy.data.images.load(image.filepath_raw, check_existing=False)


main(Path(sys.argv[1]))
