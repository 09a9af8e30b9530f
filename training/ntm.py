"""Training of neural temporal models: `python -m training ntm`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from tqdm import tqdm

from model_runtime.histories import roll_out
from model_runtime.package import ModelCard, hash_tensors, read_card, save_model
from model_runtime.plan import appearance_psnr
from model_runtime.representation import load_representation
from model_runtime.representation.latents import Representation, inverse_log_transform
from model_runtime.temporal.domain import Domain
from model_runtime.temporal.models import Affine, LatentLSTM, ParameterLSTM
from model_runtime.temporal.ntm import LADDER, NeuralTemporalModel

from .checkpoint import load_checkpoint, save_checkpoint
from .data.sequences import read_sequence
from .histories import SourceHistories, source_histories

__all__ = ("NTMConfig", "train_ntm")

Model = ParameterLSTM | LatentLSTM

_HELD_OUT = 0.1
_VALIDATION_TEXELS = 256


@dataclass(frozen=True)
class NTMConfig:
    """Both LSTMs are trained alike; `sufficient` and `margin` (dB) decide which rung is used."""

    iterations: int = 2500
    batch: int = 256
    learning_rate: float = 3e-3
    warm_up: int = 100
    sufficient: float = 45.0
    margin: float = 1.0


def train_ntm(
    *,
    sequence: Path,
    encoder: Path,
    output: Path,
    card: Mapping[str, str],
    resume: bool = False,
    minutes: float | None = None,
    seed: int = 0,
    config: NTMConfig = NTMConfig(),
) -> Path:
    """Train every rung of the ladder on a sequence and write the NTM to `output`; returns that
    path.

    A tenth of the texels is held out; on them each rung is scored (mean appearance PSNR over the
    ages), and the cheapest one that reaches `config.sufficient` or is within `config.margin` of the
    best is what `auto` will use. `card` holds name, title, description, process, source, license.
    """
    representation, identity = load_representation(encoder)
    source = source_histories(read_sequence(sequence, clamp=False), representation, seed=seed)
    g = torch.Generator().manual_seed(seed)
    order = torch.randperm(len(source.parameters), generator=g)
    held = max(1, int(len(order) * _HELD_OUT))
    train, test = source.select(order[held:]), source.select(order[:held][:_VALIDATION_TEXELS])

    torch.manual_seed(seed)
    parameters = ParameterLSTM()
    parameters.standardise(train.parameters)
    latents = LatentLSTM(*representation.latent_sizes)
    faithful = representation.name == "paper"
    if not faithful:
        latents.standardise(train.latents)
    each = None if minutes is None else minutes / 2
    done: dict[str, Any] = {}
    for name, model, states, loss_of in (
        ("parameters", parameters, train.parameters, _parameter_loss),
        ("latents", latents, train.latents, _paper_loss if faithful else _latent_loss),
    ):
        done[name] = _train(
            model,
            states,
            train.observed,
            loss_of,
            config,
            checkpoint=output.with_suffix(f".{name}.checkpoint.safetensors"),
            log=output.with_suffix(".tensorboard") / name,
            resume=resume,
            minutes=each,
            seed=seed,
        )
    affine = Affine.fit(train.parameters, train.observed)
    domain = Domain.of(train.parameters[:, 0], seed=seed)
    frames = source.parameters.shape[1]
    details: dict[str, Any] = {
        **card,
        "source": f"{card['source']}. Encoder: {read_card(encoder).source}",
        "frames": frames,
        "representation": identity,
        "domain": {"radius": domain.radius, "ranges": _ranges(train.parameters[:, 0])},
    }
    draft = ModelCard(output, "ntm", 1, card["name"], card["title"], frames=frames, details=details)
    ntm = NeuralTemporalModel(draft, affine, parameters, latents, domain)
    scores = {rung: _score(rung, ntm, test, representation) for rung in LADDER}
    chosen = _choose(scores, config)
    details |= {
        "temporal_model": chosen,
        "ladder": {rung: round(score, 1) for rung, score in scores.items()},
        "trained": {
            "command": f"python -m training ntm --sequence {sequence} --encoder {encoder.name} "
            f"--output {output.name} --name {card['name']} --seed {seed}"
            + (f" --minutes {minutes:g}" if minutes is not None else ""),
            "iterations": {name: record["iterations"] for name, record in done.items()},
            "minutes": round(sum(record["seconds"] for record in done.values()) / 60, 1),
            "seed": seed,
            "texels": len(source.parameters),
            "out_of_range": round(source.out_of_range, 4),
        },
    }
    save_model(output, ntm.tensors(), details, kind="ntm")
    print(
        f"{output}: {chosen}; held-out texels "
        + ", ".join(f"{k} {v:.1f} dB" for k, v in scores.items())
    )
    return output


def _ranges(initial: Tensor) -> dict[str, list[float]]:
    """The 1 % and 99 % quantiles of every parameter at age 0."""
    names = ("kd_r", "kd_g", "kd_b", "ks_r", "ks_g", "ks_b", "alpha")
    low, high = initial.quantile(0.01, 0), initial.quantile(0.99, 0)
    return {
        n: [round(float(a), 4), round(float(b), 4)]
        for n, a, b in zip(names, low, high, strict=True)
    }


def _parameter_loss(estimate: Tensor, truth: Tensor, model: Model) -> Tensor:
    """[B, T, 7]: squared difference in standard deviations, and of square roots (as the eye
    sees).
    """
    standard = (estimate - truth) / model.scale
    seen = estimate.clamp_min(1e-4).sqrt() - truth.clamp_min(1e-4).sqrt()
    return standard.square() + 30 * seen.square()


def _paper_loss(estimate: Tensor, truth: Tensor, model: LatentLSTM) -> Tensor:
    """[B, T, D]: the paper's loss (section 3.2), colours compared after the inverse of l."""
    colors = model.sizes[0]
    seen = [inverse_log_transform(z[..., :colors].clamp_min(0)) for z in (estimate, truth)]
    shared = estimate[..., colors:] - truth[..., colors:]
    return torch.cat((seen[0] - seen[1], shared), -1).square()


