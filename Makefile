# Two commands: "make run" (the whole automatic job on the simulated rig) and "make test" (all that CI checks).
# ARGS goes to the program: make run ARGS="--seed 7", make test ARGS="tests/kinematics -k inverse".

BIN = .venv/bin

.PHONY: run test setup lint format lock proof bench fuzz soak

run: setup
	$(BIN)/ascrcp $(ARGS)

test: lint
	$(BIN)/python -m pytest $(ARGS)

# Idempotent; a second call only compares a stamp.
setup:
	@scripts/setup.sh

lint: setup
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports --no-logo
	$(BIN)/mypy

# Put right what the formatter and the linter can put right by themselves.
format: setup
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

# The kinematics' promises at full size: 240,000 round trips and a numeric search beside. Minutes.
proof: setup
	$(BIN)/ascrcp bench proof $(ARGS)

# Every figure beside its aim; beside peers too, once they are installed: .tools/bin/uv sync --group peers
bench: setup
	$(BIN)/ascrcp bench $(ARGS)

# 2,000 corrupted cloud files over all formats: each refused with one clear error, memory flat. Minutes.
fuzz: setup
	ASCRCP_FUZZ_FILES=2000 $(BIN)/python -m pytest tests/perception/test_reader_fuzz.py $(ARGS)

# Eight hours of the screen on the rig in virtual time: does memory stay flat? ARGS="--round DIR" of a solved round.
soak: setup
	QT_QPA_PLATFORM=offscreen $(BIN)/python -m ascrcp.hmi.soak $(ARGS)

# After a change of dependencies in pyproject.toml; commit uv.lock with it.
lock: setup
	.tools/bin/uv lock
