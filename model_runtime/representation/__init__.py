"""BRDF autoencoders: the paper's, and one built on analytic lobes."""

from __future__ import annotations

from pathlib import Path

from ..errors import ModelFileError
from ..model_files.weights import ENCODER, hash_tensors, load_model
from .lobes import LobeRepresentation
from .paper import JointRepresentation, PaperRepresentation

__all__ = ("Trained", "build", "load_representation")

Trained = LobeRepresentation | PaperRepresentation
_KINDS = {
    kind.name: kind for kind in (LobeRepresentation, PaperRepresentation, JointRepresentation)
}


def build(name: str) -> Trained:
    """A new, untrained representation of the kind `name`."""
    return _KINDS[name]()


def load_representation(path: Path = ENCODER) -> tuple[Trained, str]:
    """The trained representation in `path`, ready for use, and the hash that NTMs refer to it
    by.
    """
    tensors, card = load_model(path, "encoder")
    if card.name not in _KINDS:
        raise ModelFileError(
            f"{path.name} holds a representation '{card.name}' unknown here.",
            "Update the extension.",
        )
    model = build(card.name)
    try:
        model.load_state_dict(tensors)
    except RuntimeError as error:
        raise ModelFileError(
            f"{path.name} does not fit the representation '{card.name}'.",
            "Copy or download it again.",
        ) from error
    return model.eval().requires_grad_(False), hash_tensors(tensors)
