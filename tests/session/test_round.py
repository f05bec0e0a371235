"""The round folder: numbering, the lock of one session, and what is refused in one line."""

import subprocess
import sys
from pathlib import Path

import pytest

from ascrcp.core.errors import InputError
from ascrcp.session.round import Round, open_round


def test_numbered_rounds_follow_each_other_and_a_taken_number_is_passed_over(tmp_path: Path) -> None:
    first = open_round(None, tmp_path / "rounds").folder
    (tmp_path / "rounds" / "round-0007").mkdir()
    assert first.name == "round-0001"
    assert open_round(None, tmp_path / "rounds").folder.name == "round-0008"


def test_two_at_once_get_two_folders(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from ascrcp.session.round import open_round;"
        "[print(open_round(None, Path(sys.argv[1])).folder) for _ in range(40)]"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    made = [line for one in both for line in one.communicate()[0].split()]
    assert len(made) == len(set(made)) == 80


def test_f43_lock_refuses_a_second_holder_and_is_free_after_the_first(tmp_path: Path) -> None:
    with Round(tmp_path).lock(), pytest.raises(InputError, match="another ascrcp"):
        Round(tmp_path).lock()
    Round(tmp_path).lock().close()


def test_manifest_of_another_shape_and_a_file_in_a_folders_place_are_one_error(tmp_path: Path) -> None:
    (tmp_path / "round.json").write_text("[1]")
    (tmp_path / "pictures").touch()
    with pytest.raises(InputError, match="one JSON object"):
        Round(tmp_path).manifest()
    with pytest.raises(InputError, match="pictures"):
        _ = Round(tmp_path).pictures
