"""Model files: safetensors whose header holds a JSON card.

Reading a card needs nothing but the standard library, so the add-on lists models without torch;
only `load_model` and `save_model` import safetensors, when called.
"""

from __future__ import annotations

import hashlib
import json
import stat
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import ModelFileError

if TYPE_CHECKING:
    from torch import Tensor

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

FORMAT_VERSION = 1
MODELS = Path(__file__).parent / "models"
ENCODER = MODELS / "encoder.safetensors"
ESTIMATOR = MODELS / "encoder.estimator.safetensors"

_FORMATS = {
    "encoder": "tvbrdf-encoder",
    "estimator": "tvbrdf-estimator",
    "ntm": "tvbrdf-ntm",
}
_MAX_HEADER = 1 << 20
_MAX_FILE = 1 << 28
_NO_CARD = (KeyError, TypeError, ValueError, IndexError, OverflowError, RecursionError)


@dataclass(frozen=True)
class ModelCard:
    """What a model file says of itself. `kind` is "encoder", "estimator" or "ntm"; `details` is
    the whole card.
    """

    path: Path
    kind: str
    version: int
    name: str
    title: str
    description: str = ""
    process: str = ""
    frames: int = 0
    representation: str = ""
    domain: Mapping[str, Any] = field(default_factory=dict)
    source: str = ""
    license: str = ""
    trained: Mapping[str, Any] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)


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
            header = json.loads(file.read(length))
            if not isinstance(header, dict):
                raise ValueError("its header is not an object")
            return header, 8 + length
    except FileNotFoundError as error:
        raise ModelFileError(
            f"There is no model file {path}.", "Check the path, or choose a bundled model."
        ) from error
    except (OSError, ValueError, RecursionError, struct.error) as error:
        raise ModelFileError(
            f"{path.name} is not a model file ({error}).", "Copy or download it again."
        ) from error


def read_card(path: Path) -> ModelCard:
    """The card of the model file at `path`.

    Raises ModelFileError for a file that is missing, truncated, damaged, without a card, or of a
    newer version than this program knows.
    """
    header, start = _header(path)
    try:
        card = json.loads(header.pop("__metadata__", {})["card"])
        kind = {value: key for key, value in _FORMATS.items()}[card["format"]]
        version = int(card["version"])
        if version > FORMAT_VERSION:
            raise ModelFileError(
                f"{path.name} has format version {version}; this program knows {FORMAT_VERSION}.",
                "Update the extension.",
            )
        end = max(int(entry["data_offsets"][1]) for entry in header.values())
        frames = int(card.get("frames", 0))
        domain, trained = (_object(card.get(name, {})) for name in ("domain", "trained"))
    except _NO_CARD as error:
        raise ModelFileError(
            f"{path.name} carries no card of a tvbrdf model.",
            "Choose a file made by `python -m training`.",
        ) from error
    if path.stat().st_size != start + end:
        raise ModelFileError(f"{path.name} is truncated or damaged.", "Copy or download it again.")
    texts = {
        key: str(card.get(key, ""))
        for key in (
            "name",
            "title",
            "description",
            "process",
            "representation",
            "source",
            "license",
        )
    }
    return ModelCard(
        path=path,
        kind=kind,
        version=version,
        frames=frames,
        domain=domain,
        trained=trained,
        details=card,
        **texts,
    )


def _object(value: object) -> dict[str, Any]:
    """A JSON object; TypeError for everything else."""
    if not isinstance(value, dict):
        raise TypeError(f"{value!r} is not an object")
    return value


def list_models(
    folders: Sequence[Path] = (MODELS,),
    *,
    refuse: Callable[[ModelFileError], None] = lambda _error: None,
) -> list[ModelCard]:
    """The cards of all readable NTMs in `folders`, by title; files that are not models are
    skipped, and `refuse` hears why.
    """
    cards = []
    for path in sorted(path for folder in folders for path in folder.glob("*.safetensors")):
        try:
            card = read_card(path)
        except ModelFileError as error:
            refuse(error)
            continue
        if card.kind == "ntm":
            cards.append(card)
    return sorted(cards, key=lambda card: card.title)


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
        f"There is no model called '{name_or_file}'.",
        f"Use one of these: {known}; or give the path of a .safetensors file.",
    )


def hash_tensors(tensors: Mapping[str, Tensor]) -> str:
    """Sixteen hexadecimal digits that identify names, shapes and values of `tensors`."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        value = tensors[name].detach().cpu().contiguous()
        digest.update(f"{name}{tuple(value.shape)}{value.dtype}".encode())
        digest.update(value.numpy().tobytes())
    return digest.hexdigest()[:16]


def load_model(path: Path, kind: str) -> tuple[dict[str, Tensor], ModelCard]:
    """Tensors and card of the model file at `path`, which must be of `kind`."""
    import safetensors
    import torch
    from safetensors.torch import load_file

    card = read_card(path)
    if card.kind != kind:
        raise ModelFileError(
            f"{path.name} holds an {card.kind}, not an {kind}.", "Choose another file."
        )
    try:
        tensors = load_file(path)
    except (safetensors.SafetensorError, OSError) as error:
        raise ModelFileError(
            f"{path.name} is damaged ({error}).", "Copy or download it again."
        ) from error
    other = [name for name, value in tensors.items() if value.dtype != torch.float32]
    if other:
        raise ModelFileError(
            f"{path.name} holds numbers of another kind than single precision ({other[0]}).",
            "Choose a file made by `python -m training`.",
        )
    broken = [name for name, value in tensors.items() if not torch.isfinite(value).all()]
    if broken:
        raise ModelFileError(
            f"{path.name} holds values that are not finite ({broken[0]}).", "Train it again."
        )
    return tensors, card


def save_model(
    path: Path, tensors: Mapping[str, Tensor], card: Mapping[str, Any], *, kind: str
) -> None:
    """Write `tensors` and `card` to `path`, whole or not at all."""
    from safetensors.torch import save_file

    card = {"format": _FORMATS[kind], "version": FORMAT_VERSION, **card}
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(path.name + ".partial")
    contiguous = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    save_file(contiguous, beside, metadata={"card": json.dumps(card)})
    beside.replace(path)
