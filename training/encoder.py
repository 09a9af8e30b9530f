"""Training of BRDF encoders and decoders: `python -m training encoder`."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor, nn
from tqdm import tqdm

from model_runtime.atomic import check_writable
from model_runtime.model_files.weights import save_model
from model_runtime.representation import Trained, build, load_representation
from model_runtime.representation.latents import Latents, Representation, log_transform
from model_runtime.representation.lobes import LobeRepresentation, compress

from .checkpoint import load_checkpoint, save_checkpoint
from .data.location import data_folder
from .data.materials import damage, draw_batch, loss_angles, sphere_angles
from .data.nbrdf import HELD_OUT, NeuralBRDFs, load
from .distillation import distil
from .log import open_log
from .metric.sphere import tone_map
from .progress import Progress

__all__ = ("CONFIGS", "EncoderConfig", "train_encoder")


_DIRECTIONS = 16_200
"""The paper's number of samples of a BRDF."""

ATTRIBUTION = (
    "Trained on the MERL BRDF Database (Matusik, Pfister, Brand, McMillan 2003, Mitsubishi "
    "Electric Research Laboratories, CC-BY-SA-4.0), changes made, through the networks of "
    "Neural-BRDF (Sztrajman, Rainer, Ritschel, Weyrich 2021, MIT), and on random analytic BRDFs."
)


@dataclass(frozen=True)
class EncoderConfig:
    """One recipe. `iterations` is what `--minutes` overrides, at the speed measured on this
    machine.
    """

    representation: Literal["lobes", "paper", "brdfnps"]
    iterations: int
    batch: int
    samples: int
    """Directions that the encoder is given, drawn anew from its own for every batch; 0 for all."""
    targets: int
    """Directions at which the decoded BRDF is compared."""
    learning_rate: float
    warm_up: int
    schedule: Literal["constant", "cosine"]
    loss: Literal["compressed", "l"]
    """Space in which reflectances are compared: log(1 + f / 0.01), or the paper's l(f)."""
    pixels: int
    """Random sphere pixels compared after tone mapping, 0 for none."""
    latent_noise: float
    """Standard deviation added to latents, so that near latents decode to near BRDFs."""
    damaged: float
    """Share of the materials of which the encoder sees only a part, or sees it badly."""
    bent: float
    """Share of the measured materials that are bent, mixed and recoloured."""
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
        samples=16_200,
        targets=16_200,
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


def learning_rate(config: EncoderConfig, step: int, total: int) -> float:
    """The rate at `step` of `total`: a linear warm-up, then constant or a cosine to 1 %."""
    rate = config.learning_rate * min(1.0, (step + 1) / max(1, config.warm_up))
    if config.schedule == "cosine":
        rate *= 0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(1.0, step / total)))
    return rate


def _noisy(latents: Latents, scale: float, g: torch.Generator) -> Latents:
    if scale == 0:
        return latents
    color = latents.color + scale * torch.randn(latents.color.shape, generator=g)
    return Latents(color, latents.shared + scale * torch.randn(latents.shared.shape, generator=g))


def training_loss(
    model: Representation,
    config: EncoderConfig,
    measured: NeuralBRDFs,
    g: torch.Generator,
) -> Tensor:
    """One random batch: distance of compressed values, plus tone-mapped sphere pixels and latent
    size.
    """
    sources = draw_batch(
        measured, config.batch, g, bent=config.bent, torrance_sparrow=config.torrance_sparrow
    )
    asked = model.sample_angles(_DIRECTIONS)
    if config.samples:
        asked = asked[torch.randperm(len(asked), generator=g)[: config.samples]]
    targets = loss_angles(config.targets, g)
    pixel_angles, weights = sphere_angles(config.pixels, 64, g)
    angles = torch.cat((asked, targets, pixel_angles))
    with torch.no_grad():
        truth = torch.cat([evaluate(angles) for evaluate in sources]).clamp(0, 1e5)
    seen, truth = truth[:, : len(asked)], truth[:, len(asked) :]
    if config.damaged:
        measured_rows = config.batch - config.batch // 2
        seen = damage(asked, seen, config.damaged, g, measured=measured_rows)
    latents = model.encode(asked, seen)
    decoded = model.decode(_noisy(latents, config.latent_noise, g), angles[len(asked) :])
    m = len(targets)
    if config.loss == "l":
        return (log_transform(decoded) - log_transform(truth)).abs().mean()
    loss = (compress(decoded[:, :m]) - compress(truth[:, :m])).abs().mean()
    shown = [
        torch.einsum("npdc,pd->npc", f[:, m:].unflatten(1, weights.shape), weights)
        for f in (decoded, truth)
    ]
    error = tone_map(shown[0] + 1e-4) - tone_map(shown[1] + 1e-4)
    size = latents.color.square().mean() + latents.shared.square().mean()
    excess = (shown[0] - shown[1]).clamp(0, 1)
    return loss + 4 * error.abs().mean() + excess.mean() + 1e-4 * size


