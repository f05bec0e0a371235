"""Every error has a Chinese sentence; those the operator meets are Chinese throughout."""

import inspect
import re

import pytest

from ascrcp.core import errors
from ascrcp.core.errors import AscrcpError, DeviceError, InputError, RecognitionError, UnreachableError
from ascrcp.core.event import EVENTS
from ascrcp.session.operation import StoppedError
from ascrcp.session.wording import KINDS, SENTENCES, say_chinese

CHINESE = re.compile("[\u4e00-\u9fff]")
MET = (
    DeviceError("pan head sends no angle for 140 ms, allowed 100 ms"),
    DeviceError("pan head did not reach -90 deg in 40 s"),
    DeviceError("pan head stuck at 12.50 deg during the sweep"),
    DeviceError("lidar reports status 3, allowed 0"),
    DeviceError("lidar missed 15 of 720 lines, allowed 2% and 3 in a row"),
    DeviceError("joint sensor 3 has no value while scanning"),
    AscrcpError("no progress for 20 s: joint boom pitch does not follow"),
    AscrcpError("planned point 12 is missed by 120 mm, 3.2 deg; allowed 100 mm, 5.0 deg"),
    RecognitionError("no tunnel found: the surfaces run 31 deg off base X, allowed 20 deg"),
    RecognitionError("registration: the scans agree to 31 mm only, allowed 20 mm"),
    RecognitionError("the scan shows 12 % of the wall of the first one, needed 30 %"),
    RecognitionError("the scan shows 1 % of the arches of the first one, needed 30 %"),
    RecognitionError(
        "37 % of the wall lies more than 50 mm deeper than before, allowed 5 %: "
        "a wall that is sprayed comes nearer"
    ),
    RecognitionError("registration: the two scans did not settle on one another"),
    InputError(
        "rounds/r/joints.csv: names point 2284, the path has 2209; run `ascrcp solve` on this round again"
    ),
    UnreachableError("none of the 12 planned points has a joint solution within limits"),
    DeviceError("the compute process died while running solve; the next use starts it again"),
    InputError("rounds/round-0001/joints.csv: not there; run `ascrcp solve` on this round first"),
)


@pytest.mark.parametrize("error", MET, ids=str)
def test_sentences_the_operator_meets_are_chinese(error: AscrcpError) -> None:
    said = say_chinese(error)
    assert CHINESE.search(said)
    assert str(error) not in said, "the English sentence is not simply repeated"
    numbers = re.findall(r"\d+(?:\.\d+)?", said)
    assert all(number in str(error) for number in numbers if number != "100")


def test_every_kind_of_error_is_named() -> None:
    tree = [
        kind
        for _, kind in inspect.getmembers(errors, inspect.isclass)
        if issubclass(kind, AscrcpError)
        and kind is not errors.CancelledError
        and "__init__" not in vars(kind)  # one that says its own sentence reaches no operator
    ]
    for kind in tree:
        said = say_chinese(kind("something in file x.yaml, line 3"))
        assert CHINESE.match(said) and said.endswith("something in file x.yaml, line 3")
    assert {kind for kind, _ in KINDS} >= set(tree)


def test_a_stop_says_its_cause_in_both_languages() -> None:
    for event in EVENTS.values():
        error = StoppedError(event.cause)
        assert str(error) == event.cause[0] and say_chinese(error) == event.cause[1]


@pytest.mark.parametrize("pattern, chinese", SENTENCES)
def test_patterns_are_sound(pattern: str, chinese: str) -> None:
    groups = re.compile(pattern).groups
    used = {int(number) for number in re.findall(r"\\(\d)", chinese)}
    assert used == set(range(1, groups + 1)) or not used
    assert CHINESE.search(chinese)
