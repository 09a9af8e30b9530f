"""What both ends agree on: the contract's names, and the stand-in that tests use for the worker."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
from pathlib import Path
from typing import Any, get_args

import pytest

from model_runtime import contract
from model_runtime.contract import (
    BINDINGS,
    FORMATS,
    FRAMES,
    LIVE,
    QUALITIES,
    SPECULARS,
    STAGES,
    frame_file,
    is_result_file,
)
from model_runtime.messages import Done, Failed, Progress, Ready, Reply, Request
from tests.aging import write_painted_steel
from tests.test_serve import ROOT, STUB


@pytest.mark.parametrize(
    ("names", "type_"),
    [
        (QUALITIES, contract.Quality),
        (SPECULARS, contract.Specular),
        (BINDINGS, contract.Binding),
        (FORMATS, contract.Format),
        (STAGES, contract.Stage),
    ],
)
def test_types_have_the_names_that_are_listed(names: dict, type_: object):
    assert tuple(names) == get_args(type_)


def test_every_file_of_a_result_is_known_as_one():
    maps = {name for maps in FORMATS.values() for name in maps}
    names = [frame_file(name, k) for name in maps for k in (0, 35, 9998)]
    names += [contract.CURVES, contract.TIMING, contract.coefficients_file(11)]
    assert all(map(is_result_file, names))
    assert not any(map(is_result_file, (contract.REPORT, "kd.exr", "../kd_0001.exr", "notes.txt")))


def test_messages_come_back_as_they_were_written():
    for message in (Ready(1, "0.1"), Progress("reading", 0.5), Failed("a", "b", "c"), Done([{}])):
        answered = None if isinstance(message, Ready) else 7
        reply = Reply(message, answered)
        assert Reply.read(reply.line()) == reply
    request = Request("x", "age", {"frames": 2})
    assert Request.read(request.line().encode()) == request


def conversation(worker: tuple[str, ...], requests: list[Request]) -> list[dict[str, Any]]:
    """What a worker says, all requests being asked at their time, but for signs of life."""
    said = []
    with subprocess.Popen(
        [sys.executable, *worker, contract.SERVE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    ) as process:
        for request in requests:
            process.stdin.write(request.line() + "\n")
            process.stdin.flush()
            for line in process.stdout:
                said.append(json.loads(line))
                if said[-1]["type"] in ("done", "error"):
                    break
    return [each for each in said if each["type"] not in ("alive", "loaded")]


def shape(message: dict[str, Any]) -> tuple[Any, ...]:
    """The type and fields of a message, and those of the report in it."""
    result = message.get("result")
    inner = (
        (*sorted(result), *result.get("seconds", ())) if isinstance(result, dict) else type(result)
    )
    return message["type"], tuple(sorted(message)), inner, message.get("code")


@pytest.mark.parametrize("binding", [FRAMES, LIVE])
def test_the_stub_says_what_the_worker_says(tmp_path: Path, binding: str):
    """The same types of messages with the same fields, in this order, and the same report.

    How often progress comes is each one's own. There is a warning, for painted steel is unlike what
    moss was learned from.
    """
    paint = write_painted_steel(tmp_path / "paint", 16)
    good = {"input": str(paint), "ntm": "moss", "frames": 3, "binding": binding}
    good |= {"quality": "draft", "output": str(tmp_path / "aged")}
    requests = [
        Request(1, "age", good),
        Request(2, "age", good | {"frames": 0}),
        Request(3, "age", good | {"input": str(tmp_path / "absent")}),
        Request(4, "info", {}),
        Request(5, "cancel", {}),
        Request(6, "sing", {}),
        Request(7, "shutdown", {}),
    ]
    real, stub = (
        conversation(worker, requests) for worker in (("-m", "model_runtime"), (str(STUB),))
    )
    shapes = [[each for each, _ in itertools.groupby(map(shape, all_))] for all_ in (real, stub)]
    assert shapes[0] == shapes[1]
    assert [each[0] for each in shapes[0][:4]] == ["ready", "progress", "warning", "progress"]
    for message in (*real, *stub):
        if message["type"] == "progress":
            assert message["stage"] in STAGES.values()
