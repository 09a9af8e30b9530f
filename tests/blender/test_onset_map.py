"""When each texel starts, from what was painted on the mesh or in an image."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.material_cases import (
    add,
    image,
    link,
    new_material,
    pixels,
    plane,
)
from tests.blender.object_cases import NAME, paint
from tests.blender.test_bake import SIZE, U, V

pytestmark = pytest.mark.usefixtures("empty_scene")
# A byte attribute holds sRGB: its coarsest step, near white, is 2.2 of 255 in linear light.
BYTE = 1.2 / 255


def across(x: float, _y: float, _z: float) -> float:
    """From 0 at the left of a plane of 2 x 2 to 1 at its right."""
    return (x + 1) / 2


def painted(color=across, **settings) -> tuple[bpy.types.Material, bpy.types.Object]:
    """A plain material that starts as a plane of it is painted."""
    material = new_material()
    obj = plane(material)
    paint(obj, color, **settings)
    material.tvbrdf.onset, material.tvbrdf.onset_attribute = "attribute", NAME
    return material, obj


def written(material: bpy.types.Material, obj: bpy.types.Object, folder: Path):
    """What is written for the worker, and where: the module's result."""
    from tvbrdf.tvbrdf_addon.material.reading.onset_map import write_onset
    from tvbrdf.tvbrdf_addon.material.reading.read import read

    maps = folder / "maps"
    maps.mkdir(exist_ok=True)
    scene = bpy.context.scene
    reading = read(material=material, obj=obj, scene=scene, folder=maps, size=SIZE)
    return write_onset(material=material, scene=scene, reading=reading, folder=folder, frame=1)


def onset_of(material: bpy.types.Material, obj: bpy.types.Object, folder: Path) -> np.ndarray:
    found = pixels(written(material, obj, folder).path)
    assert (found == found[..., :1]).all(), "gray"
    return found[..., 0]


def why_not(material: bpy.types.Material) -> str | None:
    from tvbrdf.tvbrdf_addon.run import why_not

    material.tvbrdf.output = "/tmp"  # one beside the .blend needs a saved one
    return why_not(material, bpy.context.scene)


def refusal(material: bpy.types.Material, obj: bpy.types.Object, folder: Path) -> str:
    from tvbrdf.tvbrdf_addon.errors import MaterialError

    with pytest.raises(MaterialError) as caught:
        written(material, obj, folder)
    return str(caught.value)


# Painted on the mesh


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
@pytest.mark.parametrize(("kind", "tolerance"), [("FLOAT_COLOR", 2e-4), ("BYTE_COLOR", BYTE)])
def test_a_gradient_is_found_texel_by_texel(tmp_path, kind, domain, tolerance):
    material, obj = painted(kind=kind, domain=domain)
    np.testing.assert_allclose(onset_of(material, obj, tmp_path), U, atol=tolerance)


def test_row_0_is_the_top(tmp_path):
    material, obj = painted(lambda _x, y, _z: (y + 1) / 2)
    np.testing.assert_allclose(onset_of(material, obj, tmp_path), V, atol=2e-4)


def test_inverted_white_starts_first(tmp_path):
    material, obj = painted()
    material.tvbrdf.onset_invert = True
    np.testing.assert_allclose(onset_of(material, obj, tmp_path), 1 - U, atol=2e-4)


def test_colors_count_by_their_luminance(tmp_path):
    material, obj = painted(lambda *_: (0.0, 1.0, 0.0))
    np.testing.assert_allclose(onset_of(material, obj, tmp_path), 0.7152, atol=1e-4)


def test_an_image_on_the_uv_map_keeps_its_size(tmp_path):
    material, obj = painted()
    node = add(material, "ShaderNodeTexImage", image=bpy.data.images.new("image", 8, 4))
    link(material, node.outputs[0], "Base Color")
    found = onset_of(material, obj, tmp_path)
    np.testing.assert_allclose(found, np.tile((np.arange(8) + 0.5) / 8, (4, 1)), atol=2e-4)


def test_tiled_images_are_baked_to_the_uv_map_with_it(tmp_path):
    """A texture that repeats cannot start in one place."""
    from tvbrdf.tvbrdf_addon.material.reading.read import read

    material, obj = painted()
    node = add(material, "ShaderNodeTexImage", image=bpy.data.images.new("image", 8, 4))
    mapping, coordinates = add(material, "ShaderNodeMapping"), add(material, "ShaderNodeTexCoord")
    mapping.inputs["Scale"].default_value = (3, 3, 3)
    tree = material.node_tree
    tree.links.new(coordinates.outputs["UV"], mapping.inputs[0])
    tree.links.new(mapping.outputs[0], node.inputs[0])
    link(material, node.outputs[0], "Base Color")
    np.testing.assert_allclose(onset_of(material, obj, tmp_path), U, atol=2e-4)
    reading = read(material=material, obj=obj, scene=bpy.context.scene, folder=tmp_path, size=SIZE)
    assert reading.uv_map == "UVMap"
    assert any("cannot be moved or tiled" in each for each in reading.warnings)