def _latent_loss(estimate: Tensor, truth: Tensor, model: Model) -> Tensor:
    """[B, T, D]: the squared difference in standard deviations."""
    return ((estimate - truth) / model.scale).square()


def _train(
    model: Model,
    states: Tensor,
    observed: Tensor,
    loss_of: Callable[[Tensor, Tensor, Any], Tensor],
    config: NTMConfig,
    *,
    checkpoint: Path,
    log: Path,
    resume: bool,
    minutes: float | None,
    seed: int,
) -> dict[str, Any]:
    """Train `model` to roll states[:, 0] out into `states` [N, T, D]; returns the run's record:
    steps, iterations and seconds.
    """
    from torch.utils.tensorboard import SummaryWriter

    g = torch.Generator().manual_seed(seed)
    optimizer = torch.optim.Adam(model.parameters(), lr=config.learning_rate, betas=(0.9, 0.99))
    frames = states.shape[1]

    def one_step() -> Tensor:
        rows = torch.randint(len(states), (min(config.batch, len(states)),), generator=g)
        mask = observed[rows, 1:, None]
        loss = loss_of(model.rollout(states[rows, 0], frames), states[rows], model)[:, 1:]
        value = (loss * mask).sum() / (mask.sum() * states.shape[2]).clamp_min(1)
        optimizer.zero_grad()
        value.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        return value

    run = {"seed": seed, "config": asdict(config), "states": hash_tensors({"": states})}
    record: dict[str, Any] = {
        "step": 0,
        "seconds": 0.0,
        "iterations": config.iterations,
        "run": run,
    }
    if resume and checkpoint.exists():
        record = load_checkpoint(checkpoint, model=model, optimizer=optimizer, generator=g, run=run)
    elif minutes is not None:
        one_step()
        start = time.monotonic()
        for _ in range(5):
            one_step()
        record["iterations"] = max(1, int(minutes * 60 * 5 / (time.monotonic() - start)))
        g.manual_seed(seed)
    writer, saved = SummaryWriter(log), time.monotonic()
    begun = saved - record["seconds"]
    total = record["iterations"]
    bar = tqdm(range(record["step"], total), initial=record["step"], total=total)
    for step in bar:
        rate = config.learning_rate * min(1.0, (step + 1) / config.warm_up)
        rate *= 0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * step / total))
        for group in optimizer.param_groups:
            group["lr"] = rate
        value = one_step()
        optimizer.step()
        if step % 50 == 0:
            bar.set_postfix_str(
                f"{checkpoint.stem.split('.')[1]} loss {value.item():.5f}", refresh=False
            )
            writer.add_scalar("loss", value.item(), step)
        if time.monotonic() - saved > 60 or step == total - 1:
            saved = time.monotonic()
            record |= {"step": step + 1, "seconds": saved - begun}
            save_checkpoint(
                checkpoint, model=model, optimizer=optimizer, generator=g, record=record
            )
    return record


def _score(
    rung: str, ntm: NeuralTemporalModel, test: SourceHistories, representation: Representation
) -> float:
    """Appearance PSNR in dB of held-out histories, anchored as ageing anchors them."""
    with torch.no_grad():
        rolled = roll_out(test.parameters[:, 0], ntm, rung, representation)
    initial = test.parameters[:, :1]
    anchored = rolled.states + ntm.affine.gain * (initial - rolled.states[:, :1])
    seen = test.observed.clone()
    seen[:, 0] = False
    return appearance_psnr(test.parameters[seen], anchored[seen])


def _choose(scores: Mapping[str, float], config: NTMConfig) -> str:
    """The first rung of the ladder that suffices."""
    enough = min(config.sufficient, max(scores.values()) - config.margin)
    return next(rung for rung in LADDER if scores[rung] >= enough)
