"""The demo's scene: a jerrycan of painted steel in soft daylight, everything procedural.

The body is one sheet, unfolded without a seam: its UV coordinates are the two parameters it is
modeled with, so what grows over the texture grows over the surface.  The paint is a Principled
material whose color, roughness and metalness come out of noise, with chips down to the steel.
"""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Vector

HALF_WIDTH, HALF_HEIGHT, DEPTH = 1.0, 1.28, 0.7
CORNER, FILLET = 0.26, 0.13  # radii of the outline and of the edge between face and side
FACE, BEND = 0.66, 0.08  # shares of the texture, from its center out, of the front and its edge


def rectangle_distance(x: np.ndarray, z: np.ndarray, inset: float, corner: float) -> np.ndarray:
    """Signed distance [N] to a rounded rectangle `inset` inside the outline; negative inside."""
    qx = np.abs(x) - (HALF_WIDTH - inset - corner)
    qz = np.abs(z) - (HALF_HEIGHT - inset - corner)
    outside = np.hypot(np.maximum(qx, 0), np.maximum(qz, 0))
    return outside + np.minimum(np.maximum(qx, qz), 0) - corner


def smooth_step(x: np.ndarray, low: float, high: float) -> np.ndarray:
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)


def outline(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the ray from the center through (s, t) in [-1, 1]^2 meets the can's outline."""
    x, z = s * HALF_WIDTH, t * HALF_HEIGHT
    low, high = np.zeros_like(x), np.full_like(x, 2.0)
    scale = 1 / np.maximum(np.maximum(np.abs(s), np.abs(t)), 1e-9)
    for _ in range(40):
        middle = (low + high) / 2
        inside = rectangle_distance(x * scale * middle, z * scale * middle, 0.0, CORNER) < 0
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return x * scale * low, z * scale * low


def can_surface(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Points [N, 3] of the body at the parameters s, t [N] in [-1, 1]."""
    radius = np.maximum(np.abs(s), np.abs(t))
    edge_x, edge_z = outline(s, t)
    shrink = 1 - FILLET / np.maximum(np.hypot(edge_x, edge_z), 1e-9)
    # Along a spoke: flat front, a quarter circle, the straight side.
    front = np.minimum(radius / FACE, 1)
    bend = np.clip((radius - FACE) / BEND, 0, 1) * (math.pi / 2)
    side = np.clip((radius - FACE - BEND) / (1 - FACE - BEND), 0, 1)
    share = front * shrink + (1 - shrink) * np.sin(bend)
    x, z = edge_x * share, edge_z * share
    y = -DEPTH / 2 + FILLET * (1 - np.cos(bend)) + side * (DEPTH - FILLET)

    pressed = 1 - smooth_step(rectangle_distance(x, z, 0.24, 0.2), -0.05, 0.05)
    slope = HALF_HEIGHT / HALF_WIDTH * 0.92
    diagonal = np.minimum(np.abs(z - slope * x), np.abs(z + slope * x)) / math.hypot(1, slope)
    ridge = (1 - smooth_step(diagonal, 0.06, 0.15)) * pressed
    hub = 1 - smooth_step(np.hypot(x, z), 0.22, 0.34)
    y += 0.07 * pressed - 0.075 * np.maximum(ridge, hub * pressed)
    return np.stack([x, y, z], axis=-1)


def add_body(steps: int = 160) -> bpy.types.Object:
    axis = np.linspace(-1, 1, steps + 1)
    s, t = (grid.ravel() for grid in np.meshgrid(axis, axis))
    corner = np.arange(steps)[None, :] + (steps + 1) * np.arange(steps)[:, None]
    quads = np.stack([corner, corner + 1, corner + steps + 2, corner + steps + 1], -1)
    quads = quads.reshape(-1, 4)
    mesh = bpy.data.meshes.new("Jerrycan")
    mesh.from_pydata(can_surface(s, t).tolist(), [], quads.tolist())
    uv = mesh.uv_layers.new(name="UVMap")
    corners = np.stack([s, t], -1)[quads.ravel()] * 0.5 + 0.5
    uv.data.foreach_set("uv", corners.astype(np.float32).ravel())
    mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
    body = bpy.data.objects.new("Jerrycan", mesh)
    bpy.context.scene.collection.objects.link(body)
    return body


def new_material(name: str) -> tuple[bpy.types.Material, bpy.types.Node]:
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    return material, material.node_tree.nodes["Principled BSDF"]


def painted_steel() -> bpy.types.Material:
    """Green enamel, mottled and worn, with chips down to the bare steel."""
    material, principled = new_material("Painted Steel")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    place = nodes.new("ShaderNodeTexCoord").outputs["Object"]

    def noise(scale: float, detail: float) -> bpy.types.NodeSocket:
        node = nodes.new("ShaderNodeTexNoise")
        node.inputs["Scale"].default_value = scale
        node.inputs["Detail"].default_value = detail
        links.new(place, node.inputs["Vector"])
        return node.outputs["Fac"]

    def ramp(factor: bpy.types.NodeSocket, *stops: tuple[float, tuple]) -> bpy.types.NodeSocket:
        node = nodes.new("ShaderNodeValToRGB")
        elements = node.color_ramp.elements
        while len(elements) < len(stops):
            elements.new(0.5)
        for element, (position, color) in zip(elements, stops, strict=True):
            element.position = position
            element.color = (*color, 1.0)
        links.new(factor, node.inputs["Fac"])
        return node.outputs["Color"]

    def gray(value: float) -> tuple[float, float, float]:
        return (value, value, value)

    def mix(
        factor: bpy.types.NodeSocket, a: bpy.types.NodeSocket, b: tuple
    ) -> bpy.types.NodeSocket:
        node = nodes.new("ShaderNodeMix")
        node.data_type = "RGBA"
        sockets = {socket.identifier: socket for socket in node.inputs}
        links.new(factor, sockets["Factor_Float"])
        links.new(a, sockets["A_Color"])
        sockets["B_Color"].default_value = (*b, 1.0)
        return next(s for s in node.outputs if s.identifier == "Result_Color")

    chips = ramp(noise(7.0, 9.0), (0.655, gray(0)), (0.67, gray(1)))
    paint = ramp(noise(2.2, 6.0), (0.3, (0.035, 0.105, 0.095)), (0.7, (0.06, 0.165, 0.14)))
    gloss = ramp(noise(4.0, 8.0), (0.3, gray(0.24)), (0.7, gray(0.46)))
    links.new(mix(chips, paint, (0.56, 0.55, 0.53)), principled.inputs["Base Color"])
    links.new(mix(chips, gloss, gray(0.38)), principled.inputs["Roughness"])
    links.new(chips, principled.inputs["Metallic"])
    return material


def plain(name: str, color: tuple, roughness: float, metallic: float = 0.0) -> bpy.types.Material:
    material, principled = new_material(name)
    principled.inputs["Base Color"].default_value = (*color, 1.0)
    principled.inputs["Roughness"].default_value = roughness
    principled.inputs["Metallic"].default_value = metallic
    return material


def add_fittings() -> None:
    """Three grips and a cap, which do not age, and a studio sweep to stand on."""
    rubber = plain("Rubber", (0.02, 0.02, 0.022), 0.6)
    brass = plain("Brass", (0.72, 0.5, 0.22), 0.28, metallic=1.0)
    ground = plain("Ground", (0.42, 0.4, 0.37), 0.8)
    top = HALF_HEIGHT
    for y in (-0.2, 0.0, 0.2):
        curve = bpy.data.curves.new("Grip", "CURVE")
        curve.dimensions, curve.bevel_depth, curve.bevel_resolution = "3D", 0.045, 6
        spline = curve.splines.new("BEZIER")
        points = [(-0.5, y, top - 0.02), (-0.38, y, top + 0.2), (0.22, y, top + 0.2)]
        points.append((0.34, y, top - 0.02))
        spline.bezier_points.add(len(points) - 1)
        for point, position in zip(spline.bezier_points, points, strict=True):
            point.co = position
            point.handle_left_type = point.handle_right_type = "AUTO"
        curve.materials.append(rubber)
        bpy.context.scene.collection.objects.link(bpy.data.objects.new("Grip", curve))
    bpy.ops.mesh.primitive_cylinder_add(
        vertices=64, radius=0.17, depth=0.26, location=(0.68, 0, top + 0.06)
    )
    cap = bpy.context.object
    bevel = cap.modifiers.new("Bevel", "BEVEL")
    bevel.width, bevel.segments = 0.03, 4
    cap.data.materials.append(brass)
    bend = [(math.sin(a), 1 - math.cos(a)) for a in np.linspace(0, math.pi / 2, 24)]
    profile = [(-12.0, 0.0), *((2.5 + 3 * y, 3 * z) for y, z in bend), (5.5, 12.0)]
    points = [(x, y, z - HALF_HEIGHT) for y, z in profile for x in (-14.0, 14.0)]
    faces = [(i, i + 1, i + 3, i + 2) for i in range(0, len(points) - 2, 2)]
    sweep = bpy.data.meshes.new("Sweep")
    sweep.from_pydata(points, [], faces)
    sweep.polygons.foreach_set("use_smooth", [True] * len(faces))
    sweep.materials.append(ground)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Sweep", sweep))


def add_light() -> None:
    scene = bpy.context.scene
    world = scene.world = bpy.data.worlds.new("Sky")
    if bpy.app.version < (5, 0):
        world.use_nodes = True
    nodes, links = world.node_tree.nodes, world.node_tree.links
    ramp = nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].color = (0.5, 0.47, 0.42, 1)
    ramp.color_ramp.elements[0].position = 0.45
    ramp.color_ramp.elements[1].color = (0.55, 0.7, 0.95, 1)
    ramp.color_ramp.elements[1].position = 0.75
    split, scale = nodes.new("ShaderNodeSeparateXYZ"), nodes.new("ShaderNodeMapRange")
    scale.inputs["From Min"].default_value = -1.0
    links.new(nodes.new("ShaderNodeTexCoord").outputs["Generated"], split.inputs[0])
    links.new(split.outputs["Z"], scale.inputs["Value"])
    links.new(scale.outputs["Result"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], nodes["Background"].inputs["Color"])
    nodes["Background"].inputs["Strength"].default_value = 0.55
    for name, place, size, power, color in (
        ("Key", (-3.4, -3.6, 4.0), 1.8, 420, (1.0, 0.93, 0.84)),
        ("Strip", (3.4, -2.0, 1.2), 1.4, 90, (0.85, 0.92, 1.0)),
        ("Rim", (1.6, 3.4, 3.4), 1.5, 160, (1.0, 0.96, 0.9)),
    ):
        light = bpy.data.lights.new(name, "AREA")
        light.size, light.energy, light.color = size, power, color
        lamp = bpy.data.objects.new(name, light)
        lamp.location = place
        scene.collection.objects.link(lamp)
        look_at(lamp, (0, 0, 0))


def look_at(thing: bpy.types.Object, target: tuple[float, float, float]) -> None:
    direction = Vector(target) - thing.location
    thing.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()


def build(*, width: int, height: int, samples: int) -> bpy.types.Object:
    """Replace the open file by the demo's scene, ready to render; the object to age, active."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    body = add_body()
    body.data.materials.append(painted_steel())
    add_fittings()
    add_light()
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.lens = 66
    camera.location = (-1.95, -6.1, 1.15)
    scene.collection.objects.link(camera)
    look_at(camera, (0, 0, 0.1))
    scene.camera = camera

    scene.render.engine = "CYCLES"
    scene.cycles.samples = samples
    scene.cycles.use_denoising = True
    scene.cycles.max_bounces = 4
    scene.render.resolution_x, scene.render.resolution_y = width, height
    scene.render.use_persistent_data = True
    scene.view_settings.view_transform = "AgX"
    scene.view_settings.look = "AgX - Medium High Contrast"
    scene.view_settings.exposure = 0.35
    bpy.context.view_layer.objects.active = body
    body.select_set(True)
    return body
