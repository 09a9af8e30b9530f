"""Stresses of the means: fewer samples, fewer materials modelled, coarser numbers, sudden ends."""

from __future__ import annotations

from collections.abc import Mapping

import torch

from model_runtime.contract import LADDER, LSTM_LATENTS, LSTM_PARAMETERS

from .trials import Stress, Trial, World

__all__ = ("MEANS",)

_FORMATS = {
    23.0: ("fp32", torch.float32),
    10.0: ("fp16", torch.float16),
    7.0: ("bf16", torch.bfloat16),
    3.0: ("e4m3", torch.float8_e4m3fn),
    2.0: ("e5m2", torch.float8_e5m2),
}


def _samples(world: World, m: float) -> Trial:
    return Trial(world.case(), samples=int(m))


def _palette(world: World, entries: float) -> Trial:
    return Trial(world.case(), palette=int(entries))


def _precision(world: World, bits: float) -> Trial:
    return Trial(world.case(), dtype=_FORMATS[bits][1])


def _restarted(world: World, share: float) -> Trial:
    return Trial(world.case(), killed=share or None)


MEANS: Mapping[str, Stress] = {
    "samples": Stress(
        "samples read by the encoder", "m",
        (256.0, 64.0, 32.0, 16.0, 8.0), _samples, ("ours", "paper", LSTM_LATENTS),
        note="only encoders read samples; the product chooses a rung that reads none",
    ),
    "palette": Stress(
        "materials modelled", "entries of the palette",
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
}  # fmt: skip
"""By name."""
