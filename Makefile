# Everything runs from a virtual environment in this checkout, made from the lock file.
PYTHON ?= python3
DATA ?= ../shared/data
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
# How long to fuzz, all targets together, and which: make fuzz SECONDS=3600 TARGETS="ply pcd"
SECONDS ?=
TARGETS ?=
# The SDKs of the depth cameras: make install CAMERAS=1
CAMERAS ?=
CAMERAS_INSTALLED := $(VENV)/.installed-cameras

.DEFAULT_GOAL := help
.PHONY: help install demo test check mutants fuzz bench lock arm docs clean

help: ## show the commands
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

install: $(INSTALLED) $(if $(CAMERAS),$(CAMERAS_INSTALLED)) ## make .venv with everything that development needs (CAMERAS=1: and the cameras' SDKs)

$(INSTALLED): requirements.lock pyproject.toml .ci/install
	@PYTHON="$(PYTHON)" .ci/install $(VENV)
	@touch $@

$(CAMERAS_INSTALLED): requirements-cameras.lock $(INSTALLED)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-cameras.lock
	@touch $@

demo: install ## walk through the simulated building, watched in the browser
	@$(BIN)/vbr demo

test: install ## run all tests
	@.ci/test $(BIN)

check: install ## formatting, lint, types, import contracts, generated docs
	@.ci/check $(BIN)

mutants: install ## put small faults into gate and follower: a test must find each
	@OPENBLAS_NUM_THREADS=1 $(BIN)/python .ci/mutants

fuzz: install ## read spoiled files of every kind, guided by coverage (SECONDS: longer, TARGETS: some)
	@.ci/fuzz $(SECONDS) $(TARGETS)

bench: install ## measure speed, accuracy and memory (DATA: folder of the real recordings)
	@.ci/bench $(BIN) "$(DATA)"

docs: install ## write the generated pages of docs/
	@$(BIN)/vbr settings --markdown > docs/settings.md
	@$(BIN)/vbr cues --markdown > docs/cues.md
	@$(BIN)/vbr link --markdown > docs/link.md
	@$(BIN)/vbr states --markdown > docs/states.md
	@$(BIN)/vbr doctor --markdown > docs/doctor.md
	@$(BIN)/vbr alerts --markdown > docs/alerts.md

lock: install ## resolve the dependencies anew
	@$(BIN)/python -m pip install --quiet uv
	@.ci/lock $(BIN)

arm: install ## resolve what the glasses need for aarch64, from wheels alone
	@$(BIN)/python -m pip install --quiet uv
	@.ci/arm $(BIN)

clean: ## remove the virtual environment and what the demo keeps
	@rm -rf $(VENV) .vbr
