"""`python -m training encoder | ntm | weathering | evaluate`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

import tyro

from model_runtime.errors import TvbrdfError

app = tyro.extras.SubcommandApp()


@app.command
def encoder(
    output: Path,
    config: Literal["fast", "paper"] = "fast",
    resume: bool = False,
    minutes: float | None = None,
    seed: int = 0,
) -> None:
    """Train a BRDF encoder and decoder.

    Args:
        output: the .safetensors file to write; checkpoints and logs go beside it.
        config: the recipe.
        resume: go on from the checkpoint beside the output.
        minutes: train about this long instead of the recipe's number of iterations.
        seed: of all random numbers.
    """
    from .encoder import train_encoder

    train_encoder(config=config, output=output, resume=resume, minutes=minutes, seed=seed)


def main() -> int:
    """Run the command line; 0 when done, 1 when it failed with a reason."""
    try:
        app.cli(prog="python -m training")
    except TvbrdfError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
