"""UDIM tiles: which are read, how they lie in one image, and that it shows what they showed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import bpy
import numpy as np
import pytest

from model_runtime.maps import PrincipledMaps
from model_runtime.reading.inputs import read_input
from tests.blender.aged_cases import bind
from tests.blender.material_cases import (
    add,
    image,
    link,
    new_material,
    principled_of,
    read_maps,
    render,
    snapshot,
    view_from_above,
)
from tests.blender.object_cases import paint
from tests.blender.test_frame_one import aged_authored, lit_scene, psnr
from tvbrdf.tvbrdf_addon.errors import MaterialError

pytestmark = pytest.mark.usefixtures("empty_scene")

SQUARE = {1001: (0, 0), 1002: (1, 0), 1011: (0, 1), 1012: (1, 1)}


def noise(seed: int, size: int = 16) -> np.ndarray:
    """Gray values [H, W, 3] that a byte holds to the bit."""
    values = np.random.default_rng(seed).integers(20, 250, (size, size, 1)) / np.float32(255)
    return values.repeat(3, 2)


def tiled(
    folder: Path, name: str, parts: Mapping[int, np.ndarray], *, colorspace: str = "Non-Color"
) -> bpy.types.Image:
    """An image of files `name`.1001.png and so on."""
    for number, values in parts.items():
        one = image("part", values, colorspace=colorspace)
        one.filepath_raw, one.file_format = str(folder / f"{name}.{number}.png"), "PNG"
        one.save()
        bpy.data.images.remove(one)
    made = bpy.data.images.load(str(folder / f"{name}.{min(parts)}.png"))
    made.name = name
    made.source = "TILED"
    made.filepath = str(folder / f"{name}.<UDIM>.png")
    for number in parts:
        if made.tiles.get(number) is None:
            made.tiles.new(number)
    made.colorspace_settings.name = colorspace
    return made


def squares(
    material: bpy.types.Material, tiles: Sequence[tuple[int, int]], name: str = "Squares"
) -> bpy.types.Object:
    """A unit square facing +z for each tile, where the tile lies in UV space, around the origin."""
    corners = [(u + x, v + y) for u, v in tiles for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    mesh = bpy.data.meshes.new(name)
    faces = [range(first, first + 4) for first in range(0, len(corners), 4)]
    mesh.from_pydata([(x - 1, y - 1, 0) for x, y in corners], [], faces)
    layer = mesh.uv_layers.new(name="UVMap")
    layer.data.foreach_set("uv", np.array(corners, np.float32).ravel())
    mesh.materials.append(material)
    obj = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def painted(folder: Path, parts: Mapping[int, np.ndarray], socket: str = "Roughness"):
    """A material that shows a tiled image."""
    material = new_material()
    node = add(material, "ShaderNodeTexImage", image=tiled(folder, socket, parts))
    node.interpolation = "Closest"
    link(material, node.outputs[0], socket)
    return material


def read(material, obj, folder: Path, size: int | None = 16):
    from tvbrdf.tvbrdf_addon.material.reading.read import read as read_material

    maps = folder / "maps"
    maps.mkdir(exist_ok=True)
    return read_material(
        material=material, obj=obj, scene=bpy.context.scene, folder=maps, size=size
    )


def refusal(material, obj, folder: Path) -> str:
    with pytest.raises(MaterialError) as caught:
        read(material, obj, folder)
    return str(caught.value)


def test_tiles_lie_side_by_side_as_in_uv_space(tmp_path):
    parts = {number: noise(number) for number in SQUARE}
    material = painted(tmp_path, parts)
    reading = read(material, squares(material, list(SQUARE.values())), tmp_path)
    assert reading.size == (32, 32)
    assert reading.warnings == ()
    rough = read_maps(tmp_path / "maps")["Roughness"][..., 0]
    for number, (u, v) in SQUARE.items():
        there = rough[16 * (1 - v) : 16 * (2 - v), 16 * u : 16 * (u + 1)]
        np.testing.assert_allclose(there, parts[number][..., 0], atol=1e-5, err_msg=str(number))


def test_only_tiles_with_faces_that_are_rendered_are_read(tmp_path):
    parts = {number: noise(number) for number in (1001, 1002, 1003, 1004)}
    material = painted(tmp_path, parts)
    used = squares(material, [(1, 0), (2, 0)])
    squares(material, [(3, 0)], "Hidden").hide_render = True
    reading = read(material, used, tmp_path)
    assert reading.size == (16, 32)
    assert reading.tiles.used == ((1, 0), (2, 0))
    rough = read_maps(tmp_path / "maps")["Roughness"][..., 0]
    np.testing.assert_allclose(rough[:, :16], parts[1002][..., 0], atol=1e-5)
    np.testing.assert_allclose(rough[:, 16:], parts[1003][..., 0], atol=1e-5)


def test_all_tiles_are_read_where_no_uv_map_says_which(tmp_path):
    material = painted(tmp_path, {number: noise(number) for number in (1001, 1002, 1003)})
    node = next(n for n in material.node_tree.nodes if n.type == "TEX_IMAGE")
    mapping, coordinates = add(material, "ShaderNodeMapping"), add(material, "ShaderNodeTexCoord")
    material.node_tree.links.new(coordinates.outputs["UV"], mapping.inputs[0])
    material.node_tree.links.new(mapping.outputs[0], node.inputs[0])
    assert read(material, squares(material, [(0, 0)]), tmp_path).size == (16, 48)


def test_between_tiles_that_are_used_nothing_new_shows(tmp_path):
    parts = {number: noise(number) for number in (1001, 1002, 1003)}
    material = painted(tmp_path, parts)
    read(material, squares(material, [(0, 0), (2, 0)]), tmp_path)
    rough = read_maps(tmp_path / "maps")["Roughness"][..., 0]
    np.testing.assert_array_equal(rough[:, 16:32], rough[:, :16])


def test_tiles_of_different_sizes_become_as_large_as_the_largest(tmp_path):
    material = painted(tmp_path, {1001: noise(1, 8), 1002: noise(2, 16)})
    obj = squares(material, [(0, 0), (1, 0)])
    assert read(material, obj, tmp_path).size == (16, 32)


def test_what_the_cameras_see_is_said_of_a_tile(tmp_path):
    scene = bpy.context.scene
    view_from_above()
    scene.render.resolution_x = scene.render.resolution_y = 64
    scene.render.resolution_percentage = 100
    material = painted(tmp_path, {number: noise(number, 256) for number in SQUARE})
    reading = read(material, squares(material, list(SQUARE.values())), tmp_path, size=None)
    assert reading.textures.pixels == 64
    assert reading.size == (128, 128)


def test_too_many_pixels_for_one_image_are_made_fewer(tmp_path, monkeypatch):
    from tvbrdf.tvbrdf_addon.material.reading import lookup as module

    monkeypatch.setattr(module, "_LARGEST", 24)
    material = painted(tmp_path, {number: noise(number) for number in SQUARE})
    reading = read(material, squares(material, list(SQUARE.values())), tmp_path)
    assert reading.size == (24, 24)
    assert "are made 12 px large instead of 16: one image" in reading.warnings[0]


def two_maps(folder: Path) -> bpy.types.Material:
    """Color and roughness in four tiles, and an image without tiles that goes on over all."""
    material = new_material()
    for socket, shift, space in (("Base Color", 0, "sRGB"), ("Roughness", 100, "Non-Color")):
        parts = {number: noise(number + shift) for number in SQUARE}
        made = tiled(folder, socket, parts, colorspace=space)
        node = add(material, "ShaderNodeTexImage", image=made, interpolation="Closest")
        link(material, node.outputs[0], socket)
    metal = image("Metal", np.round(noise(7)))
    node = add(material, "ShaderNodeTexImage", image=metal, interpolation="Closest")
    link(material, node.outputs[0], "Metallic")
    return material


@pytest.mark.parametrize("used", [list(SQUARE.values()), [(1, 0), (1, 1)], [(1, 1)]])
def test_frame_one_is_the_material_before_aging(tmp_path, used):
    lit_scene()
    material = two_maps(tmp_path)
    obj = squares(material, used)
    before = render(tmp_path / "before.exr")
    untouched = snapshot(material)
    reading = read(material, obj, tmp_path)
    maps = read_input(tmp_path / "maps", size=None)
    assert isinstance(maps, PrincipledMaps)
    assert maps.size == reading.size
    bind(material, obj, aged_authored(tmp_path / "aged", maps), tmp_path, span=(1, 2))
    assert psnr(before, render(tmp_path / "after.exr")) >= 50
    assert psnr(before, render(tmp_path / "aged.exr", 2)) < 40
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    revert(material)
    assert snapshot(material) == untouched


def test_what_has_to_be_baked_is_baked_tile_by_tile(tmp_path):
    """An image times a checker that lies in space: neither alone knows where texels are."""
    parts = {number: noise(number) for number in SQUARE}
    material = painted(tmp_path, parts)
    tree, rough = material.node_tree, principled_of(material).inputs["Roughness"]
    checker, product = add(material, "ShaderNodeTexChecker"), add(material, "ShaderNodeMath")
    coordinates = add(material, "ShaderNodeTexCoord")
    checker.inputs["Scale"].default_value = 1.0
    checker.inputs["Color1"].default_value = (1, 1, 1, 1)
    checker.inputs["Color2"].default_value = (0.5, 0.5, 0.5, 1)
    product.operation = "MULTIPLY"
    tree.links.new(coordinates.outputs["Object"], checker.inputs[0])
    tree.links.new(rough.links[0].from_socket, product.inputs[0])
    tree.links.new(checker.outputs["Color"], product.inputs[1])
    link(material, product.outputs[0], "Roughness")
    reading = read(material, squares(material, list(SQUARE.values())), tmp_path)
    assert (reading.uv_map, reading.size) == ("UVMap", (32, 32))
    assert reading.warnings == ()
    found = read_maps(tmp_path / "maps")["Roughness"][..., 0]
    for number, (u, v) in SQUARE.items():
        there = found[16 * (1 - v) : 16 * (2 - v), 16 * u : 16 * (u + 1)]
        share = 1.0 if (u + v) % 2 == 0 else 0.5
        ratio = there / parts[number][..., 0]
        assert abs(np.median(ratio) - share) < 1e-3 or abs(np.median(ratio) - 1.5 + share) < 1e-3
        np.testing.assert_allclose(ratio, np.median(ratio), rtol=1e-4)
    assert len(bpy.data.meshes) == 1


def test_faces_beside_all_tiles_are_named(tmp_path):
    material = painted(tmp_path, {1001: noise(1), 1002: noise(2)})
    bpy.data.images["Roughness"].tiles.new(1003)  # empty
    obj = squares(material, [(0, 0), (1, 0), (2, 0), (0, -1)])
    reading = read(material, obj, tmp_path)
    assert reading.tiles.used == ((0, 0), (1, 0))
    (warning,) = reading.warnings
    assert "no tile (u 0, v -1, 1003);" in warning
    squares(material, [(5, v) for v in range(5)], "More")
    (warning,) = read(material, obj, tmp_path).warnings
    assert "1003, 1006, 1016, 1026, ...);" in warning


def test_tiles_that_nothing_uses_or_that_are_lost_are_refused(tmp_path):
    material = painted(tmp_path, {1001: noise(1), 1002: noise(2)})
    obj = squares(material, [(5, 5)])
    assert "No face of “Paint” lies on a tile" in refusal(material, obj, tmp_path)
    for path in tmp_path.glob("*.png"):
        path.unlink()
    bpy.data.images["Roughness"].reload()
    assert "“Roughness” cannot be loaded" in refusal(material, obj, tmp_path)


def test_packed_tiles_are_read(tmp_path):
    parts = {1001: noise(1), 1002: noise(2)}
    material = painted(tmp_path, parts)
    bpy.data.images["Roughness"].pack()
    for number in parts:
        (tmp_path / f"Roughness.{number}.png").unlink()
    read(material, squares(material, [(0, 0), (1, 0)]), tmp_path)
    rough = read_maps(tmp_path / "maps")["Roughness"][..., 0]
    np.testing.assert_allclose(rough[:, 16:], parts[1002][..., 0], atol=1e-5)


def test_one_tile_at_the_origin_is_a_plain_texture(tmp_path):
    material = painted(tmp_path, {1001: noise(1)})
    obj = squares(material, [(0, 0)])
    reading = read(material, obj, tmp_path)
    assert reading.tiles.are_one
    maps = read_input(tmp_path / "maps", size=None)
    assert isinstance(maps, PrincipledMaps)
    bind(material, obj, aged_authored(tmp_path / "aged", maps), tmp_path, span=(1, 2))
    assert "MAPPING" not in {node.type for node in material.node_tree.nodes}


# When each texel starts


def onset_of(material, obj, folder: Path) -> np.ndarray:
    from tests.blender.material_cases import pixels
    from tvbrdf.tvbrdf_addon.material.reading.onset_map import write_onset

    reading = read(material, obj, folder)
    scene = bpy.context.scene
    found = write_onset(material=material, scene=scene, reading=reading, folder=folder, frame=1)
    assert found.warnings == ()
    return pixels(found.path)[..., 0]


def test_a_start_that_is_painted_goes_on_over_tiles(tmp_path):
    material = painted(tmp_path, {1001: noise(1), 1002: noise(2)})
    obj = squares(material, [(0, 0), (1, 0)])
    paint(obj, lambda x, _y, _z: (x + 1) / 2)
    material.tvbrdf.onset, material.tvbrdf.onset_attribute = "attribute", "Wear"
    across = (np.arange(32) + 0.5) / 32
    found = onset_of(material, obj, tmp_path)
    np.testing.assert_allclose(found, np.tile(across, (16, 1)), atol=2e-4)


def test_a_start_image_without_tiles_is_the_same_in_each(tmp_path):
    material = painted(tmp_path, {1001: noise(1), 1002: noise(2)})
    start = noise(5)
    material.tvbrdf.onset, material.tvbrdf.onset_image = "image", image("Start", start)
    found = onset_of(material, squares(material, [(0, 0), (1, 0)]), tmp_path)
    np.testing.assert_allclose(found, np.tile(start[..., 0], (1, 2)), atol=1e-5)


@pytest.mark.parametrize("invert", [False, True])
def test_a_start_image_with_tiles(tmp_path, invert):
    material = painted(tmp_path, {1001: noise(1), 1002: noise(2)})
    starts = {number: noise(number) for number in (1001, 1002)}
    material.tvbrdf.onset, material.tvbrdf.onset_invert = "image", invert
    material.tvbrdf.onset_image = tiled(tmp_path, "Start", starts, colorspace="sRGB")
    images = len(bpy.data.images)
    obj = squares(material, [(0, 0), (1, 0)])
    found = onset_of(material, obj, tmp_path)
    whole = np.concatenate([each[..., 0] for each in starts.values()], 1)
    np.testing.assert_allclose(found, 1 - whole if invert else whole, atol=1e-5)
    assert len(bpy.data.images) == images
    (tmp_path / "Start.1002.png").unlink()
    material.tvbrdf.onset_image.reload()
    with pytest.raises(MaterialError, match="“Start” has no tile 1002"):
        onset_of(material, obj, tmp_path)


def test_the_forecast_counts_tiles(tmp_path):
    from tvbrdf.tvbrdf_addon import outlook as module

    material = painted(tmp_path, {number: noise(number) for number in SQUARE})
    squares(material, [(0, 0), (1, 0)])
    material.tvbrdf.use_camera_size = False
    module.outlook_of(material, bpy.context.scene)
    module._look_in_time()
    assert module.outlook_of(material, bpy.context.scene).size == (16, 32)
