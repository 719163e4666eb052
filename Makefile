# make paint    install, paint the bundled cow with the built-in prior, print the path of a GLB
# make test     install, run the tests (about five minutes on two cores)
# make lint     ruff, pyright, the layer contract
# make bench    seconds per step, split by stage, at three mesh sizes; ratios within one run
# make bench-gpu  one step in the paper's setting, full-size Stable Diffusion 2.1 with random weights, stage by stage: ms, TFLOP,
#               memory, against plain float32; without a GPU reduced to two minutes; ARGS="--steps 1000" paints one whole
# make test-slow  the checks that take minutes each
# make judge    our pictures against Cycles and three.js (needs a Chromium) and Mitsuba, and maps recovered from renders; about
#               an hour
# make reproduce  the paper's tables and figures, rerun into docs/reproduction.md; hours, goes on where it was; SMOKE=1: minutes
# make train-pocket  train the built-in prior anew (training/pocket/README.md)

PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
PROMPT ?= a brown and white dairy cow with short fur
MESH   ?= assets/meshes/spot/spot.obj
OUTPUT ?= outputs/spot.glb

.PHONY: paint test test-slow lint bench bench-gpu judge reproduce train-pocket clean
.DEFAULT_GOAL := paint

$(BIN)/paintit: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --constraint constraints.txt --editable .
	@touch $@

$(VENV)/.dev: $(BIN)/paintit
	$(BIN)/pip install --quiet --constraint constraints.txt --editable ".[dev,judges]"
	@touch $@

tests/node_modules: tests/package.json tests/package-lock.json
	npm ci --prefix tests --no-audit --no-fund --loglevel=error
	@touch $@

paint: $(BIN)/paintit
	$(BIN)/paintit paint $(MESH) "$(PROMPT)" -o $(OUTPUT) --overwrite

test: $(VENV)/.dev tests/node_modules
	$(BIN)/pytest -m "not slow"

test-slow: $(VENV)/.dev tests/node_modules
	$(BIN)/pytest -m slow

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python
	$(BIN)/lint-imports

bench: $(BIN)/paintit
	$(BIN)/python benchmarks/step.py

bench-gpu: $(VENV)/.dev
	$(BIN)/python -m benchmarks.gpu $(ARGS)

judge: $(VENV)/.dev tests/node_modules
	$(BIN)/python -m benchmarks.viewers
	$(BIN)/python -m benchmarks.transport
	for mesh in avocado water_bottle; do \
		$(BIN)/python benchmarks/ground_truth.py --mesh $$mesh --steps 500 --picture outputs/viewers/$${mesh}_fit.png || exit 1; done
	$(BIN)/python benchmarks/ground_truth.py --mesh flight_helmet --steps 2000 --lr 5e-3 --views 6 --close-up 0.75 \
		--picture outputs/viewers/flight_helmet_fit.png

reproduce: $(VENV)/.dev
	$(BIN)/python -m reproduction $(if $(SMOKE),--smoke)

# The recipe of the shipped weights is in training/pocket/README.md; SMOKE=1 walks the whole pipeline in minutes.
POCKET := training/pocket
WORK   := $(POCKET)/work$(if $(SMOKE),/smoke)
train-pocket: $(BIN)/paintit
	$(BIN)/python $(POCKET)/gbuffers.py --out $(WORK)/gbuffers $(if $(SMOKE),--shapes 60)
	$(BIN)/python $(POCKET)/data.py --gbuffers $(WORK)/gbuffers --out $(WORK)/data $(if $(SMOKE),--samples 600 --chunk 300 --synthetic 1)
	$(BIN)/python $(POCKET)/train.py --gbuffers $(WORK)/gbuffers --data $(WORK)/data --out $(WORK)/run $(if $(SMOKE),--smoke)
	$(BIN)/python $(POCKET)/sample.py --weights $(WORK)/run/pocket.safetensors --out $(WORK)/samples.png

clean:
	rm -rf $(VENV) tests/node_modules outputs .pytest_cache .ruff_cache
