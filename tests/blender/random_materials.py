"""Random materials as artists have them, on random meshes: the same ones for the same seed."""

from __future__ import annotations

import random
from collections.abc import Sequence

import bpy
import numpy as np

__all__ = ("build",)

NAMES = (
    *("Material", "Rost & Öl", "木の板", "a\"quote'", "back\\slash", "[0].inputs", "dots.001"),
    *("x" * 63, "é" * 31, " spaces  ", "slash/es", "emoji 🎨", "%s {0}", "Age", "tvbrdf"),
)
LABELS = ("", "", "", "Age", "My label", "ünï", '"')
TEXTURES = ("TexNoise", "TexVoronoi", "TexWave", "TexGradient", "TexChecker", "TexMagic")
SHADERS = ("BsdfTransparent", "Emission", "BsdfSheen", "BsdfTranslucent", "BsdfGlass")
MODIFIERS = ("SUBSURF", "MIRROR", "ARRAY", "SOLIDIFY", "BEVEL", "DISPLACE", "TRIANGULATE", "WAVE")
SOCKETS = (
    *("Base Color", "Metallic", "Roughness", "Specular IOR Level", "IOR", "Specular Tint"),
    *("Coat Weight", "Emission Color", "Alpha", "Normal"),
)


def build(seed: int) -> bpy.types.Material:
    """Fills an empty file; the material to age, which an object shows."""
    rng = random.Random(seed)
    material = bpy.data.materials.new(rng.choice(NAMES))
    other = bpy.data.materials.new(rng.choice(NAMES))
    for each in (material, other):
        if bpy.app.version < (5, 0):
            each.use_nodes = True
        each.node_tree.nodes.clear()
    groups: list[bpy.types.NodeTree] = []
    for each in (material, other):
        _Grower(rng, each.node_tree, groups).surface()
        _decorate(rng, each.node_tree)
    obj = _mesh(rng, [material, other])
    if rng.random() < 0.4:
        second = obj.copy()
        second.location.x += 3
        bpy.context.scene.collection.objects.link(second)
    if rng.random() < 0.3:
        _share_an_action(material, other)
    if rng.random() < 0.2:
        material.node_tree.nodes.active = rng.choice(list(material.node_tree.nodes))
    return material


