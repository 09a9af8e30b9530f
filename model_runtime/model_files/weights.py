"""Model files: safetensors whose header holds a JSON card.

Reading a card needs nothing but the standard library, so the add-on lists models without a library;
only `load_model` and `save_model` import any, when called.
"""

from __future__ import annotations

import hashlib
import json
import stat
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..atomic import replaced
from ..errors import ModelFileError, reason, shown
from ..memory import ran_out_of_memory
from .card import ModelCard, check_card, strict_json

if TYPE_CHECKING:
    from ..backend import Tensor

__all__ = (
    "ENCODER",
    "ESTIMATOR",
    "FORMAT_VERSION",
    "MODELS",
    "ModelCard",
    "find_model",
    "hash_tensors",
    "list_models",
    "load_model",
    "read_card",
    "save_model",
)

FORMAT_VERSION = 2
"""The newest that is known: 1 has neither grain nor height, and is what older programs read."""

MODELS = Path(__file__).parents[1] / "models"
ENCODER = MODELS / "encoder.safetensors"
ESTIMATOR = MODELS / "encoder.estimator.safetensors"

_FORMATS = {
    "encoder": "tvbrdf-encoder",
    "estimator": "tvbrdf-estimator",
    "ntm": "tvbrdf-ntm",
}
_MAX_HEADER = 1 << 20
_MAX_FILE = 1 << 28
_GRAIN, _BYTES = "grain.", "grain.tile"
_HEIGHT = "height"
_LARGEST_WEIGHT = 1e4
"""Beyond any that training makes: those of the bundled models stay below 6."""

_NO_CARD = (KeyError, TypeError, ValueError, IndexError, OverflowError, RecursionError)


def _header(path: Path) -> tuple[dict[str, Any], int]:
    """The safetensors header and the offset at which the tensors begin."""
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise ValueError("it is not a file")
        size = status.st_size
        with path.open("rb") as file:
            length = struct.unpack("<Q", file.read(8))[0]
            if size > _MAX_FILE or not 0 < length <= min(_MAX_HEADER, size - 8):
                raise ValueError("its header does not fit")
            header = strict_json(file.read(length))
            if not isinstance(header, dict):
                raise ValueError("its header is not an object")
            return header, 8 + length
    except FileNotFoundError as error:
        raise ModelFileError(
            f"There is no model file {shown(path)}.", "Check the path, or choose a bundled model."
        ) from error
    except (OSError, ValueError, RecursionError, struct.error) as error:
        raise ModelFileError(
            f"{shown(path.name)} is not a model file ({reason(error)}).",
            "Copy or download it again.",
        ) from error


def read_card(path: Path) -> ModelCard:
    """The card of the model file at `path`.

    Raises ModelFileError for a file that is missing, truncated, damaged, without a card, with one
    that cannot be shown or lacks what is needed, or of a newer version than this program knows.
    """
    header, start = _header(path)
    file = shown(path.name)
    try:
        card = strict_json(header.pop("__metadata__", {})["card"])
        kind = {value: key for key, value in _FORMATS.items()}[card["format"]]
        version = int(card["version"])
        end = max(int(entry["data_offsets"][1]) for entry in header.values())
        size = path.stat().st_size
    except (*_NO_CARD, OSError) as error:
        raise ModelFileError(
            f"{file} carries no card of a tvbrdf model.",
            "Choose a file made by `python -m training`.",
        ) from error
    if version > FORMAT_VERSION:
        raise ModelFileError(
            f"{file} has format version {shown(version)}; this program knows {FORMAT_VERSION}.",
            "Update the extension.",
        )
    if size != start + end:
        raise ModelFileError(f"{file} is truncated or damaged.", "Copy or download it again.")
    try:
        fields = check_card(kind, card)
    except (ValueError, RecursionError) as error:
        raise ModelFileError(
            f"The card of {file} cannot be used: {reason(error)}.",
            "Train the model again, or remove the file.",
        ) from error
    return ModelCard(path=path, kind=kind, version=version, **fields)


def list_models(
    folders: Sequence[Path] = (MODELS,),
    *,
    skipped: Callable[[ModelFileError], None] = lambda error: None,
) -> list[ModelCard]:
    """The cards of all NTMs in `folders`, by title. Of one name that of the last folder is listed,
    so that a user's model goes before a bundled one. `skipped` hears of each file and folder that
    cannot be read, and of a second file of one name in a folder.
    """
    found: dict[str, ModelCard] = {}
    for folder in dict.fromkeys(folders):
        for card in _models_in(folder, skipped):
            earlier = found.get(card.name)
            if earlier is None:
                found[card.name] = card
            elif earlier.path.parent != folder:
                found[card.name] = replace(card, namesake=earlier.path)
            else:
                skipped(
                    ModelFileError(
                        f"{shown(card.path.name)} calls itself {shown(card.name)}, as "
                        f"{shown(earlier.path.name)} does.",
                        "Rename one of the models.",
                    )
                )
    return sorted(found.values(), key=lambda card: card.title)


