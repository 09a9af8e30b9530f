"""How long a source must be learned from: PSNR against minutes of training."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

from model_runtime.contract import LSTM_LATENTS, LSTM_PARAMETERS

from .cases import make_cases
from .charts import COLORS, TITLES
from .methods import Models
from .results import LearningCurves
from .scoring import Scorer
from .sphere import TexturedSphere
from .stage import Stage

__all__ = ("LEARNED", "chart_minutes", "learning_curves")

LEARNED = ("s2_a0.8_b0.2", "s3")
"""Cases on whose first material it is shown: what parameters hold, and what only latents do."""

_METHODS = ("ours", LSTM_PARAMETERS, LSTM_LATENTS)
_SHARES = (0.0625, 0.125, 0.25, 0.5, 1.0)


def learning_curves(
    data: Path, sphere: TexturedSphere, models: Models, *, size: int, look: str
) -> LearningCurves:
    """The ladder taught with a sixteenth to all of the iterations, each from the start.

    `size` and `look` are those of the report's cases, `size` the width of their patches.
    """
    found: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for name in LEARNED:
        case = next(make_cases(data, (name,), size=size))
        stage = Stage.of(case, sphere)
        curves = found[name] = {method: [] for method in _METHODS}
        for share in _SHARES:
            effort = models.school.effort
            ladder = replace(effort.ladder, iterations=round(effort.ladder.iterations * share))
            kept = models.school.kept / f"iterations_{ladder.iterations}"
            school = replace(models.school, kept=kept, effort=replace(effort, ladder=ladder))
            representation, encoder = models.encoders["ours"]
            ntm = school.ladder(case.source_key, case.source, representation, encoder)
            scorer = Scorer(
                case, lambda stage=stage: stage, replace(models, school=school), kept, look
            )
            for method, curve in curves.items():
                psnr = scorer.score(method).curves["score"].json()["mean"]
                curve.append((ntm.card.trained["minutes"], psnr))
    return found


def chart_minutes(curves: LearningCurves, path: Path) -> bool:
    """A panel a case. Writes nothing and returns False where there are none."""
    if not curves:
        return False
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    axes = figure.subplots(1, len(curves), squeeze=False)[0]
    for ax, (case, methods) in zip(axes, curves.items(), strict=True):
        for method, points in methods.items():
            minutes, psnr = zip(*points, strict=True)
            ax.plot(minutes, psnr, "o-", color=COLORS[method], label=TITLES[method])
        ax.set_title(case, fontsize=10)
        ax.set_xlabel("minutes of one core, all rungs")
        ax.set_ylabel("mean PSNR (dB)")
        ax.grid(color="#dddddd", linewidth=0.6)
    axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=100)
    return True
