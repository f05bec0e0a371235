"""Survey files: what is written reads back, and every bad file is refused in one clear line."""

from pathlib import Path

import numpy as np
import pytest
from machine_survey import ARM, CONFIG, survey

from ascrcp.core.errors import InputError
from ascrcp.kinematics.calibration import calibrate
from ascrcp.kinematics.observation import list_columns, read_observations, write_observations

GOOD = ",".join(["10", "20", "500", "-10", "5", "300", "90", "45", "0", "9000", "1000", "3000"])
HEADER = ",".join(list_columns(ARM))


def read(folder: Path, text: str):
    file = folder / "survey.csv"
    file.write_bytes(text.encode())
    return read_observations(file, ARM)


def test_what_is_written_reads_back(tmp_path):
    seen = survey(20).seen
    write_observations(tmp_path / "s.csv", ARM, seen)
    again = read_observations(tmp_path / "s.csv", ARM)
    np.testing.assert_allclose(again.q, seen.q, atol=1e-6)
    np.testing.assert_allclose(again.position, seen.position, atol=1e-7)
    np.testing.assert_array_equal(again.line, seen.line)


def test_order_of_columns_labels_comments_and_spreadsheet_marks_do_not_matter(tmp_path):
    cells = dict(zip(HEADER.split(","), GOOD.split(","), strict=True)) | {"label": "P1"}
    turned = list(reversed(cells))
    text = "﻿# on the yard\r\n" + ",".join(turned) + "\r\n\r\n" + ",".join(cells[k] for k in turned) + "\r\n"
    seen = read(tmp_path, text)
    np.testing.assert_allclose(seen.position, [[9.0, 1.0, 3.0]])
    np.testing.assert_allclose(np.degrees(seen.q[0, 1]), 20.0)
    assert seen.q[0, 2] == pytest.approx(0.5) and seen.line.tolist() == [4]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty"),
        ("# nothing\n", "empty"),
        (HEADER + "\n", "no rows"),
        (HEADER.replace("q3_mm,", "") + "\n" + GOOD, "column q3_mm is missing"),
        (HEADER.replace("payload_kg,", "") + "\n" + GOOD, "column payload_kg is missing"),
        (HEADER + ",speed\n" + GOOD + ",1", "unknown column 'speed'"),
        (HEADER + ",q1_deg\n" + GOOD + ",1", "column q1_deg stands twice"),
        (HEADER + "\n" + GOOD + "\n" + GOOD.replace("500", "nan", 1), "line 3: q3_mm is nan"),
        (HEADER + "\n" + GOOD.replace("500", "inf", 1), "line 2: q3_mm is inf"),
        (HEADER + "\n" + GOOD.replace("500", "half", 1), "line 2: q3_mm is 'half'"),
        (HEADER + "\n" + GOOD.replace("500", "", 1), "line 2: q3_mm is ''"),
        (HEADER + "\n" + GOOD + ",7", "line 2: 13 cells, the header has 12"),
        (HEADER + "\n" + GOOD.replace("20", "95", 1), r"line 2: q2 is 95.0 deg, allowed -25..75 \(joint 2"),
        (HEADER + "\n" + GOOD.replace("-10", "70", 1), r"line 2: q2\+q4 is 90.0 deg, allowed -25..75"),
        (HEADER + "\n" + GOOD.replace(",0,9000", ",-1,9000"), "line 2: payload_kg is -1, allowed 0..2000"),
        (HEADER + "\n" + GOOD.replace("9000", "9000000"), "line 2: point .* allowed up to 50000 mm"),
        ("PK\x03\x04 \x00 spreadsheet", "column q1_deg is missing"),
    ],
)
def test_bad_files_are_refused(tmp_path, text: str, message: str):
    with pytest.raises(InputError, match=message) as error:
        read(tmp_path, text)
    assert str(error.value).count("\n") == 0


def test_unreadable_files_are_refused(tmp_path):
    (tmp_path / "latin.csv").write_bytes(b"\xff\xfe\x00")
    for name, message in (("absent.csv", "No such file"), (".", "directory"), ("latin.csv", "not UTF-8")):
        with pytest.raises(InputError, match=message):
            read_observations(tmp_path / name, ARM)


def test_too_few_rows_are_refused():
    with pytest.raises(InputError, match="8 rows are too few for 22 parameters, at least 19 are needed"):
        calibrate(ARM, survey(8).seen, CONFIG)