def half(obj: bpy.types.Object, left: float) -> None:
    """Squeezes the UVs into half of the square."""
    for corner in obj.data.uv_layers[0].data:
        corner.uv.x = left + corner.uv.x / 2


def test_all_objects_that_show_the_material_are_baked(tmp_path):
    material, first = painted(lambda *_: 0.25)
    second = plane(material)
    paint(second, lambda *_: 0.75)
    half(first, 0.0)
    half(second, 0.5)
    onset = written(material, first, tmp_path)
    expected = np.where(U < 0.5, 0.25, 0.75)
    np.testing.assert_allclose(pixels(onset.path)[..., 0], expected, atol=1e-5)
    assert onset.warnings == ()
    for corner in second.data.uv_layers[0].data:
        corner.uv.x -= 0.5
    (warning,) = written(material, first, tmp_path).warnings
    assert "shares UVs with another object" in warning


def test_linked_duplicates_are_one_mesh(tmp_path):
    material, obj = painted()
    for _ in range(3):
        bpy.context.scene.collection.objects.link(obj.copy())
    onset = written(material, obj, tmp_path)
    assert onset.warnings == ()
    np.testing.assert_allclose(pixels(onset.path)[..., 0], U, atol=2e-4)


def test_an_object_without_the_attribute_does_not_age_and_is_named(tmp_path):
    material, obj = painted(lambda *_: 0.0)
    half(obj, 0.0)
    half(plane(material), 0.5)
    onset = written(material, obj, tmp_path)
    (warning,) = onset.warnings
    assert warning.startswith("“Plane.001” also shows “Paint”, but without a color attribute")
    found = pixels(onset.path)[..., 0]
    np.testing.assert_allclose(found[:, : SIZE // 2], 0, atol=1e-5)


def test_beside_the_islands_a_margin_and_then_nothing_that_ages(tmp_path):
    size = 128
    material, obj = painted(lambda *_: 0.5)
    for corner in obj.data.uv_layers[0].data:
        corner.uv = corner.uv * 0.5
    from tvbrdf.tvbrdf_addon.material.reading import onset_map
    from tvbrdf.tvbrdf_addon.material.reading.evaluated import evaluated

    with evaluated(obj, 1) as look:
        target = onset_map.Target(material, look, "UVMap")
        baked = onset_map._bake(target, NAME, (size, size), 1)
    assert np.count_nonzero(baked.inside) == (size // 2) ** 2
    np.testing.assert_allclose(baked.shades[baked.reach], 0.5, atol=1e-5)
    assert baked.reach[size // 2 - 4, 0]
    assert not baked.reach[0, -1]


def test_in_edit_mode_and_nothing_is_left_behind(tmp_path):
    material, obj = painted()
    bpy.ops.object.mode_set(mode="EDIT")
    kinds = ("scenes", "objects", "meshes", "materials", "images")

    def names() -> dict[str, list[str]]:
        return {kind: [each.name for each in getattr(bpy.data, kind)] for kind in kinds}

    before = names()
    np.testing.assert_allclose(onset_of(material, obj, tmp_path), U, atol=2e-4)
    assert names() == before
    assert obj.mode == "EDIT"


def test_the_active_attribute_is_the_first_choice():
    material = new_material()
    paint(plane(material), across)
    material.tvbrdf.onset = "attribute"
    assert material.tvbrdf.onset_attribute == NAME


# Images


def shades() -> np.ndarray:
    return np.random.default_rng(1).integers(0, 256, (4, 8))[..., None].repeat(3, 2) / 255


def with_image(made: bpy.types.Image | None) -> tuple[bpy.types.Material, bpy.types.Object]:
    material = new_material()
    material.tvbrdf.onset, material.tvbrdf.onset_image = "image", made
    return material, plane(material)


@pytest.mark.parametrize("invert", [False, True])
@pytest.mark.parametrize("colorspace", ["sRGB", "Non-Color"])
def test_a_painted_image_that_was_never_saved(tmp_path, colorspace, invert):
    material, obj = with_image(image("Mask", shades(), colorspace=colorspace))
    material.tvbrdf.onset_invert = invert
    expected = 1 - shades() if invert else shades()
    np.testing.assert_allclose(onset_of(material, obj, tmp_path), expected[..., 0], atol=1e-6)


def test_a_packed_image(tmp_path):
    made = image("Mask", shades())
    made.pack()
    found = onset_of(*with_image(made), tmp_path)
    np.testing.assert_allclose(found, shades()[..., 0], atol=1e-6)


@pytest.mark.parametrize("depth", [8, 16])
def test_an_image_on_disk_is_left_there_until_it_is_painted_over(tmp_path, depth):
    from PIL import Image

    codes = (shades()[..., 0] * (2**depth - 1)).round().astype(f"uint{depth}")
    file = tmp_path / "mask.png"
    Image.fromarray(codes).save(file)
    loaded = bpy.data.images.load(str(file))
    material, obj = with_image(loaded)
    assert written(material, obj, tmp_path).path == file
    material.tvbrdf.onset_invert = True
    # What the worker would have read, inverted: the file's own numbers, whatever the color space.
    np.testing.assert_allclose(
        onset_of(material, obj, tmp_path), 1 - codes / (2**depth - 1), atol=2e-4
    )
    material.tvbrdf.onset_invert = False
    loaded.pixels.foreach_set(np.ones(4 * codes.size, np.float32))
    loaded.update()
    assert loaded.is_dirty
    np.testing.assert_allclose(onset_of(material, obj, tmp_path), 1, atol=1e-6)


# What cannot be read


def _no_name(material, obj) -> None:
    material.tvbrdf.onset_attribute = ""


def _other_name(material, obj) -> None:
    material.tvbrdf.onset_attribute = "Weer"


def _no_attributes(material, obj) -> None:
    obj.data.color_attributes.remove(obj.data.color_attributes[0])


def _no_color(material, obj) -> None:
    obj.data.attributes.new("Height", "FLOAT", "POINT")
    material.tvbrdf.onset_attribute = "Height"


def _no_uvs(material, obj) -> None:
    obj.data.uv_layers.remove(obj.data.uv_layers[0])


def _two_without(material, obj) -> None:
    _no_attributes(material, obj)
    plane(material)


def _no_object(material, obj) -> None:
    bpy.data.objects.remove(obj)


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (_no_name, "No color attribute is chosen: choose one, or let aging start in spots."),
        (_other_name, "“Plane” has no color attribute “Weer”: there is Wear."),
        (
            _no_attributes,
            "“Plane” has no color attribute “Wear”: paint one in Vertex Paint mode.",
        ),
        (_no_color, "“Height” of “Plane” is no color attribute: convert it"),
        (_no_uvs, "The mesh of “Plane” has no UV map: unwrap it (UV > Smart UV Project), or set"),
        (_two_without, "No object that shows this has a color attribute “Wear”"),
        (_no_object, "“Paint” has to become a texture: select an object that uses it in one"),
    ],
)
def test_what_is_missing_is_said_before_the_click(spoil, sentence):
    material, obj = painted()
    assert why_not(material) is None
    spoil(material, obj)
    assert why_not(material).startswith(sentence)


@pytest.mark.parametrize("value", [-0.5, 1.5, np.nan])
def test_values_out_of_range_are_refused(tmp_path, value):
    material, obj = painted()
    colors = np.full(4 * 4, value, np.float32)
    obj.data.color_attributes[0].data.foreach_set("color", colors)
    said = refusal(material, obj, tmp_path)
    assert said == (
        "The color attribute “Wear” of “Plane” has values outside 0 to 1. Paint black (0) where "
        "aging starts at once and white (1) where it starts last."
    )
    material, obj = with_image(image("Mask", np.full((2, 2, 3), value), floating=True))
    assert "“Mask” has values outside 0 to 1" in refusal(material, obj, tmp_path)


def test_uvs_outside_the_square_are_refused(tmp_path):
    material, obj = painted()
    for corner in obj.data.uv_layers[0].data:
        corner.uv *= 4
    assert "outside the square" in refusal(material, obj, tmp_path)


def test_images_that_are_none_are_refused(tmp_path):
    material, obj = with_image(None)
    assert why_not(material).startswith("No start image is chosen")
    lost = bpy.data.images.new("Lost", 4, 4)
    lost.source, lost.filepath = "FILE", "/nowhere/lost.png"
    material.tvbrdf.onset_image = lost
    assert "“Lost” cannot be loaded from /nowhere/lost.png" in refusal(material, obj, tmp_path)
