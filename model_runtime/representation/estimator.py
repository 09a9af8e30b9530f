"""What the fit finds in latents, told by a small network without decoding them."""

from __future__ import annotations

import math
from pathlib import Path

from ..backend import Tensor, nn, torch
from ..channels import ALPHA_MIN
from ..errors import ModelFileError
from ..model_files.weights import ESTIMATOR, load_model
from ..states import joined
from .latents import Latents
from .lobes import compress, expand, mlp

__all__ = ("ParameterEstimator", "as_states", "load_estimator")

_BRIGHTEST = compress(torch.tensor(30.0)).item()


class ParameterEstimator(nn.Module):
    """Torrance-Sparrow parameters straight from latents of sizes `color_latents` a channel and
    `shared_latents`, without decoding and fitting them.

    Channels are treated alike, and alpha does not depend on their order.
    """

    def __init__(self, color_latents: int = 4, shared_latents: int = 12, width: int = 96) -> None:
        super().__init__()
        k, d = color_latents, shared_latents
        self.to_alpha = mlp(k + d, width, width, 1)
        self.to_albedos = mlp(2 * k + d, width, width, 2)

    def forward(self, latents: Latents) -> tuple[Tensor, Tensor]:
        """`compress`ed (kd, ks) [N, 3, 2] and log alpha [N], out of range where they may be."""
        color, shared = latents.color, latents.shared
        mean = color.mean(1)
        log_alpha = self.to_alpha(torch.cat((shared, mean), 1))[:, 0]
        others = torch.cat((mean, shared), 1)[:, None].expand(-1, 3, -1)
        return self.to_albedos(torch.cat((color, others), 2)), log_alpha

    def parameters_of(self, latents: Latents) -> Tensor:
        """States [N, C], kd and ks >= 0 and alpha in [1e-4, 1]."""
        return as_states(*self(latents))


def as_states(albedos: Tensor, log_alpha: Tensor) -> Tensor:
    """The states [N, C] that the output of a `ParameterEstimator` stands for."""
    kd, ks = expand(albedos.clamp(0, _BRIGHTEST)).unbind(2)
    alpha = log_alpha.clamp(math.log(ALPHA_MIN), 0).exp()
    return joined(kd, ks, alpha)


def load_estimator(identity: str, path: Path = ESTIMATOR) -> ParameterEstimator:
    """The trained estimator in `path` for the latents of the encoder `identity`.

    Raises ModelFileError where the file is missing, damaged or of another encoder.
    """
    tensors, card = load_model(path, "estimator")
    if card.representation != identity:
        raise ModelFileError(
            f"{path.name} belongs to another encoder than the one that is used.",
            "Train it again (`python -m training estimator`).",
        )
    model = ParameterEstimator()
    try:
        model.load_state_dict(tensors)
    except RuntimeError as error:
        raise ModelFileError(
            f"{path.name} does not fit the encoder's latents.", "Copy or download it again."
        ) from error
    return model.eval().requires_grad_(False)
