# Age Material: everything is built, tried and tested from here.  `make` alone lists what there is.

PYTHON ?= python3.11
# Pythons whose wheels go into the zip: 3.11 serves Blender 4.2 to 5.0, 3.13 serves 5.1 and later.
PYTHONS ?= 3.11 3.13
# Where PyTorch's CPU build is taken from when pip finds it nowhere else.
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
# What the zip is for: linux-x64, macos-arm64 or windows-x64, built on any of them.
ifeq ($(OS),Windows_NT)
HERE := windows-x64
else
HERE := $(if $(filter Darwin,$(shell uname -s)),macos-arm64,linux-x64)
endif
PLATFORM ?= $(HERE)
PLATFORMS = linux-x64 macos-arm64 windows-x64
# Folder of wheels to pack, or none.
WHEELS ?= build/wheels
# Blender versions that `make test-blenders` tries besides the one in requirements-blender.txt.
BLENDERS ?= 4.2.23 5.0.1
PYTEST_ARGS ?=
# A Python with all of requirements.txt whose torch uses a GPU; that of .venv does not.
GPU_PYTHON ?=
# What `age` promises, tried without torch too.
AGING = $(patsubst %,tests/test_%.py,age age_measured age_models cli coverage grain_files grained_runs \
    look model_files output serve surface_age timing_apart wear)

# pyright would ask PyPI each time whether there is a newer one.
export PYRIGHT_PYTHON_IGNORE_WARNINGS = 1

PIP_INSTALL = -m pip install --quiet --disable-pip-version-check
READY = .venv/ready .venv-blender/ready build/wheels/$(HERE)/ready \
    build/wheels/small/$(HERE)/ready

.DELETE_ON_ERROR:
.PHONY: help gpu-check demo objects examples tutorial panels thumbnails extension extensions small repository wheels test test-blenders types format clean

help:
	@echo "make demo           age a painted steel can in Blender, into out/demo"
	@echo "make objects        age five objects by every model, into out/objects.jpg"
	@echo "make examples       three aged materials for the Asset Browser, and a scene, into out/examples"
	@echo "make tutorial       the pictures of docs/tutorial.md, and what its clicks took"
	@echo "make panels         the panel at three widths, in two themes and on a 4K screen: docs/panels.jpg"
	@echo "make thumbnails     the pictures by which models are picked, beside the models"
	@echo "make extension      build the zip to install in Blender, for PLATFORM (WHEELS=none: without torch)"
	@echo "make extensions     build that of each platform: $(PLATFORMS)"
	@echo "make small          build for each that without torch, under 30 MB: all but learning"
	@echo "make repository     a folder to put on a web server, that Blender installs and updates from"
	@echo "make test           lint, types and every test, in real Blender too"
	@echo "make test-blenders  install, age, render, revert, uninstall in Blender $(BLENDERS)"
	@echo "make gpu-check      tests, aging and training on a GPU beside the CPU, into out/gpu-check.md"
	@echo "make format         put the code in order"
	@echo "make types          check types with pyright"
	@echo "make clean          remove what was built; environments and trainings stay"

demo: $(READY)
	@extension=$$(.venv/bin/python .ci/extension.py build --wheels build/wheels --output build) \
	&& BLENDER_USER_RESOURCES="$(CURDIR)/build/demo-profile" \
	    .venv-blender/bin/python tests/demo/demo.py "$$extension" out/demo \
	&& .venv/bin/python tests/demo/contact_sheet.py out/demo

objects: $(READY)
	@mkdir -p out && extension=$$(.venv/bin/python .ci/extension.py build --wheels build/wheels --output build) \
	&& BLENDER_USER_RESOURCES="$(CURDIR)/build/demo-profile" \
	    .venv-blender/bin/python tests/demo/weathered_objects.py "$$extension" out/objects.jpg

examples: $(READY)
	@extension=$$(.venv/bin/python .ci/extension.py build --small --wheels build/wheels --output build) \
	&& BLENDER_USER_RESOURCES="$(CURDIR)/build/demo-profile" \
	    .venv-blender/bin/python tests/demo/example_files.py "$$extension" \
	    "$(CURDIR)/.venv/bin/python" out/examples

tutorial: $(READY)
	@.venv/bin/python tests/demo/tutorial.py docs/tutorial

