"""The fault campaign: its judge recognizes every kind of fault, and a short one runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from model_runtime.model_files.weights import save_model

if not Path("/proc/self/clear_refs").exists():
    pytest.skip("the campaign reads /proc", allow_module_level=True)

from tests.campaign.damage import damaged_json
from tests.campaign.evidence import Answer, Evidence, Result, read_result, tree_of
from tests.campaign.judge import Fault, Normal, judge
from tests.campaign.programs import Child, Gone, command
from tests.campaign.samples import exr
from tests.campaign.tally import Tally, Verdict

ROOT = Path(__file__).resolve().parents[1]
NORMAL = Normal(seconds=1.0, peak_mb=300.0)
OLD = {"aged.json": "old report", "kd_0001.exr": "old", "kd_0002.exr": "old"}
NEW = {"aged.json": "new report", "kd_0001.exr": "new", "kd_0002.exr": "new"}


def tree(output: dict[str, str] | None = None, **others: str) -> dict[str, str]:
    """A trial's folder: an input, perhaps an output with these files, and whatever else."""
    held = {} if output is None else {"out": "folder"} | {f"out/{k}": v for k, v in output.items()}
    return {"in": "folder", "in/Color.png": "honest"} | held | others


GOOD = Evidence(
    Answer("done", seconds=1.0, peak_mb=300.0),
    before=tree(OLD),
    after=tree(NEW),
    output="out",
    earlier=Result(OLD),
    result=Result(NEW),
)
REFUSED = replace(
    GOOD,
    answer=Answer("refused", "1", ("The map is damaged. Save it again.",)),
    after=tree(OLD),
    result=Result(OLD),
)
KILLED = replace(REFUSED, answer=Answer("stopped", "SIGKILL"), abandoned=True)


def faults(evidence: Evidence) -> set[Fault]:
    return {finding.fault for finding in judge(evidence, NORMAL)}


@pytest.mark.parametrize(
    "evidence",
    [
        GOOD,
        REFUSED,
        KILLED,
        replace(GOOD, before=tree(), earlier=None),
        replace(REFUSED, before=tree(), after=tree(), earlier=None, result=None),
        replace(KILLED, after=tree(NEW), result=Result(NEW)),
        replace(REFUSED, after=tree(NEW), result=Result(NEW), untold=True),
        replace(KILLED, after=tree(OLD, **{".out.partial-1": "folder", ".out.partial-1/x": "y"})),
        replace(KILLED, after=tree(OLD | {".aged.partial-1": "folder"})),
        replace(
            GOOD, before=tree(OLD | {"notes.txt": "kept"}), after=tree(NEW | {"notes.txt": "kept"})
        ),
        replace(
            GOOD,
            output="new/out",
            before=tree(),
            earlier=None,
            after={**tree(), "new": "folder", "new/out": "folder", "new/out/kd_0001.exr": "new"},
            result=Result({"kd_0001.exr": "new"}),
        ),
        replace(GOOD, alone=({"kd_0001.exr": "new", "kd_0002.exr": "new"},)),
        replace(GOOD, output=None, before=tree(), after=tree(), earlier=None, result=None),
    ],
)
def test_what_is_no_fault(evidence: Evidence):
    assert judge(evidence, NORMAL) == []


