"""`--command age_material` on many materials: patterns, job files, progress for a farm's log."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import bpy
import pytest

from tests.blender.three_planes import QUICK, USUAL, aged, build
from tvbrdf.tvbrdf_addon.headless import progress
from tvbrdf.tvbrdf_addon.headless.command import main

pytestmark = pytest.mark.usefixtures("stub_worker")


@pytest.fixture
def folder(empty_scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "0")
    monkeypatch.chdir(tmp_path)
    build(tmp_path)
    return tmp_path


def cannot_be_aged(name: str = "Smoke") -> None:
    """A material without a surface."""
    bpy.data.materials.new(name).use_nodes = True
    bpy.data.materials[name].node_tree.nodes.clear()


def report_of(folder: Path, name: str) -> dict:
    return json.loads((folder / "aged" / name / "aged.json").read_text())


def test_a_pattern_means_all_that_match(folder: Path, capfd):
    bpy.data.materials["Oak"].name = "Copper Oak"
    assert main(["--material", "Copper*", *USUAL]) == 0
    assert aged() == {"Copper", "Copper Oak"}
    assert "age_material: 2 materials done." in capfd.readouterr().out


def test_a_name_that_looks_like_a_pattern_is_a_name(folder: Path):
    bpy.data.materials["Oak"].name = "[SC]*"
    assert main(["--material", "[SC]*", *USUAL]) == 0
    assert aged() == {"[SC]*"}


def test_all_leaves_out_what_cannot_be_aged_and_says_so(folder: Path, capfd):
    cannot_be_aged()
    assert main(["--all", *USUAL, "--save-as", "aged.blend"]) == 0
    assert aged() == {"Steel", "Copper", "Oak"}
    assert (folder / "aged.blend").is_file()
    out = capfd.readouterr().out
    assert re.search(r"^Smoke: Left out: .+\.$", out, re.MULTILINE)
    assert "3 materials done, saved as " in out


def test_what_is_linked_is_left_out_of_a_pattern(folder: Path, capfd):
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(folder / "file.blend"), link=True) as (_, to):
        to.materials = ["Steel"]
    assert main(["--all", *USUAL, "--output", str(folder / "aged")]) == 0
    assert "Steel: Left out:" in capfd.readouterr().out
    assert aged() == set()


def test_what_was_named_and_cannot_be_aged_fails_and_the_rest_is_done(folder: Path, capfd):
    cannot_be_aged()
    words = ["--material", "Smoke", "--material", "Cooper", "--material", "Zinc*"]
    assert main([*words, "--material", "Steel", *USUAL, "--save-as", "aged.blend"]) == 1
    assert aged() == {"Steel"}
    assert not (folder / "aged.blend").exists()
    err = capfd.readouterr().err
    assert "There is no material called Cooper. Did you mean Copper?" in err
    assert "No material has a name like Zinc*." in err
    assert "Not aged: Cooper, Zinc*, Smoke. aged.blend was not written." in err


def test_a_job_file_says_what_becomes_of_whom(folder: Path):
    (folder / "jobs.txt").write_text(
        "\ufeff# after the fire\n"
        "\n"
        "--material 'Copper' --ntm patina --amount 0.5   # a comment\n"
        "--material Oak --ntm char --frames 5-9 --steps 3\n",
        encoding="utf-8",
    )
    assert main(["--all", *USUAL, "--jobs", "//jobs.txt"]) == 0
    assert aged() == {"Steel", "Copper", "Oak"}
    models = {name: Path(report_of(folder, name)["ntm"]).stem for name in sorted(aged())}
    assert models == {"Copper": "patina", "Oak": "char", "Steel": "rust"}
    assert report_of(folder, "Oak")["frames"] == 3
    assert report_of(folder, "Copper")["frames"] == 4, "of the command line"
    oak, copper = (bpy.data.materials[name].tvbrdf for name in ("Oak", "Copper"))
    assert (oak.frame_start, oak.frame_end) == (5, 9)
    assert copper.amount == pytest.approx(0.5)
    assert oak.amount == 1.0, "what a line says holds for it alone"


def test_a_job_file_is_enough(folder: Path):
    (folder / "jobs.txt").write_text("--material Steel --ntm rust\n--material O*k --ntm char\n")
    assert main(["--jobs", "jobs.txt", *QUICK]) == 0
    assert aged() == {"Steel", "Oak"}


def test_tasks_share_the_materials(folder: Path, capfd):
    """Each material is one task's, and what is not there is said once."""
    cannot_be_aged()
    words = ["--all", "--material", "Zinc", *USUAL, "--output", "results"]
    shares = []
    for part, code in ((1, 1), (2, 0), (3, 0), (4, 0), (5, 0)):
        bpy.ops.wm.open_mainfile(filepath=str(folder / "file.blend"))
        cannot_be_aged()
        assert main([*words, "--share", f"{part}/5"]) == code
        shares.append(aged())
    assert sorted(shares, key=sorted) == [set(), set(), {"Copper"}, {"Oak"}, {"Steel"}]
    out, err = capfd.readouterr()
    assert out.count("Smoke: Left out:") == 1
    assert err.count("Zinc.") == 2, "why, and that it was not aged"
    for wrong in ("0/3", "4/3", "1", "-1/2", "1/"):
        assert main([*words, f"--share={wrong}"]) == 2


