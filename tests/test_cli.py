"""`python -m model_runtime`: exit codes and what goes where, with the stub for the computing."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from model_runtime.backend import torch
from model_runtime.model_files.weights import save_model
from model_runtime.output.stored import StagedResult
from tests.aging import write_painted_steel

ROOT = Path(__file__).resolve().parents[1]
STUB = Path(__file__).with_name("stub_worker.py")


def command(*words: str | Path, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(STUB), *map(str, words)],
        capture_output=True,
        text=True,
        cwd=cwd,
        env=os.environ | {"TVBRDF_STUB_SECONDS": "0"},
        check=False,
    )


def test_json_on_stdout_and_nothing_else_there(tmp_path: Path):
    out = tmp_path / "out"
    done = command(
        "age", "--input", tmp_path, "--ntm", "rust", "--output", out, "--frames", 3, "--json"
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == json.loads((out / "aged.json").read_text())
    assert "100%" in done.stderr or "writing" in done.stderr
    assert "a library prints this" in done.stderr
    assert "Warning: The stub paints flat colors." in done.stderr


def test_without_json_a_sentence(tmp_path: Path):
    out = tmp_path / "out"
    done = command("age", "--input", tmp_path, "--ntm", "rust", "--output", out, "--frames", 3)
    assert done.returncode == 0
    assert "3 frames of 16 x 16" in done.stdout
    assert str(out) in done.stdout
    words = ("--input", tmp_path, "--ntm", "rust", "--output", out, "--binding", "live")
    assert "A live material of 16 x 16" in command("age", *words).stdout


def test_a_failure_is_one_sentence_and_exit_code_1(tmp_path: Path):
    done = command("age", "--input", tmp_path / "no", "--ntm", "rust", "--output", tmp_path / "out")
    assert done.returncode == 1
    assert done.stdout == ""
    assert "There is no input at" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--frames", "0"], "--frames"),
        (["--frames", "-1"], "--frames"),
        (["--frames", "1000000000"], "--frames"),
        (["--size", "16385"], "--size"),
        (["--seed", str(1 << 70)], "--seed"),
        (["--tolerance", "1e300"], "--tolerance"),
        (["--tolerance", "inf"], "--tolerance"),
        (["--frames", "many"], "--frames"),
        (["--size", "0"], "--size"),
        (["--quality", "best"], "--quality"),
        (["--temporal-model", "x"], "--temporal-model"),
        (["--tolerance", "nan"], "--tolerance"),
        (["--seed", "-2"], "--seed"),
        (["--frames", "1000000000"], "from 1 to 9999"),
        (["--frames", "10000"], "from 1 to 9999"),
        (["--size", "3000000000"], "from 1 to 16384"),
        (["--seed", "9" * 20], "from 0 to 9223372036854775807"),
        (["--seed", "9" * 5000], "--seed"),
        (["--tolerance", "1e400"], "--tolerance"),
        (["--format", "png"], "--format"),
        (["--surprise"], "--surprise"),
    ],
)
def test_wrong_usage_is_exit_code_2(tmp_path: Path, options: list[str], word: str):
    out = tmp_path / "out"
    done = command("age", "--input", tmp_path, "--ntm", "rust", "--output", out, *options)
    assert done.returncode == 2
    assert word in done.stderr
    assert not out.exists()


@pytest.mark.parametrize("option", ["--frames", "--quality", "--surprise"])
def test_what_was_given_is_quoted_in_part_and_plainly(option: str):
    done = command(
        "age", "--input", "x", "--ntm", "y", "--output", "z", f"{option}=\x1b[2J" + "x" * 9000
    )
    assert done.returncode == 2
    assert len(done.stderr) < 2000
    assert "\x1b" not in done.stderr


@pytest.mark.parametrize(
    "words",
    [
        [],
        ["age"],
        ["sing"],
        *(["serve", "--idle-minutes", each] for each in ("0", "nan", "inf", "1e300")),
        *(["serve", "--cache-gb", each] for each in ("-1", "nan", "inf", "much")),
    ],
)
def test_incomplete_commands_are_exit_code_2(words: list[str]):
    assert command(*words).returncode == 2


def test_info_needs_neither_torch_nor_numpy(tmp_path: Path):
    model = tmp_path / "moss.safetensors"
    card = {"name": "moss", "title": "Moss", "description": "Grows", "temporal_model": "affine"}
    save_model(model, {"weight": torch.zeros(2)}, card, kind="ntm")
    code = (
        "import sys\n"
        "for name in ('torch', 'numpy', 'OpenEXR', 'safetensors'): sys.modules[name] = None\n"
        "from model_runtime.cli import main\n"
        "sys.exit(main(sys.argv[1:]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, "info", "--ntm", str(model), "--json"],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=True,
    )
    (listed,) = json.loads(done.stdout)
    assert listed.items() >= card.items()


def test_info_says_that_a_model_is_named_as_a_bundled_one(tmp_path: Path):
    model = tmp_path / "mine.safetensors"
    for name, said in (("rust", "not the bundled model of this name"), ("lichen", "Mine: Grows\n")):
        card = {"name": name, "title": "Mine", "description": "Grows", "temporal_model": "affine"}
        save_model(model, {"weight": torch.zeros(2)}, card, kind="ntm")
        assert said in command("info", "--ntm", model).stdout
    assert "not the bundled" not in command("info").stdout


def test_info_on_a_file_that_is_no_model(tmp_path: Path):
    (tmp_path / "broken.safetensors").write_bytes(b"\x07")
    done = command("info", "--ntm", tmp_path / "broken.safetensors")
    assert done.returncode == 1
    assert "broken.safetensors" in done.stderr


def test_info_lists_the_others_and_says_which_file_it_skipped(tmp_path: Path):
    card = {"name": "moss", "title": "Moss", "temporal_model": "affine"}
    weights = {"weight": torch.zeros(2)}
    save_model(tmp_path / "moss.safetensors", weights, card, kind="ntm")
    for name, title in (("half", "\ud800"), ("code", "\x1b[2J" + "x" * 900_000), ("null", None)):
        path = tmp_path / f"{name}.safetensors"
        save_model(path, weights, card | {"title": title}, kind="ntm")
    code = (
        "import sys\nfrom pathlib import Path\nfrom model_runtime.model_files import weights\n"
        "weights.list_models.__defaults__ = ((Path(sys.argv.pop(1)),),)\n"
        "from model_runtime.cli import main\nsys.exit(main(sys.argv[1:]))"
    )

    def info(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-c", code, str(tmp_path), "info", *words],
            capture_output=True,
            text=True,
            cwd=ROOT,
            check=False,
        )

    done = info()
    assert done.returncode == 0
    assert done.stdout.split() == ["moss", "Moss:"]
    said = done.stderr.splitlines()
    assert len(said) == 3
    for name, line in zip(("code", "half", "null"), said, strict=True):
        assert f"{name}.safetensors" in line
        assert len(line) < 300
        assert line.isprintable()
        alone = info("--ntm", str(tmp_path / f"{name}.safetensors"))
        assert (alone.returncode, alone.stdout) == (1, "")
        assert len(alone.stderr.splitlines()) == 1


@pytest.mark.parametrize("library", ["numpy", "OpenEXR", "PIL"])
def test_a_python_that_lacks_a_library_is_told_what_to_do(tmp_path: Path, library: str):
    code = (
        f"import sys\nsys.modules[{library!r}] = None\n"
        "from model_runtime.cli import main\nsys.exit(main(sys.argv[1:]))"
    )
    words = ["age", "--input", str(tmp_path), "--ntm", "rust", "--output", str(tmp_path / "out")]
    done = subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert done.returncode == 1
    assert "Worker Python" in done.stderr
    assert "Traceback" not in done.stderr


AGE = ["age", "--ntm", "rust", "--frames", "3", "--input", str(ROOT)]


def shell(script: str, *words: str | Path, cwd: Path = ROOT, **environment: str):
    """Run `script`, in which "$@" is the command with `words`; text that is no UTF-8 is kept."""
    return subprocess.run(
        ["/bin/bash", "-c", script, "bash", sys.executable, str(STUB), *map(str, words)],
        capture_output=True,
        text=True,
        errors="surrogateescape",
        cwd=cwd,
        env=os.environ | {"TVBRDF_STUB_SECONDS": "0"} | environment,
        timeout=60,
        check=False,
    )


@pytest.mark.skipif(sys.platform != "linux", reason="needs /dev/full")
class TestStreams:
    """Wherever stdout and stderr lead: no traceback, and an exit code that says what happened."""

    @pytest.mark.parametrize("words", [["--json"], []])
    @pytest.mark.parametrize(
        ("script", "code", "said"),
        [
            ('"$@" > /dev/full', 1, "Standard output cannot be written (No space left on device)."),
            ('"$@" | true; exit ${PIPESTATUS[0]}', 1, ""),
            ('"$@" 2>&-', 0, ""),
            ('"$@" 2> /dev/full', 0, ""),
            ('"$@" 2> >(true)', 0, ""),
            ('"$@" <&-', 0, ""),
        ],
    )
    def test_age(self, tmp_path: Path, script: str, code: int, said: str, words: list[str]):
        done = shell(script, *AGE, "--output", tmp_path / "out", *words)
        assert done.returncode == code
        assert said in done.stderr
        assert "Traceback" not in done.stderr
        assert "Exception" not in done.stderr
        aged = (tmp_path / "out" / "aged.json").read_text()
        if code == 0 and words:
            assert json.loads(done.stdout) == json.loads(aged)

    def test_closed_stdout(self, tmp_path: Path):
        """It is no matter, unless it is asked for."""
        done = shell('"$@" >&-', *AGE, "--output", tmp_path / "out")
        assert (done.returncode, "Traceback" in done.stderr) == (0, False)
        assert (tmp_path / "out" / "aged.json").exists()
        for words in ([*AGE, "--output", tmp_path / "json", "--json"], ["info", "--json"]):
            done = shell('"$@" >&-', *words)
            assert done.returncode == 1
            assert done.stderr.strip() == (
                "model_runtime: Standard output is closed. --json needs one to print on."
            )
        assert not (tmp_path / "json").exists()

    def test_everything_closed(self, tmp_path: Path):
        """No file takes the place of a stream, and what is printed there."""
        done = shell('"$@" <&- >&- 2>&-', *AGE, "--output", tmp_path / "out")
        assert done.returncode == 0
        assert json.loads((tmp_path / "out" / "aged.json").read_text())["frames"] == 3

    @pytest.mark.parametrize("words", [["info"], ["info", "--json"], ["--help"], ["age", "--help"]])
    def test_text(self, words: list[str]):
        for script in ('"$@" > /dev/full', '"$@" | true; exit ${PIPESTATUS[0]}'):
            done = shell(script, *words)
            # argparse says nothing of help that does not arrive
            assert done.returncode == (0 if "--help" in words else 1)
            assert "Traceback" not in done.stderr
            assert "Exception" not in done.stderr

    def test_wrong_usage_with_a_full_stderr(self):
        assert shell('"$@" 2> /dev/full', "age").returncode == 2

    def test_a_path_that_is_no_text(self, tmp_path: Path):
        out = tmp_path / os.fsdecode(b"caf\xe9")
        done = shell('"$@"', *AGE, "--output", out)
        assert (done.returncode, done.stderr.count("Traceback")) == (0, 0)
        assert "caf\\udce9" in done.stdout
        done = shell('"$@"', *AGE[:-1], out / "no", "--output", tmp_path / "other")
        assert done.returncode == 1
        assert "caf" in done.stderr
        assert "Traceback" not in done.stderr


@pytest.mark.parametrize("writable", [True, False])
def test_what_nobody_has_foreseen_is_a_sentence_and_a_log(tmp_path: Path, writable: bool):
    code = (
        "import sys, tempfile, types\n"
        "import model_runtime.request\n"
        f"tempfile.tempdir = {str(tmp_path if writable else tmp_path / 'none')!r}\n"
        "def fail(*_): raise KeyError('unforeseen \\x1b[2J' + 'x' * 9999)\n"
        "stub = types.ModuleType('model_runtime.age')\n"
        "stub.age, stub.AgeRequest = fail, model_runtime.request.MissingLibraryError\n"
        "sys.modules['model_runtime.age'] = stub\n"
        "import model_runtime.cli\n"
        "model_runtime.cli.request_from = lambda fields: None\n"
        "sys.exit(model_runtime.cli.main(sys.argv[1:]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *AGE, "--output", str(tmp_path / "out")],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith("model_runtime: This should not happen (KeyError). Please report it")
    assert len(line) < 400
    logs = list(tmp_path.glob("tvbrdf-*.log"))
    assert len(logs) == writable
    for log in logs:
        assert line.endswith(f"and the file {log}.")
        assert "Traceback" in log.read_text()
        assert "KeyError: 'unforeseen" in log.read_text()


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such signals")
class TestSignals:
    """The real run, ended while it computes or writes."""

    def end(self, tmp_path: Path, number: int, stage: str, before: str = "") -> tuple[int, str]:
        """Start a run that would take long, and end it at `stage`: its exit code, what it said."""
        if not (source := tmp_path / "in").exists():
            write_painted_steel(source, 64)
        words = ["--ntm", "rust", "--size", "256", "--frames", "2000", "--output", tmp_path / "out"]
        words = [sys.executable, "-m", "model_runtime", "age", "--input", source, *words]
        run = subprocess.Popen(
            ["/bin/bash", "-c", f'{before} exec "$@"', "bash", *map(str, words)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert run.stderr is not None
        for line in run.stderr:
            if stage in line:
                break
        run.send_signal(number)
        _, said = run.communicate(timeout=60)
        return run.returncode, said

    @pytest.mark.parametrize(
        ("number", "stage", "before"),
        [
            # as in the background of a script
            (signal.SIGINT, "modeling", "trap '' INT;"),
            (signal.SIGTERM, "writing", ""),
            (signal.SIGHUP, "reading", ""),
        ],
    )
    def test_nothing_is_left(self, tmp_path: Path, number: int, stage: str, before: str):
        code, said = self.end(tmp_path, number, stage, before)
        assert code == 128 + number
        assert said.strip().splitlines()[-1] == (
            "model_runtime: Interrupted; nothing is left half-written."
        )
        assert "Traceback" not in said
        assert [path.name for path in tmp_path.iterdir()] == ["in"]

    def test_a_killed_run_s_files_go_with_the_next_one(self, tmp_path: Path):
        code, _ = self.end(tmp_path, signal.SIGKILL, "writing")
        assert code == -signal.SIGKILL
        assert len(list(tmp_path.glob(".out.partial-*"))) == 1
        with StagedResult(tmp_path / "out"):
            assert len(list(tmp_path.glob(".out.partial-*"))) == 1
        assert [path.name for path in tmp_path.iterdir()] == ["in"]
