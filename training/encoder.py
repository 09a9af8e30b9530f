"""Training of BRDF encoders and decoders: `python -m training encoder`."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor

from model_runtime.atomic import check_writable
from model_runtime.model_files.weights import save_model
from model_runtime.representation.latents import (
    PAPER_SAMPLES,
    Latents,
    Representation,
    log_transform,
)
from model_runtime.representation.lobes import LobeRepresentation, compress

from .baselines.encoders import Encoder, build_encoder, load_encoder
from .data.location import data_folder
from .data.materials import damage, draw_batch, loss_angles, sphere_angles
from .data.nbrdf import HELD_OUT, NeuralBRDFs, load
from .distillation import SHORT_CUT, distil
from .distributed import ALONE, Share, World, exactly
from .loop import Run, Schedule, Training, remove_checkpoints, train
from .metric.sphere import tone_map
from .progress import Progress

__all__ = ("CONFIGS", "EncoderConfig", "train_encoder")


ATTRIBUTION = (
    "Trained on the MERL BRDF Database (Matusik, Pfister, Brand, McMillan 2003, Mitsubishi "
    "Electric Research Laboratories, CC-BY-SA-4.0), changes made, through the networks of "
    "Neural-BRDF (Sztrajman, Rainer, Ritschel, Weyrich 2021, MIT), and on random analytic BRDFs."
)


_APART = 1 << 40  # between the seeds of two processes: more than any run has steps


@dataclass(frozen=True)
class EncoderConfig:
    """One recipe. `iterations` is what `--minutes` overrides, at the speed measured on this
    machine.
    """

    representation: Literal["lobes", "paper", "brdfnps", "deepbrdf", "hyperbrdf"]
    iterations: int
    batch: int
    samples: int
    """Directions that the encoder is given, drawn anew from its own for every batch; 0 for all."""
    targets: int
    """Directions at which the decoded BRDF is compared; 0 for those that the encoder is given."""
    learning_rate: float
    warm_up: int
    schedule: Literal["constant", "cosine"]
    loss: Literal["compressed", "log", "l"]
    """Space in which reflectances are compared: log(1 + f / 0.01), beside sphere pixels and alone,
    or the paper's l(f)."""
    pixels: int
    """Random sphere pixels compared after tone mapping, 0 for none."""
    latent_noise: float
    """Standard deviation added to latents, so that near latents decode to near BRDFs."""
    damaged: float
    """Share of the materials of which the encoder sees only a part, or sees it badly."""
    bent: float
    """Share of the measured materials that are bent, mixed and recolored."""
    torrance_sparrow: float
    """Share of a batch; half of it is measured, the rest Disney."""
    looks: int
    """How often the run measures itself on seen and unseen materials; its clock stops meanwhile."""
    distillation: int
    """Iterations in which the short cut from parameters to latents is learned afterwards."""


CONFIGS = {
    "fast": EncoderConfig(
        representation="lobes",
        iterations=70_000,
        batch=64,
        samples=0,
        targets=384,
        learning_rate=1e-3,
        warm_up=500,
        schedule="cosine",
        loss="compressed",
        pixels=8,
        latent_noise=0.02,
        damaged=0.35,
        bent=0.65,
        torrance_sparrow=0.25,
        looks=20,
        distillation=6_000,
    ),
    "paper": EncoderConfig(
        representation="paper",
        iterations=600_000,
        batch=16,
        samples=PAPER_SAMPLES,
        targets=PAPER_SAMPLES,
        learning_rate=1e-4,
        warm_up=0,
        schedule="constant",
        loss="l",
        pixels=0,
        latent_noise=0.0,
        damaged=0.0,
        bent=0.0,
        torrance_sparrow=0.0,
        looks=20,
        distillation=0,
    ),
}
_SHORT = replace(
    CONFIGS["paper"],
    iterations=40_000,
    samples=128,
    targets=256,
    learning_rate=1e-3,
    warm_up=500,
    schedule="cosine",
    bent=CONFIGS["fast"].bent,
    torrance_sparrow=CONFIGS["fast"].torrance_sparrow,
)
CONFIGS["paper-short"] = _SHORT
CONFIGS["brdfnps-short"] = replace(_SHORT, representation="brdfnps")
CONFIGS["deepbrdf"] = replace(_SHORT, representation="deepbrdf", samples=0, targets=0, loss="log")
CONFIGS["hyperbrdf"] = replace(
    _SHORT, representation="hyperbrdf", batch=32, samples=256, targets=256, loss="log"
)


def _noisy(latents: Latents, scale: float, g: torch.Generator, mine: Share) -> Latents:
    if scale == 0:
        return latents
    parts = (latents.color, latents.shared)
    noise = [mine(torch.randn(mine.whole, *each.shape[1:], generator=g)) for each in parts]
    return Latents(*(each + scale * some for each, some in zip(parts, noise, strict=True)))


