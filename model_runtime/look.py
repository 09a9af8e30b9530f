"""A look at where aging would start: pictures of the object, before anything is modeled."""

from __future__ import annotations

from typing import Any

import numpy as np
from PIL import Image

from .backend import torch
from .contract import LOOKS, AgeRequest
from .errors import InputError, OutputError, reason, shown
from .maps import Pixels
from .memory import memory_in_words
from .modelling.start import Start, read_start
from .run import Reporter, Run
from .surface.maps import read_surface
from .surface.pictures import seen_from

__all__ = ("look",)

_NO_SURFACE = "This model changes the whole surface at once, or nothing is known of the surface."


def look(request: AgeRequest, reporter: Reporter) -> dict[str, Any]:
    """Write pictures (`LOOKS`) of when the surface of `request` starts to age to its output folder;
    returns their names as `pictures`, and what `aged.json` would say of the surface.

    Raises a kind of TvbrdfError with a sentence for the user where anything is wrong.
    """
    run = Run(request, reporter)
    with memory_in_words("Choose a smaller size."), torch.inference_mode():
        run.progress("read", 0.0)
        start = read_start(run)
        if start.apart is None and start.texels.onset is None:
            raise InputError(_NO_SURFACE, "There is nothing to look at.")
        onset = _late(start, lit=request.light is not None)
        run.progress("write", 0.8)
        atlas = read_surface(request.surface or request.input)
        try:
            request.output.mkdir(parents=True, exist_ok=True)
            for name, direction in LOOKS.items():
                pixels = np.rint(seen_from(direction, atlas, onset) * 255).astype(np.uint8)
                Image.fromarray(pixels, "RGBA").save(request.output / name)
        except OSError as error:
            raise OutputError(
                f"{shown(request.output)} cannot be written to: {reason(error)}.",
                "Choose another folder.",
            ) from error
    return {"pictures": [*LOOKS], **start.grown}


def _late(start: Start, *, lit: bool) -> Pixels:
    """How late texels start, or of what is `lit` how far it stays behind: [H, W], 0 to 1."""
    if start.apart is not None:
        onset, rate = start.apart
    else:
        onset, rate = (
            np.ones(start.size, np.float32) if each is None else each.numpy().reshape(start.size)
            for each in (start.texels.onset, start.texels.rate)
        )
    return np.maximum(onset, 1 - rate) if lit else onset
