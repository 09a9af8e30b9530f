"""What a click will take, for the panel: looked up while nothing else happens, not while drawing.

Drawing asks; a timer then looks through the cameras on the frame that is shown, and draws again
where that says something new.  A run itself looks at the whole frame range.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy

from ..model_runtime.contract import AUTO, BALANCED, CACHE_SECONDS, EVERYWHERE, LIVE, LSTM_LATENTS
from . import preferences, properties, suiting
from .errors import MaterialError
from .known import by_uid, known
from .log import said_of, tell
from .material.nodes.revert import is_aged
from .material.nodes.surface import find_principled
from .material.reading.onset import is_painted, showing
from .material.reading.space import Space, choose_space, image_size
from .material.result import result_folder
from .rates import Estimate, Rates, Work
from .redraw import redraw
from .sentences import report_in

__all__ = ("Outlook", "is_worth_a_preview", "learn", "look_soon", "outlook_of", "unregister")

# Seconds between two looks, at least; and how many times as long as a look took.
PAUSE, SHARE = 1.0, 20.0
RATES = "rates.json"

# A preview delays the result by a second or two, and by its shader, which Blender has to build.
PREVIEW_SECONDS = 5.0


@dataclass(frozen=True)
class Outlook:
    """What is probable: `size` (height, width) of the textures and why (a sentence or nothing),
    time and disk use, and those of quality Balanced, and those once the surface's maps are made.
    """

    size: tuple[int, int]
    why: str
    estimate: Estimate
    balanced: Estimate
    mapped: Estimate


@dataclass(frozen=True)
class _Look:
    """What was seen of a material: how its maps are made, its images' size, what cameras see.

    These sizes are those of a tile; `tiles` are the (rows, columns) of them.
    """

    kind: str
    images: tuple[int, int] | None
    tiles: tuple[int, int]
    seen: int
    why: str


_looks: dict[tuple[int, int], _Look] = {}
_mapped: set[int] = set()  # materials whose surface's maps are kept, unless their objects change
_wanted: tuple[int, int] | None = None
_next_look = 0.0
_rates: Rates | None = None


def outlook_of(
    material: bpy.types.Material, scene: bpy.types.Scene, *, cold: bool = False
) -> Outlook | None:
    """What aging `material` will take, with the start of the worker where it is `cold`; None until
    the material has been looked at, soon after.
    """
    uids = (material.session_uid, scene.session_uid)
    look_soon(material, scene)
    settings = material.tvbrdf
    if is_aged(material):
        # Its nodes are ours now: what counts is what it was, and that is what was aged.
        folder = result_folder(material)
        report = report_in(folder) if folder is not None else None
        if report is None:
            return None
        size, why = report.size, ""
    elif (look := _looks.get(uids)) is not None:
        size, why = _size(settings, look)
    else:
        return None
    work = Work(
        texels=size[0] * size[1],
        frames=settings.steps,
        quality=settings.quality,
        temporal_model=_temporal_model(settings),
        live=settings.binding == LIVE,
        grows=settings.onset == AUTO,
        maps=settings.onset == AUTO and uids[0] not in _mapped,
        cold=cold,
    )
    expected = _kept_rates().of
    balanced, mapped = replace(work, quality=BALANCED), replace(work, maps=False)
    return Outlook(size, why, expected(work), expected(balanced), expected(mapped))


def is_worth_a_preview(material: bpy.types.Material, scene: bpy.types.Scene) -> bool:
    """Whether what a preview does not wait for takes so long that it is welcome."""
    expected = outlook_of(material, scene)
    return expected is not None and expected.mapped.seconds > PREVIEW_SECONDS


def learn(
    material: bpy.types.Material,
    aged: Mapping[str, Any],
    folder: Path,
    *,
    before: float = 0.0,
    maps: float = 0.0,
    start: float = 0.0,
) -> None:
    """Remember what the run took whose report is `aged` and whose files lie in `folder`: before the
    worker had it, of its surface's maps (0: those of a run before were kept) and of the worker's
    start (0: it was there).  A result that was kept tells nothing new, or of another machine.
    """
    global _rates
    if "surface" in aged:
        _mapped.add(material.session_uid)
    if CACHE_SECONDS in aged:
        return
    stored = sum(path.stat().st_size for path in folder.iterdir())
    _rates = _kept_rates().after(aged, stored, before=before, maps=maps, start=start)
    if (path := preferences.user_file(RATES)) is not None:
        # On a full disk only the next start of Blender knows less.
        with contextlib.suppress(OSError):
            _rates.save(path)


def _kept_rates() -> Rates:
    global _rates
    if _rates is None:
        _rates = Rates.load(preferences.user_file(RATES))
    return _rates


def _temporal_model(settings: properties.TVBRDF_PG_material) -> str:
    if settings.temporal_model != AUTO:
        return settings.temporal_model
    card = properties.card_of(settings)
    # Of an unknown model the slowest is to be expected.
    return (properties.usual_model(card) if card is not None else None) or LSTM_LATENTS


def _size(settings: properties.TVBRDF_PG_material, look: _Look) -> tuple[tuple[int, int], str]:
    longer, why = (look.seen, look.why) if settings.use_camera_size else (settings.size, "")
    if look.kind == "uniform" and settings.onset == EVERYWHERE:
        return (1, 1), ""
    height, width = look.images or (longer, longer)
    if look.images is not None and settings.use_camera_size:
        share = min(longer, max(look.images)) / max(look.images)
        height, width = (max(1, round(length * share)) for length in look.images)
    rows, columns = look.tiles
    return (rows * height, columns * width), why


def look_soon(material: bpy.types.Material, scene: bpy.types.Scene) -> None:
    """Lets a timer look at `material`, and draw again where that says something new."""
    global _wanted
    uids = (material.session_uid, scene.session_uid)
    _wanted = uids
    if not bpy.app.background and not bpy.app.timers.is_registered(_look_in_time):
        wait = 0.0 if uids not in _looks else max(0.1, _next_look - time.monotonic())
        bpy.app.timers.register(_look_in_time, first_interval=wait)


def _look_in_time() -> None:
    global _next_look
    windows = bpy.context.window_manager.windows
    if _wanted is None or any(window.screen.is_animation_playing for window in windows):
        return
    started = time.monotonic()
    material = by_uid(bpy.data.materials, _wanted[0])
    scene = by_uid(bpy.data.scenes, _wanted[1])
    if material is None or scene is None or is_aged(material):
        return
    look, is_new = None, False
    try:
        is_new = suiting.look_at(material)
        look = _look(material, scene)
    except Exception as error:  # a timer's traceback would reach nobody
        tell(said_of(error), of_error=True)
    ended = time.monotonic()
    _next_look = ended + max(PAUSE, SHARE * (ended - started))
    if look is not None and look != _looks.get(_wanted):
        _looks[_wanted] = look
        is_new = True
    if is_new:
        redraw()


def _look(material: bpy.types.Material, scene: bpy.types.Scene) -> _Look | None:
    """None where the material cannot be aged as it is."""
    # Only now: numpy, which it needs, has no part in drawing a panel.
    from .material.reading.cameras import all_the_cameras_see
    from .material.reading.tiles import tiles_of

    readable = _readable(material)
    layers = (layer.depsgraph for layer in scene.view_layers)
    depsgraph = next((each for each in layers if each is not None), None)
    if readable is None or depsgraph is None:
        return None
    principled, space = readable
    try:
        users = showing(material, scene)
        tiles = tiles_of(principled, space, material, users, depsgraph)
    except MaterialError:
        return None
    seen = all_the_cameras_see(material, space, scene, None, depsgraph=depsgraph)
    images = None
    if space.kind == "texture":
        images = max((image_size(known(node.image)) for node in space.images), key=max)
    return _Look(space.kind, images, (tiles.rows, tiles.columns), seen.pixels, seen.why)


def _readable(material: bpy.types.Material) -> tuple[bpy.types.Node, Space] | None:
    if material.node_tree is None:
        return None
    try:
        place = find_principled(material)
    except MaterialError:
        return None
    space = choose_space(place.principled, place.groups, painted=is_painted(material))
    broken = any(node.image is None or min(image_size(node.image)) == 0 for node in space.images)
    return None if broken else (place.principled, space)


def unregister() -> None:
    global _rates
    if bpy.app.timers.is_registered(_look_in_time):
        bpy.app.timers.unregister(_look_in_time)
    _looks.clear()
    _mapped.clear()
    _rates = None
