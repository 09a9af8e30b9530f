"""The settings of a run, kept in the material: `material.tvbrdf`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, NamedTuple, TypeAlias

import bpy

from ..model_runtime.contract import (
    AUTO,
    BINDINGS,
    EVERYWHERE,
    LIVE,
    PRINCIPLED,
    PRINCIPLED_EXACT,
    QUALITIES,
    RANGES,
    RUNGS,
    SPECULARS,
    AgeRequest,
    Format,
    Told,
)
from ..model_runtime.model_files import weights
from . import exposure, preferences, suiting
from .known import scene_of
from .lights import Lights
from .masks import Masks, is_still
from .material.binding.retime import retime
from .material.nodes.age import frame_range
from .models import OWN_FILE, Item, enum_number, models_in
from .strengths import Strengths

__all__ = (
    "CLASSES",
    "LAST_FRAME",
    "OWN_FILE",
    "SHOWN",
    "card_named",
    "card_of",
    "model_file",
    "register",
    "unregister",
    "usual_model",
)

# Blender 4.5 and later want to be told that a path may begin with `//`; earlier ones never ask.
_Relative: TypeAlias = Literal["PATH_SUPPORTS_BLEND_RELATIVE"]
RELATIVE: tuple[_Relative, ...] = (
    ("PATH_SUPPORTS_BLEND_RELATIVE",) if bpy.app.version >= (4, 5) else ()
)

# Blender's own limit of frame numbers, on both sides of 0.
LAST_FRAME = 1_048_574

AUTOMATIC = Told("Automatic", "The simplest model that the source sequence supports")
ONSETS = (
    (AUTO, "Spots", "Aging starts in spots and spreads from them, as the model's process does"),
    (EVERYWHERE, "Everywhere at Once", "Every texel starts to age on the first frame"),
    ("image", "Image", "An image says when each texel starts: black at once, white at the end"),
    (
        "attribute",
        "Color Attribute",
        "What is painted on the mesh says when it starts: black at once, white at the end",
    ),
)


class Shown(NamedTuple):
    """How the aged reflectance becomes a Principled BSDF: the result's format, as it is told."""

    format: Format
    told: Told


SHOWN = {
    "as-authored": Shown(
        PRINCIPLED,
        Told(
            "As Authored",
            "Carries the change over to your own base color, metallic, specular and roughness. "
            "The first frame is your material, exactly. Best for materials made by hand, and "
            "exports to glTF",
        ),
    ),
    "exact": Shown(
        PRINCIPLED_EXACT,
        Told(
            "Exact",
            "Shows the modeled reflectance to the digit, without Fresnel. Best for measured "
            "materials and for comparisons",
        ),
    ),
}
"""What `format` may be; saved in .blend files under these names."""


def _items(choices: Mapping[str, Told]) -> tuple[tuple[str, str, str], ...]:
    """`choices` as Blender's lists have them, with a plain tuple each."""
    return tuple((name, told.title, told.meaning) for name, told in choices.items())


def _model_items(self: TVBRDF_PG_material | None, _context: bpy.types.Context | None) -> list[Item]:
    return suiting.models_for(self.id_data if self is not None else None)


def _choose_model(self: TVBRDF_PG_material, _context: bpy.types.Context) -> None:
    self.suggested = ""


def _leave_scene_range(self: TVBRDF_PG_material, _context: bpy.types.Context) -> None:
    self.use_scene_range = False  # which moves the keys


def _move_keys(self: TVBRDF_PG_material, context: bpy.types.Context) -> None:
    material = self.id_data
    assert isinstance(material, bpy.types.Material)
    retime(material, *frame_range(material, scene_of(context)))


def _leave_camera_size(self: TVBRDF_PG_material, _context: bpy.types.Context) -> None:
    self.use_camera_size = False


def _take_active_attribute(self: TVBRDF_PG_material, context: bpy.types.Context) -> None:
    obj = context.object
    if self.onset == "attribute" and not self.onset_attribute and obj and obj.type == "MESH":
        self.onset_attribute = obj.data.color_attributes.active_color_name


