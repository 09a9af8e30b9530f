"""What the material tests share: materials built in code, results made up, trees compared."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import bpy
import numpy as np
import OpenEXR

SKIPPED = {"rna_type", "dimensions", "internal_links", "image_user", "texture_mapping", "type_info"}


def new_material(name: str = "Paint") -> bpy.types.Material:
    """A material with a Principled BSDF and its output."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    return material


def principled_of(material: bpy.types.Material) -> bpy.types.Node:
    return next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")


def plane(material: bpy.types.Material | None = None) -> bpy.types.Object:
    """A plane of 2 x 2 facing +z, UVs over the whole square."""
    bpy.ops.mesh.primitive_plane_add(size=2)
    obj = bpy.context.object
    if material is not None:
        obj.data.materials.append(material)
    return obj


def link(material: bpy.types.Material, source: bpy.types.NodeSocket, socket: str) -> None:
    material.node_tree.links.new(source, principled_of(material).inputs[socket])


def add(material: bpy.types.Material, kind: str, **settings: object) -> bpy.types.Node:
    node = material.node_tree.nodes.new(kind)
    for name, value in settings.items():
        setattr(node, name, value)
    return node


def image(
    name: str, pixels: np.ndarray, *, colorspace: str = "Non-Color", floating: bool = False
) -> bpy.types.Image:
    """A generated image from [H, W, 3 or 4] with row 0 at the top, values in its color space."""
    height, width = pixels.shape[:2]
    made = bpy.data.images.new(name, width, height, alpha=True, float_buffer=floating)
    made.colorspace_settings.name = colorspace
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., : pixels.shape[2]] = pixels
    made.pixels.foreach_set(rgba[::-1].ravel())
    made.update()
    return made


def procedural(material: bpy.types.Material) -> None:
    """Noise-driven color, roughness and metalness, as a painted steel may have."""
    noise = add(material, "ShaderNodeTexNoise")
    noise.inputs["Scale"].default_value = 4.0
    ramp = add(material, "ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].color = (0.02, 0.1, 0.3, 1)
    ramp.color_ramp.elements[1].color = (0.5, 0.45, 0.4, 1)
    tree = material.node_tree
    tree.links.new(noise.outputs[0], ramp.inputs[0])
    link(material, ramp.outputs[0], "Base Color")
    link(material, noise.outputs[0], "Roughness")
    link(material, noise.outputs[0], "Metallic")


def awkward(material) -> None:
    """Links in every order, frames, reroutes, muted links, keys, drivers, odd settings."""
    procedural(material)
    tree, inputs = material.node_tree, principled_of(material).inputs
    principled_of(material).distribution = "MULTI_GGX"
    frame = add(material, "NodeFrame", label="Mine")
    noise = next(n for n in tree.nodes if n.type == "TEX_NOISE")
    noise.parent, noise.location = frame, (-300, 77)
    reroute = add(material, "NodeReroute")
    tree.links.new(noise.outputs[0], reroute.inputs[0])
    link(material, reroute.outputs[0], "Specular IOR Level")
    tint = add(material, "ShaderNodeRGB")
    link(material, tint.outputs[0], "Specular Tint")
    inputs["Specular Tint"].links[0].is_muted = True
    bump = add(material, "ShaderNodeBump")
    tree.links.new(noise.outputs[0], bump.inputs["Height"])
    link(material, bump.outputs[0], "Normal")
    inputs["IOR"].default_value = 1.7
    inputs["IOR"].keyframe_insert("default_value", frame=3)
    noise.inputs["Scale"].keyframe_insert("default_value", frame=3)
    noise.inputs["Scale"].default_value = 9.0
    noise.inputs["Scale"].keyframe_insert("default_value", frame=30)
    driver = noise.inputs["Detail"].driver_add("default_value").driver
    driver.expression = "frame / 10"
    age = add(material, "ShaderNodeValue")
    age.name = "Age"
    tree.nodes.active = noise


def textured(material, pixels: np.ndarray, socket: str = "Base Color", **settings):
    """An Image Texture with these pixels that feeds the socket."""
    colorspace = settings.pop("colorspace", "Non-Color")
    floating = settings.pop("floating", False)
    made = image(f"{socket} image", pixels, colorspace=colorspace, floating=floating)
    node = add(material, "ShaderNodeTexImage", image=made, **settings)
    link(material, node.outputs["Color"], socket)
    return node


def baked_material() -> bpy.types.Material:
    """One whose color only a bake tells."""
    material = new_material()
    procedural(material)
    return material


def read_maps(folder: Path) -> dict[str, np.ndarray]:
    """The maps that `read` wrote, as OpenEXR sees them."""
    return {path.stem: pixels(path) for path in sorted(folder.glob("*.exr"))}


def pixels(path: Path) -> np.ndarray:
    channels = OpenEXR.File(str(path)).channels()
    assert len(channels) == 1, channels
    return next(iter(channels.values())).pixels[..., :].astype(np.float32)


def write_map(path: Path, values: np.ndarray) -> None:
    """A half-float EXR: [H, W] as channel Y, [H, W, 3] as R, G, B."""
    half = np.ascontiguousarray(values, np.float16)
    header = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"Y" if half.ndim == 2 else "RGB": half}).write(str(path))


