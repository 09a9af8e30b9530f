"""Cycles is the judge: frame 1 is the artist's material, and the exact mapping is the formula."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import bpy
import numpy as np
import pytest

from model_runtime.brdf import principled
from model_runtime.maps import PrincipledMaps, TorranceSparrowMaps
from model_runtime.reading.inputs import read_input
from tests.blender.aged_cases import bind, read
from tests.blender.material_cases import (
    add,
    add_sun,
    image,
    link,
    new_material,
    plane,
    principled_of,
    render,
    view_from_above,
    write_result,
)

pytestmark = pytest.mark.usefixtures("empty_scene")

SIZE = 48
SUN = 4.0


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    """In dB on the tone-mapped scale of docs/design.md, (1 - exp(-2 v))^(1 / 2.8)."""
    tones = [(1 - np.exp(-2 * np.maximum(v, 0))) ** (1 / 2.8) for v in (one, other)]
    error = float(((tones[0] - tones[1]) ** 2).mean())
    return 100.0 if error == 0 else -10 * np.log10(error)


def lit_scene() -> None:
    view_from_above()
    add_sun((0.5, 0.3, -1.0), SUN)
    world = bpy.data.worlds.new("World")
    bpy.context.scene.world = world
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    world.node_tree.nodes["Background"].inputs[0].default_value = (0.4, 0.5, 0.6, 1)


def metal(material) -> None:
    inputs = principled_of(material).inputs
    inputs["Base Color"].default_value = (0.95, 0.6, 0.3, 1)
    inputs["Metallic"].default_value = 1.0
    inputs["Roughness"].default_value = 0.3


def plastic(material) -> None:
    inputs = principled_of(material).inputs
    inputs["Base Color"].default_value = (0.1, 0.3, 0.8, 1)
    inputs["Roughness"].default_value = 0.2
    inputs["Specular IOR Level"].default_value = 0.6
    inputs["IOR"].default_value = 1.6
    inputs["Specular Tint"].default_value = (1.0, 0.8, 0.9, 1)


def wood(material) -> None:
    """Tiled images, as a downloaded texture set is used."""
    rng = np.random.default_rng(5)
    grain = rng.random((1, 32, 1)) * np.ones((32, 1, 3)) * (0.7, 0.45, 0.25)
    mapping, coordinates = add(material, "ShaderNodeMapping"), add(material, "ShaderNodeTexCoord")
    mapping.inputs["Scale"].default_value = (2, 3, 1)
    tree = material.node_tree
    tree.links.new(coordinates.outputs["UV"], mapping.inputs[0])
    for socket, values, space in (
        ("Base Color", grain, "sRGB"),
        ("Roughness", 0.4 + 0.4 * rng.random((32, 32, 1)).repeat(3, 2), "Non-Color"),
    ):
        made = image(socket, values, colorspace=space)
        node = add(material, "ShaderNodeTexImage", image=made, interpolation="Closest")
        tree.links.new(mapping.outputs[0], node.inputs[0])
        link(material, node.outputs[0], socket)


def mix(material) -> None:
    """Half metal, half paint, by images of which one also carries alpha, normals and a coat."""
    rng = np.random.default_rng(6)
    wood(material)
    inputs = principled_of(material).inputs
    node = add(
        material,
        "ShaderNodeTexImage",
        image=image("Metal", rng.integers(0, 2, (32, 32, 1)).repeat(3, 2)),
    )
    node.interpolation = "Closest"
    mapping = next(n for n in material.node_tree.nodes if n.type == "MAPPING")
    material.node_tree.links.new(mapping.outputs[0], node.inputs[0])
    link(material, node.outputs[0], "Metallic")
    inputs["Coat Weight"].default_value = 0.3
    bump = add(material, "ShaderNodeBump")
    bump.inputs["Strength"].default_value = 0.2
    material.node_tree.links.new(node.outputs[0], bump.inputs["Height"])
    link(material, bump.outputs[0], "Normal")


def aged_authored(folder: Path, maps: PrincipledMaps) -> Path:
    """Frame 1 as it was read, through both mappings; frame 2 something else altogether."""
    first = principled.read_back(principled.forward(maps), maps)
    names = ("base_color", "metallic", "specular", "roughness")
    frames = {name: [getattr(first, name), 0.5 * getattr(first, name) + 0.2] for name in names}
    return write_result(folder, "principled", frames)


@pytest.mark.parametrize("build", [metal, plastic, wood, mix])
def test_frame_one_as_authored_is_the_material_before_aging(tmp_path, build):
    lit_scene()
    material = new_material()
    build(material)
    obj = plane(material)
    before = render(tmp_path / "before.exr", size=SIZE)
    reading = read(material, obj, tmp_path)
    maps = read_input(tmp_path / "maps", size=None)
    assert isinstance(maps, PrincipledMaps)
    assert maps.size == reading.size
    bind(material, obj, aged_authored(tmp_path / "aged", maps), tmp_path, span=(1, 2))
    after = render(tmp_path / "after.exr", size=SIZE)
    aged = render(tmp_path / "aged.exr", 2, size=SIZE)
    assert psnr(before, after) >= 50
    assert psnr(before, aged) < 40


def test_frame_one_of_a_baked_material_is_its_bake(tmp_path):
    """Against the bake bound by hand: the same texels, the same seed."""
    from tests.blender.material_cases import procedural

    lit_scene()
    material = new_material()
    procedural(material)
    obj = plane(material)
    reading = read(material, obj, tmp_path)
    maps = read_input(tmp_path / "maps", size=None)
    bind(material, obj, aged_authored(tmp_path / "aged", maps), tmp_path, span=(1, 2))
    after = render(tmp_path / "after.exr", size=SIZE)
    baked = new_material("Baked")
    for socket, file in (
        ("Base Color", "BaseColor"),
        ("Metallic", "Metallic"),
        ("Roughness", "Roughness"),
    ):
        made = bpy.data.images.load(str(tmp_path / "maps" / f"{file}.exr"))
        made.colorspace_settings.name = "Non-Color"
        link(baked, add(baked, "ShaderNodeTexImage", image=made).outputs[0], socket)
    obj.data.materials[0] = baked
    assert reading.uv_map
    assert psnr(render(tmp_path / "baked.exr", size=SIZE), after) >= 50


# The exact mapping, against the formula worked out here in NumPy


def torrance_sparrow(kd, ks, alpha, wi, wo) -> np.ndarray:
    """f cos_i of docs/design.md's formula for one pair of directions, n = +z: [H, W, 3]."""
    half = (wi + wo) / np.linalg.norm(wi + wo)
    cos_i, cos_o, cos_h = wi[2], wo[2], half[2]
    a2 = (alpha**2)[..., None]
    d = a2 / (np.pi * (cos_h**2 * (a2 - 1) + 1) ** 2)

    def g1(cos: float) -> np.ndarray:
        return 2 * cos / (cos + np.sqrt(a2 + (1 - a2) * cos**2))

    specular = ks * d * g1(cos_i) * g1(cos_o) / (4 * cos_i * cos_o)
    return (kd / np.pi + specular) * cos_i


