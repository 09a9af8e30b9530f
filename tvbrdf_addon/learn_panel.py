"""Learn from Material: what is learned from, the operators and how the panel shows it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import ClassVar, Literal, NamedTuple

import bpy

from . import preferences
from .drawing import guarded, paragraph
from .errors import SettingsError
from .known import by_uid, known, scene_of
from .learning import Learning, Lesson, lesson
from .log import is_cancel, said_of, tell
from .operators import material_of
from .properties import RELATIVE
from .redraw import redraw

__all__ = ("CLASSES", "draw", "register", "unregister")

_HINT = "Choose what is clean in places and weathered in others; learning takes some minutes."

TICK = 0.1
POLL_SECONDS = 0.05

_KINDS = (
    ("rust", "Rust", "Spots that merge, in patches that stay wet"),
    ("peeling_metal", "Paint off Metal", "Chips, from edges and where water stands"),
    ("peeling_wood", "Paint off Wood", "Flakes, from edges and where the sun reaches"),
    ("patina", "Patina", "Streaks where rain runs"),
    ("moss", "Moss", "Round cushions where it is damp"),
    ("soiling", "Dirt", "Streaks from above; what is below shows through"),
    ("weathered_wood", "Weathered Wood", "All over; what is below shows through"),
    ("fading", "Fading", "All over, as light reaches it; most of what is below stays"),
    ("char", "Burning", "From a few places, upward"),
    ("drying", "Drying", "Islands that grow together; much of what is below stays"),
)
"""The processes that something unknown may spread like."""


class TVBRDF_PG_lesson(bpy.types.PropertyGroup):
    """What is to be learned from; of this session alone."""

    source: bpy.props.EnumProperty(
        name="Learn From",
        description="What shows how something weathers",
        items=(
            ("material", "Material", "A material of this file that is weathered in places"),
            ("folder", "Textures", "A folder with the texture maps of such a material"),
        ),
        default="material",
    )
    material: bpy.props.PointerProperty(
        name="Material",
        description="A material that is clean in places and weathered in others",
        type=bpy.types.Material,
    )
    folder: bpy.props.StringProperty(
        name="Textures",
        description=(
            "Folder with texture maps, such as a scan, that are clean in places and weathered in "
            "others"
        ),
        subtype="DIR_PATH",
        options={*RELATIVE},
    )
    title: bpy.props.StringProperty(
        name="Name", description="What the new model is called in the list", maxlen=60
    )
    process: bpy.props.EnumProperty(
        name="Spreads Like",
        description="How what is learned starts and spreads on other objects",
        items=_KINDS,
        default="rust",
    )


class _Ended(NamedTuple):
    """How the last one ended."""

    icon: Literal["NONE", "ERROR", "INFO"]
    sentences: tuple[str, ...]


_learning: Learning | None = None
_ended: _Ended | None = None
_timer: bpy.types.Timer | None = None


def _settings(context: bpy.types.Context) -> TVBRDF_PG_lesson:
    return context.window_manager.tvbrdf_lesson


def _lesson(context: bpy.types.Context) -> Lesson:
    """What the settings ask for.  Raises `SettingsError`."""
    settings = _settings(context)
    if settings.source == "folder":
        if not settings.folder:
            raise SettingsError("No folder is chosen.", "Choose one with texture maps.")
        source: bpy.types.Material | Path = Path(bpy.path.abspath(settings.folder))
    elif settings.material is None:
        raise SettingsError("No material is chosen.", "Choose one that is weathered in places.")
    else:
        source = settings.material
    return lesson(
        source=source, title=settings.title, process=settings.process, scene=scene_of(context)
    )


class TVBRDF_OT_learn(bpy.types.Operator):
    """Learn how a material weathers from one that is weathered in places; takes some minutes"""

    bl_idname = "tvbrdf.learn"
    bl_label = "Learn"

    _target: int | None

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if _learning is not None:
            cls.poll_message_set(f"{_learning.lesson.title} is being learned")
            return False
        try:
            reason = _why_not(context)
        except Exception as error:
            reason = said_of(error)
        if reason:
            cls.poll_message_set(reason)
        return not reason

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self._begin(context)
            learning, said = known(_learning), ""
            while learning.step():
                if learning.stage != said:
                    said = learning.stage
                    tell(f"{learning.lesson.title}: {learning.fraction:4.0%} {said}")
                time.sleep(POLL_SECONDS)
        except (Exception, KeyboardInterrupt) as error:
            return self._fail(error)
        return self._finish()

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        global _timer
        # Timers do not run without a window.
        if bpy.app.background or context.window is None:
            return self.execute(context)
        try:
            self._begin(context)
        except Exception as error:
            return self._fail(error)
        _timer = context.window_manager.event_timer_add(TICK, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type != "TIMER" or _learning is None:
            return {"PASS_THROUGH"} if _learning is not None else {"CANCELLED"}
        redraw()
        try:
            if _learning.step():
                return {"PASS_THROUGH"}
        except (Exception, KeyboardInterrupt) as error:
            return self._fail(error)
        return self._finish()

    def cancel(self, _context: bpy.types.Context) -> None:
        # Blender calls this when the window closes or another file is loaded.
        _end(_Ended("NONE", ("Learning ended, because its window or file was closed.",)))

    def _begin(self, context: bpy.types.Context) -> None:
        global _learning
        material = material_of(context)
        self._target = material.session_uid if material is not None else None
        _learning = Learning(_lesson(context))

    def _fail(self, error: BaseException) -> set[str]:
        cancelled = is_cancel(error)
        said = "Canceled; nothing was learned." if cancelled else said_of(error)
        _end(_Ended("NONE" if cancelled else "ERROR", (said,)))
        self.report({"INFO" if cancelled else "ERROR"}, said)
        return {"CANCELLED"}

    def _finish(self) -> set[str]:
        learning = known(_learning)
        said = f"{learning.lesson.title} is in the list of models"
        _end(_Ended("INFO", (f"{said}.", *learning.notes)))
        _settings(bpy.context).title = ""  # the next one needs another name
        material = by_uid(bpy.data.materials, self._target)
        if material is not None and material.library is None:
            material.tvbrdf.ntm = learning.lesson.name
        self.report({"INFO"}, said)
        return {"FINISHED"}


class TVBRDF_OT_cancel_learning(bpy.types.Operator):
    """End the learning; there will be no new model"""

    bl_idname = "tvbrdf.cancel_learning"
    bl_label = "Cancel"
    bl_options: ClassVar[set[str]] = {"INTERNAL"}

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        if _learning is None:
            cls.poll_message_set("Nothing is being learned")
        return _learning is not None

    def execute(self, context: bpy.types.Context) -> set[str]:
        known(_learning).cancel()
        redraw()
        return {"FINISHED"}


@guarded
def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    settings = _settings(context)
    layout.use_property_split = True
    layout.use_property_decorate = False
    column = layout.column()
    column.enabled = _learning is None
    column.row().prop(settings, "source", expand=True)
    column.prop(settings, settings.source)
    column.prop(settings, "title")
    column.prop(settings, "process")
    if _learning is not None:
        _draw_progress(layout, _learning)
        return
    row = layout.row()
    row.scale_y = 1.5
    row.operator("tvbrdf.learn")
    says = settings.title or not preferences.launch().has_torch
    if says and (reason := _why_not(context)):
        paragraph(layout, context, reason, "ERROR")
    for sentence in _ended.sentences if _ended is not None else (_HINT,):
        paragraph(layout, context, sentence, "INFO" if _ended is None else _ended.icon)


def _why_not(context: bpy.types.Context) -> str | None:
    try:
        _lesson(context)
    except SettingsError as error:
        return str(error)
    return None


def _draw_progress(layout: bpy.types.UILayout, learning: Learning) -> None:
    # In the place of the button, as high as it: as the run's own panel has it.
    row = layout.row()
    row.scale_y = 1.5
    row.alignment = "CENTER"
    row.label(text=f"Learning {learning.lesson.title}")
    column = layout.column(align=True)
    column.progress(factor=learning.fraction, type="BAR", text=f"{learning.fraction:.0%}")
    column.label(text=f"{learning.stage}…")
    row = layout.row()
    row.enabled = not learning.cancel_requested
    text = "Canceling…" if learning.cancel_requested else "Cancel"
    row.operator("tvbrdf.cancel_learning", text=text, icon="X")


def _end(ended: _Ended) -> None:
    """Let go of what goes on, and keep what is to be said of it."""
    global _learning, _ended, _timer
    if _timer is not None:
        bpy.context.window_manager.event_timer_remove(_timer)
        _timer = None
    if _learning is not None:
        _learning.close()
    _learning, _ended = None, ended


def register() -> None:
    bpy.types.WindowManager.tvbrdf_lesson = bpy.props.PointerProperty(type=TVBRDF_PG_lesson)


def unregister() -> None:
    global _ended
    _end(_Ended("NONE", ()))
    # What is enabled again later may find this module as it was left.
    _ended = None
    del bpy.types.WindowManager.tvbrdf_lesson


CLASSES = (TVBRDF_PG_lesson, TVBRDF_OT_learn, TVBRDF_OT_cancel_learning)
