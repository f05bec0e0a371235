"""Codec: the compiled packing equals cantools', and nothing unfit is ever packed."""

import math

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ascrcp.core.errors import ConfigError, InputError
from ascrcp.devices.codec import Codec
from ascrcp.devices.machine_link import DBC

CODEC = Codec(DBC)
DATABASE = cantools.database.load_file(DBC)
NAMES = sorted(CODEC.by_name)


@pytest.mark.parametrize("name", NAMES)
@given(data=st.binary(min_size=8, max_size=8))
def test_decode_equals_cantools(name, data):
    layout = CODEC.layout(name)
    data = data[: layout.length]
    truth = DATABASE.decode_message(name, data, decode_choices=False)
    for field, value in zip(layout.fields, layout.decode(data), strict=True):
        assert value == pytest.approx(truth[field.name], abs=1e-9)


@pytest.mark.parametrize("name", NAMES)
@given(parts=st.lists(st.floats(0.0, 1.0), min_size=8, max_size=8))
def test_encode_equals_cantools_and_decodes_again(name, parts):
    layout = CODEC.layout(name)
    values = tuple(
        f.minimum + part * (f.maximum - f.minimum) for f, part in zip(layout.fields, parts, strict=False)
    )
    frame = bytes(layout.encode(values))
    for field, value, back in zip(layout.fields, values, layout.decode(frame), strict=True):
        assert abs(back - value) <= field.scale * 0.5 * (1 + 1e-9)
    signals = dict(zip((f.name for f in layout.fields), layout.decode(frame), strict=True))
    assert DATABASE.encode_message(name, {"Crc": 0, "Counter": 0, **signals}) == frame


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e9, -1e9])
def test_f15_what_is_not_finite_or_in_range_is_never_packed(name, bad):
    layout = CODEC.layout(name)
    for i in range(len(layout.fields)):
        values = [f.minimum for f in layout.fields]
        values[i] = bad
        with pytest.raises(InputError, match=layout.fields[i].name):
            layout.encode(tuple(values))


def test_identifiers_are_apart_and_eleven_bit():
    assert len(CODEC.by_id) == len(CODEC.by_name) == len(DATABASE.messages)
    assert all(0 < can_id <= 0x7FF for can_id in CODEC.by_id)


GOOD = (
    'BU_: A\nBO_ 1 M: 4 A\n SG_ Crc : 0|8@1+ (1,0) [0|255] "" A\n SG_ Counter : 8|4@1+ (1,0) [0|14] "" A\n'
    ' SG_ X : 16|16@1- (0.1,0) [-1|1] "" A\nBA_DEF_ BO_ "E2EDataId" INT 0 65535;\n'
    'BA_DEF_DEF_ "E2EDataId" 0;\nBA_ "E2EDataId" BO_ 1 7;\n'
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not a DBC file"),
        ("hello", "not a DBC file"),
        (GOOD[:60], "not a DBC file"),
        (GOOD.replace("16|16@1-", "23|16@0-"), "little-endian"),
        (GOOD.replace("8|4@1+", "12|4@1+"), "Counter must lie at bit 8"),
        (GOOD.replace("(0.1,0)", "(0.1,5)"), "no offset"),
        (GOOD.replace('BA_ "E2EDataId" BO_ 1 7;\n', ""), "E2EDataId is missing"),
        (GOOD.replace("BO_ 1 ", "BO_ 2147483649 "), "11-bit"),
    ],
)
def test_f39_a_broken_dbc_is_refused_with_one_line(tmp_path, text, message):
    path = tmp_path / "broken.dbc"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message) as refusal:
        Codec(path)
    assert "\n" not in str(refusal.value)


def test_the_good_one_is_taken(tmp_path):
    path = tmp_path / "good.dbc"
    path.write_text(GOOD)
    assert Codec(path).layout("M").field("X").scale == 0.1
    with pytest.raises(ConfigError, match="no message Y"):
        Codec(path).layout("Y")
    with pytest.raises(ConfigError, match=r"missing\.dbc"):
        Codec(tmp_path / "missing.dbc")
