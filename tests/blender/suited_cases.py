"""Forty materials and the models that an artist would want for each, written down before anything
was measured.

Textured ones are whole texture sets, as artists download them; measured ones are BRDFs, fitted and
made a Principled BSDF's values, which are all there is to see of them.  No encoder has
seen the first five of MERL or any of RGL; Metal022, PaintedMetal007, wood_peeling_paint_weathered,
Planks023B, Rock053 and dirty_concrete are what models were learned from.
"""

from __future__ import annotations

TEXTURED = {
    "pbr/Wood049": {"weathered_wood"},  # brown oak
    "pbr/PaintedWood007B": {"peeling_wood"},  # blue paint worn to wood
    "pbr/Metal035": {"patina"},  # copper
    "pbr/Metal024": {"rust"},  # gray steel with rust spots
    "pbr/Metal032": {"rust"},  # blue-gray steel
    "pbr/Plastic005": {"soiling", "fading"},  # scratched gray-blue plastic
    "pbr/PaintedMetal004": {"peeling_metal", "rust"},  # red paint scratched to bare metal
    "pbr/PaintedMetal007": {"peeling_metal", "rust"},  # blue paint flaking to rust
    "pbr/Rust004": {"rust"},  # dark rust
    "pbr/Leather028": {"char", "fading"},  # brown leather
    "pbr/Granite002A": {"moss", "soiling"},  # speckled granite, very smooth
    "pbr/Fabric045": {"char", "soiling"},  # off-white cloth
    "scans/Metal022": {"rust"},  # bare steel half rusted
    "scans/CorrugatedSteel007B": {"peeling_metal", "rust"},  # pale blue paint, rust in streaks
    "scans/rusty_metal_05": {"rust"},  # rust flaking off steel
    "scans/wood_peeling_paint_weathered": {"peeling_wood"},  # dark paint peeling off wood
    "scans/Planks010": {"peeling_wood", "weathered_wood"},  # gray paint that begins to go
    "scans/Planks023B": {"weathered_wood", "moss"},  # wood gone gray outdoors
    "scans/dirty_concrete": {"soiling", "moss"},  # concrete with soaked-in stains
    "scans/Rock053": {"moss"},  # moss and lichen on rock
}
"""Folders of the data with the models that are right."""

MEASURED = {
    "merl": {
        "alum-bronze": {"patina"},  # held out, as are the next four
        "blue-acrylic": {"fading"},
        "dark-red-paint": {"peeling_metal", "peeling_wood", "fading"},
        "pink-felt": {"fading"},
        "steel": {"rust"},
        "chrome-steel": {"rust"},
        "black-oxidized-steel": {"rust"},
        "cherry-235": {"weathered_wood", "yellowing", "char"},  # stained wood
        "ipswich-pine-221": {"weathered_wood", "yellowing", "char"},
        "special-walnut-224": {"weathered_wood", "yellowing", "char"},
        "blue-fabric": {"fading"},
        "red-plastic": {"fading"},
        "white-paint": {"soiling", "peeling_metal", "peeling_wood"},
        "gray-plastic": {"soiling"},
        "orange-paint": {"peeling_metal", "peeling_wood", "fading"},
    },
    "rgl-isotropic": {
        "acrylic_felt_green_rgb": {"fading"},
        "acrylic_felt_orange_rgb": {"fading"},
        "paper_blue_rgb": {"fading", "char"},
        "paper_yellow_rgb": {"fading", "char", "yellowing"},
        "laika_ceiling_paint_18_gray_rgb": {"soiling", "peeling_metal", "peeling_wood"},
    },
}
"""Materials of the two databases with the models that are right."""

CALLED: list[tuple[set[str], tuple[str, ...]]] = [
    ({"rust"}, ("rusty_metal_02", "rust_coarse_01", "metal_plate", "SheetMetal004")),
    (
        {"peeling_metal", "rust"},
        ("green_metal_rust", "corrugated_iron_02", "painted_metal_shutter"),
    ),
    ({"peeling_wood"}, ("blue_painted_planks", "PaintedWood009")),
    ({"peeling_wood", "weathered_wood"}, ("weathered_brown_planks", "WoodSiding008")),
    ({"char", "peeling_wood", "weathered_wood"}, ("bark_willow", "oak_veneer_01")),
    ({"moss"}, ("rock_face", "aerial_rocks_02", "PavingStones092")),
    (
        {"moss", "soiling"},
        (
            "cobblestone_floor_04",
            "marble_01",
            "slate_floor",
            "red_brick_03",
            "castle_brick_01",
            "Bricks076",
            "concrete_wall_001",
            "factory_wall",
            "Facade018A",
            "painted_plaster_wall",
            "beige_wall_001",
            "roof_tiles_14",
            "asphalt_02",
            "Travertine009",
        ),
    ),
    ({"char", "fading"}, ("brown_leather", "denim_fabric", "cotton_jersey", "Cardboard004")),
    ({"patina"}, ("copper_roof", "Messing Brass")),
    ({"fading", "soiling"}, ("Plastic013A",)),
]
"""What artists' libraries call their materials, with the models that are right for a middling gray
one of that name.
"""
