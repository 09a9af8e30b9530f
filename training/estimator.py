"""Training of the estimator of fitted parameters: `python -m training estimator`."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor
from tqdm import tqdm

from model_runtime.atomic import check_writable
from model_runtime.brdf.fit import fit_angles, fit_torrance_sparrow
from model_runtime.channels import optics
from model_runtime.errors import shown
from model_runtime.model_files.weights import save_model
from model_runtime.modelling.palette import viewed
from model_runtime.representation import Trained, load_representation
from model_runtime.representation.estimator import ParameterEstimator, as_states, load_estimator
from model_runtime.representation.latents import Latents
from model_runtime.representation.lobes import compress

from .distillation import random_states
from .loop import Run, Schedule, Training, remove_checkpoints, train
from .metric.sphere import tone_map

__all__ = ("random_latents", "train_estimator")

_BATCH = 512
_LOOKED_AT = 64  # of a batch, whose appearance is compared too
_SCHEDULE = Schedule(3e-3, warm_up=200)
_FITTED = 4096  # at a time
# Specular albedo at which alpha counts half: without a lobe it means nothing.
_VISIBLE = 0.02


def random_latents(n: int, representation: Trained, g: torch.Generator) -> Latents:
    """Latents of `n` random materials, a third as they are, the others in between two or a bit
    beyond, all with noise: where a temporal model may lead.
    """
    one, other = (representation.encode_parameters(random_states(n, g)) for _ in range(2))
    share = 1.4 * torch.rand(n, 1, generator=g) - 0.2
    share[: n // 3] = 1
    flat = torch.lerp(other.flat(), one.flat(), share)
    noise = 0.3 * torch.rand(n, 1, generator=g) ** 3
    return one.unflat(flat + noise * torch.randn(flat.shape, generator=g))


def train_estimator(
    *,
    encoder: Path,
    output: Path,
    resume: bool = False,
    minutes: float | None = None,
    iterations: int = 135_000,
    materials: int = 400_000,
    seed: int = 0,
) -> Path:
    """Train an estimator for the latents of `encoder` and write it to `output`; returns that path.

    It learns what the fit finds in `materials` random latents, in so many `iterations`, or in as
    many as fit in `minutes` of a core. A checkpoint beside the output is replaced every minute, and
    removed in the end; `resume` goes on from it, once the fits are found again.
    """
    check_writable(output)
    torch.manual_seed(seed)
    g = torch.Generator().manual_seed(seed)
    representation, identity = load_representation(encoder)
    with torch.no_grad():
        latents = random_latents(materials, representation, g)
        wanted = _fitted(latents, representation)
    model = ParameterEstimator(latents.color.shape[2], latents.shared.shape[1])
    training = Training(
        model,
        _loss(model, latents, wanted, g),
        _SCHEDULE,
        iterations,
        g,
        {"encoder": identity, "iterations": iterations, "materials": materials},
    )
    run = Run(output, output.with_suffix(".tensorboard"), resume, minutes, seed)
    record = train(training, run)
    options = f"--encoder {shown(encoder)} --output {shown(output)} --seed {seed}"
    options += f" --minutes {minutes:g}" if minutes is not None else ""
    save_model(
        output,
        model.state_dict(),
        {
            "name": "estimator",
            "title": "Parameters of latents",
            "representation": identity,
            "source": "Random Torrance-Sparrow materials.",
            "license": "GPL-3.0-or-later",
            "trained": {
                "command": f"python -m training estimator {options}",
                "iterations": record["iterations"],
                "minutes": round(record["seconds"] / 60, 1),
                "seed": seed,
                "data": f"what the fit finds in {materials:,} random latents",
            },
        },
        kind="estimator",
        check=lambda file: load_estimator(identity, file),
    )
    remove_checkpoints(run)
    return output


def _loss(
    model: ParameterEstimator, latents: Latents, wanted: Tensor, g: torch.Generator
) -> Callable[[int], Tensor]:
    """Of a random batch: albedos, alpha as far as it is visible, and what a few of them look like;
    `wanted` [N, C] is what the fit finds in `latents`.
    """
    kd, ks, alpha = optics(wanted)
    albedos, log_alpha = compress(torch.stack((kd, ks), 2)), alpha.log()
    specular = ks.mean(1)
    visible = specular / (specular + _VISIBLE)

    def loss(_: int) -> Tensor:
        rows = torch.randint(len(wanted), (_BATCH,), generator=g)
        told, told_alpha = model(Latents(latents.color[rows], latents.shared[rows]))
        missed = (told - albedos[rows]).abs().mean(0).sum() / 3
        missed = missed + ((told_alpha - log_alpha[rows]).abs() * visible[rows]).mean()
        seen = as_states(told[:_LOOKED_AT], told_alpha[:_LOOKED_AT])
        return missed + 5 * _difference(seen, wanted[rows[:_LOOKED_AT]])

    return loss


def _fitted(latents: Latents, representation: Trained) -> Tensor:
    """Parameters [N, C] that the fit finds in latents."""
    angles, flat = fit_angles(), latents.flat()
    parts = (
        representation.decode(latents.unflat(flat[start : start + _FITTED]), angles)
        for start in tqdm(range(0, len(flat), _FITTED), desc="fits")
    )
    return torch.cat([fit_torrance_sparrow(part, angles).parameters() for part in parts])


def _difference(states: Tensor, wanted: Tensor) -> Tensor:
    """Mean difference [] of what two lists of states [N, C] look like, tone-mapped."""
    return (_look(states) - _look(wanted)).abs().mean()


def _look(states: Tensor) -> Tensor:
    return tone_map(math.pi * viewed(states) + 1e-4)
