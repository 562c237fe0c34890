# Each goal sets up all it needs in .venv, then does its job.
# PYTHON=/path/to/python chooses the interpreter of a new .venv; ARGS="..." is handed to the command.

SHELL := /bin/sh
PYTHON ?=
ARGS ?=
STAMP := .venv/.installed
RUN := .venv/bin
define BOUNDS
import re, sys, tomllib
project = tomllib.load(open("pyproject.toml", "rb"))["project"]
extras = project["optional-dependencies"]
wanted = [extras[name] for name in ("results", "train", "dev", "video", "render")]
for line in sum(wanted, project["dependencies"]):
    if sys.argv[1] == "lowest" and (lower := re.match(r"([\w.-]+)>=([\d.]+)", line)):
        print(f"{lower[1]}=={lower[2]}")
endef
export BOUNDS

# The caller's own Python settings must not leak into .venv.
unexport PYTHONHOME PYTHONPATH VIRTUAL_ENV
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.DEFAULT_GOAL := help
.PHONY: help install train test slow peers lowest newest coverage bench soak cluster cluster-long reproduce examples neighbours docs clean FORCE

help: ## list what can be made
	@awk -F ':.*## ' '/^[a-z ]+:.*## / { printf "make %-10s %s\n", $$1, $$2 }' Makefile

install: $(STAMP) ## set up .venv with the tested versions; the second time there is nothing to do

train: install ## train 40 swimmers in a linear field and evaluate them: a new folder in runs/
	$(RUN)/swarm train experiment=linear_n4 evaluate=true $(ARGS)

test: install ## style, types and every test that is not slow
	$(RUN)/ruff check .
	$(RUN)/ruff format --check .
	$(RUN)/mypy
	$(RUN)/lint-imports
	$(RUN)/pytest -m "not slow" -n 2 $(ARGS)

slow: install ## the slow tests
	$(RUN)/pytest -m slow -n 2 $(ARGS)

coverage: install ## the tests that are not slow, and which lines they reach
	$(RUN)/pytest -m "not slow" -n 2 --cov --cov-report=term-missing:skip-covered $(ARGS)

lowest newest: ## the tests that are not slow with the lowest, or the newest, allowed versions, in a venv of their own
	@test -x .venv-$@/bin/python || $(or $(PYTHON),python3) -m venv .venv-$@
	@.venv-$@/bin/python -c "$$BOUNDS" $@ > .venv-$@/bounds.txt
	.venv-$@/bin/python -m pip install -qq --upgrade --upgrade-strategy eager -c .venv-$@/bounds.txt -e '.[train,dev]'
	.venv-$@/bin/python -m pytest -m "not slow" -W default -n 2 $(ARGS)

bench: install ## measure speed against the alternatives
	$(RUN)/python -m benchmarks $(ARGS)

soak: install ## hours of simulation, watching memory and speed
	$(RUN)/python -m benchmarks.soak $(ARGS)

cluster: install ## lose a worker and a node of a local Ray cluster, and no bit of a result
cluster-long: install
cluster cluster-long:
	@$(RUN)/python -c 'import ray' 2>/dev/null || $(RUN)/python -m pip install -qq -c constraints.txt -e '.[cluster]'
	CLUSTER=$@ $(RUN)/pytest -m cluster tests/trainers/test_cluster.py $(ARGS)

reproduce: install ## every figure and table of the paper, in runs/reproduce
	$(RUN)/swarm reproduce --out runs/reproduce $(ARGS)

examples: install ## install the libraries that the examples are about, and test the examples
	@$(RUN)/python -c 'import jax, stable_baselines3, supersuit' 2>/dev/null || $(RUN)/python -m pip install -qq -c constraints.txt -e '.[examples]'
	$(RUN)/pytest tests/docs/test_examples.py $(ARGS)

neighbours: install ## try the environments beside ten other libraries, each in a venv of its own: docs/neighbours.txt
	$(RUN)/python -m tests.neighbours $(ARGS)

peers: install ## install other libraries, and run their tests and wrappers on these environments
	@$(RUN)/python -m pip install -qq -c constraints.txt -e '.[examples,peers]'
	@$(RUN)/python -m pip install -qq --no-deps moviepy decorator proglog python-dotenv tqdm # moviepy asks for an older pillow
	$(RUN)/pytest tests/envs/test_peers.py -n 2 $(ARGS)

