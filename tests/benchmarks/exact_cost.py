"""Where the seconds of `--quality exact` through latents go, and how few they could be.

    python -m tests.benchmarks.exact_cost

Prints microseconds of a core that a texel and its ages take to be encoded, rolled out, decoded and
fitted; those that the decoder's multiplications with its weights would take alone, at the speed
of one large product of matrices; and the paper's pipeline as a multiple of both. It needs the
paper's encoder (`training/evaluation/bench/encoders.py`).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import torch

from model_runtime.brdf.fit import Fitter, at_a_time, fit_angles
from model_runtime.contract import LSTM_LATENTS
from model_runtime.model_files.weights import find_model
from model_runtime.modelling.rollout import roll_out
from model_runtime.representation import load_representation
from model_runtime.representation.latents import PAPER_SAMPLES
from model_runtime.representation.lobes import LobeRepresentation
from model_runtime.temporal.ntm import NeuralTemporalModel
from training.evaluation.bench.encoders import WEIGHTS, trained_encoder
from training.evaluation.pareto.truth import paper_pipeline_seconds

_TEXELS, _SIDE = 64, 1000


def seconds_of(work: Callable[[], object]) -> float:
    """The least of a few, of a core."""
    found = []
    for _ in range(3):
        clock = time.process_time()
        work()
        found.append(time.process_time() - clock)
    return min(found)


def multiplications(decoder: LobeRepresentation, directions: int) -> int:
    """Of a decoded BRDF with the decoder's weights; its three channels go through most of them."""
    shapes = sum(each.numel() for each in decoder.to_shapes.parameters() if each.ndim == 2)
    weights = sum(each.numel() for each in decoder.to_weights.parameters() if each.ndim == 2)
    return shapes + 3 * weights + 3 * directions * decoder.config.rank


def main() -> None:
    torch.set_num_threads(1)
    decoder, encoder = load_representation()
    assert isinstance(decoder, LobeRepresentation)
    ntm, angles = NeuralTemporalModel.load(find_model("fading"), encoder), fit_angles()
    states = 0.1 + 0.5 * torch.rand(_TEXELS, 7, generator=torch.Generator().manual_seed(0))
    square = torch.rand(_SIDE, _SIDE)
    with torch.inference_mode():
        latents = decoder.encode_parameters(states)
        flat = ntm.latents.rollout(latents.flat(), ntm.frames).flatten(0, 1)
        parts = [latents.unflat(part) for part in flat.split(at_a_time(angles.device))]
        decoded = [decoder.decode(part, angles) for part in parts]
        fitter = Fitter(angles)
        exact = partial(roll_out, states, ntm, LSTM_LATENTS, decoder, samples=PAPER_SAMPLES)
        whole = seconds_of(exact) / _TEXELS
        decode = seconds_of(lambda: [decoder.decode(part, angles) for part in parts]) / _TEXELS
        fit = seconds_of(lambda: [fitter.fit(part) for part in decoded]) / _TEXELS
        one = seconds_of(lambda: square @ square) / _SIDE**3
        paper = paper_pipeline_seconds(
            load_representation(trained_encoder("paper", WEIGHTS))[0], states[:1]
        )
    least = one * multiplications(decoder, len(angles)) * ntm.frames
    for name, seconds in (
        ("exact", whole),
        ("of that, decoding", decode),
        ("of that, fitting", fit),
        ("the decoder's multiplications alone", least),
    ):
        print(
            f"{name}: {1e6 * seconds:.0f} us a texel, the paper's pipeline {paper / seconds:.0f} x"
        )


if __name__ == "__main__":
    main()
