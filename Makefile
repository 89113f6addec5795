# On a machine with Python 3.11 to 3.13, make and git, `make demo` and `make test` do everything:
# each first makes or refreshes the environment in .venv from uv.lock.
#
#   PYTHON=...  the interpreter to use; else the one in .venv, else the newest one found
#   UV=...      the uv to use; else a recent one on PATH, else one installed by pip into .tools

.DEFAULT_GOAL := help
.NOTPARALLEL:

VENV := .venv
BIN := $(VENV)/bin
# Of pyyeti there are wheels for few machines; elsewhere the tests of Nastran's files are skipped.
TEST_EXTRAS := dev notebooks fem io dist $(if $(findstring Linux x86_64,$(shell uname -sm)),nastran)
# The first to know --system-certs that was tried with this uv.lock.
UV_REQUIREMENT := uv>=0.13

ifndef UV
UV := $(or $(shell uv sync --system-certs --help >/dev/null 2>&1 && command -v uv),.tools/bin/uv)
endif

export UV_PYTHON_DOWNLOADS := never
export UV_PROJECT_ENVIRONMENT := $(VENV)
# Once here instead of in every first run; where PYTHONDONTWRITEBYTECODE is set, in every run.
export UV_COMPILE_BYTECODE := 1
# Certificates that pip already trusts: the system's, and the file pip was told of.
export UV_SYSTEM_CERTS := 1
ifdef PIP_CERT
export SSL_CERT_FILE ?= $(PIP_CERT)
endif
# pyright's own Node.js comes with it; the system's may be too old to run it.
export PYRIGHT_PYTHON_GLOBAL_NODE := 0
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1
# Another active environment is not the one in use here.
unexport VIRTUAL_ENV

# The stamps lie inside .venv, so they go whenever uv makes it anew.
CORE := $(VENV)/.core-synced
TEST := $(VENV)/.test-synced
# __init__.py holds the version, which the installed metadata repeats.
SOURCES := pyproject.toml uv.lock Makefile iwanjax/__init__.py

VERSION := -c 'import sys; print("%d.%d" % sys.version_info[:2], sys.executable)'

# A pyenv shim exists for every version pyenv has and fails for those not selected, so a candidate
# counts only once it has run.
define PICK_PYTHON
python=; seen=; \
for candidate in $(or $(PYTHON),$(wildcard $(BIN)/python) python3.13 python3.12 python3.11 python3); do \
	found=$$("$$candidate" $(VERSION) 2>/dev/null) || continue; \
	case "$${found%% *}" in 3.11|3.12|3.13) python="$${found#* }"; break;; esac; \
	seen="$$seen, $$candidate is $${found%% *}"; \
done; \
if [ -z "$$python" ]; then \
	echo "iwanjax needs Python 3.11, 3.12 or 3.13; found: $${seen:-, none that runs}." \
		"Install one, or name it: make PYTHON=/path/to/python3" | sed 's/found: , /found: /' >&2; \
	exit 1; \
fi
endef

TYPES = $(BIN)/pyright --pythonpath $(BIN)/python
SYNC = $(PICK_PYTHON); "$(UV)" sync --locked --inexact --python "$$python"

.PHONY: help env demo test lint style bench house lock clean FORCE

help: ## list the targets
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/make \1|\2/p' Makefile | awk -F'|' '{printf "%-12s%s\n", $$1, $$2}'

env: $(TEST) ## make or refresh .venv with all that demo, test and notebooks need

demo: $(CORE) ## two reports in results/: a joint fitted to hammer hits, and what a model lacks
	@$(BIN)/iwanjax curves configs/modal_ringdown.yaml --out results/modal_ringdown
	@$(BIN)/iwanjax diagnose configs/concealed_spring.yaml --out results/concealed_spring
	@$(BIN)/iwanjax fit configs/modal_ringdown.yaml --out results/modal_ringdown
	@echo "what a model lacks: results/concealed_spring/report.html"
	@echo "a fitted joint:     results/modal_ringdown/report.html"

test: style ## check style and the package's types, and run the tests
	@# The type checker keeps one core busy for a minute: beside the tests instead of before them.
	@types=$$(mktemp); $(TYPES) iwanjax > "$$types" 2>&1 & checker=$$!; \
	$(BIN)/pytest -n 2 --dist worksteal; tests=$$?; \
	wait $$checker; failed=$$?; cat "$$types"; rm -f "$$types"; \
	exit $$((tests ? tests : failed))

lint: style ## check style and all types, the tests' too
	$(TYPES)

style: $(TEST)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

bench: $(TEST) ## time the kernels, one process
	$(BIN)/pytest tests/benchmarks --benchmark-only

house: $(CORE) ## count modules, tuned numbers, laws, dependencies beside their bounds
	@$(BIN)/python tests/house.py

lock: | $(UV) ## bring uv.lock in line with pyproject.toml (UPGRADE=1: newest versions)
	@$(PICK_PYTHON); "$(UV)" lock $(if $(UPGRADE),--upgrade) --python "$$python"

clean: ## remove the environment and all caches, but not results/
	rm -rf $(VENV) .tools .pytest_cache .ruff_cache .hypothesis .benchmarks .jax_cache build dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# An existing .venv of another Python than the one asked for is made anew.
ifdef PYTHON
ifneq ($(firstword $(shell $(PYTHON) $(VERSION) 2>/dev/null)),$(firstword $(shell $(BIN)/python $(VERSION) 2>/dev/null)))
$(CORE) $(TEST): FORCE
endif
endif

$(CORE): $(SOURCES) | $(UV)
	@$(SYNC)
	@touch $@

$(TEST): $(SOURCES) | $(UV)
	@$(SYNC) $(TEST_EXTRAS:%=--extra %)
	@touch $(CORE) $@

.tools/bin/uv:
	@$(PICK_PYTHON); \
	if ! "$$python" -c 'import ensurepip, venv' 2>/dev/null; then \
		echo "$$python cannot make virtual environments: install its venv module" \
			"(python3-venv on Debian and Ubuntu), or put uv on PATH." >&2; \
		exit 1; \
	fi; \
	"$$python" -m venv --clear .tools && \
	.tools/bin/python -m pip install --quiet --disable-pip-version-check "$(UV_REQUIREMENT)"
