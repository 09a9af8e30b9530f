"""Stresses of the target: materials and times ever further from what was learned from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from model_runtime.channels import ALPHA_MIN
from model_runtime.maps import TorranceSparrowMaps

from ...data.sequences import uniform_times
from ...data.synthetic import S1_DELTA, offset, s1, s2
from ..synthesis.cases import Case
from .trials import FRAMES, Stress, Trial, TrialSetup, grown

__all__ = ("TARGETS",)

_FOREIGN = "Metal024"
_GAP_MATERIAL = "Wood049"
_A = 0.8
_SPAN = 0.1  # of the process, that the source of a longer target shows


def _roughness_gap(setup: TrialSetup, beta: float) -> Trial:
    source, target = setup.patches(_GAP_MATERIAL)
    start = offset(target, delta=(0.0, 0.0, 0.0), beta=beta)
    return Trial(_gap("s2", s2(source, _A), s2(start, _A)))


def _color_gap(setup: TrialSetup, factor: float) -> Trial:
    source, target = setup.patches(_GAP_MATERIAL)
    red, green, blue = S1_DELTA
    delta = (red * factor, green * factor, blue * factor)
    start = offset(target, delta=delta, beta=0.0)
    return Trial(_gap("s1", s1(source, _A), s1(start, _A)))


def _gap(family: str, source, target) -> Case:
    name = f"stability_{family}"
    return Case(name, _GAP_MATERIAL, source, target, name)


def _alpha(setup: TrialSetup, median: float) -> Trial:
    """The target's alpha scaled to a median."""
    start = setup.start
    alpha = start.alpha * np.float32(median / np.median(start.alpha))
    return _beginning(setup, replace(start, alpha=np.clip(alpha, ALPHA_MIN, 1)))


def _specular(setup: TrialSetup, mean: float) -> Trial:
    """The target's Ks scaled to a mean."""
    start = setup.start
    return _beginning(setup, replace(start, ks=start.ks * np.float32(mean / start.ks.mean())))


def _albedo(setup: TrialSetup, factor: float) -> Trial:
    """The target's Kd and Ks times a factor."""
    start, times = setup.start, np.float32(factor)
    return _beginning(setup, replace(start, kd=start.kd * times, ks=start.ks * times))


def _foreign_mixed(setup: TrialSetup, share: float) -> Trial:
    """Every texel mixed with one of another kind of material."""
    own = setup.start.map(lambda maps: maps * np.float32(1 - share))
    other = _foreign(setup).map(lambda maps: maps * np.float32(share))
    mixed = TorranceSparrowMaps(own.kd + other.kd, own.ks + other.ks, own.alpha + other.alpha)
    return _beginning(setup, mixed)


def _foreign_part(setup: TrialSetup, share: float) -> Trial:
    """A part of the texels, from the left, of another kind of material."""
    foreign, start = _foreign(setup), setup.start
    there = (np.arange(setup.size) < round(share * setup.size))[None].repeat(setup.size, 0)
    return _beginning(
        setup,
        TorranceSparrowMaps(
            np.where(there[..., None], foreign.kd, start.kd),
            np.where(there[..., None], foreign.ks, start.ks),
            np.where(there, foreign.alpha, start.alpha),
        ),
    )


def _foreign(setup: TrialSetup) -> TorranceSparrowMaps:
    return setup.patches(_FOREIGN)[1]


def _rollout(setup: TrialSetup, span: float) -> Trial:
    """The source shows a tenth of the process, the target `span` times as long."""
    times = np.linspace(0, span, round(span * (FRAMES - 1)) + 1, dtype=np.float32)
    source = grown(setup.patches()[0], until=_SPAN)
    target = grown(setup.start, times=times, until=_SPAN)
    return Trial(setup.case(source=source, target=target, key="tenth"), last_only=True, span=span)


def _resampled(setup: TrialSetup, frames: float) -> Trial:
    """The target is asked for at another number of times than the source was seen at."""
    times = uniform_times(int(frames))
    return Trial(setup.case(target=grown(setup.start, times=times)))


def _beginning(setup: TrialSetup, start: TorranceSparrowMaps) -> Trial:
    return Trial(setup.case(start=start))


_AFFINE = "the change is channelwise affine, which the affine rung holds exactly"
_LAW = "the truth is the law of the process, carried on beyond the materials it was made for"

TARGETS: Mapping[str, Stress] = {
    "roughness_gap": Stress(
        "gap in roughness (S2)",
        "\N{GREEK SMALL LETTER BETA}, added to \N{GREEK SMALL LETTER ALPHA}",
        (0.0, 0.05, 0.1, 0.2, 0.4, 0.8),
        _roughness_gap,
        note=_AFFINE,
    ),
    "color_gap": Stress(
        "gap in color (S1)",
        "\N{GREEK SMALL LETTER DELTA}, in units of the paper's",
        (0.0, 1.0, 2.0, 4.0, 8.0),
        _color_gap,
        note=_AFFINE,
    ),
    "alpha_small": Stress(
        "\N{GREEK SMALL LETTER ALPHA} down to a mirror",
        "median \N{GREEK SMALL LETTER ALPHA} of the target",
        (0.25, 0.1, 0.03, 1e-3, 1e-4),
        _alpha,
        note=_LAW,
    ),
    "alpha_large": Stress(
        "\N{GREEK SMALL LETTER ALPHA} up to 1",
        "median \N{GREEK SMALL LETTER ALPHA} of the target",
        (0.25, 0.4, 0.7, 1.0),
        _alpha,
        note=_LAW,
    ),
    "ks_above_1": Stress(
        "Ks above 1", "mean Ks of the target", (0.5, 1.2, 2.0, 4.0, 16.0), _specular,
        note=_LAW,
    ),
    "albedo_zero": Stress(
        "albedo down to 0", "Kd and Ks times", (1.0, 0.5, 0.1, 0.03, 0.0), _albedo, note=_LAW
    ),
    "albedo_above_1": Stress(
        "albedo above 1", "Kd and Ks times", (1.0, 2.0, 4.0, 8.0, 16.0), _albedo,
        note=_LAW,
    ),
    "foreign_mixed": Stress(
        "foreign material, mixed in", "share in every texel", (0.0, 0.25, 0.5, 0.75, 1.0),
        _foreign_mixed, note=_LAW,
    ),
    "foreign_part": Stress(
        "foreign material, in a part", "share of the texels", (0.0, 0.1, 0.3, 0.6, 1.0),
        _foreign_part, note=_LAW,
    ),
    "rollout": Stress(
        "rollout to 10 times as long", "the source's duration", (1.0, 2.0, 3.0, 5.0, 10.0),
        _rollout,
        note="only the last frame counts; the affine rung and the product know nothing after the"
        " source's end: they stop there, and `age` cannot be asked for more",
    ),
    "resampled": Stress(
        "time resampled", "frames asked for, of a source with 36", (36.0, 144.0, 1000.0, 9.0, 2.0),
        _resampled,
        note="the paper's model has one step for each frame of its source: between two, latents"
        " are interpolated",
    ),
}  # fmt: skip
"""By name."""
