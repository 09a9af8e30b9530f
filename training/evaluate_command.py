"""`python -m training evaluate`: every report, by its name."""

from __future__ import annotations

from json import dumps
from pathlib import Path
from typing import Literal

import tyro

from model_runtime.errors import UsageError

__all__ = ("evaluate",)


def evaluate(
    what: tyro.conf.Positional[
        Literal["representation", "synthesis", "pareto", "stability", "realism", "fading", "layers"]
    ],
    output: Path,
    pixels: int = 64,
    methods: tuple[str, ...] = (),
    cases: tuple[str, ...] = (),
    json: bool = False,
) -> None:
    """Measure what is bundled beside its rivals; reports go to the output folder.

    Args:
        what: the PSNR of BRDF representations on every set of materials, or of models of change on
            every case of synthesis; speed against accuracy, and the time and memory of aging;
            under which stresses methods fail; how far from real ones weathered textures look; or
            how a dye fades by its dose of light; or what varnish does to what lies under it.
        output: the folder to write; what is finished there is not done again.
        pixels: width of the rendered spheres (fewer is faster and rougher); pareto ages maps 16
            times as wide, and realism has sizes of its own.
        methods: only these (ours, paper, brdfnps, nbrdf, stt, ...); all by default.
        cases: of synthesis, only these (s1_a0.6_b0.05, s3, real_tvbtf45, ...), or only these
            stresses, or targets of realism; all by default.
        json: print the report on stdout as JSON instead of a table.
    """
    from .data.location import data_folder

    if what in ("pareto", "fading", "layers") and (methods or cases):
        raise UsageError(f"{what.capitalize()} takes all.", "Leave out --methods and --cases.")
    if what == "pareto":
        from .evaluation.pareto.evaluate import evaluate_pareto
        from .evaluation.pareto.report import tables

        report = evaluate_pareto(data_folder(), output, pixels=pixels)
        table = tables(report)
    elif what == "representation":
        from .evaluation.representation.evaluate import evaluate_representation
        from .evaluation.representation.report import main_table

        if cases:
            raise UsageError("Representation has no cases.", "Leave out --cases.")
        chosen = methods or None
        report = evaluate_representation(data_folder(), output, pixels=pixels, methods=chosen)
        table = main_table(report)
    elif what == "stability":
        from .evaluation.stability.evaluate import STRESSES, evaluate_stability
        from .evaluation.stability.report import stability_table

        report = evaluate_stability(
            data_folder(), output, methods=methods or None, stresses=cases or None
        )
        table = stability_table(report, STRESSES)
    elif what == "layers":
        from .evaluation.layers.evaluate import evaluate_layers
        from .evaluation.layers.evaluate import table as layers_table

        report = evaluate_layers(output)
        table = layers_table(report)
    elif what == "fading":
        from .evaluation.fading.evaluate import evaluate_fading
        from .evaluation.fading.evaluate import table as fading_table

        report = evaluate_fading(output)
        table = fading_table(report)
    elif what == "realism":
        from .evaluation.realism.evaluate import evaluate_realism
        from .evaluation.realism.report import tables

        report = evaluate_realism(
            data_folder(), output, methods=methods or None, targets=cases or None
        )
        table = tables(report)
    else:
        from .evaluation.synthesis.evaluate import evaluate_synthesis
        from .evaluation.synthesis.report import tables

        report = evaluate_synthesis(
            data_folder(), output, pixels=pixels, methods=methods or None, cases=cases or None
        )
        table = tables(report)
    print(dumps(report.json(), indent=1) if json else table)
