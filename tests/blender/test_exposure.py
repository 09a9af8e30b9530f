"""Where aging starts, as sliders: what the model has, what the artist says, what is asked for."""

from __future__ import annotations

import bpy
import pytest

from tests.blender.material_cases import new_material
from tvbrdf.model_runtime.contract import exposure_weights, start_places
from tvbrdf.tvbrdf_addon.exposure import asked

pytestmark = pytest.mark.usefixtures("empty_scene")


def test_the_model_decides_until_the_artist_does():
    settings = new_material().tvbrdf
    usual = {"exposure": None, "pattern_size": None, "amount": 1.0, "starts": None}
    assert asked(settings) == usual
    settings.ntm = "moss"
    settings.use_own_exposure = True
    weights = exposure_weights(asked(settings)["exposure"])
    assert weights["edges"] < 0 < weights["crevices"], "moss leaves edges alone"
    settings.exposure.edges, settings.pattern_size, settings.amount = 1.0, 0.5, 0.25
    request = asked(settings)
    assert exposure_weights(request["exposure"])["edges"] == 1
    assert request["pattern_size"] == 0.5
    assert request["amount"] == 0.25


def test_what_is_painted_or_everywhere_asks_for_nothing():
    settings = new_material().tvbrdf
    for onset in ("none", "image", "attribute"):
        settings.onset = onset
        assert asked(settings) == {}


def test_the_panel_has_a_place_for_it():
    for name in ("NODE_PT_tvbrdf_start", "MATERIAL_PT_tvbrdf_start"):
        assert getattr(bpy.types, name).bl_label == "Where It Starts"


def test_where_the_cursor_is_it_starts(empty_scene):
    material = bpy.data.materials.new("Paint")
    for place in ((1, 2, 0.5), (-1, 0, 0)):
        bpy.context.scene.cursor.location = place
        assert bpy.ops.tvbrdf.start_here(material="Paint") == {"FINISHED"}
    request = asked(material.tvbrdf)
    assert start_places(request["starts"]) == [(1, 2, 0.5), (-1, 0, 0)]
    bpy.ops.tvbrdf.start_anywhere(material="Paint")
    assert asked(material.tvbrdf)["starts"] is None
