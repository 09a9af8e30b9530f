"""Joins the group that ages a material to the material: the artist's nodes in, what they age to
out.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TypeAlias

from ....model_runtime.live.evaluate import Curves, unpacked_lobes
from ....model_runtime.maps import Pixels
from ...errors import MaterialError
from ..live.group import AUTHORED, aged_group, outputs_of
from ..nodes.strengths import GRAIN
from ..reading.pixels import read_exr
from ..result import LiveFiles
from .edit import Edit
from .relief import Show

__all__ = ("Aged", "aged_by_shader", "read_curves", "read_lobes")

Aged: TypeAlias = Mapping[str, Show]
"""What lets a socket show a map as it ages, by the map's name."""


def aged_by_shader(edit: Edit, maps: LiveFiles) -> Aged:
    """Adds the group of a material, fed with what feeds the Principled BSDF."""
    vector, lobes = edit.lookup(), read_lobes(maps)
    name = f"Aged {edit.material.name}"
    node = edit.layout.add("ShaderNodeGroup", name, column=0, row=0)
    node.width = 220
    node.node_tree = aged_group(
        name,
        maps,
        read_curves(maps.curves),
        lobes,
        age=edit.age,
        vector=vector is not None,
        timing_map=edit.timing_map,
        load=edit.show_file,
    )
    for identifier in AUTHORED:
        edit.follow(identifier, node.inputs[identifier])
    edit.tree.links.new(edit.age_socket(), node.inputs["Age"])
    if vector is not None:
        edit.tree.links.new(vector, node.inputs["Vector"])
    if maps.grain:
        node.inputs[GRAIN].default_value = edit.material.tvbrdf.grain
    outputs = outputs_of(maps, lobes).items()
    return {each: partial(edit.connect, node.outputs[output]) for each, output in outputs}


def read_curves(path: Path) -> Curves:
    rows = read_exr(path)
    if rows.shape[0] < 6 or rows.shape[0] % 3 or rows.shape[1] < 2:
        raise MaterialError(f"{path} holds no curves.", "Age the material again.")
    return Curves.unpacked(rows)


def read_lobes(maps: LiveFiles) -> Pixels | None:
    """The curves [K, T, 8] of lobes after the first; None where there are none."""
    if maps.lobe_curves is None:
        return None
    rows = read_exr(maps.lobe_curves)
    if len(rows) != 3 * (maps.lobes - 1) or rows.shape[1] < 2:
        raise MaterialError(f"{maps.lobe_curves} holds no lobes.", "Age the material again.")
    return unpacked_lobes(rows)
