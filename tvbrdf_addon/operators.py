"""Age, bake frames, look, cancel, revert, freeze."""

from __future__ import annotations

import difflib
from typing import ClassVar, Literal, NamedTuple

import bpy

from . import session, suiting
from .errors import SettingsError
from .known import by_uid, scene_of
from .log import is_cancel, said_of
from .look import Look
from .material.binding.freeze import freeze
from .material.nodes.record import is_live
from .material.nodes.revert import is_aged, revert
from .outlook import is_worth_a_preview
from .run import Run, object_with, why_not

__all__ = ("CLASSES", "find_material", "material_of", "unregister")

# Seconds between two looks at the worker: often enough for a smooth bar.
TICK = 0.1

# That of the run that goes on.
_timer: bpy.types.Timer | None = None


def material_of(context: bpy.types.Context) -> bpy.types.Material | None:
    """The material that the editor under the mouse shows, else the active object's."""
    space = context.space_data
    if space is not None and space.type == "NODE_EDITOR":
        # A pinned editor shows another material than the object's.
        return space.id if isinstance(space.id, bpy.types.Material) else None
    if getattr(context, "material", None) is not None:
        return context.material
    return context.object.active_material if context.object is not None else None


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


class _Target(NamedTuple):
    material: bpy.types.Material
    scene: bpy.types.Scene


class _OnMaterial:
    """An operator on the material named by `material`, or else shown where it is called."""

    material: bpy.props.StringProperty(
        name="Material",
        description="Name of the material; empty for the one that is shown",
        options={"SKIP_SAVE"},
    )

    def target(self, context: bpy.types.Context) -> _Target:
        if self.material:
            return _Target(find_material(self.material), scene_of(context))
        if (material := material_of(context)) is None:
            raise SettingsError("There is no material here.", "Give the object one first.")
        return _Target(material, scene_of(context))

    def refuse(self, error: BaseException) -> set[str]:
        self.report({"ERROR"}, said_of(error))
        return {"CANCELLED"}


def _shown(context: bpy.types.Context) -> bool:
    """Whether the call comes from an editor that shows a material, so that it must be that one.

    A script names its material instead, which `poll` cannot see.
    """
    return context.area is not None and context.area.type in {"NODE_EDITOR", "PROPERTIES"}


