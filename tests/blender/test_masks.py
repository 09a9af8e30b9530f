"""What an artist paints to say where aging starts, or where it never does."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.material_cases import image, new_material, plane
from tests.blender.surface_truth import SIZE, cube, read_map, tiled, unwrap, without_uvs

pytestmark = pytest.mark.usefixtures("empty_scene")


def painted(obj: bpy.types.Object, kind: str, domain: str, name: str = "Mask") -> None:
    """White where x is above 0, in the object's own space."""
    mesh = obj.data
    attribute = mesh.color_attributes.new(name, kind, domain)
    for i, corner in enumerate(attribute.data):
        vertex = i if domain == "POINT" else mesh.loops[i].vertex_index
        corner.color = (*(float(mesh.vertices[vertex].co.x > 0),) * 3, 1)


def mask_of(material, folder: Path, *, uv_map="", alike=False, **what) -> tuple[np.ndarray, ...]:
    """The mask [H, W] and where its texels lie [H, W, 4]."""
    maps = written(material, folder, uv_map=uv_map, alike=alike, **what)
    assert maps.folder is not None and maps.mask is not None, maps.notes
    return read_map(maps.folder, maps.mask.stem)[..., 0], read_map(maps.folder, "position")


def written(material, folder: Path, *, uv_map="", alike=False, **what):
    from tvbrdf.tvbrdf_addon.material.reading.tiles import Tiles
    from tvbrdf.tvbrdf_addon.material.surface_maps.maps import write_surface
    from tvbrdf.tvbrdf_addon.material.surface_maps.painted import Mask

    return write_surface(
        *(material, bpy.context.scene, 1),
        uv_map=uv_map,
        tiles=Tiles(),
        kept=folder / "kept",
        alike=alike,
        mask=Mask(**what),
        size=SIZE,
    )


def agrees(mask: np.ndarray, position: np.ndarray, where: np.ndarray | None = None) -> float:
    """The share of covered texels at which the mask is white where x is above 0."""
    covered = position[..., 3] > 0
    if where is not None:
        covered &= where
    return float(((mask > 0.5) == (position[..., 0] > 0))[covered].mean())


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
@pytest.mark.parametrize("kind", ["BYTE_COLOR", "FLOAT_COLOR"])
def test_a_color_attribute_lies_where_it_was_painted(tmp_path, kind, domain):
    material = new_material()
    obj = cube(material)
    unwrap(obj)
    painted(obj, kind, domain)
    mask, position = mask_of(material, tmp_path, attribute="Mask")
    assert agrees(mask, position) > 0.97
    assert set(np.unique(mask.round(3)[position[..., 3] > 0])) >= {0, 1}


def test_gray_is_gray_and_goes_on_beside_faces(tmp_path):
    material = new_material()
    obj = cube(material)
    unwrap(obj)
    for corner in obj.data.color_attributes.new("Mask", "FLOAT_COLOR", "POINT").data:
        corner.color = (0.25, 0.25, 0.25, 1)
    mask, position = mask_of(material, tmp_path, attribute="Mask")
    np.testing.assert_allclose(mask[position[..., 3] > 0], 0.25, atol=1e-6)
    assert (mask[position[..., 3] == 0] == np.float32(0.25)).any()


def test_modifiers_and_turned_objects_take_it_along(tmp_path):
    material = new_material()
    obj = cube(material, location=(3, 0, 0), rotation=(0, 0, np.pi / 2))
    unwrap(obj)
    painted(obj, "FLOAT_COLOR", "POINT")
    obj.modifiers.new("Finer", "SUBSURF").subdivision_type = "SIMPLE"
    obj.scale.x = -1
    mask, position = mask_of(material, tmp_path, attribute="Mask")
    position = position.copy()
    # Its own x, turned and mirrored, is the world's -y.
    position[..., 0] = -position[..., 1]
    assert agrees(mask, position, np.abs(position[..., 1]) > 0.1) > 0.97


@pytest.mark.parametrize("make", [tiled, without_uvs])
def test_what_has_no_texels_of_its_own_can_be_painted(tmp_path, make):
    """Tiles repeat and UVs may lack: the attribute is the mesh's, and the layout one of its own."""
    material = new_material()
    (obj,) = make(material)
    painted(obj, "FLOAT_COLOR", "POINT")
    bpy.context.view_layer.update()
    mask, position = mask_of(material, tmp_path, attribute="Mask")
    # Linear between the corners of a face: half way is white.
    away = np.abs(position[..., 0]) > 0.1
    assert agrees(mask, position, away) > 0.97


