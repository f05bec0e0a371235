"""fk, ik, machines, doctor: JSON in, JSON out."""

import json

import numpy as np
import pytest

from ascrcp.__main__ import main


def test_ik_finds_what_fk_came_from(capsys: pytest.CaptureFixture[str]) -> None:
    q = [0.2, 0.3, 0.5, -0.1, 0.1, 0.7, 2.0, 1.2]
    assert main(["fk", json.dumps({"q": q}), "--json"]) == 0
    pose = json.loads(capsys.readouterr().out)
    question = {"T": pose["T"], "held": {"5": q[4], "6": q[5]}}
    assert main(["ik", json.dumps(question), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert 1 <= len(answer["solutions"]) <= 8
    nearest = min(float(np.abs(np.array(s["q"]) - q).max()) for s in answer["solutions"])
    assert nearest < 1e-9


def test_options_may_stand_before_or_after_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["--json", "machines"], ["machines", "--json"]):
        assert main(arguments) == 0
        names = [m["name"] for m in json.loads(capsys.readouterr().out)["machines"]]
        assert {"kc", "muck", "duct"} <= set(names)


def test_machines_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["machines"]) == 0
    assert "boom telescope" in capsys.readouterr().out


def test_doctor_names_what_it_looked_at(capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["doctor", "--json"])
    tree = json.loads(capsys.readouterr().out)
    assert code == (0 if tree["ok"] else 1)
    assert {"Python", "numpy", "display", "real-time priority"} <= {c["what"] for c in tree["checks"]}
