"""Grain and relief of a live material: what the shader makes of them, and that it starts from
nothing.
"""

from __future__ import annotations

import json
import math
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
import pytest
from PIL import Image

from tests.blender.aged_cases import bind, settled
from tests.blender.live_cases import height_by_hand, made_up_live
from tests.blender.live_materials import data_blocks, group_node, shown
from tests.blender.material_cases import (
    add,
    add_sun,
    awkward,
    link,
    made_up,
    new_material,
    plane,
    principled_of,
    procedural,
    render,
    view_from_above,
)
from tests.blender.surface_cases import in_nested_groups
from tests.blender.test_frame_one import psnr
from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
from tvbrdf.tvbrdf_addon.material.binding.freeze_live import freeze_live
from tvbrdf.tvbrdf_addon.material.nodes.revert import revert
from tvbrdf.tvbrdf_addon.material.nodes.strengths import strength
from tvbrdf.tvbrdf_addon.material.reading.pixels import read_exr

pytestmark = pytest.mark.usefixtures("empty_scene")
FORMATS = ("principled", "principled-exact", "torrance-sparrow")
SIDE = 32


def relief_node(material) -> bpy.types.Node:
    return next(node for node in material.node_tree.nodes if node.name == "Relief")


def grained(folder: Path, kind: str = "principled", **options) -> Path:
    defaults = {"count": 5, "grain": 3, "height": True, "size": (SIDE, SIDE)}
    return made_up_live(folder, kind, **(defaults | options))


def bumpy(material) -> None:
    """With a normal of the artist's own."""
    procedural(material)
    bump = add(material, "ShaderNodeBump")
    noise = next(node for node in material.node_tree.nodes if node.type == "TEX_NOISE")
    material.node_tree.links.new(noise.outputs[0], bump.inputs["Height"])
    link(material, bump.outputs[0], "Normal")


def displaced(material) -> None:
    procedural(material)
    node = add(material, "ShaderNodeDisplacement")
    noise = next(node for node in material.node_tree.nodes if node.type == "TEX_NOISE")
    links, output = material.node_tree.links, material.node_tree.get_output_node("ALL")
    links.new(noise.outputs[0], node.inputs["Height"])
    links.new(node.outputs[0], output.inputs["Displacement"])


def lit() -> None:
    view_from_above()
    add_sun((0.7, 0.3, -1.0))
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.9, segments=24, ring_count=16)
    bpy.ops.object.shade_smooth()


