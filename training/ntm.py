"""Training of neural temporal models: `python -m training ntm`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import torch
from torch import Tensor

from model_runtime.atomic import check_writable
from model_runtime.channels import NAMES
from model_runtime.contract import LADDER
from model_runtime.errors import InputError, UsageError, reason, shown
from model_runtime.model_files.card import ModelCard, check_card
from model_runtime.model_files.weights import hash_tensors, read_card, save_model
from model_runtime.representation import load_representation
from model_runtime.representation.latents import Representation, inverse_log_transform
from model_runtime.representation.paper import PaperRepresentation
from model_runtime.states import perceptual
from model_runtime.temporal.domain import Domain
from model_runtime.temporal.models import Affine, LatentLSTM, ParameterLSTM
from model_runtime.temporal.ntm import NeuralTemporalModel

from .data.folder import Sample
from .data.sequences import MixtureSequence, Sequence, read_sequence
from .distributed import ALONE, World
from .grain import grained
from .ladder import Split, choose, held_out_ranges, held_out_texels, score, suffices, widest_channel
from .loop import Run, Schedule, Training, remove_checkpoints, train
from .source.histories import MOST_TEXELS, SourceHistories, source_histories
from .source.onsets import timed
from .source.steadiness import steadied

__all__ = (
    "PARTS",
    "NTMConfig",
    "check_texts",
    "train_ladder",
    "train_lstm",
    "train_ntm",
    "write_ntm",
)

Model = ParameterLSTM | LatentLSTM
Kind = Literal["parameters", "latents"]

PARTS = tuple(f"{fold}{kind}" for fold in ("", "above.", "below.") for kind in get_args(Kind))
"""What is trained of a model, each with a checkpoint: two LSTMs, and those that only cross-validate
what is above and below a range.
"""

_DOUBTFUL = 25.0


@dataclass(frozen=True)
class NTMConfig:
    """Both LSTMs are trained alike, on so many `texels` of all sequences together, and those that
    only cross-validate ranges for `fold_share` of the iterations; `sufficient` and `margin` (dB)
    decide which rung is used.
    """

    iterations: int = 2500
    batch: int = 256
    learning_rate: float = 3e-3
    warm_up: int = 100
    sufficient: float = 45.0
    margin: float = 1.0
    fold_share: float = 0.25
    texels: int = MOST_TEXELS


def train_ntm(
    *,
    sequences: tuple[Path, ...],
    encoder: Path,
    output: Path,
    card: Mapping[str, str],
    resume: bool = False,
    minutes: float | None = None,
    seed: int = 0,
    config: NTMConfig = NTMConfig(),
    world: World = ALONE,
) -> Path:
    """Train every rung of the ladder on `sequences` of one process and write the NTM to `output`;
    returns that path. `card` holds name, title, description, process, source, license.

    When texels start, grain and relief are the first sequence's. Of the others histories are
    learned: they are read one after the other, a frame at a time, and a sample of texels is kept.

    The file takes the place of an earlier one only when it can be loaded again.
    """
    check_writable(output)
    check_texts(card)
    command = (
        f"python -m training ntm --sequence {' '.join(map(shown, sequences))} "
        f"--encoder {shown(encoder.name)} --output {shown(output.name)} --name {card['name']} "
        f"--seed {seed}"
        + (f" --minutes {minutes:g}" if minutes is not None else "")
        + "".join(
            f" --{name} {getattr(config, name)}"
            for name in ("texels", "batch")
            if getattr(config, name) != getattr(NTMConfig, name)
        )
    )
    run = Run(output, output.with_suffix(".tensorboard"), resume, minutes, seed, world=world)
    first = timed(steadied(read_sequence(sequences[0], clamp=False)), seed=seed)
    found = write_ntm(first, encoder, {**card}, command, config, run, sequences[1:])
    if not world.leads:
        return output
    print(f"{output}: {found['temporal_model']}; dB of what was held out:")
    for rung, scores in found["ladder"].items():
        print(f"  {rung}: " + ", ".join(f"{name} {psnr:.1f}" for name, psnr in scores.items()))
    for warning in found["warnings"]:
        print(f"Warning: {warning}")
    return output


def check_texts(card: Mapping[str, str]) -> None:
    """Raises UsageError where a model's `card` cannot have these texts."""
    try:
        check_card("ntm", {**card, "temporal_model": LADDER[0]})
    except ValueError as error:
        raise UsageError(f"Of the model {reason(error)}.", "Give plain texts.") from error


