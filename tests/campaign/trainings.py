"""Trainings on damaged sequences, with damaged encoders, checkpoints and odd outputs."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

from .damage import damaged, damaged_json, odd_json
from .evidence import Evidence
from .images import picture
from .models import hostile_model
from .samples import MODELS, ModelFile
from .trial import Trial

__all__ = ("attempt_training", "train_undisturbed")

# Torch's optimizers make a folder for what they compile, which is nothing here.
_BESIDE = (
    r"model\..*checkpoint\.safetensors(/|$)",
    r"model\.tensorboard(/|$)",
    r"home/torchinductor_[^/]*$",
)
_MODEL = "model.safetensors"


def attempt_training(trial: Trial) -> list[Evidence]:
    """A training of a second on something that is not as it should be."""
    shutil.copytree(trial.samples.sequence, trial.folder / "sequence")
    output = trial.folder / _MODEL
    if trial.rng.random() < 0.5:
        shutil.copy(MODELS / "patina.safetensors", output)
    more = trial.rng.choice(_CHANGES)(trial, trial.folder / "sequence", output)
    return [_train(trial, *more)]


def train_undisturbed(trial: Trial) -> list[Evidence]:
    """What every other training is compared with."""
    shutil.copytree(trial.samples.sequence, trial.folder / "sequence")
    return [_train(trial, expected="done")]


def _train(trial: Trial, *more: str, **observed: Any) -> Evidence:
    options = {
        "--sequence": trial.folder / "sequence",
        "--encoder": MODELS / "encoder.safetensors",
        "--output": trial.folder / _MODEL,
        "--name": "x",
        "--minutes": "0.001",
    }
    words = [str(word) for option in options.items() for word in option]
    output = trial.folder / _MODEL
    evidence = trial.command(
        *("ntm", *words, *more), module="training", output=output, beside=_BESIDE, **observed
    )
    # Its progress and what libraries say go to stderr as well.
    answer = replace(evidence.answer, noise="", words=_sentences(evidence.answer.words))
    return replace(evidence, answer=answer)


def _sentences(lines: tuple[str, ...]) -> tuple[str, ...]:
    """What is no progress bar, which is written over and over on one line."""
    return tuple(line for line in lines if "it/s" not in line and "|" not in line)


def _frame(trial: Trial, folder: Path) -> Path:
    return trial.rng.choice(sorted(folder.glob("*.exr")))


def _damage_frame(trial: Trial, folder: Path, _output: Path) -> list[str]:
    path = _frame(trial, folder)
    path.write_bytes(damaged(path.read_bytes(), trial.rng))
    return []


def _replace_frame(trial: Trial, folder: Path, _output: Path) -> list[str]:
    path = _frame(trial, folder)
    path.write_bytes(picture(trial)[1])
    return []


def _rename_frame(trial: Trial, folder: Path, _output: Path) -> list[str]:
    odd = ("kd_999999999", "kd_0000", "kd_-001", "kd_1", "ks_0005", "alpha_", "Diffuse-0", "kd_²")
    path = _frame(trial, folder)
    new = folder / f"{trial.rng.choice(odd)}.exr"
    shutil.copy(path, new)
    if trial.rng.random() < 0.5:
        path.unlink()
    return []


def _make_no_file(trial: Trial, folder: Path, _output: Path) -> list[str]:
    path = _frame(trial, folder)
    path.unlink()
    trial.rng.choice((lambda: None, path.mkdir, path.touch, lambda: os.mkfifo(path)))()
    return []


def _describe(trial: Trial, folder: Path, _output: Path) -> list[str]:
    honest = {
        "times": [0.0, 0.4, 1.0],
        "timing": {"begin": 0.0, "end": 0.8, "never": 0.1, "at_once": False},
    }
    name = trial.rng.choice(("sequence.json", "sequence.json", "mixture.json"))
    value: Any = honest if name == "sequence.json" else {"materials": ["steel", "../../etc/x"]}
    path = folder / name
    if trial.rng.random() < 0.1:
        os.mkfifo(path)
    else:
        path.write_bytes(damaged_json(value, trial.rng))
    return []


def _add_onset(trial: Trial, folder: Path, _output: Path) -> list[str]:
    (folder / "onset.exr").write_bytes(picture(trial)[1])
    return []


def _damage_encoder(trial: Trial, _folder: Path, _output: Path) -> list[str]:
    path = trial.folder / "encoder.safetensors"
    path.write_bytes(hostile_model(trial.samples.encoder, trial))
    return ["--encoder", str(path)]


def _spoil_output(trial: Trial, _folder: Path, output: Path) -> list[str]:
    output.unlink(missing_ok=True)
    match trial.rng.randrange(4):
        case 0:
            output.mkdir()
            (output / "kept.txt").write_text("kept")
        case 1:
            output.symlink_to("absent/absent.safetensors")
        case 2:
            os.mkfifo(output)
        case 3:
            output.symlink_to(output)
    return []


def _odd_option(trial: Trial, _folder: Path, _output: Path) -> list[str]:
    odd = (
        "nan",
        "inf",
        "-1",
        "0",
        "1e-9",
        "",
        "x",
        "\x1b[2J",
        "ü",
        "x" * 5000,
        str(2**64),
        "\udcff",
    )
    name = trial.rng.choice(("--minutes", "--seed", "--name", "--title", "--process", "--x"))
    return [name, trial.rng.choice(odd)]


def _resume(trial: Trial, _folder: Path, output: Path) -> list[str]:
    """A training that goes on from a damaged checkpoint beside a good model."""
    for path in trial.samples.trained.glob("model.*"):
        if path.is_file():
            shutil.copy(path, output.parent / path.name)
    checkpoint = trial.rng.choice(sorted(output.parent.glob("*.checkpoint.safetensors")))
    match trial.rng.randrange(4):
        case 0:
            checkpoint.write_bytes(damaged(checkpoint.read_bytes(), trial.rng))
        case 1:
            checkpoint.write_bytes(_spoiled_record(checkpoint, trial))
        case 2:
            checkpoint.unlink()
            trial.rng.choice((checkpoint.mkdir, lambda: os.mkfifo(checkpoint), lambda: None))()
        case 3:
            checkpoint.write_bytes(_spoiled_tensor(checkpoint, trial))
    return ["--resume"]


def _spoiled_record(checkpoint: Path, trial: Trial) -> bytes:
    file = ModelFile.read(checkpoint, "record")
    record = json.dumps(odd_json(file.card, trial.rng))
    return file.content(card=record)


def _spoiled_tensor(checkpoint: Path, trial: Trial) -> bytes:
    file = ModelFile.read(checkpoint, "record")
    names = [name for name in file.header if name.startswith(("model.", "adam."))]
    start, end = file.header[trial.rng.choice(names)]["data_offsets"]
    value = trial.rng.choice((b"\0\0\xc0\x7f", b"\0\0\x80\x7f", b"\xff\xff\x7f\x7f"))
    at = trial.rng.randrange(start, end, 4)
    return replace(file, body=file.body[:at] + value + file.body[at + 4 :]).content()


_CHANGES = (
    *(_damage_frame, _replace_frame, _rename_frame, _make_no_file, _describe, _add_onset),
    *(_damage_encoder, _spoil_output, _odd_option, _resume, _resume),
)
