"""The operators that age: one material or several, live or as image sequences."""

from __future__ import annotations

from typing import ClassVar, Literal

import bpy

from . import session, suiting
from .errors import SettingsError
from .known import by_uid, scene_of
from .log import is_cancel, said_of
from .look import Look
from .operators import OnMaterial, Target, is_shown, material_of
from .outlook import is_worth_a_preview
from .redraw import redraw
from .run import Run, why_not

__all__ = ("CLASSES", "unregister")

# Seconds between two looks at the worker: often enough for a smooth bar.
TICK = 0.1
_NEXT = "Drag Age, or play, to see it grow."

# That of the run that goes on.
_timer: bpy.types.Timer | None = None


class _Ages(OnMaterial):
    """An operator that ages materials, bound as `binding` says: None is as their settings do."""

    # All edits are made in the last step of a run, so that one undo takes them back.
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
    _scene: int
    _left: list[int]  # materials whose turn comes
    _count: int
    _aged: int

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if (run := session.current()) is not None:
            cls.poll_message_set(f"{run.plan.material_name} is being aged")
            return False
        if not is_shown(context):
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

    def targets(self, context: bpy.types.Context) -> list[Target]:
        """What is aged, one after the other; never empty.  Raises `SettingsError`."""
        return [self.target(context)]

    def execute(self, context: bpy.types.Context) -> set[str]:
        aged = 0
        try:
            for target in self.targets(context):
                run = session.age_and_wait(
                    *target, self.object, binding=self.binding, kind=self.kind()
                )
                aged += 1
                for warning in run.warnings:
                    self.report({"WARNING"}, warning)
        except (Exception, KeyboardInterrupt) as error:
            refused = self.refuse(error)
            return refused if not aged else {"FINISHED"}
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        global _timer
        # Timers do not run without a window.
        if bpy.app.background or context.window is None:
            return self.execute(context)
        try:
            targets = self.targets(context)
            self._scene = targets[0].scene.session_uid
            self._left = [target.material.session_uid for target in targets]
            self._count, self._aged = len(targets), 0
            self._begin_next()
        except Exception as error:
            return self.refuse(error)
        _timer = context.window_manager.event_timer_add(TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        redraw()
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC" and event.value == "PRESS" and not is_playing():
            self._run.cancel()
            return {"RUNNING_MODAL"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        redraw()
        try:
            if self._run.step():
                return {"PASS_THROUGH"}
        except (Exception, KeyboardInterrupt) as error:
            return self._fail(error)
        warnings = tuple(self._run.warnings)
        said = _show(self._run) if self.kind() is Run else ""
        session.finish(self._run, icon="ERROR", sentences=warnings, next=said)
        self._aged += 1
        self.report({"INFO"}, self.done.format(self._run.plan.material_name))
        for warning in warnings:
            self.report({"WARNING"}, warning)
        return self._go_on()

    def cancel(self, _context: bpy.types.Context) -> None:
        # Blender calls this when the window closes or another file is loaded.
        reason = self._run.ended_by or "Aging ended, because its window was closed."
        session.finish(self._run, icon="NONE", sentences=(reason,))
        self._left.clear()
        self._go_on()

    def _begin_next(self) -> None:
        """Begins to age the first of those that are left.  Raises `TvbrdfError`."""
        material = by_uid(bpy.data.materials, self._left.pop(0))
        scene = by_uid(bpy.data.scenes, self._scene)
        if material is None or scene is None:
            raise SettingsError("A material was deleted before its turn came.", "Nothing ages.")
        suiting.look_at(material)
        preview = self._count == 1 and is_worth_a_preview(material, scene)
        self._run = session.begin(
            *(material, scene, self.object),
            preview=preview,
            binding=self.binding,
            kind=self.kind(),
        )
        self._run.turn = (self._count - len(self._left), self._count)

    def _fail(self, error: BaseException) -> set[str]:
        icon: Literal["NONE", "ERROR"] = "NONE" if is_cancel(error) else "ERROR"
        session.finish(self._run, icon=icon, sentences=(said_of(error),))
        self.report({"INFO" if is_cancel(error) else "ERROR"}, said_of(error))
        if is_cancel(error) or self._run.ended_by:
            self._left.clear()
        return self._go_on()

    def _go_on(self) -> set[str]:
        """Turns to the next material that can be aged; ends after the last."""
        while self._left:
            try:
                self._begin_next()
                return {"PASS_THROUGH"}
            except Exception as error:
                self.report({"ERROR"}, said_of(error))
        _remove_timer()
        redraw()
        return {"FINISHED"} if self._aged else {"CANCELLED"}


class TVBRDF_OT_age_material(_Ages, bpy.types.Operator):
    """Age the material over the frame range. It stays yours: Revert brings the original back"""

    bl_idname = "tvbrdf.age_material"
    bl_label = "Age Material"


class TVBRDF_OT_age_materials(_Ages, bpy.types.Operator):
    """Age all materials of the selected objects, one after the other"""

    bl_idname = "tvbrdf.age_materials"
    bl_label = "Age Materials of Selected"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if (run := session.current()) is not None:
            cls.poll_message_set(f"{run.plan.material_name} is being aged")
            return False
        if not materials_of_selected(context):
            cls.poll_message_set("No selected object has a material")
            return False
        return True

    def targets(self, context: bpy.types.Context) -> list[Target]:
        scene, reasons = scene_of(context), []
        targets = []
        for material in materials_of_selected(context):
            if reason := why_not(material, scene):
                reasons.append(f"“{material.name}” is left out. {reason}")
            else:
                targets.append(Target(material, scene))
        if not targets:
            raise SettingsError(*reasons[:1] or ("No selected object has a material.",))
        for reason in reasons:
            self.report({"WARNING"}, reason)
        return targets


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


def materials_of_selected(context: bpy.types.Context) -> list[bpy.types.Material]:
    """The materials in the slots of all selected objects, each once."""
    slots = (slot for obj in context.view_layer.objects.selected for slot in obj.material_slots)
    return list(dict.fromkeys(slot.material for slot in slots if slot.material is not None))


def _show(run: Run) -> str:
    """Lets the viewport show what a run made, where it does not yet; says what to do next."""
    plan, scene = run.plan, by_uid(bpy.data.scenes, run.plan.scene_uid)
    if scene is not None and scene.frame_current <= plan.frame_start and not is_playing():
        scene.frame_set((plan.frame_start + plan.frame_end) // 2)
    return _NEXT


def is_playing() -> bool:
    """Whether an animation plays in any window."""
    windows = bpy.context.window_manager.windows
    return any(window.screen.is_animation_playing for window in windows)


def _remove_timer() -> None:
    global _timer
    if _timer is not None:
        bpy.context.window_manager.event_timer_remove(_timer)
        _timer = None


def unregister() -> None:
    # With its class Blender lets go of the operator that goes on, without a word to it.
    _remove_timer()


CLASSES = (
    TVBRDF_OT_age_material,
    TVBRDF_OT_age_materials,
    TVBRDF_OT_bake_frames,
    TVBRDF_OT_look,
)