panels: $(READY)
	@.venv/bin/python tests/demo/panels.py docs/panels.jpg

thumbnails: $(READY)
	@extension=$$(.venv/bin/python .ci/extension.py build --wheels build/wheels --output build) \
	&& BLENDER_USER_RESOURCES="$(CURDIR)/build/demo-profile" \
	    .venv-blender/bin/python tests/demo/thumbnails.py "$$extension" model_runtime/models

extension: .venv/ready $(if $(filter none,$(WHEELS)),,build/wheels/$(PLATFORM)/ready)
	@.venv/bin/python .ci/extension.py build --platform $(PLATFORM) --wheels "$(WHEELS)" --output build

extensions: .venv/ready $(PLATFORMS:%=build/wheels/%/ready)
	@for platform in $(PLATFORMS); do .venv/bin/python .ci/extension.py build \
	    --platform $$platform --wheels build/wheels --output build || exit; done

small: .venv/ready $(PLATFORMS:%=build/wheels/small/%/ready)
	@for platform in $(PLATFORMS); do .venv/bin/python .ci/extension.py build --small \
	    --platform $$platform --wheels build/wheels --output build || exit; done

repository: .venv/ready $(PLATFORMS:%=build/wheels/%/ready)
	@zips=$$(for platform in $(PLATFORMS); do .venv/bin/python .ci/extension.py build \
	    --platform $$platform --wheels build/wheels --output build || exit; done) \
	&& .venv/bin/python .ci/extension.py repository --output build/repository $$zips

wheels: build/wheels/$(PLATFORM)/ready

test: $(READY)
	.venv/bin/python -m ruff check .
	.venv/bin/python -m ruff format --check .
	.venv/bin/python -m pyright
	.venv/bin/python -m pytest -m "not blenders" $(PYTEST_ARGS)
	TVBRDF_BACKEND=numpy .venv/bin/python -m pytest $(AGING)

test-blenders: $(READY) $(foreach version,$(BLENDERS),.venv-blender-$(version)/ready)
	TVBRDF_BLENDERS="$(BLENDERS)" .venv/bin/python -m pytest -m blenders $(PYTEST_ARGS)

gpu-check: $(if $(GPU_PYTHON),,.venv/ready)
	@"$(or $(GPU_PYTHON),.venv/bin/python)" -m tests.benchmarks.gpu_check

types: .venv/ready
	.venv/bin/python -m pyright

format: .venv/ready
	.venv/bin/python -m ruff check --fix .
	.venv/bin/python -m ruff format .

clean:
	rm -rf build/wheels build/demo-profile build/repository build/tvbrdf-* out

# Environments.  Scripts inside them are not called: their first line breaks in a path with a space.

.venv/bin/python:
	.ci/system-libraries "$(PYTHON)"
	"$(PYTHON)" -m venv .venv

build/wheels/%/ready: requirements-runtime.txt | .venv/bin/python
	.venv/bin/python .ci/extension.py wheels --platform $* --output build/wheels \
	    --torch-index "$(TORCH_INDEX)" $(foreach version,$(PYTHONS),--python $(version))
	@touch $@

build/wheels/small/%/ready: requirements-runtime.txt | .venv/bin/python
	.venv/bin/python .ci/extension.py wheels --small --platform $* --output build/wheels \
	    $(foreach version,$(PYTHONS),--python $(version))
	@touch $@

.venv/ready: requirements.txt requirements-runtime.txt requirements-blender.txt build/wheels/$(HERE)/ready
	.venv/bin/python $(PIP_INSTALL) --find-links build/wheels/$(HERE)/3.11 --requirement requirements.txt
	@touch $@

.venv-blender/ready: requirements-blender.txt | .venv/bin/python
	"$(PYTHON)" -m venv .venv-blender
	.venv-blender/bin/python $(PIP_INSTALL) --requirement requirements-blender.txt
	@touch $@

.venv-blender-%/ready: requirements-blender.txt | .venv/bin/python
	"$(PYTHON)" -m venv .venv-blender-$*
	sed "s/^bpy==.*/bpy==$*/" requirements-blender.txt > .venv-blender-$*/requirements.txt
	.venv-blender-$*/bin/python $(PIP_INSTALL) --requirement .venv-blender-$*/requirements.txt
	@touch $@
