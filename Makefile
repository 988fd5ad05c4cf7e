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
# What the glasses have: make glasses EXTRAS="realsense serial audio"
EXTRAS ?= oak serial audio
CAMERAS_INSTALLED := $(VENV)/.installed-cameras

.DEFAULT_GOAL := help
.PHONY: help install demo test check mutants fuzz bench lock arm licences sbom glasses docs clean

help: ## show the commands
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

install: $(INSTALLED) $(if $(CAMERAS),$(CAMERAS_INSTALLED)) ## make .venv with everything that development needs (CAMERAS=1: and the cameras' SDKs)

$(INSTALLED): requirements.lock pyproject.toml .ci/install
	@PYTHON="$(PYTHON)" .ci/install $(VENV)
	@touch $@

$(CAMERAS_INSTALLED): requirements-cameras.lock $(INSTALLED)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps --no-compile \
		-r requirements-cameras.lock
	@touch $@

demo: install ## walk through the simulated building, watched in the browser
	@$(BIN)/vbr demo

test: install ## run all tests
	@.ci/test $(BIN)

check: install ## formatting, lint, types, import contracts, generated docs
	@.ci/check $(BIN)

mutants: install ## put small faults into what safety hangs on: a test must find each
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
	@$(BIN)/python -m pip install --quiet --require-hashes -r .ci/uv.lock
	@.ci/lock $(BIN)

arm: install ## resolve what the glasses need for aarch64, from wheels alone
	@$(BIN)/python -m pip install --quiet --require-hashes -r .ci/uv.lock
	@.ci/arm $(BIN)

licences: install ## list every locked package with its licence; fails where one does not go with Apache-2.0
	@$(BIN)/python .ci/licences

sbom: install ## write the bills of materials (CycloneDX) of the glasses and of everything (EXTRAS="oak serial audio")
	@$(BIN)/python .ci/sbom sbom/glasses.json $(EXTRAS)
	@$(BIN)/python .ci/sbom sbom/whole.json --whole

glasses: install ## make dist/glasses, to be installed on a device with every hash checked (EXTRAS="oak serial audio")
	@.ci/glasses $(BIN) $(EXTRAS)

clean: ## remove the virtual environment and what the demo keeps
	@rm -rf $(VENV) .vbr
