"""What operators act on, and those that wait for nothing: cancel, revert, freeze, starts."""

from __future__ import annotations

import difflib
from typing import ClassVar, NamedTuple

import bpy

from . import session
from .errors import SettingsError
from .known import known, scene_of
from .log import said_of
from .material.binding.freeze import freeze
from .material.nodes.record import is_live
from .material.nodes.revert import is_aged, revert
from .material.reading.chosen import object_with
from .redraw import redraw

__all__ = (
    "CLASSES",
    "OnMaterial",
    "Target",
    "can_have_material",
    "find_material",
    "is_shown",
    "material_of",
)


def material_of(context: bpy.types.Context) -> bpy.types.Material | None:
    """The material that the editor under the mouse shows, else the active object's."""
    space = context.space_data
    if space is not None and space.type == "NODE_EDITOR":
        # A pinned editor shows another material than the object's.
        return space.id if isinstance(space.id, bpy.types.Material) else None
    if getattr(context, "material", None) is not None:
        return context.material
    return context.object.active_material if context.object is not None else None


def can_have_material(obj: bpy.types.Object | None) -> bool:
    """Whether an object has a surface that a material can be given to."""
    return obj is not None and obj.library is None and hasattr(obj.data, "materials")


def find_material(name: str) -> bpy.types.Material:
    """The material of this file called `name`.

    Raises:
        SettingsError: there is none; names the closest.
    """
    names = [material.name for material in bpy.data.materials if material.library is None]
    if name in names:
        # A linked one may have the same name; the stubs know no library beside it.
        return bpy.data.materials[name, None]  # pyright: ignore[reportCallIssue, reportArgumentType]
    if name in bpy.data.materials:
        return bpy.data.materials[name]
    folded = {other.casefold(): other for other in names}
    close = difflib.get_close_matches(name.casefold(), folded, n=3, cutoff=0.5)
    if close:
        hint = f"Did you mean {' or '.join(folded[match] for match in close)}?"
    elif names:
        hint = f"There are {', '.join(sorted(names)[:10])}."
    else:
        hint = "The file has no materials."
    raise SettingsError(f"There is no material called {name}.", hint)


class Target(NamedTuple):
    material: bpy.types.Material
    scene: bpy.types.Scene


class OnMaterial:
    """An operator on the material named by `material`, or else shown where it is called."""

    material: bpy.props.StringProperty(
        name="Material",
        description="Name of the material; empty for the one that is shown",
        options={"SKIP_SAVE"},
    )

    def target(self, context: bpy.types.Context) -> Target:
        if self.material:
            return Target(find_material(self.material), scene_of(context))
        if (material := material_of(context)) is None:
            raise SettingsError("There is no material here.", "Give the object one first.")
        return Target(material, scene_of(context))

    def refuse(self, error: BaseException) -> set[str]:
        self.report({"ERROR"}, said_of(error))
        return {"CANCELLED"}


def is_shown(context: bpy.types.Context) -> bool:
    """Whether the call comes from an editor that shows a material, so that it must be that one.

    A script names its material instead, which `poll` cannot see.
    """
    return context.area is not None and context.area.type in {"NODE_EDITOR", "PROPERTIES"}


class TVBRDF_OT_new_material(bpy.types.Operator):
    """Give the object a material with a Principled BSDF, which can be aged"""

    bl_idname = "tvbrdf.new_material"
    bl_label = "New Material"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not can_have_material(context.object):
            cls.poll_message_set("There is no object with a surface")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        material = bpy.data.materials.new("Material")
        if bpy.app.version < (5, 0):
            material.use_nodes = True
        known(context.object).active_material = material
        return {"FINISHED"}


class TVBRDF_OT_start_here(OnMaterial, bpy.types.Operator):
    """Let aging start at the 3D cursor before anywhere else; Shift and right click put it there"""

    bl_idname = "tvbrdf.start_here"
    bl_label = "Start at 3D Cursor"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            material, scene = self.target(context)
        except SettingsError as error:
            return self.refuse(error)
        place = ",".join(f"{each:.4f}" for each in scene.cursor.location)
        settings = material.tvbrdf
        settings.starts = ";".join(filter(None, (settings.starts, place)))
        return {"FINISHED"}


class TVBRDF_OT_start_anywhere(OnMaterial, bpy.types.Operator):
    """Forget the places at which aging was to start"""

    bl_idname = "tvbrdf.start_anywhere"
    bl_label = "Forget Starts"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self.target(context).material.tvbrdf.starts = ""
        except SettingsError as error:
            return self.refuse(error)
        return {"FINISHED"}


class TVBRDF_OT_cancel(bpy.types.Operator):
    """End the run; the material stays as it is"""

    bl_idname = "tvbrdf.cancel"
    bl_label = "Cancel"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if session.current() is None:
            cls.poll_message_set("Nothing is being aged")
            return False
        return True

    def execute(self, context: bpy.types.Context) -> set[str]:
        run = session.current()
        assert run is not None
        run.cancel()
        redraw()
        return {"FINISHED"}


class _OnAgedMaterial(OnMaterial):
    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if session.current() is not None:
            cls.poll_message_set("A material is being aged")
            return False
        if not is_shown(context):
            return True
        material = material_of(context)
        if material is None or not is_aged(material):
            cls.poll_message_set("The material is not aged")
            return False
        return True

    def aged_target(self, context: bpy.types.Context) -> Target:
        target = self.target(context)
        if not is_aged(target.material):
            raise SettingsError(f"{target.material.name} is not aged.", "Age it first.")
        return target


class TVBRDF_OT_revert(_OnAgedMaterial, bpy.types.Operator):
    """Bring the original material back, exactly; the textures stay on disk"""

    bl_idname = "tvbrdf.revert"
    bl_label = "Revert"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            material = self.aged_target(context).material
            revert(material)
            session.forget(material)
        except Exception as error:
            return self.refuse(error)
        return {"FINISHED"}


class TVBRDF_OT_freeze(_OnAgedMaterial, bpy.types.Operator):
    """Keep the material as it is on the current frame, without animation; Revert still works"""

    bl_idname = "tvbrdf.freeze"
    bl_label = "Freeze at This Frame"
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            material, scene = self.aged_target(context)
            if is_live(material):
                # Only now: numpy, which it needs, has no part in starting Blender.
                from .material.binding.freeze_live import freeze_live

                for warning in freeze_live(material, object_with(material, scene), scene):
                    self.report({"WARNING"}, warning)
            else:
                freeze(material, scene.frame_current)
        except Exception as error:
            return self.refuse(error)
        return {"FINISHED"}


CLASSES = (
    TVBRDF_OT_new_material,
    TVBRDF_OT_start_here,
    TVBRDF_OT_start_anywhere,
    TVBRDF_OT_cancel,
    TVBRDF_OT_revert,
    TVBRDF_OT_freeze,
)