def white_on_the_right(name: str = "Painted", size: int = 32, **settings) -> bpy.types.Image:
    pixels = np.zeros((size, size, 3))
    pixels[:, size // 2 :] = 1
    return image(name, pixels, **settings)


def test_an_image_lies_as_the_material_s_textures_do(tmp_path):
    material = new_material()
    plane(material)
    mask, position = mask_of(material, tmp_path, image=white_on_the_right())
    assert agrees(mask, position, np.abs(position[..., 0]) > 0.1) == 1


@pytest.mark.parametrize("size", [1, 7, 3000])
def test_an_image_of_any_size(tmp_path, size):
    material = new_material()
    plane(material)
    found = bpy.data.images.new("Mask", size, 2 * size)
    found.pixels.foreach_set(np.ones(size * 2 * size * 4, np.float32))
    mask, _ = mask_of(material, tmp_path, image=found)
    np.testing.assert_allclose(mask, 1, atol=1e-6)


def test_packed_generated_and_unsaved_images_count_as_they_are_now(tmp_path):
    material = new_material()
    plane(material)
    generated = bpy.data.images.new("Generated", 16, 16)
    generated.generated_color = (1, 1, 1, 1)
    mask, _ = mask_of(material, tmp_path, image=generated)
    assert mask.min() == 1
    file = bpy.data.images.new("Saved", 16, 16)
    file.filepath_raw, file.file_format = str(tmp_path / "saved.png"), "PNG"
    file.save()
    loaded = bpy.data.images.load(str(tmp_path / "saved.png"))
    mask, _ = mask_of(material, tmp_path, image=loaded)
    assert mask.max() == 0
    loaded.pixels[:] = [1.0] * len(loaded.pixels)
    assert loaded.is_dirty
    mask, _ = mask_of(material, tmp_path, image=loaded)
    assert mask.min() == 1, "what is painted, not what lies on the disk"
    loaded.pack()
    (tmp_path / "saved.png").unlink()
    mask, _ = mask_of(material, tmp_path, image=loaded)
    assert mask.min() == 1


def test_an_image_repeats_with_the_uv_map_and_timing_lies_apart(tmp_path):
    material = new_material()
    (obj,) = tiled(material)
    mask, position = mask_of(material, tmp_path, image=white_on_the_right())
    x = (position[..., 0] + 1) / 2 * 5 % 1
    covered = (position[..., 3] > 0) & (np.abs(x - 0.5) < 0.4) & (np.abs(x - 0.5) > 0.1)
    assert ((mask > 0.5) == (x > 0.5))[covered].mean() > 0.97
    assert obj.data.uv_layers.keys() == ["UVMap"]


def test_an_image_that_is_gone_is_refused_by_name(tmp_path):
    from tvbrdf.tvbrdf_addon.errors import MaterialError

    material = new_material()
    plane(material)
    file = bpy.data.images.new("Saved", 4, 4)
    file.filepath_raw, file.file_format = str(tmp_path / "saved.png"), "PNG"
    file.save()
    loaded = bpy.data.images.load(str(tmp_path / "saved.png"))
    (tmp_path / "saved.png").unlink()
    loaded.reload()
    with pytest.raises(MaterialError, match=r"saved\.png.*cannot be loaded"):
        mask_of(material, tmp_path, image=loaded)


# What is kept


def test_another_mask_bakes_nothing_anew_and_leaves_nothing_behind(tmp_path):
    material = new_material()
    obj = cube(material)
    unwrap(obj)
    painted(obj, "FLOAT_COLOR", "POINT")
    first = written(material, tmp_path, attribute="Mask")
    assert first.mask is not None and first.folder is not None
    baked = (first.folder / "ao.exr").stat().st_mtime_ns
    assert written(material, tmp_path, attribute="Mask").seconds == 0
    obj.data.color_attributes["Mask"].data[0].color = (0.5, 0.5, 0.5, 1)
    second = written(material, tmp_path, attribute="Mask")
    assert second.folder == first.folder and second.mask != first.mask
    assert (first.folder / "ao.exr").stat().st_mtime_ns == baked
    assert [each.name for each in first.folder.glob("mask*")] == [second.mask.name]


def test_objects_without_it_are_black_and_it_is_said(tmp_path):
    material = new_material()
    first, second = cube(material), cube(material, location=(4, 0, 0))
    unwrap(first, second)
    painted(first, "FLOAT_COLOR", "POINT")
    maps = written(material, tmp_path, attribute="Mask")
    assert any(f"“{second.name}” has no mask “Mask”" in each for each in maps.notes)
    mask = read_map(maps.folder, maps.mask.stem)
    position = read_map(maps.folder, "position")
    assert mask[(position[..., 0] > 2.9) & (position[..., 3] > 0)].max() == 0


# In a material's settings


@pytest.mark.parametrize(
    ("source", "said"),
    [("image", "No mask image is chosen"), ("attribute", "No color attribute is chosen")],
)
def test_what_is_not_named_is_asked_for(tmp_path, source, said):
    from tvbrdf.tvbrdf_addon.run import why_not

    material = new_material()
    plane(material)
    material.tvbrdf.output = str(tmp_path / "aged")
    assert why_not(material, bpy.context.scene) is None
    material.tvbrdf.mask_source = source
    assert said in why_not(material, bpy.context.scene)
    material.tvbrdf.onset = "none"
    assert why_not(material, bpy.context.scene) is None, "then there is no mask"


def test_an_attribute_that_no_mesh_has_is_said(tmp_path):
    from tvbrdf.tvbrdf_addon.run import why_not

    material = new_material()
    obj = plane(material)
    settings = material.tvbrdf
    settings.output, settings.mask_attribute = str(tmp_path / "aged"), "Mask"
    settings.mask_source = "attribute"
    assert "no color attribute “Mask”" in why_not(material, bpy.context.scene)
    painted(obj, "BYTE_COLOR", "CORNER")
    assert why_not(material, bpy.context.scene) is None


def test_the_active_attribute_is_taken_at_first():
    material = new_material()
    obj = plane(material)
    painted(obj, "BYTE_COLOR", "CORNER", "Mine")
    bpy.context.view_layer.objects.active = obj
    material.tvbrdf.mask_source = "attribute"
    assert material.tvbrdf.mask_attribute == "Mine"


@pytest.mark.parametrize("make", [tiled, None])
def test_a_mask_that_finds_no_surface_is_said_before_why(tmp_path, make):
    """In frames, where a tile has no texels of its own, and on text."""
    from tvbrdf.tvbrdf_addon.growth import growth
    from tvbrdf.tvbrdf_addon.material.reading.read import Reading

    material = new_material()
    if make is None:
        bpy.ops.object.text_add()
        bpy.context.object.data.materials.append(material)
    else:
        make(material)
    settings = material.tvbrdf
    settings.mask_source, settings.mask_image = "image", white_on_the_right()
    request = {"onset": "auto", "binding": "frames"}
    reading = Reading((8, 8), None, False, "", ())
    found = growth(request, material, bpy.context.scene, reading, 1)
    assert found.fields == {}
    assert "where the mask lies" in found.notes[0]
    assert len(found.notes) == 2


def test_what_is_never_stays_as_it_is_and_age_again_and_undo_keep_to_it(tmp_path, monkeypatch):
    """By the worker: painted white, a half never ages, wherever it lies in a repeated UV map."""
    from tvbrdf.tvbrdf_addon.material.reading.pixels import read_exr

    monkeypatch.delenv("TVBRDF_WORKER", raising=False)
    material = new_material("Painted")
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=2, y_subdivisions=1, size=2)
    mesh = bpy.context.object.data
    mesh.materials.append(material)
    for corner in mesh.uv_layers[0].data:
        corner.uv *= 5
    shades = mesh.color_attributes.new("Mask", "BYTE_COLOR", "CORNER").data
    for face in mesh.polygons:
        for i in face.loop_indices:
            shades[i].color = (*(float(face.center.x > 0),) * 3, 1)
    settings = material.tvbrdf
    settings.ntm, settings.output, settings.size = "rust", str(tmp_path / "aged"), 64
    settings.mask_attribute, settings.mask_means = "Mask", "never"
    bpy.ops.ed.undo_push(message="Before")
    settings.mask_source = "attribute"
    bpy.ops.ed.undo_push(message="Painted")
    for _ in range(2):
        assert bpy.ops.tvbrdf.age_material(material="Painted") == {"FINISHED"}
        folder = Path(bpy.path.abspath(settings.folder))
        told = json.loads((folder / "aged.json").read_text())
        assert told["surface"]["mask"] == "never" and "mask" in told["hashes"]
        onset = read_exr(folder / "timing.exr")[..., 0]
        (surface,) = (Path(bpy.app.tempdir) / "surfaces").iterdir()
        position = read_map(surface, "position")
        step = len(position) // len(onset)
        x, covered = (position[step // 2 :: step, step // 2 :: step, k] for k in (0, 3))
        assert (onset[(x > 0.1) & (covered > 0)] == 1).all()
        assert onset[(x < -0.1) & (covered > 0)].mean() < 0.9
    bpy.ops.ed.undo_push(message="Aged")
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    assert bpy.data.materials["Painted"].tvbrdf.mask_source == "none"
