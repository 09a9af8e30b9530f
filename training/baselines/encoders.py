"""Every BRDF encoder that is trained here: the product's kinds, and those of rivals alone."""

from __future__ import annotations

from pathlib import Path

from model_runtime.model_files.weights import load_model, read_card
from model_runtime.representation import Trained, build, load_representation

from .deepbrdf import DeepBRDF
from .hyperbrdf import HyperBRDF

__all__ = ("Encoder", "build_encoder", "load_encoder")

Encoder = Trained | DeepBRDF | HyperBRDF
_RIVALS = {kind.name: kind for kind in (DeepBRDF, HyperBRDF)}


def build_encoder(name: str) -> Encoder:
    """A new, untrained encoder of the kind `name`."""
    return _RIVALS[name]() if name in _RIVALS else build(name)


def load_encoder(path: Path) -> Encoder:
    """The trained encoder in `path`, ready for use; errors as those of `load_representation`."""
    if read_card(path).name not in _RIVALS:
        return load_representation(path)[0]
    tensors, card = load_model(path, "encoder")
    model = _RIVALS[card.name]()
    model.load_state_dict(tensors)
    return model.eval().requires_grad_(False)