@pytest.mark.parametrize("grain", [1.0, 0.0, 0.4])
@pytest.mark.parametrize("count", [3, 5])
def test_heights_are_those_of_the_result(tmp_path, grain, count):
    material = new_material()
    procedural(material)
    obj = plane(material)
    folder = grained(tmp_path / "live", count=count)
    bind(material, obj, folder, tmp_path, span=(0, 100))
    material.tvbrdf.grain = grain
    group = group_node(material)
    for node in group.node_tree.nodes:
        if node.type == "TEX_IMAGE":
            node.interpolation = "Closest"
    shift = add(material, "ShaderNodeMath", operation="MULTIPLY_ADD")
    shift.inputs[1].default_value, shift.inputs[2].default_value = 20.0, 1.0
    emission = add(material, "ShaderNodeEmission")
    tree = material.node_tree
    tree.links.new(group.outputs["Height"], shift.inputs[0])
    tree.links.new(shift.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
    view_from_above()
    for frame in (0, 13, 40, 77, 100):
        seen = (shown(tmp_path, frame, SIDE)[..., 0] - 1) / 20
        wanted = height_by_hand(folder, frame / 100, (SIDE, SIDE), grain=grain)
        assert np.abs(wanted).max() > 1e-3 or frame == 0
        np.testing.assert_allclose(seen, wanted, atol=2e-5, err_msg=str(frame))


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("build", [procedural, bumpy, displaced])
def test_at_age_0_nothing_is_changed_to_the_last_bit(tmp_path, kind, build):
    """Against the same result without relief: what there is besides has its own tests."""
    lit()
    pictures = []
    for height in (False, True):
        material = new_material()
        build(material)
        bpy.context.object.data.materials.clear()
        bpy.context.object.data.materials.append(material)
        folder = grained(tmp_path / f"live {height}", kind, height=height)
        bind(material, bpy.context.object, folder, tmp_path, span=(1, 11))
        pictures.append([render(tmp_path / "a.exr", frame, samples=4) for frame in (1, 11)])
    (flat, old), (raised, aged) = pictures
    np.testing.assert_array_equal(raised, flat)
    assert np.abs(aged - old).max() > 0.01


@pytest.mark.parametrize("build", [procedural, bumpy, displaced])
def test_nor_is_it_between_texels(tmp_path, build):
    """Against the material before: no rounding error starts what has not started."""
    view_from_above()
    add_sun((0.7, 0.3, -1.0))
    material = new_material()
    build(material)
    obj = plane(material)
    before = render(tmp_path / "a.exr", size=96, samples=2)
    bind(material, obj, grained(tmp_path / "live", size=(64, 64)), tmp_path)
    np.testing.assert_array_equal(render(tmp_path / "a.exr", size=96, samples=2), before)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("build", [procedural, awkward, bumpy, displaced, in_nested_groups])
def test_revert_leaves_nothing(tmp_path, kind, build):
    material = new_material()
    build(material)
    obj = plane(material)
    before, blocks = settled(material), data_blocks()
    bind(material, obj, grained(tmp_path / "live", kind), tmp_path)
    assert relief_node(material).inputs["Height"].is_linked
    revert(material)
    after = settled(material)
    for key in before:
        assert after[key] == before[key], key
    assert data_blocks() == blocks


def test_a_slope_is_as_steep_as_the_result_says(tmp_path):
    """A ramp of height across the plane, whose normal is known: its shade under a sun is."""
    material = new_material()
    inputs = principled_of(material).inputs
    inputs["Roughness"].default_value, inputs["Specular IOR Level"].default_value = 1.0, 0.0
    inputs["Base Color"].default_value = (0.5, 0.5, 0.5, 1)
    obj = plane(material)
    folder = made_up_live(tmp_path / "live", count=1, height=True, onset=False, tile_side=0.25)
    slope(folder, per_tile=0.1)
    bind(material, obj, folder, tmp_path, span=(1, 11))
    node = relief_node(material)
    assert node.inputs["Distance"].default_value == pytest.approx(0.5)  # of a plane 2 wide
    view_from_above()
    add_sun((0.0, 0.0, -1.0), strength=math.pi)
    wanted = 0.5 / math.hypot(1, 0.1 * 0.5 * 4 / 2)  # four tiles on two meters
    middle = slice(24, 40)
    flat, steep = (
        render(tmp_path / "a.exr", frame, samples=4)[middle, middle] for frame in (1, 11)
    )
    np.testing.assert_allclose(flat, 0.5, rtol=2e-3)
    np.testing.assert_allclose(steep, wanted, rtol=2e-3)
    material.tvbrdf.relief = 0.0
    np.testing.assert_allclose(
        render(tmp_path / "a.exr", 11, samples=4)[middle, middle], 0.5, rtol=2e-3
    )


TEXELS = 16


def slope(folder: Path, *, per_tile: float) -> None:
    """Lets the one coefficient rise from left to right, and change nothing but the height."""
    from tests.blender.live_cases import AGES, write_image

    rows = np.zeros((3, 3, AGES, 3), np.float32)
    rows[0] = 1.0
    rows[0, 2, :, 1:] = 0.0
    # From the first texel's center to the last one's.
    rows[2, 2, :, 1] = np.linspace(0, 4 * per_tile * (TEXELS - 1) / TEXELS, AGES)
    write_image(folder / "curves.exr", rows.reshape(-1, AGES, 3))
    (name,) = json.loads((folder / "aged.json").read_text())["files"]["coefficients"]
    bytes_across = np.tile(np.linspace(0, 255, TEXELS, dtype=np.uint8)[:, None], (TEXELS, 1, 3))
    Image.fromarray(bytes_across).save(folder / name)


def test_sliders_move_the_nodes_and_are_kept(tmp_path):
    material = new_material()
    procedural(material)
    obj = plane(material)
    material.tvbrdf.relief = 0.3
    assert strength(material, "Relief") is None
    bind(material, obj, grained(tmp_path / "live"), tmp_path)
    assert strength(material, "Relief") == pytest.approx(0.3)
    assert strength(material, "Grain") == 1.0
    material.tvbrdf.grain = 0.6
    assert group_node(material).inputs["Grain"].default_value == pytest.approx(0.6)
    assert relief_node(material).inputs["Relief"].default_value == pytest.approx(0.3)


def test_freezing_keeps_grain_and_relief(tmp_path):
    view_from_above()
    add_sun((0.7, 0.3, -1.0))
    material = new_material()
    procedural(material)
    obj = plane(material)
    shown(tmp_path)  # whose image stays in the file
    before, blocks = settled(material), data_blocks()
    folder = grained(tmp_path / "live", size=(64, 64), onset=False)
    bind(material, obj, folder, tmp_path, span=(1, 11))
    material.tvbrdf.folder, material.tvbrdf.size = str(folder), 64
    material.tvbrdf.grain = 0.5
    live = render(tmp_path / "a.exr", 7)
    freeze_live(material, obj, bpy.context.scene)
    still = read_exr(folder / "frame 7" / "height.exr")[..., 0]
    wanted = height_by_hand(folder, 0.6, (64, 64), grain=0.5)
    np.testing.assert_allclose(still, wanted, atol=1e-5)
    frozen = render(tmp_path / "a.exr", 1)
    assert psnr(frozen, live) > 40
    material.tvbrdf.relief = 0.0
    assert psnr(render(tmp_path / "a.exr", 1), live) < psnr(frozen, live) - 10
    revert(material)
    assert settled(material) == before
    assert data_blocks() == blocks


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("build", [procedural, bumpy, displaced])
def test_frames_play_heights(tmp_path, kind, build):
    lit()
    obj = bpy.context.object
    material = new_material()
    build(material)
    obj.data.materials.append(material)
    shown(tmp_path)  # whose image stays in the file
    before = settled(material)
    folder = made_up(tmp_path / "frames", kind, count=3, size=SIDE)
    bind(material, obj, folder, tmp_path, span=(1, 11))
    flat = [render(tmp_path / "a.exr", frame, samples=4) for frame in (1, 11)]
    add_heights(folder)
    bind(material, obj, folder, tmp_path, span=(1, 11))
    raised = [render(tmp_path / "a.exr", frame, samples=4) for frame in (1, 11)]
    np.testing.assert_array_equal(raised[0], flat[0])
    assert np.abs(raised[1] - flat[1]).max() > 0.01
    bpy.context.scene.frame_set(11)
    freeze(material, 11)
    np.testing.assert_array_equal(render(tmp_path / "a.exr", 1, samples=4), raised[1])
    revert(material)
    assert settled(material) == before


def add_heights(folder: Path) -> None:
    """Waves that grow."""
    report = json.loads((folder / "aged.json").read_text())
    wave = np.sin(np.linspace(0, 6 * np.pi, SIDE))
    names = [f"height_{k + 1:04d}.exr" for k in range(3)]
    for k, name in enumerate(names):
        # Single floats: of half floats Cycles makes 0 something more.
        OpenEXR.File({}, {"Y": (0.02 * k * np.outer(wave, wave)).astype(np.float32)}).write(
            str(folder / name)
        )
    report["files"]["height"] = names
    (folder / "aged.json").write_text(json.dumps(report))
