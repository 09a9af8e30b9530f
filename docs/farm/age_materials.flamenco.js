// SPDX-License-Identifier: GPL-3.0-or-later
//
// A job type for Flamenco: materials age in tasks of their own, one task shows them, frames are
// rendered.  It goes into the folder `scripts` beside the Manager; docs/farm.md says more.

const JOB_TYPE = {
  label: "Age Materials",
  description: "Age materials in parallel, save the scene that shows them, and render it",
  settings: [
    {
      key: "job_file", type: "string", subtype: "file_path", required: true,
      description: "Which materials age and how, a line each, such as --all --ntm rust",
    },
    {
      key: "age_frames", type: "string", required: true,
      eval: "f'{C.scene.frame_start}-{C.scene.frame_end}'",
      description: "From which frame to which they age, unless a line says otherwise",
    },
    {
      key: "tasks", type: "int32", default: 10, propargs: { min: 1, max: 10000 },
      description: "How many tasks share the materials",
    },
    {
      key: "results", type: "string", subtype: "dir_path", required: true,
      description: "A folder for the results and the aged scene, which the scene does not use yet",
    },
    {
      key: "frames", type: "string", required: true,
      eval: "f'{C.scene.frame_start}-{C.scene.frame_end}'",
      description: "The frames to render, such as 1-30 or 3, 5-10",
    },
    {
      key: "chunk_size", type: "int32", default: 1, propargs: { min: 1, max: 10000 },
      description: "How many frames a task renders",
    },
    {
      key: "pictures", type: "string", subtype: "dir_path", required: true,
      description: "A folder for the rendered frames",
    },
    { key: "blendfile", type: "string", required: true, visible: "web", description: "The scene" },
  ],
};

function compileJob(job) {
  const settings = job.settings;
  const agedFile = path.join(settings.results, `${path.stem(settings.blendfile)}-aged.blend`);
  const aging = ["--jobs", settings.job_file, "--frames", settings.age_frames];

  const bind = author.Task("bind", "blender");
  bind.addCommand(blender(settings.blendfile, [
    "--command", "age_material", ...aging, "--bind", settings.results, "--save-as", agedFile,
  ]));
  for (let task = 1; task <= settings.tasks; task++) {
    const age = author.Task(`age-${task}`, "blender");
    age.addCommand(blender(settings.blendfile, [
      "--command", "age_material", ...aging,
      "--share", `${task}/${settings.tasks}`, "--output", settings.results,
    ]));
    job.addTask(age);
    bind.addDependency(age);
  }
  job.addTask(bind);

  for (const chunk of frameChunker(settings.frames, settings.chunk_size)) {
    const render = author.Task(`render-${chunk}`, "blender");
    render.addCommand(blender(agedFile, [
      "--render-output", path.join(settings.pictures, "######"),
      "--render-frame", chunk.replaceAll("-", ".."), // as Blender has ranges
    ]));
    render.addDependency(bind);
    job.addTask(render);
  }
}

// What a worker runs: Blender as the Manager knows it, with these words after the file.
function blender(file, words) {
  return author.Command("blender-render", {
    exe: "{blender}",
    exeArgs: "{blenderArgs}",
    argsBefore: [],
    blendfile: file,
    args: words,
  });
}
