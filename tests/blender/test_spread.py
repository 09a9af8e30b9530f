"""How large textures are in the world, on the objects that show them."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import read
from tests.blender.material_cases import add, new_material, plane, procedural, textured

pytestmark = pytest.mark.usefixtures("empty_scene")


def side(material, obj, tmp_path: Path) -> float:
    return read(material, obj, tmp_path).texture_side


def test_a_texture_is_as_large_as_its_unit_square(tmp_path):
    material = new_material()
    procedural(material)
    obj = plane(material)
    assert side(material, obj, tmp_path) == pytest.approx(2)
    obj.scale = (3, 3, 3)
    bpy.context.view_layer.update()
    assert side(material, obj, tmp_path) == pytest.approx(6)


@pytest.mark.parametrize(("pixels", "wanted"), [((8, 8), 2 / 3), ((8, 16), 2 / 3 * 2**0.5)])
def test_tiled_images_are_smaller_and_the_longer_side_counts(tmp_path, pixels, wanted):
    material = new_material()
    node = textured(material, np.random.default_rng(0).random((*pixels, 3)))
    mapping = add(material, "ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = (3, 3, 1)
    links = material.node_tree.links
    links.new(add(material, "ShaderNodeTexCoord").outputs["UV"], mapping.inputs[0])
    links.new(mapping.outputs[0], node.inputs[0])
    assert side(material, plane(material), tmp_path) == pytest.approx(wanted)


def test_what_is_looked_up_otherwise_covers_the_surface_once(tmp_path):
    material = new_material()
    node = textured(material, np.random.default_rng(0).random((8, 8, 3)))
    coordinates = add(material, "ShaderNodeTexCoord")
    material.node_tree.links.new(coordinates.outputs["Object"], node.inputs[0])
    assert side(material, plane(material), tmp_path) == pytest.approx(2)
