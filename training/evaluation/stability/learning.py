"""Stresses of learning: sources that are short, gappy or unsteady; fewer samples and materials
modeled, coarser numbers, sudden ends. The target is undamaged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from model_runtime.contract import LADDER, LSTM_LATENTS, LSTM_PARAMETERS

from ...data.sequences import Sequence, uniform_times
from .trials import FRAMES, Stress, Trial, TrialSetup, grown

__all__ = ("LEARNING",)

_SEED = 20240715
_OUTLIER = 17
_FORMATS = {
    23.0: ("fp32", torch.float32),
    10.0: ("fp16", torch.float16),
    7.0: ("bf16", torch.bfloat16),
    3.0: ("e4m3", torch.float8_e4m3fn),
    2.0: ("e5m2", torch.float8_e5m2),
}


def _frames(setup: TrialSetup, frames: float) -> Trial:
    """A source of so few frames."""
    source = grown(setup.patches()[0], times=uniform_times(int(frames)))
    return _learning_from(setup, source, f"{int(frames)}_frames")


def _gaps(setup: TrialSetup, share: float) -> Trial:
    """One gap in the middle of the source: a share of its time in which there are no frames."""
    times = uniform_times(FRAMES)
    source = _only(setup.source, np.abs(times - 0.5) >= share / 2 - 1e-6)
    return _learning_from(setup, source, f"gap_{share:g}")


def _flicker(setup: TrialSetup, percent: float) -> Trial:
    """Each frame's Kd and Ks times one random number, as a lamp that is not steady makes it."""
    rng = np.random.default_rng(_SEED)
    light = 1 + percent / 100 * rng.standard_normal((FRAMES, 1, 1, 1))
    return _learning_from(setup, _lit(setup.source, light), f"flicker_{percent:g}")


def _outlier(setup: TrialSetup, factor: float) -> Trial:
    """One frame in the middle so many times too bright."""
    light = np.ones((FRAMES, 1, 1, 1))
    light[_OUTLIER] = factor
    return _learning_from(setup, _lit(setup.source, light), f"outlier_{factor:g}")


def _lit(source: Sequence, light: NDArray[np.float64]) -> Sequence:
    lamp = np.maximum(light, 0).astype(np.float32)
    return replace(source, kd=source.kd * lamp, ks=source.ks * lamp)


def _only(source: Sequence, kept: NDArray[np.bool_]) -> Sequence:
    maps = {name: getattr(source, name)[kept] for name in ("kd", "ks", "alpha", "times")}
    return replace(source, **maps)


def _learning_from(setup: TrialSetup, source: Sequence, key: str) -> Trial:
    maps = ("kd", "ks", "alpha", "times")
    if all(np.array_equal(getattr(source, m), getattr(setup.source, m)) for m in maps):
        return Trial(setup.case())  # harmless: what is learned from the setup's source already
    return Trial(setup.case(source=source, key=key.replace(".", "")))


def _samples(setup: TrialSetup, m: float) -> Trial:
    return Trial(setup.case(), samples=int(m))


def _palette(setup: TrialSetup, entries: float) -> Trial:
    return Trial(setup.case(), palette=int(entries))


def _precision(setup: TrialSetup, bits: float) -> Trial:
    return Trial(setup.case(), dtype=_FORMATS[bits][1])


def _restarted(setup: TrialSetup, share: float) -> Trial:
    return Trial(setup.case(), killed=share or None)


LEARNING: Mapping[str, Stress] = {
    "samples": Stress(
        "samples read by the encoder", "m",
        (256.0, 64.0, 32.0, 16.0, 8.0), _samples, ("ours", "paper", LSTM_LATENTS),
        note="only encoders read samples; the product chooses a rung that reads none",
    ),
    "palette": Stress(
        "materials modeled", "entries of the palette",
        (2048.0, 64.0, 16.0, 4.0, 1.0), _palette,
        ("ours", *LADDER),
        note="the rivals model every texel: they have no palette",
    ),
    "precision": Stress(
        "half precision and coarser", "format of numbers", tuple(_FORMATS), _precision,
        note="everything given and learned is stored in the format, and computed with in float32",
        labels={bits: name for bits, (name, _) in _FORMATS.items()},
    ),
    "restart": Stress(
        "training killed and resumed", "share of it done before", (0.0, 0.1, 0.5), _restarted,
        ("ours", LSTM_PARAMETERS, LSTM_LATENTS),
        note="SIGKILL; the others learn in a second, or by the same code",
    ),
    "source_frames": Stress(
        "source with few frames", "frames", (36.0, 12.0, 3.0, 2.0), _frames,
        note="STT and STAF refuse fewer than four frames",
    ),
    "source_gap": Stress(
        "source with a gap", "share of the time without frames", (0.0, 0.3, 0.9), _gaps
    ),
    "source_flicker": Stress(
        "source that flickers", "standard deviation of its light, %",
        (0.0, 5.0, 20.0, 50.0), _flicker,
    ),
    "source_outlier": Stress(
        "source with one outlier frame", "times too bright", (1.0, 2.0, 100.0),
        _outlier,
    ),
}  # fmt: skip
"""By name."""
