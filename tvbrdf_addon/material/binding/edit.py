"""Changes a node tree so that every change is recorded and can be taken back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypeAlias

import bpy
import numpy as np

from ....model_runtime.contract import HEIGHT
from ...errors import MaterialError
from ...known import image_texture, known
from ..nodes.age import give_age
from ..nodes.animation import AnimationBefore, copy_animation, drive_by_age, key, own_action
from ..nodes.groups import feed, own_groups, shown_outside
from ..nodes.layout import Layout
from ..nodes.ownership import TAG
from ..nodes.record import Link, Record, SocketBefore, store, tagged
from ..nodes.surface import find_principled
from ..nodes.trace import input_socket, is_animated
from ..nodes.uv_maps import give_uv_map
from ..reading.lookup import Reading
from ..reading.pixels import read_exr_texel, set_as_data
from ..result import AgedMap
from ..surface_maps.collect import UVMap

__all__ = ("Edit",)

Transform: TypeAlias = Callable[[float], float]


class Edit:
    """One edit of a material under way: adds nodes, takes sockets over, shows maps on them.

    `span` are the first and last frame of the scene that ages 0 to 1 are spread over, `times` the
    ages of the modeled frames, if there are such.  `finish` writes the record; call it also
    before undoing a failed edit.
    """

    def __init__(
        self,
        material: bpy.types.Material,
        reading: Reading,
        span: tuple[int, int],
        times: Sequence[float] = (),
    ) -> None:
        self.material = material
        self.tree = known(material.node_tree)
        place = find_principled(material)
        self._reading = reading
        self._times = times
        self._span = span
        self._rows = 0
        self._vector: bpy.types.NodeSocket | None = None
        self._inside: bpy.types.Node | None = None
        self._record = Record(
            principled=place.principled.name,
            frames=len(times),
            animation=AnimationBefore.of(self.tree),
            links=tuple(Link.of(link) for link in self.tree.links),
        )
        for node in tagged(self.tree):
            del node[TAG]  # pasted from an aged material: the artist's here
        own_action(self.tree, mark=True)
        self.place = own_groups(place)
        self.layout = Layout(self.tree, (*self.place.groups, self.place.principled)[0])

    def finish(self) -> None:
        """Writes what was changed into the material."""
        self._record.animation.claim(self.tree)
        if self._record.owner:
            self._record.owner.claim(self.material)
        store(self.material, self._record)

    def input(self, identifier: str) -> bpy.types.NodeSocket:
        """An input of the material's Principled BSDF."""
        return self.place.input(identifier)

    @property
    def timing_map(self) -> str | None:
        """The UV map by which timing is looked up, where the textures' own lookup is not."""
        return self._record.uv_map

    def give_uv_map(self, uv_map: UVMap) -> None:
        """Adds the UV map that timing is looked up by to the meshes that show the material."""
        give_uv_map(uv_map.name, uv_map.places)
        self._record = replace(self._record, uv_map=uv_map.name)

    @property
    def age(self) -> str:
        """The custom property of the material that says how old it is; keyed over the range."""
        if self._record.age is None:
            before, name = give_age(self.material, self._span)
            self._record = replace(self._record, owner=before, age=name)
        return known(self._record.age)

    def age_socket(self) -> bpy.types.NodeSocket:
        """The output of a new node that shows the age."""
        socket = self.layout.add("ShaderNodeValue", "Age", column=1, row=0).outputs[0]
        drive_by_age(socket, "default_value", material=self.material, age=self.age)
        return socket

    def follow(self, identifier: str, socket: bpy.types.NodeSocket) -> None:
        """Feeds a new socket with what feeds an input of the Principled BSDF."""
        original = self.input(identifier)
        if hasattr(original, "default_value") and identifier != "Normal":
            socket.default_value = original.default_value
            if original.id_data == self.tree:
                copy_animation(original, socket)
        for link in known(original.links):
            source = self.outside(known(link.from_socket))
            self.tree.links.new(source, socket).is_muted = link.is_muted

    def use_ggx(self) -> None:
        """Gives the Principled BSDF the plain GGX distribution."""
        principled = self.place.principled
        if not self.place.groups:
            self._record = replace(self._record, distribution=principled.distribution)
        principled.distribution = "GGX"

    def connect(self, source: bpy.types.NodeSocket, socket: bpy.types.NodeSocket) -> None:
        """Links `source` to one of the artist's sockets in place of what was there."""
        if socket.id_data != self.tree:
            feed(source, socket, self.place.groups)
            return
        self._remember(socket)
        self.tree.links.new(source, socket)

    def replace_shader(self, source: bpy.types.NodeSocket) -> None:
        """Shows `source` wherever the material's Principled BSDF was shown."""
        shown = known(self.place.principled.outputs)["BSDF"]
        for link in list(known(shown.links)):
            self.connect(source, known(link.to_socket))

    def outside(self, source: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """An output socket of one of the artist's nodes, as it is in the material's own tree.

        What is in a group is taken from a second node of it: the first would show what depends on
        itself.
        """
        if source.id_data == self.tree:
            return source
        if self._inside is None:
            group = self.place.groups[0]
            self._inside = self.layout.add("ShaderNodeGroup", "Inside", column=4, row=1)
            self._inside.node_tree = group.node_tree
            for theirs, ours in zip(group.inputs, self._inside.inputs, strict=True):
                if not theirs.is_linked:
                    if hasattr(theirs, "default_value"):
                        ours.default_value = theirs.default_value
                    continue
                link = known(theirs.links)[0]
                if TAG not in known(link.from_node):
                    self.tree.links.new(known(link.from_socket), ours)
        shown = shown_outside(source, self.place.groups)
        return next(each for each in self._inside.outputs if each.identifier == shown.identifier)

    def fix(self, socket: bpy.types.NodeSocket, value: float) -> None:
        """Sets one of the artist's sockets to a number for good."""
        self._own(socket).default_value = value

    def show(
        self, aged: AgedMap, socket: bpy.types.NodeSocket, transform: Transform | None = None
    ) -> None:
        """Lets a socket, the artist's or a new node's, show a map over time.

        `transform` is `math.sqrt`, or None to show the map's own values.
        """
        if aged.uniform:
            self._show_values(aged, self._own(socket), transform)
            return
        source = self._fade(aged)
        if transform is not None:
            root = self.layout.add("ShaderNodeMath", "Square Root", column=-1, row=self._rows)
            root.operation = "SQRT"
            self.tree.links.new(source, root.inputs[0])
            source = root.outputs[0]
        self._rows += 1
        self.connect(source, socket)

    def _show_values(
        self, aged: AgedMap, socket: bpy.types.NodeSocket, transform: Transform | None
    ) -> None:
        """Keys the socket once a modeled frame, straight between them."""
        texels = [read_exr_texel(path) for path in aged.files]
        if aged.changes:
            frames = range(len(self._times))
            columns = (
                np.interp(frames, aged.stored, column) for column in zip(*texels, strict=True)
            )
            texels = list(zip(*(column.tolist() for column in columns), strict=True))
        if socket.type == "RGBA":
            values: list[float | tuple[float, ...]] = [(*texel, 1.0) for texel in texels]
        else:
            values = [transform(texel[0]) if transform else texel[0] for texel in texels]
        if aged.changes:
            first, last = self._span
            key(socket, values, [first + time * (last - first) for time in self._times])
        else:
            socket.default_value = values[0]

    def _fade(self, aged: AgedMap) -> bpy.types.NodeSocket:
        """Plays the map's stored frames by Age and fades from each into the next.

        Two textures take turns: one changes to its next frame while only the other is seen.
        """
        even = self._texture(aged, 0, column=2)
        if not aged.changes:
            return known(even.outputs)["Color"]
        odd = self._texture(aged, 1, column=1)
        fade = self.layout.add("ShaderNodeMix", f"Fade {aged.name}", column=0, row=self._rows)
        fade.data_type = "RGBA"
        self.tree.links.new(known(even.outputs)["Color"], input_socket(fade, "A_Color"))
        self.tree.links.new(known(odd.outputs)["Color"], input_socket(fade, "B_Color"))
        shares = [(frame, i % 2) for i, frame in enumerate(aged.stored)]
        self._drive(input_socket(fade, "Factor_Float"), "default_value", shares, "LINEAR")
        return next(each for each in fade.outputs if each.identifier == "Result_Color")

    def _texture(self, aged: AgedMap, turn: int, *, column: int) -> bpy.types.ShaderNodeTexImage:
        """A texture of every second stored frame, from the first (`turn` 0) or second (1) on."""
        node = image_texture(
            self.layout.add("ShaderNodeTexImage", aged.name, column=column, row=self._rows)
        )
        self.show_file(node, aged.files[turn])
        if aged.name == HEIGHT:
            node.image.use_half_precision = False  # in which Cycles makes 0 something more
        frames = aged.stored[turn::2]
        if len(frames) > 1:
            node.image.source = "SEQUENCE"
            user = node.image_user
            user.frame_start = user.frame_duration = 1
            # Cyclic and of length 1: at its only frame, moved by the offset, at any time.
            user.use_cyclic = user.use_auto_refresh = True
            unseen = (0, *aged.stored[1 + turn :: 2])
            points = list(zip(unseen, frames, strict=False))
            self._drive(user, "frame_offset", points, "CONSTANT")
        vector = self.lookup()
        if vector is not None:
            self.tree.links.new(vector, input_socket(node, "Vector"))
        return node

    def show_file(self, node: bpy.types.ShaderNodeTexImage, path: Path) -> None:
        """Lets a texture show a file in the material's own projection."""
        sampling = self._reading.sampling
        node.projection = sampling.projection
        node.projection_blend = sampling.projection_blend
        # What lies beside all tiles is to show the nearest, not the farthest.
        node.extension = sampling.extension if self._reading.tiles.are_one else "EXTEND"
        node.interpolation = sampling.interpolation
        node.image = self._image(path)

    def _drive(
        self,
        driven: bpy.types.bpy_struct,
        path: str,
        points: Sequence[tuple[int, float]],
        interpolation: Literal["CONSTANT", "LINEAR"],
    ) -> None:
        drive_by_age(
            driven,
            path,
            material=self.material,
            age=self.age,
            last=len(self._times) - 1,
            points=points,
            interpolation=interpolation,
        )

    def _image(self, path: Path) -> bpy.types.Image:
        image = bpy.data.images.load(str(path), check_existing=False)
        image.name = f"{self.material.name} {path.stem.rpartition('_')[0]}"
        image[TAG] = 1
        set_as_data(image)
        image.alpha_mode = "CHANNEL_PACKED"  # it is data, if there is any
        image.filepath = _path(path)
        return image

    def lookup(self) -> bpy.types.NodeSocket | None:
        """What feeds the textures' Vector; None is the UV map that each object renders with."""
        if self._vector is None:
            self._vector = self._coordinates()
            if not self._reading.tiles.are_one:
                self._vector = self._among_tiles(self._vector or self._uv(""))
        return self._vector

    def _coordinates(self) -> bpy.types.NodeSocket | None:
        """The same for textures that are not in tiles."""
        sampling, uv_map = self._reading.sampling, self._reading.uv_map
        if sampling.node is not None:
            node = self.place.trees[sampling.depth].nodes.get(sampling.node)
            outputs = node.outputs if node else ()
            found = next((each for each in outputs if each.identifier == sampling.socket), None)
            if found is None:
                raise MaterialError(
                    f"The node “{sampling.node}” of “{self.material.name}” was removed while the "
                    "material was aging.",
                    "Age the material again.",
                )
            return self.outside(found)
        if uv_map is None or not _all_have(self.material, uv_map):
            return None
        return self._uv(uv_map)

    def _uv(self, uv_map: str) -> bpy.types.NodeSocket:
        """A UV map; with an empty name that which each object renders with."""
        node = self.layout.add("ShaderNodeUVMap", "UV", column=3, row=0)
        node.uv_map = uv_map
        return node.outputs["UV"]

    def _among_tiles(self, vector: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """Coordinates in UDIM tiles as those in the one image that shows them all."""
        tiles = self._reading.tiles
        node = self.layout.add("ShaderNodeMapping", "Tiles", column=3, row=1)
        size = tiles.columns, tiles.rows
        shift = (-at / length for at, length in zip(tiles.corner, size, strict=True))
        node.inputs["Location"].default_value = (*shift, 0)
        node.inputs["Scale"].default_value = (*(1 / length for length in size), 1)
        self.tree.links.new(vector, node.inputs["Vector"])
        return node.outputs["Vector"]

    def _own(self, socket: bpy.types.NodeSocket) -> bpy.types.NodeSocket:
        """A socket whose value may be set: this one unlinked, or a new node's that feeds it.

        Keys and drivers of the artist's would win over a value, but a link wins over them.  What
        is in a group shares its keys with others.
        """
        if TAG in known(socket.node):
            return socket
        if is_animated(socket) or socket.id_data != self.tree:
            kind = "ShaderNodeRGB" if socket.type == "RGBA" else "ShaderNodeValue"
            source = self.layout.add(kind, socket.name, column=1, row=self._rows).outputs[0]
            self._rows += 1
            self.connect(source, socket)
            return source
        self._remember(socket)
        for link in list(known(socket.links)):
            self.tree.links.remove(link)
        return socket

    def _remember(self, socket: bpy.types.NodeSocket) -> None:
        if TAG not in known(socket.node):
            self._record = self._record.with_socket(SocketBefore.of(socket))


def _path(path: Path) -> str:
    """Relative to the .blend where that is saved, so that both can move together."""
    if not bpy.data.filepath:
        return str(path)
    try:
        return bpy.path.relpath(str(path))
    except ValueError:  # another drive, on Windows
        return str(path)


def _all_have(material: bpy.types.Material, uv_map: str) -> bool:
    users = [
        obj
        for obj in bpy.data.objects
        if obj.type == "MESH" and any(slot.material == material for slot in obj.material_slots)
    ]
    return all(uv_map in obj.data.uv_layers for obj in users)