def some_maps(kind: str) -> TorranceSparrowMaps:
    rng = np.random.default_rng(8)
    shape = (6, 6)
    bound = 0.75 if kind == "principled-exact" else 1.0
    ks = rng.uniform(0.02, bound, (*shape, 3)).astype(np.float32)
    kd = (rng.uniform(0, 0.95, (*shape, 3)) * (1 - ks.max(-1, keepdims=True))).astype(np.float32)
    alpha = rng.uniform(0.1, 0.9, shape).astype(np.float32)
    return TorranceSparrowMaps(
        **{f.name: v for f, v in zip(fields(TorranceSparrowMaps), (kd, ks, alpha), strict=True)}
    )


@pytest.mark.parametrize("kind", ["principled-exact", "torrance-sparrow"])
@pytest.mark.parametrize("angle", [25.0, 60.0])
def test_exact_mapping_renders_the_formula(tmp_path, kind, angle):
    maps = some_maps(kind)
    if kind == "principled-exact":
        assert principled.representable(maps)
        names = ("base_color", "specular_tint", "roughness")
        frames = dict(zip(names, ([each] * 1 for each in principled.exact(maps)), strict=True))
    else:
        frames = {"kd": [maps.kd], "ks": [maps.ks], "alpha": [maps.alpha]}
    frames = {name: [values[0] * 0.5, values[0]] for name, values in frames.items()}
    view_from_above()
    sine, cosine = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    add_sun((-sine, 0.0, -cosine), SUN)
    material = new_material()
    material.tvbrdf.onset = "none"
    obj = plane(material)
    bind(material, obj, write_result(tmp_path / "aged", kind, frames), tmp_path, span=(1, 2))
    for node in material.node_tree.nodes:
        if node.type == "TEX_IMAGE":
            node.interpolation = "Closest"
    picture = render(tmp_path / "exact.exr", 2, size=6 * 8, samples=16)
    found = picture.reshape(6, 8, 6, 8, 3)[:, 2:6, :, 2:6].mean((1, 3))
    wi, wo = np.array([sine, 0, cosine]), np.array([0.0, 0.0, 1.0])
    expected = SUN * torrance_sparrow(maps.kd, maps.ks, maps.alpha, wi, wo)
    error = np.sqrt(((found - expected) ** 2).mean()) / np.sqrt((expected**2).mean())
    assert error < 0.01


def test_a_saved_file_renders_the_same_without_the_extension(tmp_path):
    """In a second process, where nothing of ours is loaded and scripts may not run."""
    import shutil
    import subprocess
    import sys

    lit_scene()
    material = new_material()
    wood(material)
    obj = plane(material)
    home = tmp_path / "here"
    home.mkdir()
    read(material, obj, tmp_path)
    maps = read_input(tmp_path / "maps", size=None)
    bpy.ops.wm.save_as_mainfile(filepath=str(home / "scene.blend"))
    bind(material, obj, aged_authored(home / "aged", maps), tmp_path, span=(1, 11))
    for made in bpy.data.images:
        if made.source == "GENERATED":
            made.pack()
    here = [render(tmp_path / f"here{frame}.exr", frame, size=SIZE) for frame in (1, 11)]
    bpy.ops.wm.save_mainfile()
    shutil.move(home, tmp_path / "elsewhere")
    script = (
        "import sys, bpy\n"
        "blend, out = sys.argv[1:]\n"
        "bpy.ops.wm.open_mainfile(filepath=blend, use_scripts=False)\n"
        "scene = bpy.context.scene\n"
        "for frame in (1, 11):\n"
        "    scene.frame_set(frame)\n"
        "    scene.render.filepath = f'{out}/there{frame}.exr'\n"
        "    bpy.ops.render.render(write_still=True)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, tmp_path / "elsewhere" / "scene.blend", tmp_path],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    from tests.blender.material_cases import pixels

    for frame, picture in zip((1, 11), here, strict=True):
        np.testing.assert_array_equal(pixels(tmp_path / f"there{frame}.exr"), picture)
    assert psnr(*here) < 40
