"""The report `fading`: a dye fades by first-order kinetics, as one that was measured."""

from __future__ import annotations

import json
from pathlib import Path

from training.evaluation.fading.evaluate import evaluate_fading, table


def test_a_red_dye_fades_as_alizarin_lake_did(tmp_path: Path):
    report = evaluate_fading(tmp_path)
    for found in report.methods.values():
        rates = [each.rate for each in found]
        assert max(rates) / min(rates) < 1.12, "one rate, whatever there was at first"
        assert max(each.off for each in found) < 0.06, "first order"
        assert all(each.left[0] == 1 for each in found)
    assert (tmp_path / "fading.png").stat().st_size > 5_000
    assert "| all | model |" in table(report)
    assert json.loads((tmp_path / "fading.json").read_text()) == report.json()
