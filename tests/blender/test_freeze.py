"""Freezing: stills stay, keys and drivers go, Revert still works."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from tests.blender.aged_cases import bind, emitting
from tests.blender.material_cases import (
    made_up,
    new_material,
    plane,
    principled_of,
    procedural,
    render,
    snapshot,
    view_from_above,
)

pytestmark = pytest.mark.usefixtures("empty_scene")


@pytest.mark.parametrize(("frame", "shown"), [(1, 1), (2, 4 / 3), (4, 2), (10, 4), (99, 4)])
def test_the_frame_stays_whatever_the_time(tmp_path, frame, shown):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze

    material = new_material()
    procedural(material)
    obj = plane(material)
    view_from_above()
    bind(material, obj, made_up(tmp_path / "aged"), tmp_path)
    freeze(material, frame)
    data = material.node_tree.animation_data
    assert not data.drivers
    from tvbrdf.tvbrdf_addon.material.nodes.animation import channels

    assert not len(channels(material.node_tree))
    emitting(material)
    for now in (1, 50):
        picture = render(tmp_path / "shown.exr", now, size=4, samples=1)
        np.testing.assert_allclose(picture, shown / 4, rtol=2e-3)


def test_uniform_materials_freeze_between_keys(tmp_path):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze

    material = new_material()
    material.tvbrdf.onset = "none"
    obj = plane(material)
    bind(material, obj, made_up(tmp_path / "aged", size=1), tmp_path, span=(1, 4))
    freeze(material, 2)
    for now in (1, 4):
        bpy.context.scene.frame_set(now)
        inputs = principled_of(material).inputs
        assert inputs["Roughness"].default_value == pytest.approx(0.5, rel=1e-3)
        np.testing.assert_allclose(inputs["Base Color"].default_value[:3], 0.5, rtol=1e-3)


@pytest.mark.parametrize("size", [1, 4])
def test_a_frozen_material_reverts(tmp_path, size):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze
    from tvbrdf.tvbrdf_addon.material.nodes.revert import revert

    material = new_material()
    procedural(material)
    obj = plane(material)
    bpy.context.scene.frame_set(1)
    before = snapshot(material)
    bind(material, obj, made_up(tmp_path / "aged", size=size), tmp_path)
    freeze(material, 5)
    freeze(material, 9)
    revert(material)
    bpy.context.scene.frame_set(1)
    assert snapshot(material) == before


def test_freezing_a_copy_leaves_the_other_playing(tmp_path):
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze

    material = new_material()
    procedural(material)
    bind(material, plane(material), made_up(tmp_path / "aged"), tmp_path)
    bpy.context.scene.frame_set(1)
    before = snapshot(material)
    freeze(material.copy(), 10)
    bpy.context.scene.frame_set(1)
    after = snapshot(material)
    for key in ("nodes", "links", "animation"):
        assert after[key] == before[key], key


def test_what_is_not_aged_cannot_be_frozen():
    from tvbrdf.tvbrdf_addon.errors import MaterialError
    from tvbrdf.tvbrdf_addon.material.binding.freeze import freeze

    with pytest.raises(MaterialError, match="not aged"):
        freeze(new_material(), 1)
