"""The round folder: where everything recorded about one advance of the heading lies."""

import fcntl
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import IO, Any

from ascrcp.core.errors import InputError
from ascrcp.core.file import make_folder
from ascrcp.session.evaluation import RunTrace
from ascrcp.session.store import read_archive, read_json, write_archive, write_json

STAGED = "staged"  # folder of files that are being written together
RESCAN = "rescan"  # folders of further scans: rescan-1, rescan-2, ...


class Round:
    """Names of the files in one round folder.

    Attributes:
        folder: The folder itself.
        scan: Raw lidar lines.
        look: The same from further in, of a further scan: what the first pose does not see.
        cloud: Labelled cloud, PLY.
        surface: Recognised surface.
        now: The same as a further scan shows it: what the arm keeps clear of after `plan --after`.
        features: features.json (design.md section 9).
        path: Planned nozzle path, CSV (thesis table 4-1).
        plan: What was planned beside the path: passes, layers, wanted surface.
        prediction: What it will come to, JSON.
        joints: Joint sequence, CSV.
        achieved: What a further scan found of the layer laid before it.
        finish: Its figures, JSON.
        trace: Errors of the run, one row per cycle.
        result: Summary of the run, JSON.
        log: Run log, MCAP.
        events: Event journal, SQLite.
        report: The page.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.scan = folder / "scan.npz"
        self.look = folder / "look.npz"
        self.cloud = folder / "cloud.ply"
        self.surface = folder / "surface.npz"
        self.now = folder / "surface-now.npz"
        self.features = folder / "features.json"
        self.path = folder / "path.csv"
        self.plan = folder / "plan.npz"
        self.prediction = folder / "plan.json"
        self.joints = folder / "joints.csv"
        self.achieved = folder / "achieved.npz"
        self.finish = folder / "achieved.json"
        self.trace = folder / "trace.npz"
        self.result = folder / "result.json"
        self.log = folder / "run.mcap"
        self.events = folder / "events.sqlite"
        self.report = folder / "report.html"
        self._manifest = folder / "round.json"

    @property
    def pictures(self) -> Path:
        """Folder of the pictures, made when first asked for."""
        place = self.folder / "pictures"
        try:
            place.mkdir(exist_ok=True)
        except OSError as error:
            raise InputError(f"{place}: cannot make the folder: {error.strerror or error}") from None
        return place

    def rescans(self) -> list["Round"]:
        """Return the folders of the further scans that belong to this round's plan, in their order."""
        return [Round(self.folder / name) for name in self.manifest().get("rescans", [])]

    def begin_rescan(self) -> "Round":
        """Make the folder of a further scan, and of what is planned and sprayed after it.

        None is reused but one in which a scan was given up before it had anything to keep.

        Raises:
            InputError: It cannot be made.
        """
        number = 1
        while (place := self.folder / f"{RESCAN}-{number}").is_dir() and any(place.iterdir()):
            number += 1
        make_folder(place)
        return Round(place)

    def keep_rescan(self, rescan: "Round") -> None:
        """Note that a further scan has been measured."""
        self.note(rescans=[*(found.folder.name for found in self.rescans()), rescan.folder.name])

    def leave_rescans(self) -> None:
        """Note that the further scans so far measured another plan; their folders stay."""
        if self.rescans():
            self.note(rescans=[])

    def manifest(self) -> dict[str, Any]:
        """Return what the round was made with; empty if nothing was noted."""
        tree = read_json(self._manifest) if self._manifest.exists() else {}
        if not isinstance(tree, dict):
            raise InputError(f"{self._manifest}: must hold one JSON object")
        return tree

    def note(self, **values: Any) -> None:
        """Add to what the round was made with."""
        write_json(self._manifest, {**self.manifest(), **values})

    def lock(self) -> IO[bytes]:
        """Take the folder for one session (fault F43); closing what is returned gives it back.

        The kernel gives it back by itself when the process dies.

        Raises:
            InputError: Another session has it, or it cannot be written.
        """
        place = self.folder / ".lock"
        try:
            holder = place.open("wb")
        except OSError as error:
            raise InputError(f"{place}: {error.strerror or error}") from None
        try:
            fcntl.flock(holder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            holder.close()
            raise InputError(f"{self.folder}: another ascrcp works on this round") from None
        return holder

    def lock_if_there(self) -> AbstractContextManager[object]:
        """Take the folder for one stage; a folder that is still to be made is nobody's.

        Raises:
            InputError: Another ascrcp has it, or it cannot be written.
        """
        return self.lock() if self.folder.is_dir() else nullcontext()

    def check_machine(self, machine: str) -> None:
        """Refuse a round that was solved for another machine (fault F41).

        Raises:
            InputError: Naming both.
        """
        solved_for = self.manifest().get("machine", machine)
        if self.joints.exists() and solved_for != machine:
            raise InputError(f"{self.folder}: solved for machine {solved_for}, not {machine}")

    @contextmanager
    def staged(self, *untrue: str) -> Iterator["Round"]:
        """Write several files that belong together: all of them take their places, or none (fault F38).

        Args:
            untrue: Results that they make untrue, removed once all are written.

        Yields:
            A round folder beside this one's files, to write them into.

        Raises:
            InputError: The disk refuses; what was there stays.
        """
        place = self.folder / f".{STAGED}.part"
        shutil.rmtree(place, ignore_errors=True)
        make_folder(place)
        try:
            yield Round(place)
            self.forget(*untrue)
            for file in sorted(place.iterdir()):
                os.replace(file, self.folder / file.name)
        except OSError as error:
            raise InputError(f"{self.folder}: cannot be written: {error.strerror or error}") from None
        finally:
            shutil.rmtree(place, ignore_errors=True)

    def was_run(self) -> bool:
        """Whether the folder's joint sequence has been run to its end, as its result tells.

        Raises:
            InputError: A damaged result.
        """
        if not (self.joints.exists() and self.result.exists()):
            return False
        found = read_json(self.result)
        try:
            points = found["points"]
            return bool(points["reached"] + points["skipped"] >= points["planned"] - points["left_out"])
        except (TypeError, KeyError) as error:
            raise InputError(f"{self.result}: no result of a run: {error}") from None

    def forget(self, *names: str) -> None:
        """Remove results that a new run of an earlier stage makes untrue."""
        for name in names:
            getattr(self, name).unlink(missing_ok=True)

    def need(self, name: str, stage: str) -> Path:
        """Return a file of the round, or say which stage makes it.

        Raises:
            InputError: If it is not there.
        """
        place: Path = getattr(self, name)
        if not place.exists():
            raise InputError(f"{place}: not there; run `ascrcp {stage}` on this round first")
        return place

    def write_trace(self, trace: RunTrace) -> None:
        """Keep the errors of a run."""
        arrays = {name: getattr(trace, name) for name in _TRACE_ARRAYS}
        write_archive(self.trace, "trace", {"from_truth": trace.from_truth}, arrays)

    def read_trace(self) -> RunTrace:
        """Read the errors of a run back."""
        meta, arrays = read_archive(self.trace, "trace", _TRACE_ARRAYS)
        return RunTrace(**arrays, from_truth=bool(meta["from_truth"]))


_TRACE_ARRAYS = ("t", "reference", "nozzle", "measured", "spraying", "point", "q_error")


def open_round(folder: Path | None, base: Path) -> Round:
    """Open a round folder, or make the next numbered one.

    Args:
        folder: The folder wanted, made if missing; None for a new one below `base`.
        base: Folder of all rounds.

    Raises:
        InputError: The place cannot be made or is a file.
    """
    try:
        if folder is None:
            base.mkdir(parents=True, exist_ok=True)
            taken: Sequence[int] = [
                int(p.name.removeprefix("round-"))
                for p in base.glob("round-*")
                if p.name.removeprefix("round-").isdigit()
            ]
            return Round(_make_next(base, max(taken, default=0) + 1))
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder or base}: cannot make the round folder: {error.strerror or error}"
        ) from None
    return Round(folder)


def _make_next(base: Path, number: int) -> Path:
    """Make the first folder from a number on that nobody else makes at the same moment."""
    while True:
        folder = base / f"round-{number:04d}"
        try:
            folder.mkdir()
        except FileExistsError:
            number += 1
        else:
            return folder
