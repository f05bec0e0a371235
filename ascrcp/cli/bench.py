"""bench: figures beside their aims and peers in the same run, because machines differ and are noisy."""

import gc
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from statistics import median

from ascrcp.cli.output import FAILED, OK, Output
from ascrcp.cli.parser import Options
from ascrcp.cli.table import table

REPEATS = 9

Say = Callable[[str], None]


@dataclass(frozen=True)
class Figure:
    """One measured figure.

    Attributes:
        what: What was measured.
        value: The figure, None where it could not be measured.
        unit: Its unit.
        aim: Value it is meant to reach, None for a figure that only stands beside others.
        more_is_better: Whether the aim is a least value.
        note: How it was measured, or why not.
    """

    what: str
    value: float | None
    unit: str
    aim: float | None = None
    more_is_better: bool = False
    note: str = ""

    @property
    def is_met(self) -> bool | None:
        """Whether the aim is reached; None where there is none or nothing was measured."""
        if self.aim is None or self.value is None:
            return None
        return self.value >= self.aim if self.more_is_better else self.value <= self.aim


def bench(options: Options, output: Output) -> int:
    """Measure and print; exit 1 where a proof fails (figures of speed are the machine's affair)."""
    figures: list[Figure] = []
    if options.which in ("all", "kinematics"):
        # measuring is the one command that pays for these imports
        from ascrcp.cli.bench_inverse import measure_inverse
        from ascrcp.cli.bench_path import measure_paths

        figures += measure_inverse(options.machine, options.seed, output.say)
        figures += measure_paths(options.machine, output.say)
    proofs: list[Figure] = []
    if options.which in ("all", "headings"):
        from ascrcp.cli.bench_headings import measure_headings

        proofs += measure_headings(options.machine, options.seed, output.say)
    if options.which in ("all", "perception"):
        from ascrcp.cli.bench_perception import measure_perception, measure_speed

        figures += measure_speed(options.seed, output.say)
        proofs += measure_perception(options.seed, output.say)
    if options.which in ("all", "planning"):
        from ascrcp.cli.bench_chain import measure_chain
        from ascrcp.cli.bench_planning import measure_planning

        figures += measure_chain(options.machine, options.seed, output.say)
        proofs += measure_planning(options.machine, options.seed, options.rig, output.say)
    if options.which in ("all", "proof"):
        from ascrcp.cli.bench_proof import prove_inverse

        proofs += prove_inverse(options.machine, options.seed, output.say)
    if options.which in ("all", "sister"):
        from ascrcp.cli.bench_sister import measure_sister

        beside, held = measure_sister(options.seed, output.say)
        figures += beside
        proofs += held
    if options.which in ("all", "control", "rigs"):
        from ascrcp.cli.bench_control import measure_control, measure_many

        proofs += (
            measure_control(options.machine, options.seed, output.say) if options.which != "rigs" else []
        )
        proofs += measure_many(options.seed, output.say) if options.which != "control" else []
    if options.which == "realtime":  # not part of "all": it takes its minutes, and wants a quiet computer
        from ascrcp.cli.bench_realtime import measure_realtime

        proofs += measure_realtime(options.minutes, options.seed, options.rig, options.planner, output.say)
    failed = [figure.what for figure in proofs if figure.is_met is False]
    tree = {
        "ok": not failed,
        "figures": [{**asdict(figure), "is_met": figure.is_met} for figure in figures + proofs],
    }
    output.result(tree, table(["what", "measured", "aim", "met", "how"], list(_rows(figures + proofs))))
    return FAILED if failed else OK


def _rows(figures: Iterable[Figure]) -> Iterable[list[str]]:
    for figure in figures:
        shown = "-" if figure.value is None else f"{figure.value:.3g} {figure.unit}"
        sign = ">=" if figure.more_is_better else "<="
        aim = "-" if figure.aim is None else f"{sign} {figure.aim:g}"
        met = {None: "-", True: "yes", False: "NO"}[figure.is_met]
        yield [figure.what, shown.strip(), aim, met, figure.note]


def time_per_item(action: Callable[[], object], items: int, repeats: int = REPEATS) -> float:
    """Measure the processor time of this process per item [us], the median of several runs.

    Processor time of all its threads: other programs on a busy machine hardly count, a second core
    does.
    """
    gc.collect()
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        action()
        times.append(time.process_time() - begin)
    return 1e6 * median(times) / items