def train_encoder(
    *,
    config: str,
    output: Path,
    resume: bool = False,
    minutes: float | None = None,
    seed: int = 0,
) -> Path:
    """Train the recipe `config` and write the encoder to `output`; returns that path.

    A checkpoint beside the output is replaced every minute; `resume` goes on from it. The random
    numbers, the optimiser and the step are all in it, so an interrupted run ends as an
    uninterrupted one. `minutes` sets the number of iterations, at a speed measured first. Minutes
    are those of a core, so that runs beside others compare.
    """
    recipe = CONFIGS[config]
    checkpoint = output.with_suffix(".checkpoint.safetensors")
    for file in (output, checkpoint):
        check_writable(file)
    torch.manual_seed(seed)
    g = torch.Generator().manual_seed(seed)
    measured = load(data_folder(), "merl").without(HELD_OUT)
    model = build(recipe.representation)
    optimizer = torch.optim.Adam(model.parameters(), lr=recipe.learning_rate, betas=(0.9, 0.99))
    run = {"seed": seed, "config": asdict(recipe)}
    record: dict[str, Any] = {
        "step": 0,
        "seconds": 0.0,
        "iterations": recipe.iterations,
        "curve": [],
        "run": run,
    }
    if resume and checkpoint.exists():
        record = load_checkpoint(
            checkpoint, model=model, optimizer=optimizer, generator=g, fresh=record
        )
    elif minutes is not None:
        record["iterations"] = _iterations_in(minutes, model, recipe, measured)
    writer = open_log(output.with_suffix(".tensorboard"))
    progress = Progress.load(data_folder()) if recipe.looks else None
    start, saved = time.process_time() - record["seconds"], time.monotonic()
    bar = tqdm(range(record["step"], record["iterations"]), initial=record["step"])
    bar.total = record["iterations"]
    smooth = None
    for step in bar:
        for group in optimizer.param_groups:
            group["lr"] = learning_rate(recipe, step, record["iterations"])
        torch.manual_seed(seed + step)  # variational latents: a resumed run draws the same
        loss = training_loss(model, recipe, measured, g)
        optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimizer.step()
        if step % 100 == 0:
            value = loss.item()
            smooth = value if smooth is None else 0.95 * smooth + 0.05 * value
            bar.set_postfix_str(f"loss {smooth:.4f}", refresh=False)
            writer.add_scalar("loss", value, step)
        looked, due = (at * recipe.looks // record["iterations"] for at in (step, step + 1))
        if progress is not None and due > looked:
            paused = time.process_time()
            scores = progress.scores(model.eval())
            model.train()
            start += time.process_time() - paused
            writer.add_scalars("psnr", scores, step)
            minute = round((time.process_time() - start) / 60, 2)
            record["curve"].append({"iteration": step + 1, "minutes": minute, **scores})
        if time.monotonic() - saved > 60:
            saved = time.monotonic()
            record |= {"step": step + 1, "seconds": time.process_time() - start}
            save_checkpoint(
                checkpoint, model=model, optimizer=optimizer, generator=g, record=record
            )
    record |= {"step": record["iterations"], "seconds": time.process_time() - start}
    save_checkpoint(checkpoint, model=model, optimizer=optimizer, generator=g, record=record)
    if isinstance(model, LobeRepresentation):
        distil(model, seed=seed, iterations=recipe.distillation)
    options = f"--config {config} --seed {seed}"
    options += f" --minutes {minutes:g}" if minutes is not None else ""
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
                "seed": seed,
                "data": "MERL (through Neural-BRDF), Disney, Torrance-Sparrow",
                "held_out": list(HELD_OUT),
            },
        },
        kind="encoder",
        check=load_representation,
    )
    return output


def _iterations_in(
    minutes: float, model: Trained, recipe: EncoderConfig, measured: NeuralBRDFs
) -> int:
    """How many iterations fit in `minutes` here; the trial runs leave the model as it was."""
    g = torch.Generator().manual_seed(0)
    trials = 3 if recipe.samples == _DIRECTIONS else 30
    for trial in range(trials + 2):
        if trial == 2:
            start = time.process_time()
        training_loss(model, recipe, measured, g).backward()
    model.zero_grad()
    return max(1, int(minutes * 60 / ((time.process_time() - start) / trials) * 0.9))