docs: install docs/assets/crowd.html ## build the documentation in site/
	NO_MKDOCS_2_WARNING=1 $(RUN)/mkdocs build --strict $(ARGS)

docs/assets/crowd.html: $(STAMP) $(wildcard swarm/figures/page/*.py swarm/figures/page/assets/*)
	rm -f $@ && $(RUN)/swarm watch zoo:crowd_uptake --life 30 --out $@

clean: ## remove .venv and what the tools left behind; runs/ stays
	rm -rf .venv site dist build .mypy_cache .pytest_cache .ruff_cache .hypothesis .benchmarks .coverage

# The stamp holds the folder it was made for: a copied or moved .venv would run another folder's code, and one whose
# Python is gone runs nothing.
ifneq ($(shell $(RUN)/python -c pass 2>/dev/null && cat $(STAMP) 2>/dev/null),$(CURDIR))
$(STAMP): FORCE
endif

# An install that was killed leaves .installing behind; what it left half written cannot be told from what is whole,
# so the next call starts over. The lock (where flock exists) keeps two calls from working at the same time.
$(STAMP): pyproject.toml constraints.txt
	@exec 9<Makefile; \
	if command -v flock >/dev/null 2>&1; then flock -n 9 || { echo "Waiting for another install in this folder"; flock 9; }; fi; \
	if [ "$$(cat $(STAMP) 2>/dev/null)" = "$(CURDIR)" ] && $(RUN)/python -c pass 2>/dev/null \
	   && [ -z "$$(find pyproject.toml constraints.txt -newer $(STAMP))" ]; then exit 0; fi; \
	if [ -e .venv/.installing ]; then echo "The last install did not finish: starting over"; rm -rf .venv; \
	elif [ -e $(STAMP) ] && [ "$$(cat $(STAMP))" != "$(CURDIR)" ]; then echo ".venv came from another folder: starting over"; rm -rf .venv; \
	elif [ -e .venv ] && ! $(RUN)/python -c 'import pip, sys; assert sys.version_info >= (3, 11)' 2>/dev/null; then echo ".venv has no working Python: starting over"; rm -rf .venv; fi; \
	if [ ! -e .venv ]; then \
	  base=''; \
	  for below in '(3, 14)' '(4,)'; do \
	    for candidate in "$(PYTHON)" python3 python3.13 python3.12 python3.11; do \
	      [ -n "$$candidate" ] && [ -z "$$base" ] || continue; \
	      base="$$("$$candidate" -c "import ensurepip, sys, venv; assert (3, 11) <= sys.version_info < $$below; print(getattr(sys, '_base_executable', sys.executable))" 2>/dev/null)" || base=''; \
	    done; \
	  done; \
	  if [ -z "$$base" ]; then echo "No Python 3.11 or newer with the venv module was found. Name one: make install PYTHON=/path/to/python" >&2; exit 1; fi; \
	  echo "Making .venv with $$("$$base" --version), $$base"; \
	  mkdir .venv && touch .venv/.installing && "$$base" -m venv .venv || exit 1; \
	fi; \
	touch .venv/.installing; rm -f $(STAMP); \
	echo "Installing the tested versions into .venv, the first time in about 2 minutes; pip's own words: .venv/install.log"; \
	: > .venv/install.log; \
	( t=0; while sleep 10 >/dev/null 2>&1 && kill -0 $$$$ 2>/dev/null; do t=$$((t + 10)); \
	  of=' of about 120'; [ $$t -lt 120 ] || of=''; \
	  echo "  $$t s$$of: $$(grep -v WARNING .venv/install.log | tail -n 1 | cut -c 1-60)"; done ) 9>&- & told=$$!; \
	trap 'kill $$told 2>/dev/null' EXIT; trap 'exit 130' INT TERM; \
	PIP_CONSTRAINT=constraints.txt PIP_BUILD_CONSTRAINT=constraints.txt \
	  $(RUN)/python -m pip install --progress-bar off --editable '.[train,dev,docs]' > .venv/install.log 2>&1 \
	  || { tail -n 20 .venv/install.log >&2; exit 1; }; \
	printf '%s\n' "$(CURDIR)" > $(STAMP); rm .venv/.installing; \
	echo "Installed: try .venv/bin/swarm --help"
