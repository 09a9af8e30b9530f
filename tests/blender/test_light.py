"""What ages by the light that falls on it: of a year's sun and sky, or of the scene's lights."""

from __future__ import annotations

import math

import bpy
import numpy as np
import pytest

from tests.blender.material_cases import new_material, plane, principled_of
from tests.blender.surface_truth import SIZE, cube, read_map, unwrap
from tvbrdf.tvbrdf_addon import lights, properties
from tvbrdf.tvbrdf_addon.errors import MaterialError
from tvbrdf.tvbrdf_addon.headless.parser import UsageError, line_parser
from tvbrdf.tvbrdf_addon.material.reading.tiles import Tiles
from tvbrdf.tvbrdf_addon.material.surface_maps.light import Light
from tvbrdf.tvbrdf_addon.material.surface_maps.maps import SurfaceMaps, write_surface
from tvbrdf.tvbrdf_addon.material.surface_maps.sunlight import light_of_a_year

pytestmark = pytest.mark.usefixtures("empty_scene")

UP, SOUTH, NORTH, EAST, WEST = (0, 0, 1), (0, -1, 0), (0, 1, 0), (1, 0, 0), (-1, 0, 0)


def irradiance(radiance: np.ndarray, normal: tuple[int, int, int]) -> float:
    height, width = radiance.shape
    up = ((np.arange(height) + 0.5) / height - 0.5)[:, None] * np.pi
    around = (0.5 - (np.arange(width) + 0.5) / width) * 2 * np.pi
    cosine = np.cos(up) * (normal[0] * np.cos(around) + normal[1] * np.sin(around))
    cosine = (cosine + normal[2] * np.sin(up)).clip(0)
    return float((radiance * cosine * np.cos(up)).sum() * 2 * np.pi**2 / (height * width))


def test_a_year_has_more_light_from_the_equator_than_from_the_pole():
    of = {
        side: irradiance(light_of_a_year(math.radians(45)), side)
        for side in (UP, SOUTH, NORTH, EAST, WEST)
    }
    assert of[UP] > of[SOUTH] > of[EAST] > of[NORTH] > 0
    assert of[EAST] == pytest.approx(of[WEST], rel=0.01)
    south = light_of_a_year(math.radians(-45))
    assert irradiance(south, NORTH) == pytest.approx(of[SOUTH], rel=0.01)
    level = light_of_a_year(0.0)
    assert irradiance(level, NORTH) == pytest.approx(irradiance(level, SOUTH), rel=0.01)
    turned = light_of_a_year(math.radians(45), math.radians(90))  # north is against X
    assert irradiance(turned, WEST) == pytest.approx(of[NORTH], rel=0.05)


def baked(material, tmp_path, light: Light, frame: int = 1) -> SurfaceMaps:
    maps = write_surface(
        *(material, bpy.context.scene, frame),
        uv_map="",
        tiles=Tiles(),
        kept=tmp_path / "kept",
        light=light,
        size=SIZE,
    )
    assert maps.folder is not None and maps.light is not None, maps.notes
    return maps


def sides(maps: SurfaceMaps, of=np.nanmedian) -> dict[tuple[int, ...], float]:
    """The light in the middle of each side of a cube, or another measure `of` all there."""
    assert maps.folder is not None and maps.light is not None
    light = read_map(maps.folder, maps.light.stem)[..., 0]
    normal = read_map(maps.folder, "normal")
    step = normal.shape[0] // light.shape[0]
    normal = normal[step // 2 :: step, step // 2 :: step]
    return {
        side: float(of(light[(normal[..., :3] @ np.array(side)) > 0.99]))
        for side in (UP, SOUTH, NORTH, EAST, WEST)
    }


def test_the_sun_of_a_year_lights_a_cube_as_it_does_the_sides_of_a_house(tmp_path):
    material = new_material()
    unwrap(cube(material))
    maps = baked(material, tmp_path, Light(None, math.radians(45)))
    found, radiance = sides(maps), light_of_a_year(math.radians(45))
    assert found[UP] == pytest.approx(1, abs=0.1)
    for side in (SOUTH, NORTH, EAST, WEST):
        expected = irradiance(radiance, side) / irradiance(radiance, UP)
        assert found[side] / found[UP] == pytest.approx(expected, abs=0.06)
    assert baked(material, tmp_path, Light(None, math.radians(45))).seconds == 0, "it is kept"
    assert baked(material, tmp_path, Light(None, math.radians(-45))).light != maps.light
    assert {each.name for each in bpy.data.scenes} == {bpy.context.scene.name}
    assert "tvbrdf look" not in bpy.data.worlds
    assert "tvbrdf look" not in bpy.data.images


def test_a_lamp_of_the_scene_lights_what_it_shines_on_where_it_stands_at_that_frame(tmp_path):
    material = new_material()
    unwrap(cube(material), cube(material, location=(2.2, 0, 0)))
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN"))
    bpy.context.scene.collection.objects.link(lamp)
    lamp.rotation_euler = (math.radians(90), 0, 0)  # shines along Y, on what faces against it
    found = sides(baked(material, tmp_path, Light(bpy.context.scene)), np.nanmax)
    assert found[SOUTH] == pytest.approx(1, abs=0.02)
    dark = max(found[side] for side in (UP, NORTH, EAST, WEST))
    assert dark < 0.02, "nor do two that face each other"
    lamp.hide_render = True
    with pytest.raises(MaterialError, match=r"No light of the scene falls on the surface.*Add one"):
        baked(material, tmp_path, Light(bpy.context.scene))


def test_what_glows_lights_what_stands_before_it_but_not_through_a_year(tmp_path):
    material, sign = new_material(), new_material("Neon")
    unwrap(cube(material))
    neon = plane(sign)
    neon.location, neon.rotation_euler = (0, -1.5, 0), (math.radians(90), 0, 0)
    strength = principled_of(sign).inputs["Emission Strength"]
    strength.default_value = 5.0
    found = sides(baked(material, tmp_path, Light(bpy.context.scene)))
    assert found[SOUTH] > 0.5
    assert max(found[side] for side in (NORTH, UP)) < 0.02
    by_day = sides(baked(material, tmp_path, Light(None, math.radians(45))))
    assert by_day[SOUTH] < 0.5, "it only takes the light there"
    color = principled_of(sign).inputs["Emission Color"]
    for shade, power in ((0.0, 5.0), (1.0, 0.0)):
        color.default_value, strength.default_value = (shade, shade, shade, 1.0), power
        with pytest.raises(MaterialError, match="No light of the scene"):
            baked(material, tmp_path, Light(bpy.context.scene))


def test_what_fades_does_by_the_sun_unless_told_otherwise():
    settings, scene = new_material().tvbrdf, bpy.context.scene

    def asked() -> Light | None:
        return lights.asked(settings, properties.card_of(settings), scene)

    assert asked() is None, "rust spreads"
    settings.ntm = "fading"
    assert asked() == Light(None, settings.latitude, 0)
    settings.light = "scene"
    assert asked() == Light(scene)
    settings.light = "none"
    assert asked() is None
    settings.light, settings.onset = "sun", "none"
    assert asked() is None, "everywhere at once"


def test_the_command_line_takes_degrees():
    told = line_parser().parse_args(["--light", "sun", "--latitude", "-33.9", "--north", "90"])
    assert (told.light, told.latitude, told.north) == ("sun", math.radians(-33.9), math.radians(90))
    with pytest.raises(UsageError, match="91 is not a number of degrees from -90 to 90"):
        line_parser().parse_args(["--latitude", "91"])
