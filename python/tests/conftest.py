"""A rig, a record with a hidden drag, the program and its JSON."""

import json
import os
import subprocess
from pathlib import Path

import pytest

import whirl

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def rig(tmp_path_factory):
    text = (ROOT / "rigs" / "chaotic.toml").read_text().replace("settle_s = 20.0", "settle_s = 1.0")
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    path.write_text(text)
    return path


@pytest.fixture(scope="session")
def record(rig):
    return whirl.simulate(rig, seconds=24, seed=3, effect="quadratic-drag@arm2=2e-6")


@pytest.fixture(scope="session")
def program():
    """Runs the program: exit status, JSON text, standard error."""

    def run(*words):
        done = subprocess.run([os.environ["WHIRL"], *map(os.fspath, words), "--json", "-"], capture_output=True, text=True)
        return done.returncode, done.stdout, done.stderr

    return run


@pytest.fixture
def same(program):
    """Whether an answer is the program's, for the words after the command's name."""

    def check(answer, *words):
        status, text, _ = program(*words)
        assert answer.json_text == text and answer.json == json.loads(text)
        assert answer.positive == (status == 0)

    return check