def test_places_are_kept_as_the_panel_has_them(folder: Path):
    words = ["--material", "Steel", "--ntm", "rust", "--frames", "1-20", "--size", "16"]
    places = ["--exposure", "sky=1,ground=-0.5", "--pattern-size", "0.25", "--amount", "0.5"]
    assert main([*words, *places]) == 0
    kept = bpy.data.materials["Steel"].tvbrdf
    assert kept.use_own_exposure
    assert (kept.exposure.sky, kept.exposure.ground) == (1.0, -0.5)
    assert kept.exposure.edges > 0, "as the model has it"
    assert (kept.pattern_size, kept.amount) == (0.25, 0.5)


@pytest.mark.parametrize(
    ("lines", "sentences"),
    [
        ("--material Steel\n--surprise", ["line 1: the following arguments are required: --ntm"]),
        ("\n--surprise", ["jobs.txt, line 2: unrecognized arguments: --surprise"]),
        ("--ntm rust", ["line 1: one of --material and --all is required"]),
        ("--material 'Steel --ntm rust", ["line 1: No closing quotation"]),
        ("--all --ntm rust --amount 2\n--help", ["2 is not a number", "line 2: unrecognized"]),
        ("--all --ntm rust --save-as x.blend", ["unrecognized arguments: --save-as x.blend"]),
        ("--nonsense\n" * 30, ["line 20: unrecognized", "10 more lines are like that."]),
        ("--all --ntm rust --exposure edges=2", ["the weight of edges is not a number"]),
    ],
)
def test_wrong_lines_are_all_said_before_any_work(
    folder: Path, capfd, lines: str, sentences: list[str]
):
    (folder / "jobs.txt").write_text(f"{lines}\n")
    assert main([*QUICK, "--jobs", "jobs.txt"]) == 2
    err = capfd.readouterr().err
    assert [each for each in sentences if each not in err] == []
    assert aged() == set()
    assert sorted(path.name for path in folder.iterdir()) == ["file.blend", "jobs.txt"]


def test_a_job_that_fails_names_its_line_and_stops_no_other(folder: Path, capfd):
    (folder / "jobs.txt").write_text("--material Oak --ntm frost\n--material Steel --ntm rust\n")
    assert main(["--jobs", "jobs.txt", *QUICK]) == 1
    assert aged() == {"Steel"}
    err = capfd.readouterr().err
    assert "jobs.txt, line 1: There is no model called 'frost'." in err
    assert "Not aged: Oak." in err


@pytest.mark.parametrize(
    ("content", "sentence"),
    [(b"#" * (1 << 20) + b"#", "is larger than 1 MB"), (b"\xff\xfe\x00", "is no text in UTF-8")],
)
def test_a_job_file_has_to_be_one(folder: Path, capfd, content: bytes, sentence: str):
    (folder / "jobs.txt").write_bytes(content)
    assert main(["--jobs", "jobs.txt", *QUICK]) == 1
    assert main(["--jobs", "nowhere.txt", *QUICK]) == 1
    err = capfd.readouterr().err
    assert sentence in err
    assert "nowhere.txt cannot be read" in err


def test_progress_is_a_line_a_second_at_most(folder: Path, capfd, monkeypatch):
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "1.6")
    began = time.monotonic()
    assert main(["--material", "Steel", "--material", "Oak", *USUAL, "--steps", "60"]) == 0
    seconds = time.monotonic() - began
    lines = re.findall(
        r"^(\w+): (\d+)% \w.* \((\d) of 2, (\d+)% of all\)$", capfd.readouterr().out, re.MULTILINE
    )
    assert 3 <= len(lines) <= seconds + 1
    assert {name for name, *_ in lines} == {"Steel", "Oak"}
    whole = [int(each[-1]) for each in lines]
    assert whole == sorted(whole)
    for name, own, number, all_of_them in lines:
        assert number == {"Steel": "1", "Oak": "2"}[name]
        assert abs(int(all_of_them) - (50 * (int(number) - 1) + int(own) / 2)) <= 1


def test_progress_as_open_job_description_has_it(folder: Path, capfd, monkeypatch):
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "0.5")
    monkeypatch.setattr(progress, "_SECONDS", 0.1)
    assert main(["--material", "Steel", *USUAL, "--progress", "openjd", "--steps", "60"]) == 0
    out = capfd.readouterr().out
    shares = [float(each) for each in re.findall(r"^openjd_progress: ([\d.]+)$", out, re.MULTILINE)]
    assert len(shares) > 2
    assert all(0 <= each <= 100 for each in shares)
    assert len(re.findall(r"^openjd_status: Steel: \d+% \w", out, re.MULTILINE)) == len(shares)


def test_a_quiet_log_has_what_needs_a_look_and_what_came_of_it(folder: Path, capfd):
    cannot_be_aged()
    assert main(["--all", *USUAL, "--quiet"]) == 0
    out, err = capfd.readouterr()
    said = [line for line in out.splitlines() if line.startswith(("Steel", "Oak", "Copper", "Sm"))]
    assert said[0].startswith("Smoke: Left out:")
    assert all("Warning:" in line for line in said[1:])
    assert len(said) == 4
    assert "age_material: 3 materials done." in out
    assert err == ""
