"""What a run says of itself: the content of `aged.json`."""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Sequence
from typing import Any

from . import __version__
from .backend import NAME
from .contract import FRAMES, LIVE, METERS, OF_TEXTURE, AgeRequest, Format, option
from .live.fitting import Fitted
from .memory import peak_rss_mb
from .modelling.compose import AgedTexels
from .modelling.start import Start
from .output.savings import savings
from .representation.measured import Encoded
from .run import Run

__all__ = ("account_of",)


def account_of(
    run: Run,
    start: Start,
    modeled: AgedTexels,
    live: Fitted | None,
    *,
    rung: str,
    encoded: Encoded | None,
    interval: int,
    format: Format,
    times: Sequence[float],
    files: dict[str, Any],
) -> dict[str, Any]:
    """What `aged.json` holds of a run that wrote `files`.

    Every `interval`-th frame was aged; `live` stands for all frames where it is not None. `encoded`
    are the latents of a measured material, where these were rolled out.
    """
    request = run.request
    coefficients = None if live is None else live.coefficients
    fit_error = 0.0 if start.fit is None else start.fit.error
    return {
        "format": format,
        "binding": FRAMES if live is None else LIVE,
        "coefficients": coefficients or 0,
        **_residues(modeled, start, live),
        "ntm": start.models.ntm.card.name,
        "frames": request.frames,
        "times": [round(time, 6) for time in times],
        "size": list(start.size),
        "quality": request.quality,
        "temporal_model": rung,
        "device": modeled.histories.device,
        "backend": NAME,
        "palette": len(modeled.palette.entries),
        "plan": savings(
            texels=len(modeled.initial),
            modeled=len(modeled.palette.entries),
            interval=interval,
            files=files,
            coefficients=coefficients,
            not_live=start.may_be_live and live is None,
        ),
        "fit_error": round(max(fit_error, modeled.histories.fit_error), 6),
        **_measured(start, encoded),
        **({} if live is None else {"error_db": live.error_db}),
        "warnings": run.warnings,
        "seconds": run.seconds,
        "peak_rss_mb": peak_rss_mb(),
        "files": files,
        "version": __version__,
        "command": command_line(request),
        "seed": request.seed,
        "onset": request.onset,
        "tolerance": request.tolerance,
        "hashes": start.hashes,
        **start.grown,
    }


def _residues(modeled: AgedTexels, start: Start, live: Fitted | None) -> dict[str, Any]:
    """What says how grain and heights are to be read, where there are any."""
    residues = modeled.residues if live is None else live.residues
    if residues is None:
        return {}
    return {
        **({} if live is None else {"grain": residues.grain}),
        "height": residues.raises,
        "tile_side": round(start.laid.side, 9),
        "tile_unit": METERS if start.laid.in_meters else OF_TEXTURE,
    }


def _measured(start: Start, encoded: Encoded | None) -> dict[str, Any]:
    """How near a measured material looks, as maps and as latents hold it, and by how many lobes."""
    if start.fit is None:
        return {}
    found = {"fit": start.fit.db}
    if start.fit.further is not None:
        found["one_lobe"] = float(start.fit.one.db[0])
    if encoded is not None:
        found["latents"] = float(encoded.db[0])
    db = {name: round(value, 1) for name, value in found.items()}
    return {"lobes": start.fit.lobed.lobes, "measured_db": db}


def command_line(request: AgeRequest) -> str:
    """The command that does the same again."""
    words = ["python", "-m", "model_runtime", "age"]
    for item in dataclasses.fields(request):
        value = getattr(request, item.name)
        if value is True:
            words.append(option(item.name))
        elif value is not None and value is not False:
            words += [option(item.name), str(value)]
    return shlex.join(words)