def _take_exposure_over(self: TVBRDF_PG_material, _context: bpy.types.Context) -> None:
    if self.use_own_exposure:
        exposure.take_over(self.exposure, card_of(self))


class TVBRDF_PG_material(Strengths, Masks, Lights, bpy.types.PropertyGroup):
    """How a material is aged, and what it was before."""

    ntm: bpy.props.EnumProperty(
        name="Model",
        description="What happens to the material",
        items=_model_items,
        default=enum_number("rust"),
        update=_choose_model,
    )
    suggested: bpy.props.StringProperty(
        description="The model that was chosen because it suits the material best",
        options={"HIDDEN"},
    )
    ntm_file: bpy.props.StringProperty(
        name="Model File",
        description="Model file (.safetensors) made by the training package",
        subtype="FILE_PATH",
        options={*RELATIVE},
    )
    use_scene_range: bpy.props.BoolProperty(
        name="Scene Range",
        description="Age over the scene's frame range",
        default=True,
        update=_move_keys,
    )
    frame_start: bpy.props.IntProperty(
        name="First Frame",
        description="Frame on which aging starts; the material is still as you made it",
        default=1,
        min=-LAST_FRAME,
        max=LAST_FRAME,
        update=_leave_scene_range,
    )
    frame_end: bpy.props.IntProperty(
        name="Last Frame",
        description="Frame on which the material is fully aged",
        default=250,
        min=-LAST_FRAME,
        max=LAST_FRAME,
        update=_leave_scene_range,
    )
    steps: bpy.props.IntProperty(
        name="Stages",
        description="Stages of aging that are computed and stored; spread over the frame range",
        default=AgeRequest.frames,
        min=2,  # one would be the material as it is
        max=RANGES["frames"][1],
        soft_max=250,
    )
    use_camera_size: bpy.props.BoolProperty(
        name="Size from Cameras",
        description=(
            "Make the textures as large as the cameras of the scene can see over the frame range, "
            "and never larger than the material's own images"
        ),
        default=False,
    )
    size: bpy.props.IntProperty(
        name="Size",
        description="Longer side of textures that are baked or made anew; images keep their size",
        default=1024,
        min=16,
        max=8192,
        subtype="PIXEL",
        update=_leave_camera_size,
    )
    quality: bpy.props.EnumProperty(
        name="Quality",
        description="How much of the material is modeled",
        items=_items(QUALITIES),
        default=AgeRequest.quality,
    )
    output: bpy.props.StringProperty(
        name="Output",
        description="Folder for the textures; every material gets a folder of its own inside",
        default="//aged",
        subtype="DIR_PATH",
        options={*RELATIVE},
    )
    tolerance: bpy.props.FloatProperty(
        name="Tolerance",
        description="How close, in dB, the result stays to that of quality Exact. Higher is closer",
        default=AgeRequest.tolerance,
        min=10.0,
        max=100.0,
        precision=0,
    )
    temporal_model: bpy.props.EnumProperty(
        name="Temporal Model",
        description="How change over time is modeled",
        items=_items({AUTO: AUTOMATIC, **RUNGS}),
        default=AgeRequest.temporal_model,
    )
    onset: bpy.props.EnumProperty(
        name="Start",
        description="Where aging starts",
        items=ONSETS,
        default=AgeRequest.onset,
        update=_take_active_attribute,
    )
    onset_image: bpy.props.PointerProperty(
        name="Start Image",
        description=(
            "Grayscale image that says when each texel starts to age; painted in Blender, it "
            "counts as it is now"
        ),
        type=bpy.types.Image,
        poll=is_still,
    )
    onset_attribute: bpy.props.StringProperty(
        name="Start Attribute",
        description=(
            "Color attribute, painted in Vertex Paint mode for instance, that says when each "
            "place starts to age"
        ),
    )
    onset_invert: bpy.props.BoolProperty(
        name="Invert",
        description="White starts at once and black at the end, not the other way round",
        default=False,
    )
    seed: bpy.props.IntProperty(
        name="Seed",
        description="Another number gives other spots",
        default=0,
        min=0,
    )
    use_own_exposure: bpy.props.BoolProperty(
        name="My Own Places",
        description="Say yourself where aging starts, not the model: sliders, set as it has them",
        default=False,
        update=_take_exposure_over,
    )
    exposure: bpy.props.PointerProperty(
        name="Places",
        description="What aging seeks or avoids, where you say so yourself",
        type=exposure.TVBRDF_PG_exposure,
    )
    pattern_size: bpy.props.FloatProperty(
        name="Pattern Size",
        description="How large the spots are; 0 fits them to the object",
        default=0.0,
        min=0.0,
        max=1e6,
        subtype="DISTANCE",
        unit="LENGTH",
    )
    amount: bpy.props.FloatProperty(
        name="Amount",
        description="How much of the surface has aged at the end",
        default=1.0,
        min=0.01,
        max=1.0,
        subtype="FACTOR",
    )
    shader: bpy.props.StringProperty(
        name="Shader",
        description="Which Principled BSDF ages, of several that the surface mixes, by the names "
        "of its groups and its own; empty for the one with the largest share",
        options={"HIDDEN"},
    )
    starts: bpy.props.StringProperty(
        name="Starts",
        description="Places in the world where aging starts before anywhere else, X,Y,Z in meters, "
        "with a ; in between",
    )
    use_alike: bpy.props.BoolProperty(
        name="Mirrored Alike",
        description=(
            "What shares texels, as mirrored halves do, starts alike. Else each place starts for "
            "itself, by a UV map that is made for it"
        ),
        default=False,
    )
    specular: bpy.props.EnumProperty(
        name="Highlights",
        description="Color of the aged highlights",
        items=_items(SPECULARS),
        default=AgeRequest.specular,
    )
    format: bpy.props.EnumProperty(
        name="Mapping",
        description="How the aged reflectance becomes a Principled BSDF",
        items=_items({name: shown.told for name, shown in SHOWN.items()}),
        default="as-authored",
    )
    binding: bpy.props.EnumProperty(
        name="Shown As",
        description="How the aged material is kept and shown",
        items=_items(BINDINGS),
        default=LIVE,
    )
    original: bpy.props.StringProperty(
        description="What Revert restores, as JSON; empty while the material is not aged",
        options={"HIDDEN"},
    )
    keyed: bpy.props.IntVectorProperty(
        description="The first and last frame that aging was keyed on",
        size=2,
        options={"HIDDEN"},
    )
    is_preview: bpy.props.BoolProperty(
        description="Whether what is shown is the preview of a run that goes on",
        options={"HIDDEN"},
    )
    folder: bpy.props.StringProperty(
        name="Result",
        description="Folder with the textures of the last run",
        subtype="DIR_PATH",
        options={"HIDDEN", *RELATIVE},
    )
    size_reason: bpy.props.StringProperty(
        description="Why the textures of the last run have their size; empty where it was chosen",
        options={"HIDDEN"},
    )


def card_of(settings: TVBRDF_PG_material) -> weights.ModelCard | None:
    """The card of the chosen model; None where it is a file of the user's or no longer there."""
    return card_named(settings.ntm)


def card_named(name: str) -> weights.ModelCard | None:
    """The card of a model that can be chosen; None where there is none called that."""
    return models_in(preferences.model_folders()).cards.get(name)


def usual_model(card: weights.ModelCard) -> str | None:
    """The temporal model that the card names; None where it names none that is known."""
    named = card.details.get("temporal_model")
    return named if named in RUNGS else None


def model_file(settings: TVBRDF_PG_material) -> Path | None:
    """The chosen model's file; None where none is chosen, or it is no longer there."""
    if settings.ntm == OWN_FILE:
        return Path(bpy.path.abspath(settings.ntm_file)) if settings.ntm_file else None
    card = card_of(settings)
    return card.path if card is not None else None


def register() -> None:
    bpy.types.Material.tvbrdf = bpy.props.PointerProperty(type=TVBRDF_PG_material)


def unregister() -> None:
    del bpy.types.Material.tvbrdf


CLASSES = (*exposure.CLASSES, TVBRDF_PG_material)
