"""All commands of `python -m training` but `learn`, which has to do without their libraries."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

import tyro

from model_runtime.contract import AUTO, DEVICES, is_device
from model_runtime.errors import TvbrdfError, UsageError, reason, shown
from model_runtime.memory import check_limits, memory_in_words

from .evaluate_command import evaluate

__all__ = ("main",)

_MOST_MINUTES = 1e6
_LARGEST_BATCH = 1 << 20
_MOST_TEXELS = 1 << 24

app = tyro.extras.SubcommandApp()


@app.command
def encoder(
    output: Path,
    config: Literal[
        "fast", "paper", "paper-short", "brdfnps-short", "deepbrdf", "hyperbrdf"
    ] = "fast",
    resume: bool = False,
    minutes: float | None = None,
    batch: int | None = None,
    device: str = AUTO,
    seed: int = 0,
) -> None:
    """Train a BRDF encoder and decoder. Processes that torchrun starts divide the work.

    Args:
        output: the .safetensors file to write; checkpoints and logs go beside it.
        config: fast is the bundled encoder's recipe and paper the published one; the others are for
            an hour on our training data, to compare with.
        resume: go on from the checkpoint beside the output.
        minutes: train about so many minutes of one core (of the clock on the wall, on a GPU or with
            several processes) instead of the recipe's iterations.
        batch: materials a step, of all processes together, instead of the recipe's.
        device: auto, cpu, cuda or cuda:N.
        seed: of all random numbers.
    """
    from .distributed import joined
    from .encoder import train_encoder

    _check(minutes, seed, device=device, batch=batch)

    with joined(device) as world:
        train_encoder(
            config=config,
            output=output,
            resume=resume,
            minutes=minutes,
            batch=batch,
            seed=seed,
            world=world,
        )


@app.command
def estimator(
    encoder: Path,
    output: Path,
    resume: bool = False,
    minutes: float | None = None,
    seed: int = 0,
) -> None:
    """Train the network that tells parameters from latents where a fit would take too long.

    It takes some twelve minutes of a core.

    Args:
        encoder: the encoder of the latents.
        output: the .safetensors file to write; a checkpoint and logs go beside it.
        resume: go on from the checkpoint beside the output.
        minutes: train so many minutes of one core instead, after those for the fits it learns.
        seed: of all random numbers.
    """
    from .estimator import train_estimator

    _check(minutes, seed)

    train_estimator(encoder=encoder, output=output, resume=resume, minutes=minutes, seed=seed)


@app.command
def ntm(
    sequence: tuple[Path, ...],
    encoder: Path,
    output: Path,
    name: str,
    title: str = "",
    description: str = "",
    process: str = "",
    source: str = "",
    license: str = "",
    resume: bool = False,
    minutes: float | None = None,
    texels: int | None = None,
    batch: int | None = None,
    device: str = AUTO,
    seed: int = 0,
) -> None:
    """Train a neural temporal model on sequences. Processes that torchrun starts divide the work.

    Args:
        sequence: folders of frames or polynomial coefficients, of one process over the same time
            (where it starts, grain and relief are the first one's); or one of mixtures.
        encoder: the encoder whose latents it rolls forward.
        output: the .safetensors file to write; checkpoints and logs go beside it.
        name: short name, for `--ntm`.
        title: what menus show (default: the name).
        description: one sentence for the artist.
        process: rust, patina, char, ...: chooses the onset pattern (default: the name).
        source: where the sequence comes from.
        license: of the weights.
        resume: go on from the checkpoints beside the output.
        minutes: train about this long.
        texels: how many it learns from, of all sequences together (default: 8,192).
        batch: texels a step, of all processes together.
        device: auto, cpu, cuda or cuda:N.
        seed: of all random numbers.
    """
    from .distributed import joined
    from .ntm import NTMConfig, train_ntm

    _check(minutes, seed, device=device, batch=batch)
    if not sequence:
        raise UsageError("There is no sequence to learn from.", "Name one after --sequence.")
    if texels is not None and not 1 < texels <= _MOST_TEXELS:
        raise UsageError(f"{texels:,} texels make no sense.", "Leave out --texels.")

    card = {
        "name": name,
        "title": title or name.capitalize(),
        "description": description,
        "process": process or name,
        "source": source,
        "license": license,
    }
    sizes = {"texels": texels, "batch": batch}
    config = NTMConfig(**{name: size for name, size in sizes.items() if size is not None})
    with joined(device) as world:
        train_ntm(
            sequences=sequence,
            encoder=encoder,
            output=output,
            card=card,
            resume=resume,
            minutes=minutes,
            seed=seed,
            config=config,
            world=world,
        )


@app.command
def grain(sequence: Path, model: Path, output: Path, seed: int = 0) -> None:
    """Give a model the grain and relief of a sequence; its networks stay.

    Args:
        sequence: folder of frames, with residues of weathered texels, or a picture.
        model: the .safetensors file of the model.
        output: the .safetensors file to write; it may be the same.
        seed: of all random numbers.
    """
    from .grain import give_grain

    _check(None, seed)
    give_grain(sequence=sequence, model=model, output=output, seed=seed)


@app.command
def scan(
    input: Path,
    output: Path,
    mask: Path | None = None,
    process: str = "",
    report: Path | None = None,
    seed: int = 0,
) -> None:
    """Make a sequence of a material that is weathered in places and clean in others.

    Args:
        input: a folder of texture maps, or an image.
        output: the folder of the sequence to write.
        mask: an image that is white where it is weathered.
        process: rust, moss, ...: which other materials take the same way, and how it spreads.
        report: a folder for charts of what was found.
        seed: of all random numbers.
    """
    from .data.writing import write_sequence
    from .source.change import sequence_of
    from .source.scan import change_of, read_states

    _check(None, seed)

    found = read_states(input, mask=mask, process=process)
    change = change_of(found, seed=seed)
    made = {"scan": change.name, "process": process, "seed": seed, "told": list(change.told)}
    write_sequence(sequence_of(change, process=process, seed=seed), output, made)
    if report is not None:
        from .source.charts import write_charts

        write_charts(found, change, report)
    print("\n".join(change.told))


@app.command
def weathering(
    process: tyro.conf.Positional[
        Literal["rust", "patina", "char", "drying", "fading", "soiling", "yellowing", "moss"]
    ],
    output: Path,
    size: int = 96,
    frames: int = 36,
    seed: int = 0,
) -> None:
    """Write a procedural weathering sequence, to train an NTM on.

    Args:
        process: what happens.
        output: the folder to write.
        size: texels a side.
        frames: number of frames.
        seed: of all random numbers.
    """
    from .data import weathering as sequences

    _check(None, seed)

    sequences.write(process, output, size=size, frames=frames, seed=seed)


@app.command
def ode(
    film: Path,
    output: Path,
    rows: Literal["upper", "lower", "all"] = "all",
    resume: bool = False,
    minutes: float = 60,
    seed: int = 0,
    credit: str = "",
) -> None:
    """Train the rival that learns a film's textures and starts from noise, to compare with.

    Args:
        film: an animated image, or a folder of numbered pictures.
        output: the .safetensors file to write; checkpoints and logs go beside it.
        rows: which half of the pictures it sees.
        resume: go on from the checkpoint beside the output.
        minutes: train about so many minutes of one core.
        seed: of all random numbers.
        credit: whose film it is.
    """
    from .baselines.ode import train_film
    from .loop import Run

    _check(minutes, seed)

    told = f"--rows {rows} --minutes {minutes:g} --seed {seed}"
    run = Run(output, output.with_suffix(".log"), resume, minutes, seed)
    train_film(film, rows, run, f"python -m training ode --film {film.name} {told}", credit)


@app.command
def layering(
    output: Path, resume: bool = False, minutes: float | None = None, seed: int = 0
) -> None:
    """Train the network of layered latents, to compare with what is known of films.

    It takes some five minutes of a core, the first two for the stacks that it learns from.

    Args:
        output: the .safetensors file to write; checkpoints and logs go beside it.
        resume: go on from the checkpoint beside the output.
        minutes: train so many minutes of one core instead, after those for the stacks.
        seed: of all random numbers.
    """
    from .baselines.layering import train_layering
    from .loop import Run

    _check(minutes, seed)

    told = f"--seed {seed}" + (f" --minutes {minutes:g}" if minutes is not None else "")
    run = Run(output, output.with_suffix(".log"), resume, minutes, seed)
    train_layering(run, f"python -m training layering {told}")


app.command(evaluate)


def _check(
    minutes: float | None, seed: int, *, device: str = AUTO, batch: int | None = None
) -> None:
    if minutes is not None and not 0 < minutes <= _MOST_MINUTES:
        raise UsageError(f"A training of {minutes:g} minutes makes no sense.", "Give a few.")
    if not is_device(device):
        raise UsageError(f"There is no device {shown(device)}.", f"Choose one of {DEVICES}.")
    if batch is not None and not 1 < batch <= _LARGEST_BATCH:
        raise UsageError(f"A batch of {batch:,} makes no sense.", "Leave out --batch.")
    if not 0 <= seed < 1 << 63:
        raise UsageError("The seed is out of range.", "Give a whole number from 0.")


def main() -> int:
    """Run the command line; 0 when done, 1 when it failed with a reason, 2 for wrong usage, 130
    when it was interrupted.
    """
    try:
        with memory_in_words("Take fewer or smaller frames, or close other programs."):
            check_limits()
            app.cli(prog="python -m training")
    except TvbrdfError as error:
        print(error, file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1
    except OSError as error:
        print(f"{shown(error.filename or 'A file')}: {reason(error)}.", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(
            "\nInterrupted. A training goes on from its checkpoint with --resume.", file=sys.stderr
        )
        return 130
    return 0