def _models_in(folder: Path, skipped: Callable[[ModelFileError], None]) -> Iterator[ModelCard]:
    try:
        files = [path for path in folder.iterdir() if path.suffix == ".safetensors"]
    except FileNotFoundError:
        return
    except (OSError, ValueError) as error:  # ValueError: no path at all
        skipped(
            ModelFileError(
                f"The folder {shown(folder)} cannot be read ({reason(error)}).",
                "Choose another folder for models.",
            )
        )
        return
    for path in sorted(files):
        try:
            card = read_card(path)
        except ModelFileError as error:
            skipped(error)
        else:
            if card.kind == "ntm":
                yield card


def find_model(name_or_file: str, folders: Sequence[Path] = (MODELS,)) -> Path:
    """The file of the NTM called `name_or_file`, or that path itself where it names a file."""
    if name_or_file.endswith(".safetensors"):
        return Path(name_or_file)
    cards = list_models(folders)
    for card in cards:
        if card.name == name_or_file:
            return card.path
    known = ", ".join(card.name for card in cards) or "none"
    raise ModelFileError(
        f"There is no model called '{shown(name_or_file)}'.",
        f"Use one of these: {known}; or give the path of a .safetensors file.",
    )


def hash_tensors(tensors: Mapping[str, Tensor]) -> str:
    """Sixteen hexadecimal digits that identify names, shapes and values of `tensors`."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        value = tensors[name].detach().cpu().contiguous()
        digest.update(f"{name}{tuple(value.shape)}torch.{value.numpy().dtype}".encode())
        digest.update(value.numpy().tobytes())
    return digest.hexdigest()[:16]


def load_model(path: Path, kind: str) -> tuple[dict[str, Tensor], ModelCard]:
    """Tensors and card of the model file at `path`, which must be of `kind`."""
    import numpy as np
    import safetensors

    from ..backend import torch

    card = read_card(path)
    file = shown(path.name)
    if card.kind != kind:
        raise ModelFileError(f"{file} holds an {card.kind}, not an {kind}.", "Choose another file.")
    try:
        # Not mapped into memory: a file that is cut short later would be a bus error.
        stored = safetensors.deserialize(path.read_bytes())
    except (safetensors.SafetensorError, OSError) as error:
        if ran_out_of_memory(error):
            raise
        raise ModelFileError(
            f"{file} is damaged ({reason(error)}).", "Copy or download it again."
        ) from error
    tensors = {}
    for name, entry in stored:
        of_bytes = name == _BYTES and entry["dtype"] == "U8"
        if not of_bytes and entry["dtype"] != "F32":
            raise ModelFileError(
                f"{file} holds numbers of another kind than single precision ({shown(name)}).",
                "Choose a file made by `python -m training`.",
            )
        value = np.frombuffer(entry["data"], np.uint8 if of_bytes else "<f4")
        tensors[name] = torch.from_numpy(value.reshape(entry["shape"]))
        if of_bytes:
            continue
        if not np.isfinite(value).all():
            raise ModelFileError(
                f"{file} holds values that are not finite ({shown(name)}).", "Train it again."
            )
        if (np.abs(value) > _LARGEST_WEIGHT).any():
            raise ModelFileError(
                f"{file} holds values that no training makes, above {_LARGEST_WEIGHT:,.0f} "
                f"({shown(name)}).",
                "Copy or download it again.",
            )
    return tensors, card


def save_model(
    path: Path,
    tensors: Mapping[str, Tensor],
    card: Mapping[str, Any],
    *,
    kind: str,
    check: Callable[[Path], object] = lambda file: None,
) -> None:
    """Write `tensors` and `card` to `path`, whole or not at all: `check` may refuse what it finds
    in the file by raising an error, before that takes its place. Its version is the oldest that can
    hold it.

    Raises OutputError where it cannot be written.
    """
    from safetensors.numpy import save

    newest = any(name == _HEIGHT or name.startswith(_GRAIN) for name in tensors)
    card = {"format": _FORMATS[kind], **card, "version": FORMAT_VERSION if newest else 1}
    arrays = {name: value.detach().cpu().contiguous().numpy() for name, value in tensors.items()}
    content = save(arrays, metadata={"card": json.dumps(card)})
    with replaced(path, parents=True) as beside:
        beside.write_bytes(content)
        try:
            check(beside)
        except ModelFileError as error:
            found = error.message.replace(shown(beside.name), "it")
            raise ModelFileError(
                f"{shown(path.name)} was not written: {found}",
                "Look for absurd values in what it was learned from.",
            ) from error