PLANTED = {
    "a traceback": (
        Fault.TRACEBACK,
        replace(GOOD, answer=Answer("died", "1", log="Traceback (most recent call last):\nE: x")),
    ),
    "an internal error": (
        Fault.TRACEBACK,
        replace(REFUSED, answer=Answer("refused", "internal", ("Something went wrong.",))),
    ),
    "no answer": (Fault.HANG, replace(REFUSED, answer=Answer("hung"))),
    "a late answer": (Fault.HANG, replace(GOOD, answer=Answer("done", seconds=11.5))),
    "a segmentation fault": (Fault.DIED, replace(REFUSED, answer=Answer("died", "-11"))),
    "much memory": (Fault.MEMORY, replace(GOOD, answer=Answer("done", peak_mb=601.0))),
    "silence": (Fault.SILENT, replace(REFUSED, answer=Answer("refused", "1", ("", " ")))),
    "a library's words": (
        Fault.NOISE,
        replace(REFUSED, answer=replace(REFUSED.answer, noise="libpng error: bad CRC")),
    ),
    "escape codes": (
        Fault.WORDS,
        replace(REFUSED, answer=Answer("refused", "1", ("\x1b[2J is damaged.",))),
    ),
    "a surrogate": (Fault.WORDS, replace(GOOD, answer=Answer("done", words=("\udce9",)))),
    "a long sentence": (
        Fault.WORDS,
        replace(REFUSED, answer=Answer("refused", "1", ("x" * 1001,))),
    ),
    "a mixed result": (
        Fault.LOST,
        replace(
            KILLED, after=tree(NEW | {"kd_0002.exr": "old"}), result=Result(NEW, ("kd_0002.exr",))
        ),
    ),
    "a lost result": (Fault.LOST, replace(REFUSED, after=tree(), result=None)),
    "a result replaced in spite of a refusal": (
        Fault.LOST,
        replace(REFUSED, after=tree(NEW), result=Result(NEW)),
    ),
    "left-over frames": (Fault.LOST, replace(GOOD, after=tree(NEW | {"kd_0003.exr": "old"}))),
    "the user's file replaced": (
        Fault.LOST,
        replace(GOOD, before=tree({"kd_0001.exr": "the user's"}), earlier=None),
    ),
    "the user's file removed": (
        Fault.LOST,
        replace(REFUSED, before=tree(OLD | {"notes.txt": "kept"})),
    ),
    "two runs mixed": (Fault.LOST, replace(GOOD, alone=({"kd_0001.exr": "x"}, {}))),
    "no result": (Fault.HOLLOW, replace(GOOD, after=tree(OLD), result=None)),
    "a frame less": (Fault.HOLLOW, replace(GOOD, result=Result(NEW, broken=("kd",)))),
    "NaN": (Fault.ABSURD, replace(GOOD, result=Result(NEW, absurd=("kd_0001.exr",)))),
    "a file elsewhere": (Fault.OUTSIDE, replace(GOOD, after=tree(NEW, elsewhere="x"))),
    "a changed input": (
        Fault.OUTSIDE,
        replace(GOOD, after=tree(NEW) | {"in/Color.png": "changed"}),
    ),
    "a file where nothing is to be written": (
        Fault.OUTSIDE,
        replace(GOOD, output=None, before=tree(), after=tree(cache="x"), earlier=None),
    ),
    "staged files": (
        Fault.LITTER,
        replace(REFUSED, after=tree(OLD, **{".out.partial-1": "folder"})),
    ),
    "staged files inside": (
        Fault.LITTER,
        replace(GOOD, after=tree(NEW | {".kd_0001.exr.7.part": "x"})),
    ),
    "an empty folder": (
        Fault.LITTER,
        replace(REFUSED, before=tree(), after=tree({}), earlier=None, result=None),
    ),
    "a good one refused": (Fault.WRONG, replace(REFUSED, expected="done")),
    "a bad one accepted": (Fault.WRONG, replace(GOOD, expected="refused")),
    "a complaint": (Fault.WRONG, replace(GOOD, complaints=("three lines, two answers",))),
}


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_fault_is_recognized(name: str):
    fault, evidence = PLANTED[name]
    assert fault in faults(evidence)


def test_every_kind_of_fault_is_planted():
    assert {fault for fault, _ in PLANTED.values()} == set(Fault)


def test_staged_files_of_a_kill_have_to_go_with_the_next_run():
    left = tree(NEW, **{".out.partial-1": "folder"})
    assert faults(replace(GOOD, after=left)) == {Fault.LITTER}


def result_in(folder: Path, pixels: np.ndarray) -> Path:
    exr(folder / "kd_0001.exr", Y=np.zeros((2, 2)))
    report = {"frames": 2, "files": {"kd": ["kd_0001.exr", "kd_0002.exr"]}}
    (folder / "aged.json").write_text(json.dumps(report))
    exr(folder / "kd_0002.exr", Y=pixels)
    return folder


def test_a_result_is_read_from_its_files(tmp_path: Path):
    whole = read_result(result_in(tmp_path, np.zeros((2, 2))))
    assert whole is not None
    assert sorted(whole.files) == ["aged.json", "kd_0001.exr", "kd_0002.exr"]
    assert (whole.broken, whole.absurd) == ((), ())
    assert whole.files["kd_0001.exr"] == tree_of(tmp_path)["kd_0001.exr"]


def test_nan_and_missing_or_cut_files_in_a_result_are_found(tmp_path: Path):
    absurd = read_result(result_in(tmp_path, np.full((2, 2), np.nan)))
    assert absurd is not None
    assert absurd.absurd == ("kd_0002.exr",)
    os.truncate(tmp_path / "kd_0002.exr", 100)
    (tmp_path / "kd_0001.exr").unlink()
    broken = read_result(tmp_path)
    assert broken is not None
    assert broken.broken == ("kd_0001.exr", "kd_0002.exr")


def test_a_model_s_nan_is_found(tmp_path: Path):
    import torch

    for value, absurd in ((1.0, ()), (float("nan"), ("w",))):
        save_model(tmp_path / "m", {"w": torch.tensor([value])}, {"name": "x"}, kind="ntm")
        result = read_result(tmp_path / "m")
        assert result is not None
        assert result.absurd == absurd