class _Ages(_OnMaterial):
    """An operator that ages the material, bound as `binding` says: None is as its settings do."""

    # All edits are made in the last step, so that one undo takes them back.
    bl_options: ClassVar[set[str]] = {"UNDO"}
    binding: ClassVar[str | None] = None
    done: ClassVar[str] = "{} ages"

    object: bpy.props.StringProperty(
        name="Object",
        description="Name of the object that the material is read from; empty for one that shows "
        "it, the active one if it can be",
        options={"SKIP_SAVE"},
    )

    _run: Run

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if (run := session.current()) is not None:
            cls.poll_message_set(f"{run.plan.material_name} is being aged")
            return False
        if not _shown(context):
            return True
        material = material_of(context)
        try:
            reason = (
                "There is no material" if material is None else why_not(material, scene_of(context))
            )
        except Exception as error:
            reason = said_of(error)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def kind(self) -> type[Run]:
        """What the run does.  A method, as Blender 4.2 crashes at its end over a class that holds
        another.
        """
        return Run

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            run = session.age_and_wait(
                *self.target(context), self.object, binding=self.binding, kind=self.kind()
            )
        except (Exception, KeyboardInterrupt) as error:
            return self.refuse(error)
        for warning in run.warnings:
            self.report({"WARNING"}, warning)
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        global _timer
        # Timers do not run without a window.
        if bpy.app.background or context.window is None:
            return self.execute(context)
        try:
            material, scene = self.target(context)
            suiting.look_at(material)
            preview = is_worth_a_preview(material, scene)
            self._run = session.begin(
                *(material, scene, self.object),
                preview=preview,
                binding=self.binding,
                kind=self.kind(),
            )
        except Exception as error:
            return self.refuse(error)
        _timer = context.window_manager.event_timer_add(TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        _redraw(context)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" and event.value == "PRESS" and not is_playing():
            self._run.cancel()
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        _redraw(context)
        try:
            if self._run.step():
                return {"PASS_THROUGH"}
        except (Exception, KeyboardInterrupt) as error:
            said = said_of(error)
            self._end(context, icon="NONE" if is_cancel(error) else "ERROR", sentences=(said,))
            self.report({"INFO" if is_cancel(error) else "ERROR"}, said)
            return {"CANCELLED"}
        warnings = tuple(self._run.warnings)
        said = _show(self._run) if self.kind() is Run else ""
        self._end(context, icon="ERROR", sentences=warnings, next=said)
        self.report({"INFO"}, self.done.format(self._run.plan.material_name))
        for warning in warnings:
            self.report({"WARNING"}, warning)
        return {"FINISHED"}

    def cancel(self, context: bpy.types.Context) -> None:
        # Blender calls this when the window closes or another file is loaded.
        reason = self._run.ended_by or "Aging ended, because its window was closed."
        self._end(context, icon="NONE", sentences=(reason,))

    def _end(
        self,
        context: bpy.types.Context,
        *,
        icon: Literal["NONE", "ERROR"],
        sentences: tuple[str, ...],
        next: str = "",
    ) -> None:
        _remove_timer()
        session.finish(self._run, icon=icon, sentences=sentences, next=next)
        _redraw(context)


class TVBRDF_OT_age_material(_Ages, bpy.types.Operator):
    """Age the material over the frame range. It stays yours: Revert brings the original back"""

    bl_idname = "tvbrdf.age_material"
    bl_label = "Age Material"


class TVBRDF_OT_bake_frames(_Ages, bpy.types.Operator):
    """Age the material again as image sequences, which other programs and exporters understand"""

    bl_idname = "tvbrdf.bake_frames"
    bl_label = "Bake Frames"
    binding = "frames"


class TVBRDF_OT_look(_Ages, bpy.types.Operator):
    """Show where on the object aging would start and where it comes last; nothing ages yet"""

    bl_idname = "tvbrdf.look"
    bl_label = "Look Where It Starts"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}
    done = "The picture shows where {} starts to age"

    def kind(self) -> type[Run]:
        return Look


class TVBRDF_OT_start_here(_OnMaterial, bpy.types.Operator):
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


class TVBRDF_OT_start_anywhere(_OnMaterial, bpy.types.Operator):
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
        _redraw(context)
        return {"FINISHED"}


class _OnAgedMaterial(_OnMaterial):
    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if session.current() is not None:
            cls.poll_message_set("A material is being aged")
            return False
        if not _shown(context):
            return True
        material = material_of(context)
        if material is None or not is_aged(material):
            cls.poll_message_set("The material is not aged")
            return False
        return True

    def aged_target(self, context: bpy.types.Context) -> _Target:
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
            revert(self.aged_target(context).material)
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


def _remove_timer() -> None:
    global _timer
    if _timer is not None:
        bpy.context.window_manager.event_timer_remove(_timer)
        _timer = None


def unregister() -> None:
    # With its class Blender lets go of the operator that goes on, without a word to it.
    _remove_timer()


def _show(run: Run) -> str:
    """Lets the viewport show what a run made, where it does not yet; says what to do next."""
    plan, scene = run.plan, by_uid(bpy.data.scenes, run.plan.scene_uid)
    if scene is not None and scene.frame_current <= plan.frame_start and not is_playing():
        scene.frame_set((plan.frame_start + plan.frame_end) // 2)
    return "Drag Age, or play, to see it grow."


def is_playing() -> bool:
    """Whether an animation plays in any window."""
    windows = bpy.context.window_manager.windows
    return any(window.screen.is_animation_playing for window in windows)


def _redraw(context: bpy.types.Context) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in {"NODE_EDITOR", "PROPERTIES"}:
                area.tag_redraw()


CLASSES = (
    TVBRDF_OT_age_material,
    TVBRDF_OT_bake_frames,
    TVBRDF_OT_look,
    TVBRDF_OT_start_here,
    TVBRDF_OT_start_anywhere,
    TVBRDF_OT_cancel,
    TVBRDF_OT_revert,
    TVBRDF_OT_freeze,
)