def write_result(folder: Path, kind: str, maps: Mapping[str, list[np.ndarray]]) -> Path:
    """A result as the worker leaves it: every map's frames, and `aged.json`."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {}
    for name, frames in maps.items():
        files[name] = [f"{name}_{i + 1:04d}.exr" for i in range(len(frames))]
        for file, values in zip(files[name], frames, strict=True):
            write_map(folder / file, values)
    count = len(next(iter(maps.values())))
    sizes = [frames[0].shape[:2] for frames in maps.values()]
    data = {
        "format": kind,
        "ntm": "rust",
        "frames": count,
        "times": [i / max(count - 1, 1) for i in range(count)],
        "size": list(max(sizes)),
        "files": files,
        "warnings": [],
    }
    (folder / "aged.json").write_text(json.dumps(data))
    return folder


def made_up(folder: Path, kind: str = "principled", *, count: int = 4, size: int = 4) -> Path:
    """A result in which frame i shows i / count all over, so that frames tell each other apart."""
    names = {
        "principled": ("base_color", "metallic", "specular", "roughness"),
        "principled-exact": ("base_color", "specular_tint", "roughness"),
        "torrance-sparrow": ("kd", "ks", "alpha"),
    }[kind]
    colors = {"base_color", "specular_tint", "kd", "ks"}
    maps = {
        name: [
            np.full((size, size, 3) if name in colors else (size, size), (i + 1) / count)
            for i in range(count)
        ]
        for name in names
    }
    return write_result(folder, kind, maps)


def snapshot(material: bpy.types.Material) -> dict[str, object]:
    """Everything about a material that a person or a script could see, as plain values.

    With all node groups of the file, which it may share.
    """
    return {
        "material": _walk(material, {"node_tree", "tvbrdf", "session_uid"}),
        **_tree(material.node_tree),
        "groups": {group.name: _tree(group) for group in bpy.data.node_groups},
        "actions": sorted(action.name for action in bpy.data.actions),
        "images": sorted(each.name for each in bpy.data.images),
        "original": material.tvbrdf.original,
    }


def _tree(tree: bpy.types.NodeTree) -> dict[str, object]:
    return {
        "nodes": [_node(node) for node in tree.nodes],
        "links": [
            (
                *(link.from_node.name, link.from_socket.identifier),
                *(link.to_node.name, link.to_socket.identifier),
                link.is_muted,
            )
            for link in tree.links
        ],
        "active": tree.nodes.active.name if tree.nodes.active else None,
        "animation": _animation(tree),
        "keys": sorted(tree.keys()),
    }


def _node(node: bpy.types.Node) -> dict[str, object]:
    seen = _walk(node, {"inputs", "outputs"})
    seen["keys"] = sorted(node.keys())
    for side in ("inputs", "outputs"):
        seen[side] = [_walk(socket, {"node", "links"}) for socket in getattr(node, side)]
    if hasattr(node, "image_user"):
        seen["image_user"] = _walk(node.image_user, {"frame_current", "frame_offset"})
    return seen


def _walk(thing: bpy.types.bpy_struct, skipped: set[str]) -> dict[str, object]:
    values: dict[str, object] = {}
    for prop in thing.bl_rna.properties:
        name = prop.identifier
        if name in skipped | SKIPPED or prop.type == "COLLECTION":
            continue
        value = getattr(thing, name)
        if prop.type == "POINTER":
            value = getattr(value, "name", value is not None)
        elif getattr(prop, "is_array", False):
            value = tuple(np.ravel(np.array(value)).tolist())
        values[name] = value
    return values


def _animation(tree: bpy.types.NodeTree) -> object:
    data = tree.animation_data
    if data is None:
        return None
    from tvbrdf.tvbrdf_addon.material.nodes.animation import channels

    def curve(each: bpy.types.FCurve) -> object:
        points = [
            (tuple(p.co), p.interpolation, tuple(p.handle_left)) for p in each.keyframe_points
        ]
        return each.data_path, each.array_index, points

    drivers = [(d.data_path, d.array_index, d.driver.expression) for d in data.drivers]
    slot = getattr(data, "action_slot", None)
    return {
        "action": data.action.name if data.action else None,
        "slot": slot.identifier if slot else None,
        "last_slot": getattr(data, "last_slot_identifier", None),
        "curves": [curve(each) for each in channels(tree)],
        "drivers": drivers,
        "properties": _walk(data, set()),
    }


def render(file: Path, frame: int = 1, *, size: int = 64, samples: int = 8) -> np.ndarray:
    """A Cycles render of the scene as float RGB [size, size, 3], no view transform."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.samples = samples
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.seed = 7
    scene.render.resolution_x = scene.render.resolution_y = size
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = str(file)
    scene.frame_set(frame)
    bpy.ops.render.render(write_still=True)
    return pixels(file)


def view_from_above() -> None:
    """An orthographic camera that sees the 2 x 2 plane and nothing else."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.location = "ORTHO", 2.0, (0, 0, 3)
    scene = bpy.context.scene
    scene.collection.objects.link(camera)
    scene.camera = camera


def add_sun(direction: tuple[float, float, float], strength: float = 3.0) -> None:
    """A sun without size that shines along `direction`."""
    from mathutils import Vector

    light = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    light.data.energy, light.data.angle = strength, 0.0
    light.rotation_euler = Vector(direction).to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.collection.objects.link(light)