class _Grower:
    """Grows nodes in a tree: sources of values, a Principled BSDF on them, and what mixes it.

    `groups` are groups with a shader, which all materials of the file may use.
    """

    def __init__(
        self, rng: random.Random, tree: bpy.types.NodeTree, groups: list[bpy.types.NodeTree]
    ) -> None:
        self._rng = rng
        self._tree = tree
        self._groups = groups
        self._sources: list[bpy.types.NodeSocket] = []

    def surface(self) -> None:
        shader = self._mixed(self._principled(depth=0))
        output = self._new("ShaderNodeOutputMaterial")
        self._tree.links.new(shader, output.inputs["Surface"])
        if self._rng.random() < 0.2:
            second = self._new("ShaderNodeOutputMaterial")
            output.target, second.target = "CYCLES", "EEVEE"
            self._tree.links.new(shader, second.inputs["Surface"])

    def _new(self, kind: str) -> bpy.types.Node:
        node = self._tree.nodes.new(kind)
        node.location = self._rng.uniform(-900, 900), self._rng.uniform(-600, 600)
        if self._rng.random() < 0.3:
            node.name = self._rng.choice(NAMES)
        node.label = self._rng.choice(LABELS)
        return node

    def _principled(self, *, depth: int) -> bpy.types.NodeSocket:
        """The shader of a Principled BSDF, here or in a group."""
        if depth < 2 and self._rng.random() < 0.35:
            return self._group(depth).outputs[0]
        node = self._new("ShaderNodeBsdfPrincipled")
        node.distribution = self._rng.choice(("GGX", "MULTI_GGX"))
        for name in self._rng.sample(SOCKETS, self._rng.randint(0, 5)):
            if name == "Normal":
                bump = self._new("ShaderNodeBump")
                self._tree.links.new(self._source(), bump.inputs["Height"])
                self._tree.links.new(bump.outputs[0], node.inputs[name])
            else:
                self._link(self._source(), node.inputs[name])
        for name in ("Base Color", "Roughness", "Metallic"):
            self._set(node.inputs[name])
        return node.outputs[0]

    def _group(self, depth: int) -> bpy.types.Node:
        node = self._new("ShaderNodeGroup")
        if depth == 0 and self._groups and self._rng.random() < 0.5:
            node.node_tree = self._rng.choice(self._groups)
        else:
            node.node_tree = self._new_group(depth)
        for socket in node.inputs:
            if self._rng.random() < 0.5:
                self._link(self._source(), socket)
            else:
                self._set(socket)
        return node

    def _new_group(self, depth: int) -> bpy.types.NodeTree:
        group = bpy.data.node_groups.new(self._rng.choice(NAMES), "ShaderNodeTree")
        group.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
        panel = group.interface.new_panel("Panel") if self._rng.random() < 0.5 else None
        kinds = ("NodeSocketFloat", "NodeSocketColor")
        for i in range(self._rng.randint(0, 3)):
            group.interface.new_socket(
                f"Input {i}", in_out="INPUT", socket_type=self._rng.choice(kinds), parent=panel
            )
        inside = _Grower(self._rng, group, self._groups)
        start = inside._new("NodeGroupInput")
        inside._sources = list(start.outputs)[:-1]
        shader = inside._mixed(inside._principled(depth=depth + 1))
        group.links.new(shader, inside._new("NodeGroupOutput").inputs[0])
        _decorate(self._rng, group)
        if depth == 0:
            self._groups.append(group)
        return group

    def _mixed(self, shader: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """The shader behind none to three mixers with others."""
        for _ in range(self._rng.choice((0, 0, 1, 1, 2, 3))):
            other = self._new(f"ShaderNode{self._rng.choice(SHADERS)}").outputs[0]
            if self._rng.random() < 0.5:
                mixer, slots = self._new("ShaderNodeAddShader"), [0, 1]
            else:
                mixer, slots = self._new("ShaderNodeMixShader"), [1, 2]
                mixer.inputs[0].default_value = self._rng.uniform(0.1, 0.9)
                if self._rng.random() < 0.3:
                    self._link(self._source(), mixer.inputs[0])
            self._rng.shuffle(slots)
            self._tree.links.new(shader, mixer.inputs[slots[0]])
            self._tree.links.new(other, mixer.inputs[slots[1]])
            shader = mixer.outputs[0]
        return shader

    def _source(self) -> bpy.types.NodeSocket:
        """A value: one that is there already, or a new one."""
        if self._sources and self._rng.random() < 0.5:
            return self._rng.choice(self._sources)
        grow = self._rng.choice((self._procedural, self._image, self._constant, self._computed))
        made = grow()
        self._sources.append(made)
        return made

    def _procedural(self) -> bpy.types.NodeSocket:
        node = self._new(f"ShaderNode{self._rng.choice(TEXTURES)}")
        self._coordinates(node.inputs["Vector"])
        return self._rng.choice([each for each in node.outputs if each.enabled])

    def _image(self) -> bpy.types.NodeSocket:
        node = self._new("ShaderNodeTexImage")
        if bpy.data.images and self._rng.random() < 0.5:
            node.image = self._rng.choice(list(bpy.data.images))
        else:
            node.image = _new_image(self._rng)
        node.extension = self._rng.choice(("REPEAT", "EXTEND"))
        node.interpolation = self._rng.choice(("Linear", "Closest"))
        self._coordinates(node.inputs["Vector"])
        return node.outputs["Color"]

    def _constant(self) -> bpy.types.NodeSocket:
        node = self._new(self._rng.choice(("ShaderNodeRGB", "ShaderNodeValue")))
        self._set(node.outputs[0])
        return node.outputs[0]

    def _computed(self) -> bpy.types.NodeSocket:
        kind = self._rng.choice(("ValToRGB", "Math", "Mix", "HueSaturation", "Invert", "MapRange"))
        node = self._new(f"ShaderNode{kind}")
        node.mute = self._rng.random() < 0.15
        if kind == "Mix":
            node.data_type = "RGBA"
        inputs = [each for each in node.inputs if each.enabled]
        for socket in self._rng.sample(inputs, self._rng.randint(1, min(2, len(inputs)))):
            self._link(self._source(), socket)
        return next(each for each in node.outputs if each.enabled)

    def _coordinates(self, socket: bpy.types.NodeSocket) -> None:
        kind = self._rng.choice(("none", "none", "uv", "object", "mapping", "uv map"))
        if kind == "none":
            return
        node = self._new("ShaderNodeUVMap" if kind == "uv map" else "ShaderNodeTexCoord")
        source = node.outputs["Object" if kind == "object" else "UV"]
        if kind == "mapping":
            mapping = self._new("ShaderNodeMapping")
            mapping.inputs["Scale"].default_value = [self._rng.uniform(0.5, 3) for _ in range(3)]
            self._tree.links.new(source, mapping.inputs["Vector"])
            source = mapping.outputs[0]
        self._tree.links.new(source, socket)

    def _link(self, source: bpy.types.NodeSocket, socket: bpy.types.NodeSocket) -> None:
        """Links them, perhaps by a reroute, perhaps muted."""
        if self._rng.random() < 0.25:
            reroute = self._new("NodeReroute")
            self._tree.links.new(source, reroute.inputs[0])
            source = reroute.outputs[0]
        link = self._tree.links.new(source, socket)
        link.is_muted = self._rng.random() < 0.1

    def _set(self, socket: bpy.types.NodeSocket) -> None:
        """A value, perhaps keyed or driven."""
        if socket.type == "RGBA":
            socket.default_value = [*(self._rng.random() for _ in range(3)), 1]
        elif socket.type == "VALUE":
            socket.default_value = self._rng.random()
        else:
            return
        chance = self._rng.random()
        if chance < 0.12:
            for frame in (1, 5):
                socket.keyframe_insert("default_value", frame=frame)
        elif chance < 0.2 and socket.type == "VALUE":
            driver = socket.driver_add("default_value").driver
            driver.expression = "0.3 + frame / 100"


def _new_image(rng: random.Random) -> bpy.types.Image:
    floating = rng.random() < 0.3
    width, height = rng.choice(((8, 8), (16, 8), (5, 7)))
    made = bpy.data.images.new(rng.choice(NAMES), width, height, float_buffer=floating)
    values = np.random.default_rng(rng.randrange(2**32)).random((height, width, 4), np.float32)
    values[..., 3] = 1
    made.pixels.foreach_set(values.ravel())
    made.pack()
    return made


def _decorate(rng: random.Random, tree: bpy.types.NodeTree) -> None:
    """Frames around some nodes, one in another, and nodes that nothing shows."""
    nodes = list(tree.nodes)
    for _ in range(rng.randint(0, 2)):
        frame = tree.nodes.new("NodeFrame")
        frame.label = rng.choice(LABELS)
        for node in rng.sample(nodes, min(2, len(nodes))):
            node.parent = frame
        nodes.append(frame)
    if rng.random() < 0.3:
        tree.nodes.new("ShaderNodeBsdfPrincipled")
    if rng.random() < 0.3:
        tree.nodes.new("ShaderNodeValue").name = "Age"


def _share_an_action(material: bpy.types.Material, other: bpy.types.Material) -> None:
    data = material.node_tree.animation_data
    if data is None or data.action is None:
        return
    theirs = other.node_tree.animation_data_create()
    if theirs.action is not None:
        return
    theirs.action = data.action
    if hasattr(theirs, "action_slot"):
        theirs.action_slot = data.action_slot


def _mesh(rng: random.Random, materials: Sequence[bpy.types.Material]) -> bpy.types.Object:
    shapes = bpy.ops.mesh
    rng.choice(
        (
            shapes.primitive_plane_add,
            shapes.primitive_cube_add,
            shapes.primitive_uv_sphere_add,
            shapes.primitive_grid_add,
            shapes.primitive_torus_add,
        )
    )()
    obj = bpy.context.object
    obj.name = rng.choice(NAMES)
    if rng.random() < 0.3:
        obj.data.uv_layers.new(name=rng.choice(NAMES))
    for material in materials:
        obj.data.materials.append(material)
    for polygon in obj.data.polygons:
        polygon.material_index = int(polygon.index > 0 and rng.random() < 0.3)
    for kind in rng.sample(MODIFIERS, rng.choice((0, 0, 1, 2))):
        modifier = obj.modifiers.new(rng.choice(NAMES), kind)
        modifier.show_render = modifier.show_viewport = rng.random() < 0.9
    obj.active_material_index = 0
    return obj