def write_ntm(
    sequence: Sequence | MixtureSequence,
    encoder: Path,
    card: Mapping[str, Any],
    command: str,
    config: NTMConfig,
    run: Run,
    others: tuple[Path, ...] = (),
) -> dict[str, Any]:
    """Train every rung of the ladder on `sequence`, whose timing is known, and on those in the
    folders `others`, and write the NTM, with the first one's grain and height, where `run` says;
    the card that it has.

    `card` is what is known of it before: name, title, description, process, source, license.
    """
    representation, identity = load_representation(encoder)
    source = _histories(sequence, others, representation, config.texels, run.seed)
    ntm = train_ladder(source, representation, config, run)
    ntm, told = grained(ntm, sequence, seed=run.seed)
    found = {**ntm.card.details, **told}
    details: dict[str, Any] = {
        **card,
        "source": ". ".join(
            filter(
                None,
                (card.get("source", "").rstrip("."), f"Encoder: {read_card(encoder).source}"),
            )
        ),
        "frames": ntm.frames,
        "representation": identity,
        **found,
        "trained": {"command": command, **found["trained"]},
    }
    if run.world.leads:
        save_model(
            run.base,
            ntm.tensors(),
            details,
            kind="ntm",
            check=lambda file: NeuralTemporalModel.load(file, identity),
        )
        remove_checkpoints(run, PARTS)
    return details