def test_a_folder_s_odd_contents_are_told_and_not_opened(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/zero")
    (tmp_path / os.fsdecode(b"caf\xe9")).write_bytes(b"x")
    before = tree_of(tmp_path)
    assert before["pipe"] == "special"
    assert before["link"] == "link to /dev/zero"
    (tmp_path / os.fsdecode(b"caf\xe9")).write_bytes(b"y")
    assert before != tree_of(tmp_path)


class TestPrograms:
    """Answers of real processes, which stand in for the program."""

    def run(self, tmp_path: Path, script: str, **options) -> Answer:
        (tmp_path / "home").mkdir(exist_ok=True)
        (tmp_path / "home" / "stand_in.py").write_text(f"import os, sys, time\n{script}\n")
        options = {"seconds": 20.0} | options
        places = {"home": tmp_path / "home", "logs": tmp_path}
        return command((), module="stand_in", **places, **options)

    @pytest.mark.parametrize(
        ("script", "ended"),
        [
            ("sys.exit(0)", "done"),
            ("sys.exit(1)", "refused"),
            ("sys.exit(2)", "refused"),
            ("sys.exit(3)", "died"),
            ("os.kill(os.getpid(), 11)", "died"),
            ("raise OSError", "refused"),
        ],
    )
    def test_ways_to_end(self, tmp_path: Path, script: str, ended: str):
        assert self.run(tmp_path, script).ended == ended

    def test_one_that_goes_on_is_killed(self, tmp_path: Path):
        assert self.run(tmp_path, "time.sleep(60)", seconds=0.5).ended == "hung"

    def test_a_signal_that_was_sent_is_told_from_one_that_was_not(self, tmp_path: Path):
        import signal

        stopped = self.run(tmp_path, "time.sleep(60)", watch=lambda pid, t: signal.SIGTERM)
        assert (stopped.ended, stopped.code) == ("stopped", "-15")

    def test_sentences_and_noise(self, tmp_path: Path):
        script = (
            "print('  40%  writing\\nWarning: few frames.\\nmodel_runtime: It is full.\\n"
            "libtiff: bad tag', file=sys.stderr); print('said'); sys.exit(1)"
        )
        answer = self.run(tmp_path, script)
        assert "model_runtime: It is full." in answer.words
        assert "said" in answer.words
        assert answer.noise == "libtiff: bad tag"

    def test_memory(self, tmp_path: Path):
        assert self.run(tmp_path, "x = b'1' * 200_000_000; time.sleep(0.1)").peak_mb > 200
        assert self.run(tmp_path, "").peak_mb < 150

    def test_a_child_answers_and_its_end_is_noticed(self, tmp_path: Path):
        import time

        (tmp_path / "home").mkdir()
        (tmp_path / "home" / "echo.py").write_text(
            "import sys\nfor line in sys.stdin:\n    print(len(int(line) * b'1'), flush=True)"
        )
        child = Child("-m", "echo", home=tmp_path / "home")
        until = time.monotonic() + 20
        child.send(b"200000000")
        assert child.receive(until) == 200_000_000
        assert child.peak_mb() > 200
        child.send(b"1")
        child.receive(until)
        child.forget_peak()
        child.send(b"1")
        child.receive(until)
        assert child.peak_mb() < 100
        child.send(b"x")
        with pytest.raises(Gone, match="exit code 1"):
            child.receive(until)
        assert "Traceback" in child.log()


def test_damaged_json_repeats_with_its_seed():
    import random

    made = [damaged_json({"a": [1, {"b": 2}]}, random.Random(seed)) for seed in (1, 1, *range(40))]
    assert made[0] == made[1]
    assert len(set(made)) > 30


def test_the_table_counts_and_names_a_trial_of_each_sort_of_fault():
    tally = Tally()
    finding = judge(PLANTED["escape codes"][1], NORMAL)[0]
    for verdict in (
        Verdict("images", 1, False),
        Verdict("images", 2, True),
        Verdict("images", 3, True, (finding,)),
        Verdict("images", 4, True, (finding,)),
        Verdict("kills", 5, False),
    ):
        tally.add(verdict)
    assert list(tally.rows()) == [
        ("images", 4, 1, 1, 2),
        ("kills", 1, 1, 0, 0),
        ("all", 5, 2, 1, 2),
    ]
    text = tally.markdown("Title")
    assert "| images | 4 | 1 | 1 | 2 |" in text
    assert "`--only images:3` (2) sentence with escape codes" in text
    assert "\x1b" not in text


@pytest.mark.slow
def test_a_short_campaign_finds_no_fault(tmp_path: Path):
    """Sixty trials, all kinds; `--only` repeats what this one names."""
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "tests.campaign",
            "--seed",
            "1",
            "--trials",
            "60",
            "--json",
            str(tmp_path / "counts.json"),
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    counts = json.loads((tmp_path / "counts.json").read_text())["kinds"]
    assert counts["all"]["trials"] == 60
    assert len(counts) == 15
    assert all(kind["trials"] for kind in counts.values())
