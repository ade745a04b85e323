# Each target does all of its own set-up: a virtual environment in .venv and the packages in it.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: demo test lint bench format proto system clean
.DEFAULT_GOAL := test

.venv/ready: pyproject.toml
	@test -d .venv || $(PYTHON) -m venv .venv
	@$(BIN)/python -m pip install --quiet --editable '.[dev]'
	@touch $@

# The simulator draws with OpenGL on EGL; Debian has it in three packages. The tests start brokers of their own.
SYSTEM_PACKAGES := libegl1 libgl1 libgl1-mesa-dri mosquitto nats-server \
	postgresql-15 postgresql-15-postgis-3

system:  ## system packages, where they are missing
	@missing=$$(for p in $(SYSTEM_PACKAGES); do dpkg -s $$p >/dev/null 2>&1 || echo $$p; done); \
	test -z "$$missing" || { \
		test "$$(id -u)" = 0 && sudo= || sudo=sudo; \
		$$sudo apt-get update -qq && $$sudo apt-get install -y -qq --no-install-recommends $$missing; }

demo: .venv/ready system  ## the main job on a simulated street
	$(BIN)/autowaze demo

test: .venv/ready system  ## every test
	$(BIN)/pytest

lint: .venv/ready  ## style, types, and who may import whom
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

format: .venv/ready  ## mend style
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: .venv/ready system  ## measured figures of the docs
	$(BIN)/python -m benchmarks

proto:  ## regenerate the protobuf code of the wire format, in an environment of its own
	@test -d .venv-proto || $(PYTHON) -m venv .venv-proto
	@.venv-proto/bin/python -m pip install --quiet 'grpcio-tools==1.74.*' 'mypy-protobuf==3.6.*'
	PATH=".venv-proto/bin:$$PATH" .venv-proto/bin/python -m grpc_tools.protoc -I src \
		--python_out=src --mypy_out=src src/autowaze/world/wire.proto

clean:  ## everything that make built
	rm -rf .venv .venv-proto build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
