"""What is said of a reading: where something will surprise, one sentence each; else nothing."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import read
from tests.blender.material_cases import (
    add,
    image,
    link,
    new_material,
    plane,
    procedural,
    read_maps,
)
from tests.blender.object_cases import modified

pytestmark = pytest.mark.usefixtures("empty_scene")


def stretched(obj: bpy.types.Object, across: float, up: float) -> None:
    for corner in obj.data.uv_layers[0].data:
        corner.uv = (corner.uv.x * across, corner.uv.y * up)


def with_image(pixels: np.ndarray) -> bpy.types.Material:
    material = new_material()
    node = add(material, "ShaderNodeTexImage", image=image("Image", pixels))
    link(material, node.outputs["Color"], "Base Color")
    return material


# Where UVs spoil a pattern


def test_uvs_without_area(tmp_path):
    material = new_material()
    obj = plane(material)
    stretched(obj, 0, 1)
    (warning,) = read(material, obj, tmp_path).warnings
    assert warning.startswith("The UV map “UVMap” of “Plane” has no area")
    assert warning.endswith("or set Start to Everywhere at Once.")
    material.tvbrdf.onset = "none"
    assert read(material, obj, tmp_path).warnings == ()


def test_another_object_without_uvs(tmp_path):
    material = new_material()
    obj, other = plane(material), plane(material)
    assert read(material, obj, tmp_path).warnings == ()
    other.data.uv_layers.remove(other.data.uv_layers[0])
    (warning,) = read(material, obj, tmp_path).warnings
    assert warning.startswith(f"“{other.name}” has no UV map, so that it ages alike all over")


def test_a_palette_of_colors_ages_in_flat_faces(tmp_path):
    """As low-poly models are colored: each face lies on one point of a small image."""
    material = with_image(np.random.default_rng(0).random((4, 4, 3)))
    bpy.ops.mesh.primitive_cube_add()
    obj = bpy.context.object
    obj.data.materials.append(material)
    for i, corner in enumerate(obj.data.uv_layers[0].data):
        corner.uv = (i // 4 / 8 + 0.1, 0.4)
    (warning,) = read(material, obj, tmp_path).warnings
    assert "has no area" in warning


def test_uvs_over_many_squares(tmp_path):
    material = new_material()
    obj = plane(material)
    stretched(obj, 6, 2.5)
    (warning,) = read(material, obj, tmp_path).warnings
    assert "reaches over 6 x 3 squares, and the pattern of aging repeats" in warning
    material.tvbrdf.onset = "none"
    assert read(material, obj, tmp_path).warnings == ()


def test_modifiers_move_uvs_over_squares(tmp_path):
    material = new_material()
    obj = plane(material)
    modified(obj, "ARRAY", count=3, offset_u=1.0)
    (warning,) = read(material, obj, tmp_path).warnings
    assert "reaches over 3 x 1 squares" in warning


def test_an_image_that_repeats_does_so_in_any_case(tmp_path):
    material = with_image(np.random.default_rng(0).random((4, 4, 3)))
    obj = plane(material)
    stretched(obj, 6, 6)
    assert read(material, obj, tmp_path).warnings == ()


# Where one texture serves many objects


def test_what_depends_on_uvs_alone_is_right_on_other_objects(tmp_path):
    material = new_material()
    coordinates, wave = add(material, "ShaderNodeTexCoord"), add(material, "ShaderNodeTexWave")
    material.node_tree.links.new(coordinates.outputs["UV"], wave.inputs["Vector"])
    link(material, wave.outputs["Color"], "Base Color")
    obj = plane(material)
    plane(material)
    assert read(material, obj, tmp_path).warnings == ()


def test_linked_duplicates_show_what_their_mesh_does(tmp_path):
    material = new_material()
    procedural(material)
    obj = plane(material)
    bpy.context.scene.collection.objects.link(obj.copy())
    assert read(material, obj, tmp_path).warnings == ()


def test_but_not_what_is_each_ones_own(tmp_path):
    material = new_material()
    link(material, add(material, "ShaderNodeObjectInfo").outputs["Random"], "Roughness")
    obj = plane(material)
    bpy.context.scene.collection.objects.link(obj.copy())
    (warning,) = read(material, obj, tmp_path).warnings
    assert "1 more object(s) use it" in warning


# Texels of images that no face covers


def atlas() -> np.ndarray:
    """An image of which the left half is used."""
    pixels = np.full((64, 64, 3), 0.5)
    pixels[:, 32:] = 0
    return pixels


def test_the_unused_part_of_an_atlas(tmp_path: Path):
    material = with_image(atlas())
    obj = plane(material)
    stretched(obj, 0.5, 1)
    assert read(material, obj, tmp_path).warnings == ()
    covered = read_maps(tmp_path / "maps")["Coverage"][..., 0] > 0
    half = covered.shape[1] // 2
    assert covered[:, :half].all()
    assert covered[:, half + 2 : -2].sum() == 0


def test_all_users_count_and_repetition_covers_all(tmp_path: Path):
    material = with_image(atlas())
    first, second = plane(material), plane(material)
    stretched(first, 0.5, 1)
    for corner in second.data.uv_layers[0].data:
        corner.uv = (corner.uv.x * 0.5 - 3.5, corner.uv.y)
    read(material, first, tmp_path)
    assert "Coverage" not in read_maps(tmp_path / "maps")


# Nothing is said where nothing is wrong


def _coordinates(material: bpy.types.Material, rng: np.random.Generator) -> bpy.types.NodeSocket:
    node, mapping = add(material, "ShaderNodeTexCoord"), add(material, "ShaderNodeMapping")
    kind = rng.choice(["UV", "Object", "Generated"])
    mapping.inputs["Scale"].default_value = rng.uniform(0.5, 3, 3)
    material.node_tree.links.new(node.outputs[kind], mapping.inputs["Vector"])
    return mapping.outputs["Vector"]


def _textured(material: bpy.types.Material, rng: np.random.Generator) -> bpy.types.NodeSocket:
    kind = rng.choice(["Noise", "Voronoi", "Wave", "Brick", "Magic", "Checker", "Gradient"])
    node = add(material, f"ShaderNodeTex{kind}")
    if "Scale" in node.inputs:
        node.inputs["Scale"].default_value = rng.uniform(1, 12)
    if rng.random() < 0.7:
        material.node_tree.links.new(_coordinates(material, rng), node.inputs["Vector"])
    return node.outputs["Color"]


def _pictured(material: bpy.types.Material, rng: np.random.Generator) -> bpy.types.NodeSocket:
    node = add(material, "ShaderNodeTexImage", image=image("Image", rng.random((32, 32, 3))))
    return node.outputs["Color"]


def random_material(seed: int) -> bpy.types.Material:
    """A Principled material as one may find it: plain, of images, procedural, or mixed."""
    rng = np.random.default_rng(seed)
    material = new_material(f"Random {seed}")
    sources: list[Callable] = [_textured, _pictured]
    for socket in ("Base Color", "Metallic", "Roughness", "Specular IOR Level"):
        made = rng.choice(["value", "value", "source", "ramp", "mix"])
        if made == "value":
            continue
        output = rng.choice(sources)(material, rng)
        if made == "ramp":
            ramp = add(material, "ShaderNodeValToRGB")
            material.node_tree.links.new(output, ramp.inputs[0])
            output = ramp.outputs["Color"]
        if made == "mix":
            mix = add(material, "ShaderNodeMixRGB")
            material.node_tree.links.new(output, mix.inputs[1])
            material.node_tree.links.new(_textured(material, rng), mix.inputs[2])
            output = mix.outputs["Color"]
        link(material, output, socket)
    return material


def usual_mesh(seed: int) -> bpy.types.Object:
    """A mesh with the UVs that Blender gives it, at times with a modifier that all use."""
    rng = np.random.default_rng(seed)
    kind = rng.choice(["plane", "cube", "uv_sphere", "ico_sphere", "cylinder", "cone", "torus"])
    getattr(bpy.ops.mesh, f"primitive_{kind}_add")()
    obj = bpy.context.object
    modifier = rng.choice(["", "SUBSURF", "BEVEL", "TRIANGULATE"])
    if modifier:
        modified(obj, modifier)
    return obj


@pytest.mark.slow
def test_of_a_hundred_usual_materials_nothing_is_said(tmp_path):
    said = {}
    for seed in range(100):
        material, obj = random_material(seed), usual_mesh(seed)
        obj.data.materials.append(material)
        reading = read(material, obj, tmp_path)
        if warnings := reading.warnings + reading.lost:
            said[seed, obj.name] = warnings
    assert len(said) <= 2, said


@pytest.mark.slow
def test_of_scanned_materials_nothing_is_said(tmp_path, data_folder):
    for folder in sorted((data_folder / "pbr").iterdir()):
        if not folder.is_dir():
            continue
        material = new_material(folder.name)
        for socket, word in (
            ("Base Color", "Color"),
            ("Roughness", "Roughness"),
            ("Metallic", "Metalness"),
        ):
            for file in folder.glob(f"*_{word}.*"):
                node = add(material, "ShaderNodeTexImage", image=bpy.data.images.load(str(file)))
                node.image.colorspace_settings.is_data = word != "Color"
                link(material, node.outputs["Color"], socket)
        assert material.node_tree.links[1:], f"{folder} holds no maps"
        obj = usual_mesh(len(bpy.data.objects))
        obj.data.materials.append(material)
        reading = read(material, obj, tmp_path)
        assert reading.warnings + reading.lost == (), (folder.name, obj.name)
