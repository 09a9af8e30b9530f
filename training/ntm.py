"""Training of neural temporal models: `python -m training ntm`."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor, nn
from tqdm import tqdm

from model_runtime.histories import roll_out
from model_runtime.package import ModelCard, hash_tensors, read_card, save_model
from model_runtime.plan import appearance_psnr
from model_runtime.representation import load_representation
from model_runtime.representation.latents import Representation, inverse_log_transform
from model_runtime.representation.paper import PaperRepresentation
from model_runtime.temporal.domain import Domain
from model_runtime.temporal.models import Affine, LatentLSTM, ParameterLSTM
from model_runtime.temporal.ntm import LADDER, NeuralTemporalModel

from .checkpoint import load_checkpoint, save_checkpoint
from .data.sequences import read_sequence
from .histories import SourceHistories, source_histories
from .timing import timed

__all__ = ("NTMConfig", "Run", "train_ladder", "train_lstm", "train_ntm")

Model = ParameterLSTM | LatentLSTM
Kind = Literal["parameters", "latents"]

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


@dataclass(frozen=True)
class Run:
    """Where a training leaves its checkpoints (`base` with the LSTM's name added) and, unless
    None, its TensorBoard logs; how long it may take; from which seed.
    """

    base: Path
    log: Path | None = None
    resume: bool = False
    minutes: float | None = None
    seed: int = 0


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
    path. `card` holds name, title, description, process, source, license.
    """
    representation, identity = load_representation(encoder)
    shown = timed(read_sequence(sequence, clamp=False), seed=seed)
    source = source_histories(shown, representation, seed=seed)
    run = Run(output, output.with_suffix(".tensorboard"), resume, minutes, seed)
    ntm = train_ladder(source, representation, config, run)
    found = ntm.card.details
    details: dict[str, Any] = {
        **card,
        "source": f"{card['source']}. Encoder: {read_card(encoder).source}",
        "frames": ntm.frames,
        "representation": identity,
        **found,
        "trained": {
            "command": f"python -m training ntm --sequence {sequence} --encoder {encoder.name} "
            f"--output {output.name} --name {card['name']} --seed {seed}"
            + (f" --minutes {minutes:g}" if minutes is not None else ""),
            **found["trained"],
        },
    }
    save_model(output, ntm.tensors(), details, kind="ntm")
    print(
        f"{output}: {ntm.chosen}; held-out texels "
        + ", ".join(f"{k} {v:.1f} dB" for k, v in found["ladder"].items())
    )
    return output


def train_ladder(
    source: SourceHistories, representation: Representation, config: NTMConfig, run: Run
) -> NeuralTemporalModel:
    """Every rung of the ladder, trained on `source`, under a card that holds what training found:
    domain, timing, temporal_model, ladder, trained.

    A tenth of the texels is held out; on them each rung is scored (mean appearance PSNR over the
    ages), and the cheapest one that reaches `config.sufficient` or is within `config.margin` of the
    best is what `auto` will use.
    """
    g = torch.Generator().manual_seed(run.seed)
    order = torch.randperm(len(source.parameters), generator=g)
    held = max(1, int(len(order) * _HELD_OUT))
    train, test = source.select(order[held:]), source.select(order[:held][:_VALIDATION_TEXELS])

    each = replace(run, minutes=None if run.minutes is None else run.minutes / 2)
    parameters, first = train_lstm("parameters", train, representation, config, each)
    latents, second = train_lstm("latents", train, representation, config, each)
    assert isinstance(parameters, ParameterLSTM)
    assert isinstance(latents, LatentLSTM)
    affine = Affine.fit(train.parameters, train.observed)
    domain = Domain.of(train.parameters[:, 0], seed=run.seed)
    card = ModelCard(run.base, "ntm", 1, "", "", frames=source.parameters.shape[1])
    ntm = NeuralTemporalModel(card, affine, parameters, latents, domain)
    scores = {rung: _score(rung, ntm, test, representation) for rung in LADDER}
    details = {
        "domain": {"radius": domain.radius, "ranges": _ranges(train.parameters[:, 0])},
        "timing": None if source.timing is None else source.timing.json(),
        "temporal_model": _choose(scores, config),
        "ladder": {rung: round(score, 1) for rung, score in scores.items()},
        "trained": {
            "iterations": {"parameters": first["iterations"], "latents": second["iterations"]},
            "minutes": round((first["seconds"] + second["seconds"]) / 60, 1),
            "seed": run.seed,
            "texels": len(source.parameters),
            "out_of_range": round(source.out_of_range, 4),
        },
    }
    return replace(ntm, card=replace(card, details=details))


def train_lstm(
    kind: Kind,
    source: SourceHistories,
    representation: Representation,
    config: NTMConfig,
    run: Run,
) -> tuple[Model, dict[str, Any]]:
    """One LSTM that rolls parameters or latents out, and the record of its training: steps,
    iterations, seconds. On the latents of the paper's encoders it is trained as in the paper.
    """
    torch.manual_seed(run.seed)
    model: Model
    if kind == "parameters":
        model, states, loss_of = ParameterLSTM(), source.parameters, _parameter_loss
        model.standardise(states)
    else:
        model, states = LatentLSTM(*representation.latent_sizes), source.latents
        faithful = isinstance(representation, PaperRepresentation)
        loss_of = _paper_loss if faithful else _latent_loss
        if not faithful:
            model.standardise(states)
    record = _train(
        model,
        states,
        source.observed,
        loss_of,
        config,
        checkpoint=run.base.with_suffix(f".{kind}.checkpoint.safetensors"),
        log=None if run.log is None else run.log / kind,
        resume=run.resume,
        minutes=run.minutes,
        seed=run.seed,
    )
    return model, record


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
    log: Path | None,
    resume: bool,
    minutes: float | None,
    seed: int,
) -> dict[str, Any]:
    """Train `model` to roll states[:, 0] out into `states` [N, T, D]; returns the run's record:
    steps, iterations and seconds.
    """
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
    record: dict[str, Any] = {"step": 0, "seconds": 0.0, "run": run}
    record["iterations"] = config.iterations
    if resume and checkpoint.exists():
        record = load_checkpoint(checkpoint, model=model, optimizer=optimizer, generator=g, run=run)
    elif minutes is not None:
        one_step()
        start = time.monotonic()
        for _ in range(5):
            one_step()
        record["iterations"] = max(1, int(minutes * 60 * 5 / (time.monotonic() - start)))
        g.manual_seed(seed)
    writer, saved = None, time.monotonic()
    if log is not None:  # TensorBoard takes seconds to import
        from torch.utils.tensorboard import SummaryWriter

        writer = SummaryWriter(log)
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
            if writer is not None:
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
