"""One run, from the material to the aged material: the same steps in a window and without one.

A run never keeps a reference to anything in the file from one step to the next: an undo, or the
loading of another file, would leave it dangling.  It keeps session uids.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import bpy

from ..model_runtime.contract import DRAFT, EXACT, FRAMES, LIVE
from ..model_runtime.errors import Cancelled
from ..model_runtime.messages import Verb
from ..model_runtime.output.commit import recover
from . import exposure, outlook, properties
from .destination import folder_for, require_place
from .errors import MaterialError, RunEndedError, SettingsError, WorkerError
from .growth import grows, growth, needs_no_texels
from .known import by_uid
from .material.nodes.age import frame_range
from .material.nodes.revert import is_aged, revert
from .material.reading.check import why_not as why_not_readable
from .material.reading.chosen import object_named, object_with
from .material.reading.onset import is_invertible, why_no_mask, why_no_onset
from .material.result import note_result
from .worker import Done, Notice, Progress, Worker, prepare
from .worker import run as ask

if TYPE_CHECKING:
    from .material.reading.lookup import Reading
    from .material.surface_maps.collect import UVMap

__all__ = ("Plan", "Run", "plan", "take_preview_back", "why_not")

# Until this much is done and this much time has passed, time left would be a guess.
GUESS_FRACTION, GUESS_SECONDS = 0.05, 2.0
# Before a worker says how far it is, the bar goes on by itself, ever more slowly, up to a tenth.
_LEAST, _CREEP, _CREEP_SECONDS = 0.01, 0.1, 8.0
# Longer side of a preview's textures; without images of twice that it would show little less.
PREVIEW_SIZE = 128


@dataclass(frozen=True)
class Plan:
    """Everything that a run needs to know, so that the panel may be changed meanwhile.

    `size` is None where the cameras decide.  `request` is what the worker is asked for, without the
    input, and without an onset that has to be read from the file as the input is.
    """

    material_uid: int
    material_name: str
    object_uid: int | None
    scene_uid: int
    size: int | None
    frame_start: int
    frame_end: int
    folder: Path
    request: dict[str, Any]


def plan(
    material: bpy.types.Material,
    scene: bpy.types.Scene,
    object_name: str = "",
    *,
    binding: str | None = None,
) -> Plan:
    """What aging `material` with its settings will do, bound as they say unless `binding` says
    otherwise; looks, and changes nothing.

    It is read from the object called `object_name`, or else from one that shows it.

    Raises:
        MaterialError, SettingsError: why it cannot be done.
    """
    if object_name:
        obj = object_named(object_name, material, scene)
    else:
        obj = object_with(material, scene)
    if reason := why_not_readable(material, obj):
        raise MaterialError(reason)
    settings = material.tvbrdf
    model = _require_settings(material, scene)
    frame_start, frame_end = frame_range(material, scene)
    folder = folder_for(material)
    return Plan(
        material_uid=material.session_uid,
        material_name=material.name,
        object_uid=obj.session_uid if obj is not None else None,
        scene_uid=scene.session_uid,
        size=None if settings.use_camera_size else settings.size,
        frame_start=frame_start,
        frame_end=frame_end,
        folder=folder,
        request={
            "ntm": str(model),
            "frames": settings.steps,
            "quality": settings.quality,
            "tolerance": settings.tolerance,
            "temporal_model": settings.temporal_model,
            "onset": settings.onset,
            "specular": settings.specular,
            "format": properties.SHOWN[settings.format].format,
            "seed": settings.seed,
            "binding": binding or settings.binding,
            # What is live has all of it, and shows as much as its slider says.
            "grain": settings.grain if (binding or settings.binding) == FRAMES else 1.0,
            "sparse": settings.quality != EXACT,
            **exposure.asked(settings),
        },
    )


def why_not(material: bpy.types.Material, scene: bpy.types.Scene) -> str | None:
    """One sentence why `material` cannot be aged now; None where it can.  Cheap enough to draw."""
    if reason := why_not_readable(material, object_with(material, scene)):
        return reason
    try:
        _require_settings(material, scene)
    except SettingsError as error:
        return str(error)
    return None


def _require_settings(material: bpy.types.Material, scene: bpy.types.Scene) -> Path:
    settings = material.tvbrdf
    model = properties.model_file(settings)
    if model is None:
        raise SettingsError("No model is chosen.", "Choose what happens to the material.")
    frame_start, frame_end = frame_range(material, scene)
    if frame_end <= frame_start:
        raise SettingsError(
            f"The frame range {frame_start} to {frame_end} is empty.",
            "Set a last frame after the first one.",
        )
    require_place(material)
    if reason := why_no_onset(material, scene) or why_no_mask(material, scene):
        raise SettingsError(reason)
    return model


class Run:
    """A run that goes on while `step` says so.

    `stage`, `fraction` (0 to 1) and `seconds_left` are for the eye; `warnings` and, at its end,
    `aged` (the content of `aged.json`) for the report; `ended_by` says what ended it from outside.
    `turn` says which it is of how many.

    With `preview`, a material that is not aged yet shows a small draft as soon as there is one
    (`previewing`), until the result comes; without a result it goes back to what it was.
    """

    def __init__(self, plan: Plan, worker: Worker, *, preview: bool = False) -> None:
        self.plan = plan
        self.previewing = False
        self._preview = preview
        self.stage = "Reading the material"
        self.fraction = 0.0
        self.size_reason = ""
        self.warnings: list[str] = []
        self.aged: dict[str, Any] = {}
        self.cancel_requested = False
        self.ended_by = ""
        self.turn = (1, 1)
        self._worker, self._is_cold = worker, False
        self._computing_since: float | None = None
        self._uv_map: UVMap | None = None
        self._before = self._mapping = self._starting = 0.0
        self._began = time.monotonic()
        self._steps = self._all_steps()

    def step(self) -> bool:
        """Do what can be done without waiting; False at the end, when all is done.

        Raises:
            TvbrdfError: it failed, was cancelled (`code` is `cancelled`) or ended from outside;
                the material is as it was.
        """
        if self.ended_by:
            self.close()
            raise RunEndedError(self.ended_by, "Nothing was changed.")
        try:
            next(self._steps)
        except StopIteration:
            return False
        return True

    def cancel(self) -> None:
        """Ask it to end; the next steps see to it."""
        self.cancel_requested = True

    def end(self, reason: str) -> None:
        """End it because of what happened to the file; `reason` is one sentence."""
        self.ended_by = reason
        self.close()

    def close(self) -> None:
        """Let go of the worker and of the temporary files."""
        self._steps.close()

    @property
    def name(self) -> str:
        """What is aged, for the eye."""
        turn, count = self.turn
        return self.plan.material_name + (f" ({turn} of {count})" if count > 1 else "")

    @property
    def progress(self) -> float:
        """How far it is with all whose turn it was and will be, 0 to 1."""
        turn, count = self.turn
        waited = time.monotonic() - self._began
        creeping = _LEAST + (_CREEP - _LEAST) * (1 - math.exp(-waited / _CREEP_SECONDS))
        return (turn - 1 + max(self.fraction, creeping)) / count

    @property
    def seconds_left(self) -> float | None:
        """How long it will probably go on; None while that is unknown."""
        if self._computing_since is None or self.fraction < GUESS_FRACTION:
            return None
        seconds = time.monotonic() - self._computing_since
        if seconds < GUESS_SECONDS:
            return None
        return seconds * (1 - self.fraction) / self.fraction

    def _all_steps(self) -> Iterator[None]:
        yield from self._prepare()
        with tempfile.TemporaryDirectory(prefix="tvbrdf-", ignore_cleanup_errors=True) as job:
            started = time.monotonic()
            reading, request = self._read(Path(job))
            self._before = time.monotonic() - started - self._mapping
            yield
            if self.cancel_requested:
                raise Cancelled
            try:
                if self._preview and reading.textures.pixels > 2 * PREVIEW_SIZE:
                    yield from self._show_preview(request, reading)
                yield from self._compute(request, reading)
                self._bind(reading)
            except BaseException:
                self._take_preview_back()
                raise

    def _prepare(self) -> Iterator[None]:
        """Starts the worker, which gets ready while the material is read."""
        self._is_cold = not self._worker.alive
        prepare(self._worker)
        # Twice: once for the panel to hear of the run, once to draw it before a bake blocks.
        yield
        yield

    def _read(self, folder: Path) -> tuple[Reading, dict[str, Any]]:
        """What was read of the material, and the request with it."""
        # Only now: numpy, which it needs, has no part in drawing a panel.
        from .material.reading.onset_map import write_onset
        from .material.reading.read import read

        scene = by_uid(bpy.data.scenes, self.plan.scene_uid)
        obj = by_uid(bpy.data.objects, self.plan.object_uid)
        if scene is None or (obj is None and self.plan.object_uid is not None):
            raise RunEndedError("The object that shows the material was deleted.")
        material, frame = self._material(), self.plan.frame_start
        request = dict(self.plan.request)
        maps = folder / "maps"
        maps.mkdir()
        reading = read(
            material=material,
            obj=obj,
            scene=scene,
            folder=maps,
            size=self.plan.size,
            frame=frame,
            timed=needs_no_texels(request),
        )
        self.warnings.extend(reading.warnings)
        self.size_reason = reading.textures.why
        request["input"] = str(maps)
        if grows(request):
            grown = growth(request, material, scene, reading, frame)
            self.warnings.extend(grown.notes)
            self._uv_map, self._mapping = grown.uv_map, grown.seconds
            request |= grown.fields
        if is_invertible(material):
            onset = write_onset(
                material=material, scene=scene, reading=reading, folder=folder, frame=frame
            )
            self.warnings.extend(each for each in onset.warnings if each not in self.warnings)
            request["onset"] = str(onset.path)
        return reading, request

    def _show_preview(self, request: dict[str, Any], reading: Reading) -> Iterator[None]:
        from .material.binding.bind import bind

        if is_aged(self._material()):
            return  # what it shows says more
        self.stage = "Making a preview"
        # Not beside the result, but as long as Blender lives: an undo may bring it back.
        place = Path(bpy.app.tempdir) / f"preview-{self.plan.material_uid}"
        size = PREVIEW_SIZE * max(reading.tiles.columns, reading.tiles.rows)
        quick = {"output": str(place), "size": size, "quality": DRAFT}
        request = request | quick
        for message in ask(self._worker, "age", request, cancelled=lambda: self.cancel_requested):
            self._material()
            if message is None:
                yield
        material = self._material()
        bind(
            material=material,
            reading=reading,
            folder=place,
            frame_start=self.plan.frame_start,
            frame_end=self.plan.frame_end,
            uv_map=self._uv_map,
        )
        material.tvbrdf.is_preview = self.previewing = True

    def _take_preview_back(self) -> None:
        self.previewing = False
        material = by_uid(bpy.data.materials, self.plan.material_uid)
        if material is not None:
            take_preview_back(material)

    def _compute(self, request: dict[str, Any], reading: Reading) -> Iterator[None]:
        self.stage = "Starting the worker"
        size = reading.textures.pixels if reading.uniform else max(reading.size)
        request = request | {"output": str(self.plan.folder), "size": size}
        try:
            yield from self._listen("age", request)
        except WorkerError:
            if not self._worker.alive:
                recover(self.plan.folder)
            raise

    def _listen(self, verb: Verb, request: dict[str, Any]) -> Iterator[None]:
        asked = time.monotonic()
        for message in ask(self._worker, verb, request, cancelled=lambda: self.cancel_requested):
            self._material()
            match message:
                case None:
                    # Only now: messages may come faster than steps are taken.
                    yield
                case Progress(stage, fraction):
                    if self._computing_since is None:
                        self._computing_since = time.monotonic()
                        self._starting = self._is_cold * (self._computing_since - asked)
                    self.stage, self.fraction = stage.capitalize(), max(self.fraction, fraction)
                case Notice(text):
                    self.warnings.append(text)
                case Done(result):
                    self.aged = result

    def _bind(self, reading: Reading) -> None:
        from .material.binding.bind import bind

        self.stage, self.fraction = "Building the nodes", 1.0
        material = self._material()
        self.warnings.extend(
            bind(
                material=material,
                reading=reading,
                folder=self.plan.folder,
                frame_start=self.plan.frame_start,
                frame_end=self.plan.frame_end,
                uv_map=self._uv_map,
            )
        )
        if self.aged.get("binding") != LIVE:
            self.warnings.extend(reading.lost)
        self.previewing = False
        note_result(material, self.plan.folder, self.size_reason)
        outlook.learn(
            *(material, self.aged, self.plan.folder),
            before=self._before,
            maps=self._mapping,
            start=self._starting,
        )

    def _material(self) -> bpy.types.Material:
        material = by_uid(bpy.data.materials, self.plan.material_uid)
        if material is None:
            raise RunEndedError(
                f"The material {self.plan.material_name} was deleted while it aged.",
                "Undo the deletion and press Age Material again.",
            )
        return material


def take_preview_back(material: bpy.types.Material) -> None:
    """Let a material that shows a preview be what it was before."""
    if material.tvbrdf.is_preview:
        material.tvbrdf.is_preview = False
        revert(material)
