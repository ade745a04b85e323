# Each target does all of its own set-up: a virtual environment in .venv and the packages in it.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: test lint bench format proto clean
.DEFAULT_GOAL := test

.venv/ready: pyproject.toml
	@test -d .venv || $(PYTHON) -m venv .venv
	@$(BIN)/python -m pip install --quiet --editable '.[dev]'
	@touch $@

test: .venv/ready  ## every test
	$(BIN)/pytest

lint: .venv/ready  ## style, types, and who may import whom
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache

format: .venv/ready  ## mend style
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: .venv/ready  ## measured figures of the docs
	$(BIN)/python -m benchmarks

proto:  ## regenerate the protobuf code of the wire format, in an environment of its own
	@test -d .venv-proto || $(PYTHON) -m venv .venv-proto
	@.venv-proto/bin/python -m pip install --quiet 'grpcio-tools==1.74.*' 'mypy-protobuf==3.6.*'
	PATH=".venv-proto/bin:$$PATH" .venv-proto/bin/python -m grpc_tools.protoc -I src \
		--python_out=src --mypy_out=src src/autowaze/world/wire.proto

clean:  ## everything that make built
	rm -rf .venv .venv-proto build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