def _histories(
    sequence: Sequence | MixtureSequence,
    others: tuple[Path, ...],
    representation: Representation,
    texels: int,
    seed: int,
) -> SourceHistories:
    """Histories of `texels` of all sequences together, of each as many."""
    each = max(1, texels // (1 + len(others)))
    found = source_histories(sequence, representation, texels=each, seed=seed)
    ages = len(sequence.times)
    parts = []
    for folder in others:
        sampled = read_sequence(folder, sample=Sample(max(each, MOST_TEXELS), seed), clamp=False)
        if isinstance(sequence, MixtureSequence) or isinstance(sampled, MixtureSequence):
            raise InputError(
                "A mixture of measured materials is learned from alone.", "Name one sequence."
            )
        other = timed(steadied(sampled), seed=seed)
        parts.append(source_histories(other, representation, texels=each, ages=ages, seed=seed))
    return found.and_those(parts) if parts else found


def train_ladder(
    source: SourceHistories, representation: Representation, config: NTMConfig, run: Run
) -> NeuralTemporalModel:
    """Every rung of the ladder, trained on `source`, under a card that holds what training found:
    domain, timing, temporal_model, ladder, warnings, trained.

    A tenth of the texels is held out from all rungs. Ranges are held out in trainings of their own,
    whose models are thrown away; the LSTMs' are short, and left out where a cheaper rung suffices.
    `ladder` holds the scores in dB by rung and by what was held out: texels, above, below.
    """
    split = held_out_texels(source, run.seed)
    channel = widest_channel(source)
    ranges = held_out_ranges(source, channel)
    share = 2 + 2 * len(ranges) * config.fold_share
    minutes = None if run.minutes is None else run.minutes / share
    models, records = _train_both(
        split.train, representation, (config, config), replace(run, minutes=minutes)
    )
    affine = Affine.fit(split.train.parameters, split.train.observed)
    domain = Domain.of(split.train.parameters[:, 0], seed=run.seed)
    card = ModelCard(run.base, "ntm", 1, "", "", frames=source.parameters.shape[1])
    ntm = NeuralTemporalModel(card, affine, *models, domain)
    scores = {rung: {"texels": score(rung, ntm, split.test, representation)} for rung in LADDER}
    spent = _cross_validate(scores, ntm, ranges, representation, config, records, run)
    chosen = choose(scores, sufficient=config.sufficient, margin=config.margin)
    details = {
        "domain": {"ranges": _ranges(split.train.parameters[:, 0])},
        "timing": None if source.timing is None else source.timing.json(),
        "temporal_model": chosen,
        "ladder": {
            rung: {name: round(psnr, 1) for name, psnr in found.items()}
            for rung, found in scores.items()
        },
        "warnings": [*source.warnings, *_doubts(min(scores[chosen].values()))],
        "trained": {
            "iterations": {
                kind: record["iterations"]
                for kind, record in zip(get_args(Kind), records, strict=True)
            },
            "minutes": round((sum(record["seconds"] for record in records) + spent) / 60, 2),
            "seed": run.seed,
            "texels": len(source.parameters),
            "ranges_of": NAMES[channel],
            "out_of_range": round(source.out_of_range, 4),
        },
    }
    return replace(ntm, card=replace(card, details=details))


def _cross_validate(
    scores: Mapping[str, dict[str, float]],
    ntm: NeuralTemporalModel,
    ranges: Mapping[str, Split],
    representation: Representation,
    config: NTMConfig,
    records: tuple[Mapping[str, Any], ...],
    run: Run,
) -> float:
    """Add the scores of what is held out in `ranges` to `scores`; returns the seconds of a core
    that it took to train on the rest. `records` are those of the trainings on all.
    """
    cheap, dear = LADDER[:2], LADDER[2:]
    folds = {
        name: replace(ntm, affine=Affine.fit(part.train.parameters, part.train.observed))
        for name, part in ranges.items()
    }
    for name, part in ranges.items():
        for rung in cheap:
            scores[rung][name] = score(rung, folds[name], part.test, representation)
    if run.world.agreed(any(suffices(scores[rung], config.sufficient) for rung in cheap)):
        return 0.0
    short = tuple(
        replace(
            config,
            iterations=max(1, round(record["iterations"] * config.fold_share)),
            warm_up=max(1, round(config.warm_up * config.fold_share)),
        )
        for record in records
    )
    seconds = 0.0
    for name, part in ranges.items():
        fold = replace(run, minutes=None).part(name)
        models, spent = _train_both(part.train, representation, short, fold)
        trained = replace(folds[name], parameters=models[0], latents=models[1])
        for rung in dear:
            scores[rung][name] = score(rung, trained, part.test, representation)
        seconds += sum(record["seconds"] for record in spent)
    return seconds


def _doubts(psnr: float) -> list[str]:
    """What to say of a model that missed what was held out by `psnr` dB."""
    if psnr >= _DOUBTFUL:
        return []
    return [f"Of what was held out from it, it reaches no more than {psnr:.0f} dB."]


def _train_both(
    source: SourceHistories,
    representation: Representation,
    configs: tuple[NTMConfig, ...],
    run: Run,
) -> tuple[tuple[ParameterLSTM, LatentLSTM], tuple[dict[str, Any], dict[str, Any]]]:
    """The LSTMs on parameters and on latents, trained by one of `configs` each; their records."""
    parameters, first = train_lstm("parameters", source, representation, configs[0], run)
    latents, second = train_lstm("latents", source, representation, configs[1], run)
    assert isinstance(parameters, ParameterLSTM)
    assert isinstance(latents, LatentLSTM)
    return (parameters, latents), (first, second)


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
        model.standardize(states)
    else:
        model, states = LatentLSTM(*representation.latent_sizes), source.latents
        faithful = isinstance(representation, PaperRepresentation)
        loss_of = _paper_loss if faithful else _latent_loss
        if not faithful:
            model.standardize(states)
    model.to(run.world.device)
    record = _train(model, states, source.observed, loss_of, config, run.part(kind))
    return model.cpu(), record


def _ranges(initial: Tensor) -> dict[str, list[float]]:
    """The 1 % and 99 % quantiles of every parameter at age 0."""
    low, high = initial.quantile(0.01, 0), initial.quantile(0.99, 0)
    return {
        n: [round(float(a), 4), round(float(b), 4)]
        for n, a, b in zip(NAMES, low, high, strict=True)
    }


def _parameter_loss(estimate: Tensor, truth: Tensor, model: Model) -> Tensor:
    """[B, T, C]: squared difference in standard deviations, and of square roots (as the eye
    sees).
    """
    standard = (estimate - truth) / model.scale
    # not from 0, where square roots are steep
    seen = [perceptual(each, least=1e-4, most=math.inf) for each in (estimate, truth)]
    return standard.square() + 30 * (seen[0] - seen[1]).square()


def _paper_loss(estimate: Tensor, truth: Tensor, model: LatentLSTM) -> Tensor:
    """[B, T, D]: the paper's loss (section 3.2), colors compared after the inverse of l."""
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
    run: Run,
) -> dict[str, Any]:
    """Train `model` to roll states[:, 0] out into `states` [N, T, D]; the record of `train`."""
    g = torch.Generator().manual_seed(run.seed)
    frames = states.shape[1]
    mine = run.world.share(min(config.batch, len(states)))

    def loss(_: int) -> Tensor:
        rows = torch.randint(len(states), (mine.whole,), generator=g)
        mask = observed[rows, 1:, None]
        truth = mine(states[rows])
        missed = loss_of(model.rollout(truth[:, 0], frames), truth, model)[:, 1:]
        counted = (mask.sum() * states.shape[2]).clamp_min(1)
        return mine.step * (missed * mine(mask)).sum() / counted

    settings = asdict(config)
    del settings["fold_share"], settings["texels"]  # say nothing of this LSTM
    made_from = {"config": settings, "states": hash_tensors({"": states})}
    schedule = Schedule(config.learning_rate, config.warm_up)
    return train(Training(model, loss, schedule, config.iterations, g, made_from), run)
