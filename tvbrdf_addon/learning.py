"""Learning a model from a weathered material: the same steps in a window and without one.

Like a run, it keeps no reference to anything in the file from one step to the next.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import bpy

from ..model_runtime.contract import NEEDS_TORCH
from ..model_runtime.errors import Cancelled
from . import preferences
from .errors import SettingsError
from .known import by_uid
from .material.reading.check import why_nothing_to_learn
from .material.reading.chosen import object_with
from .models import models_in
from .worker import Done, Notice, Progress, Worker
from .worker import learn as ask

__all__ = ("Learning", "Lesson", "lesson")

# Longer side that a procedural material is baked to: as many texels as are learned from.
SIZE = 1024


@dataclass(frozen=True)
class Lesson:
    """What is to be learned: from a material of the file, or from a `folder` of textures."""

    title: str
    name: str
    process: str
    target: Path
    scene_uid: int
    material_uid: int | None
    folder: Path | None


def lesson(
    *,
    source: bpy.types.Material | Path,
    title: str,
    process: str,
    scene: bpy.types.Scene,
) -> Lesson:
    """What learning from a material or a folder of textures will do; looks, and changes nothing.

    Raises:
        SettingsError: why it cannot be done.
    """
    if not preferences.launch().has_torch:
        raise SettingsError(*NEEDS_TORCH)
    title = title.strip()
    name = re.sub(r"\W+", "_", title.lower()).strip("_")
    if not name:
        raise SettingsError("The new model has no name.", "Give it one.")
    folders = preferences.model_folders()
    if name in models_in(folders).cards:
        raise SettingsError(f"There is a model called {title} already.", "Choose another name.")
    home = preferences.models_folder()
    if home is None:
        raise SettingsError(
            "There is no folder for models of your own.", "Choose one in the preferences."
        )
    if isinstance(source, Path):
        if not source.is_dir():
            raise SettingsError(f"There is no folder {source}.", "Choose one with textures.")
    elif reason := why_nothing_to_learn(source, object_with(source, scene)):
        raise SettingsError(reason)
    return Lesson(
        title=title,
        name=name,
        process=process,
        target=home / f"{name}.safetensors",
        scene_uid=scene.session_uid,
        material_uid=None if isinstance(source, Path) else source.session_uid,
        folder=source if isinstance(source, Path) else None,
    )


class Learning:
    """Learning that goes on while `step` says so.

    `stage` and `fraction` (0 to 1) are for the eye, `notes` for the report.
    """

    def __init__(self, lesson: Lesson) -> None:
        self.lesson = lesson
        self.stage = "Reading the material"
        self.fraction = 0.0
        self.notes: list[str] = []
        self.cancel_requested = False
        self._steps = self._all_steps()

    def step(self) -> bool:
        """Do what can be done without waiting; False at the end, when the model is in its place.

        Raises:
            TvbrdfError: it failed or was cancelled (`code` is `cancelled`); there is no new model.
        """
        try:
            next(self._steps)
        except StopIteration:
            return False
        return True

    def cancel(self) -> None:
        """Ask it to end; the next steps see to it."""
        self.cancel_requested = True

    def close(self) -> None:
        """Let go of the process and of the temporary files."""
        self._steps.close()

    def _all_steps(self) -> Iterator[None]:
        # Twice: once for the panel to hear of it, once to draw it before a bake blocks.
        yield
        yield
        with tempfile.TemporaryDirectory(prefix="tvbrdf-", ignore_cleanup_errors=True) as job:
            source = self.lesson.folder or self._read(Path(job))
            yield
            if self.cancel_requested:
                raise Cancelled
            self.stage = "Starting"
            self.lesson.target.parent.mkdir(parents=True, exist_ok=True)
            yield from self._listen(source)

    def _read(self, folder: Path) -> Path:
        """The maps of the material."""
        # Only now: numpy, which it needs, has no part in drawing a panel.
        from .material.reading.read import read

        scene = by_uid(bpy.data.scenes, self.lesson.scene_uid)
        material = by_uid(bpy.data.materials, self.lesson.material_uid)
        if material is None or scene is None:
            raise SettingsError("The material was deleted.", "Choose another.")
        maps = folder / re.sub(r"\W+", " ", material.name)
        maps.mkdir()
        reading = read(
            material=material,
            obj=object_with(material, scene),
            scene=scene,
            folder=maps,
            size=SIZE,
            timed=True,
            shape=True,
        )
        self.notes.extend(reading.lost)
        return maps

    def _listen(self, source: Path) -> Iterator[None]:
        arguments = ("learn", str(source), "--output", str(self.lesson.target))
        said = {"name": self.lesson.name, "title": self.lesson.title}
        said |= {"process": self.lesson.process, "description": f"Learned from {source.name}"}
        options = tuple(f"--{name}={text}" for name, text in said.items() if text)
        worker = Worker(replace(preferences.launch(), lesson=(*arguments, *options, "--json")))
        for message in ask(worker, cancelled=lambda: self.cancel_requested):
            match message:
                case None:
                    yield
                case Progress(stage, fraction):
                    self.stage, self.fraction = stage, max(self.fraction, fraction)
                case Notice(text):
                    self.notes.append(text)
                case Done(card):
                    self.notes.extend(_told(card))


def _told(card: object) -> list[str]:
    """What a new model's card says of where it comes from; its warnings have been said."""
    source = card.get("source") if isinstance(card, dict) else None
    # That of the encoder is the same for all.
    told = source.partition(" Encoder: ")[0] if isinstance(source, str) else ""
    return [told] if told else []
