"""Model files with hostile cards, headers and tensors: used, and listed beside an honest one."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np

from .damage import ODD_TEXTS, damaged, damaged_json, odd_json
from .evidence import Evidence
from .reports import ask_reader
from .samples import MODELS, ModelFile
from .trial import Trial

__all__ = ("attempt_model", "hostile_model")

_ABSURD = (float("nan"), float("inf"), 3e38, -3e38, 1e30, 1e6, 1e-40, 0.0, -1.0)
_TEXTS = ("name", "title", "description", "process", "source", "license", "representation")


def attempt_model(trial: Trial) -> list[Evidence]:
    """A hostile model file: aged with, asked about, or in a folder whose models are listed."""
    rng = trial.rng
    trial.textures()
    folder = trial.folder / "models"
    folder.mkdir()
    path = folder / rng.choice(("m", "m", "m", "ü", "a b", "x" * 200, "\x1b[2Jm", "-m", "m\nn"))
    path = path.with_name(f"{path.name}.safetensors")
    path.write_bytes(hostile_model(trial.samples.model, trial))
    match rng.randrange(4):
        case 0:
            shutil.copy(MODELS / "patina.safetensors", folder / "honest.safetensors")
            evidence, said = ask_reader(trial, "models", folder)
            lost = evidence.answer.ended == "done" and "patina" not in said
            return [replace(evidence, complaints=("the honest model is not listed",) * lost)]
        case 1:
            limit = trial.lane.limit("worker")
            ask = trial.lane.worker.ask
            about = {"ntm": str(path)}
            return [trial.observe(lambda: ask("info", about, seconds=limit), writes=False)]
        case _:
            rung = rng.choice(("auto", "affine", "lstm_parameters", "lstm_latents", "constant"))
            return [trial.age(trial.request(ntm=str(path), temporal_model=rung))]


def hostile_model(honest: ModelFile, trial: Trial) -> bytes:
    """`honest` with something wrong in its bytes, header, card or tensors."""
    rng = trial.rng
    match rng.randrange(8):
        case 0:
            return damaged(honest.content(), rng)
        case 1:
            return honest.content(header=damaged_json(honest.header, rng))
        case 2 | 3:
            text = damaged_json(honest.card, rng).decode(errors="surrogateescape")
            return honest.content(card=text)
        case 4:
            card = dict(honest.card)
            for name in rng.sample(_TEXTS, 2):
                card[name] = rng.choice(ODD_TEXTS)
            return replace(honest, card=card).content()
        case 5:
            name = rng.choice(
                ("frames", "domain", "timing", "temporal_model", "trained", "warnings")
            )
            odd = odd_json([honest.card.get(name)], rng)
            value = odd[0] if isinstance(odd, list) and odd else odd
            return replace(honest, card=honest.card | {name: value}).content()
        case 6:
            return (
                (MODELS / rng.choice(("encoder", "encoder.estimator")))
                .with_suffix(".safetensors")
                .read_bytes()
            )
        case _:
            return replace(honest, body=_absurd_tensors(honest, trial)).content()


def _absurd_tensors(honest: ModelFile, trial: Trial) -> bytes:
    rng = trial.rng
    body = bytearray(honest.body)
    names = [name for name in honest.header if name != "__metadata__"]
    for name in rng.sample(names, rng.choice((1, 1, 3, len(names)))):
        start, end = honest.header[name]["data_offsets"]
        values = np.frombuffer(bytes(body[start:end]), "<f4").copy()
        if not len(values):
            continue
        value = rng.choice(_ABSURD)
        match rng.randrange(3):
            case 0:
                values[rng.randrange(len(values))] = value
            case 1:
                values[:] = value
            case 2:
                with np.errstate(all="ignore"):
                    values *= np.float32(value)
        body[start:end] = values.tobytes()
    return bytes(body)
