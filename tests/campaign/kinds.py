"""All kinds of trials, and the undisturbed runs that they are compared with."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable

from . import images, inputs, interruptions, models, options, outputs, protocol, reports, trainings
from .evidence import Evidence
from .judge import Normal, judge
from .trial import Kind, Lane, Trial

__all__ = ("KINDS", "calibrate")

KINDS = {
    kind.name: kind
    for kind in (
        Kind("images", images.attempt_map, 24),
        Kind("onset", images.attempt_onset, 8),
        Kind("folders", inputs.attempt_folder, 10),
        Kind("measured", inputs.attempt_measured, 6, "measured"),
        Kind("models", models.attempt_model, 12),
        Kind("requests", options.attempt_request, 10),
        Kind("commands", options.attempt_command, 5, "command"),
        Kind("outputs", outputs.attempt_output, 10),
        Kind("kills", interruptions.attempt_kill, 6, "command"),
        Kind("pairs", interruptions.attempt_pair, 4),
        Kind("changes", interruptions.attempt_change, 6),
        Kind("protocol", protocol.attempt_protocol, 6),
        Kind("reports", reports.attempt_report, 8, "reader"),
        Kind("training", trainings.attempt_training, 4, "training"),
    )
}


def calibrate(lane: Lane, ways: Iterable[str]) -> dict[str, Normal]:
    """What undisturbed runs take, each way; makes the samples that programs make.

    A run that fails even undisturbed ends the campaign: it would say nothing.
    """
    normal: dict[str, Normal] = {}
    for way in ways:
        attempts = [_UNDISTURBED[way](trial) for trial in _trials(lane, way)]
        for evidence in (each for attempt in attempts for each in attempt):
            generous = Normal(60.0, 1e9)
            if findings := judge(evidence, generous):
                raise RuntimeError(f"An undisturbed {way} run fails: {findings} {evidence.answer}")
        # The first run has imports and caches to fill.
        answers = [attempt[0].answer for attempt in attempts]
        normal[way] = Normal(
            min(answer.seconds for answer in answers), max(answer.peak_mb for answer in answers)
        )
    return normal


def _trials(lane: Lane, way: str) -> Iterable[Trial]:
    for number in range(2):
        folder = lane.folder / f"undisturbed {way} {number}"
        folder.mkdir()
        yield Trial(number, Kind(way, lambda _: [], 0, way), lane, folder)


def _age(trial: Trial) -> list[Evidence]:
    trial.textures()
    # Through the latents at quality Balanced is the most that any trial asks for.
    request = trial.request(ntm="patina", quality="balanced", temporal_model="lstm_latents")
    evidence = trial.age(request, expected="done")
    shutil.copytree(trial.output, trial.samples.earlier, dirs_exist_ok=True)
    return [evidence]


def _measured(trial: Trial) -> list[Evidence]:
    path = trial.folder / "measured.binary"
    path.write_bytes(trial.samples.merl)
    return [trial.age(trial.request(input=str(path), size=8), expected="done")]


def _command(trial: Trial) -> list[Evidence]:
    trial.textures()
    words = [f"--{name.replace('_', '-')}={value}" for name, value in trial.request().items()]
    return [trial.command("age", *words, expected="done")]


def _reader(trial: Trial) -> list[Evidence]:
    trial.put_earlier_result()
    return [reports.ask_reader(trial, "report", trial.output)[0]]


def _training(trial: Trial) -> list[Evidence]:
    evidence = trainings.train_undisturbed(trial)
    trial.samples.trained.mkdir(exist_ok=True)
    for path in trial.folder.glob("model.*safetensors"):
        shutil.copy(path, trial.samples.trained)
    return evidence


_UNDISTURBED: dict[str, Callable[[Trial], list[Evidence]]] = {
    "worker": _age,
    "measured": _measured,
    "command": _command,
    "reader": _reader,
    "training": _training,
}
