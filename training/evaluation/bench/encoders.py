"""The trained encoders that reports compare."""

from __future__ import annotations

from pathlib import Path

from model_runtime.errors import ModelFileError
from model_runtime.model_files.weights import ENCODER

__all__ = ("RECIPES", "WEIGHTS", "trained_encoder")

WEIGHTS = Path(__file__).parents[2] / "baselines"
"""Where the rivals' trained weights are."""

RECIPES = {
    "ours": "fast",
    "paper": "paper-short",
    "paper_long": "paper-short",
    "brdfnps": "brdfnps-short",
    "deepbrdf": "deepbrdf",
    "hyperbrdf": "hyperbrdf",
}
"""By method, the `--config` that trains its encoder."""


def trained_encoder(name: str, weights: Path) -> Path:
    """The file of a method's encoder: ours as it is bundled, a rival's in the folder `weights`;
    ModelFileError where it is missing.
    """
    path = ENCODER if name == "ours" else weights / f"{name}.safetensors"
    if not path.exists():
        raise ModelFileError(
            f"The trained weights of the method '{name}' are missing ({path}).",
            f"Train them with `python -m training encoder --config {RECIPES[name]} --minutes 60"
            f" --output {path}`, or leave the method out with --methods.",
        )
    return path
