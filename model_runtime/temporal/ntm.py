"""A neural temporal model as it is stored: a ladder of models of change, a domain and a card."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..backend import Tensor, torch
from ..channels import WIDTH
from ..contract import AFFINE, CONSTANT, LADDER, LSTM_LATENTS, LSTM_PARAMETERS
from ..errors import ModelFileError, shown
from ..model_files.weights import ModelCard, load_model
from .domain import FOREIGN_SHARE, MOST_CENTERS, Domain
from .grain import Grain, share_of
from .models import Affine, Constant, LatentLSTM, ParameterLSTM, TemporalModel
from .pace import Timing

__all__ = ("NeuralTemporalModel",)

_SAMPLE = 4096  # texels that tell whether a material is foreign


@dataclass(frozen=True)
class NeuralTemporalModel:
    """All rungs trained on one sequence. `chosen` is the cheapest that sufficed in validation.

    grain: what its source's texels had beyond their mean history; None: nothing
    height: [T] the mean relief at each age, 0 at first, in sides of the grain's tile; None: none
    """

    card: ModelCard
    affine: Affine
    parameters: ParameterLSTM
    latents: LatentLSTM
    domain: Domain
    grain: Grain | None = None
    height: Tensor | None = None

    @property
    def chosen(self) -> str:
        return self.card.details["temporal_model"]  # `load` has seen that it is one

    @property
    def frames(self) -> int:
        return self.card.frames

    @property
    def timing(self) -> Timing | None:
        """When the source's texels started; None where the card does not say."""
        return _timing(self.card)

    @property
    def changes_at_once(self) -> bool:
        """Whether all texels of the source are known to have changed at one time."""
        return self.timing is not None and self.timing.at_once

    @property
    def warnings(self) -> tuple[str, ...]:
        """What training could not be sure of, in sentences."""
        return _warnings(self.card)

    def rung(self, name: str) -> TemporalModel:
        """The model of change called `name`."""
        return {
            CONSTANT: Constant(),
            AFFINE: self.affine,
            LSTM_PARAMETERS: self.parameters,
            LSTM_LATENTS: self.latents,
        }[name]

    def suited(self, initial: Tensor) -> tuple[str, float]:
        """The name of the rung to use for states [n, C], and the share of them that are unlike
        everything it was trained on.

        Where most are, the LSTMs would extrapolate in silence; the affine rung cannot run away.
        """
        sample = initial[:: max(1, len(initial) // _SAMPLE)].contiguous()
        share = float(self.domain.outside(sample).float().mean())
        foreign = share > FOREIGN_SHARE and self.chosen != CONSTANT
        return AFFINE if foreign else self.chosen, share

    def tensors(self) -> dict[str, Tensor]:
        """Everything that a file must hold, by name."""
        grain = {} if self.grain is None else self.grain.arrays()
        return {
            "affine.gain": self.affine.gain,
            "affine.offset": self.affine.offset,
            "domain.centres": self.domain.centers,
            "domain.radii": self.domain.radii,
            **{f"parameters.{name}": value for name, value in self.parameters.state_dict().items()},
            **{f"latents.{name}": value for name, value in self.latents.state_dict().items()},
            **{name: torch.from_numpy(value) for name, value in grain.items()},
            **({} if self.height is None else {"height": self.height}),
        }

    @classmethod
    def load(cls, path: Path, representation: str) -> NeuralTemporalModel:
        """Read the NTM in `path`, which must belong to the encoder with hash `representation`.

        Raises ModelFileError for any other, for damage and for newer versions.
        """
        tensors, card = load_model(path, "ntm")
        file = shown(path.name)
        if card.representation != representation:
            raise ModelFileError(
                f"{file} belongs to another encoder ({shown(card.representation)}, "
                f"not {representation}).",
                "Train it again with the encoder of this version.",
            )
        try:
            affine = Affine(tensors["affine.gain"], tensors["affine.offset"])
            domain = Domain(tensors["domain.centres"], tensors["domain.radii"])
            parameters = ParameterLSTM()
            parameters.load_state_dict(_part(tensors, "parameters."))
            stored = _part(tensors, "latents.")
            latents = LatentLSTM(*(len(stored[f"steps.{i}.bias"]) for i in (0, 1)))
            latents.load_state_dict(stored)
            if not (
                card.frames > 1
                and affine.gain.shape == affine.offset.shape == (card.frames, WIDTH)
                and bool(((affine.gain >= 0) & (affine.gain <= Affine.LARGEST_GAIN)).all())
                and 0 < len(domain.centers) <= MOST_CENTERS
                and domain.centers.shape[1:] == (WIDTH,)
                and domain.radii.shape == (len(domain.centers),)
                and bool((domain.radii > 0).all())
                and card.details["temporal_model"] in LADDER
            ):
                raise ValueError("shapes do not agree")
            grain, height = _grain(tensors, card), _height(tensors, card)
            _timing(card)
            _warnings(card)
        except (KeyError, RuntimeError, ValueError, TypeError) as error:
            raise ModelFileError(
                f"{file} does not hold what an NTM needs.", "Copy or download it again."
            ) from error
        for module in (parameters, latents):
            module.eval().requires_grad_(False)
        return cls(card, affine, parameters, latents, domain, grain, height)


def _grain(tensors: dict[str, Tensor], card: ModelCard) -> Grain | None:
    """The grain of a file; KeyError or ValueError where it cannot be used."""
    arrays = {name: value.numpy() for name, value in tensors.items() if name.startswith("grain.")}
    if not arrays:
        return None
    grain = Grain.of(arrays, share_of(card.details))
    if len(grain.shapes) != card.frames:
        raise ValueError("the grain has other ages")
    return grain


def _height(tensors: dict[str, Tensor], card: ModelCard) -> Tensor | None:
    """The mean relief of a file; ValueError where it cannot be used."""
    height = tensors.get("height")
    if height is not None and not (
        height.shape == (card.frames,) and height[0] == 0 and bool((height.abs() <= 1).all())
    ):
        raise ValueError("the height does not start from nothing")
    return height


def _timing(card: ModelCard) -> Timing | None:
    """The card's timing; ValueError where it cannot be used."""
    stored = card.details.get("timing")
    return None if stored is None else Timing.from_json(stored)


def _warnings(card: ModelCard) -> tuple[str, ...]:
    """The card's warnings; ValueError where they are no texts."""
    stored = card.details.get("warnings", [])
    if not isinstance(stored, list) or not all(isinstance(each, str) for each in stored):
        raise ValueError("warnings are no texts")
    return tuple(stored)


def _part(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """The tensors whose names begin with `prefix`, without it."""
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