def training_loss(
    model: Representation,
    config: EncoderConfig,
    measured: NeuralBRDFs,
    g: torch.Generator,
    mine: Share,
) -> Tensor:
    """The materials of a random batch that are `mine`: distance of compressed values, plus
    tone-mapped sphere pixels and latent size.
    """
    sources = draw_batch(
        measured, mine, g, bent=config.bent, torrance_sparrow=config.torrance_sparrow
    )
    asked = model.sample_angles(PAPER_SAMPLES).to(mine.device)
    if config.samples:
        asked = asked[torch.randperm(len(asked), generator=g)[: config.samples]]
    targets = loss_angles(config.targets, g) if config.targets else asked
    pixel_angles, weights = sphere_angles(config.pixels, 64, g)
    targets, pixel_angles, weights = (
        each.to(mine.device) for each in (targets, pixel_angles, weights)
    )
    angles = torch.cat((asked, targets, pixel_angles))
    with torch.no_grad(), exactly():
        truth = torch.cat([evaluate(angles) for evaluate in sources]).clamp(0, 1e5)
    seen, truth = truth[:, : len(asked)], truth[:, len(asked) :]
    if config.damaged:
        measured_rows = mine.whole - mine.whole // 2
        seen = damage(asked, seen, config.damaged, g, mine, measured=measured_rows)
    latents = model.encode(asked, seen)
    decoded = model.decode(_noisy(latents, config.latent_noise, g, mine), angles[len(asked) :])
    m = len(targets)
    if config.loss == "l":
        return mine.weight * (log_transform(decoded) - log_transform(truth)).abs().mean()
    loss = (compress(decoded[:, :m]) - compress(truth[:, :m])).abs().mean()
    if config.loss == "log":
        return mine.weight * loss
    shown = [
        torch.einsum("npdc,pd->npc", f[:, m:].unflatten(1, weights.shape), weights)
        for f in (decoded, truth)
    ]
    error = tone_map(shown[0] + 1e-4) - tone_map(shown[1] + 1e-4)
    size = latents.color.square().mean() + latents.shared.square().mean()
    excess = (shown[0] - shown[1]).clamp(0, 1)
    return mine.weight * (loss + 4 * error.abs().mean() + excess.mean() + 1e-4 * size)


def train_encoder(
    *,
    config: str,
    output: Path,
    resume: bool = False,
    minutes: float | None = None,
    batch: int | None = None,
    seed: int = 0,
    world: World = ALONE,
) -> Path:
    """Train the recipe `config` and write the encoder to `output`; returns that path.

    A checkpoint beside the output is replaced every minute, and removed in the end; `resume` goes
    on from it. `minutes` sets the number of iterations, at a speed measured first. Minutes are
    those of a core, so that runs beside others compare (see `World.seconds`). `batch` takes the
    place of the recipe's; the processes of `world` divide it.
    """
    recipe = CONFIGS[config]
    if batch is not None:
        recipe = replace(recipe, batch=batch)
    check_writable(output)
    torch.manual_seed(seed)
    measured = load(data_folder(), "merl").without(HELD_OUT)
    model = build_encoder(recipe.representation).to(world.device)
    run = Run(output, output.with_suffix(".tensorboard"), resume, minutes, seed, world=world)
    record = train(_training(recipe, model, measured, run), run)
    if isinstance(model, LobeRepresentation):
        distil(model, run, iterations=recipe.distillation)
    if world.leads:
        _write(output, model.cpu(), recipe, config, record, run)
    return output


def _write(
    output: Path,
    model: Encoder,
    recipe: EncoderConfig,
    config: str,
    record: Mapping[str, Any],
    run: Run,
) -> None:
    """Write the encoder that `run` trained, and remove its checkpoints."""
    options = f"--config {config} --seed {run.seed}"
    options += f" --minutes {run.minutes:g}" if run.minutes is not None else ""
    options += f" --batch {recipe.batch}" if recipe.batch != CONFIGS[config].batch else ""
    save_model(
        output,
        model.state_dict(),
        {
            "name": recipe.representation,
            "title": f"BRDF encoder ({recipe.representation})",
            "source": ATTRIBUTION,
            "license": "GPL-3.0-or-later",
            "trained": {
                "command": f"python -m training encoder {options}",
                "config": asdict(recipe),
                "iterations": record["iterations"],
                "minutes": round(record["seconds"] / 60, 1),
                "curve": record["curve"],
                "seed": run.seed,
                "data": "MERL (through Neural-BRDF), Disney, Torrance-Sparrow",
                "held_out": list(HELD_OUT),
            },
        },
        kind="encoder",
        check=load_encoder,
    )
    remove_checkpoints(run, ("", SHORT_CUT))


def _training(recipe: EncoderConfig, model: Encoder, measured: NeuralBRDFs, run: Run) -> Training:
    g = torch.Generator().manual_seed(run.seed)
    mine = run.world.share(recipe.batch)
    progress = Progress.load(data_folder()) if recipe.looks and run.world.leads else None

    def loss(step: int) -> Tensor:
        # variational latents: a resumed run draws the same, each process others
        torch.manual_seed(run.seed + step + _APART * run.world.rank)
        return training_loss(model, recipe, measured, g, mine)

    def look() -> dict[str, float]:
        assert progress is not None
        return progress.scores(deepcopy(model).cpu().eval())

    floor = 0.01 if recipe.schedule == "cosine" else 1.0
    return Training(
        model,
        loss,
        Schedule(recipe.learning_rate, recipe.warm_up, floor),
        recipe.iterations,
        g,
        {"config": asdict(recipe)},
        looks=recipe.looks,
        look=look,
    )
