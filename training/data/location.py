"""Where the research data is: the one place that tests and commands look it up."""

from __future__ import annotations

import os
from pathlib import Path

from model_runtime.errors import InputError

__all__ = ("SETTING", "data_folder")

SETTING = "TVBRDF_DATA"

_REPOSITORY = Path(__file__).resolve().parents[2]


def data_folder() -> Path:
    """The folder named by `TVBRDF_DATA`, by default `../shared/data` beside the repository.

    Raises `InputError` where that is no folder.
    """
    default = _REPOSITORY.parent / "shared" / "data"
    folder = Path(os.environ.get(SETTING) or default)
    if not folder.is_dir():
        raise InputError(
            f"There is no data folder {folder}.",
            f"Set {SETTING} to the folder that holds bsdf, hdri, nbrdf, pbr and tvbtf.",
        )
    return folder
