"""Tables for people on a terminal."""

from typing import Any


def table(header: list[str], rows: list[list[str]]) -> str:
    """Align columns: the first to the left, the others to the right."""
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]

    def line(row: list[str]) -> str:
        cells = [row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))]
        return "  ".join(cells).rstrip()

    return "\n".join([line(header), "  ".join("-" * w for w in widths), *map(line, rows)])


def _number(value: float | None, digits: int = 1) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def result_table(result: dict[str, Any]) -> str:
    """The nozzle error table of a run, its points, times and places."""
    rows = []
    at = result["at_points"]
    for name, summary, digits in (
        ("position, same instant [mm]", result["nozzle_error_mm"], 1),
        ("position, across the path [mm]", result["cross_track_mm"], 1),
        ("spray direction [deg]", result["nozzle_error_deg"], 2),
        ("position at planned points [mm]", at["error_mm"], 1),
        ("direction at planned points [deg]", at["error_deg"], 2),
    ):
        rows.append([name, *(_number(summary[key], digits) for key in ("mean", "p95", "max"))])
    points, late, timing = result["points"], result["lateness_ms"], result["timing_s"]
    times = ", ".join(f"{name} {_number(value)} s" for name, value in timing.items() if value is not None)
    truth = "the rig's true nozzle" if result["from_truth"] else "the joint sensors"
    lines = [
        f"Nozzle error, from {truth}, every 20 ms while spraying",
        table(["", "mean", "p95", "max"], rows),
        f"points: {points['planned']} planned, {points['reached']} reached, {points['skipped']} skipped; "
        f"{at['within_rule']} of {at['count']} within 100 mm and 5 deg",
        f"times: {times}; run at {_number(result['realtime_factor'])} x real time",
    ]
    if late["max"] > 0.0:
        lines.append(
            f"control cycle late: p50 {late['p50']:.2f}, p99.9 {late['p99_9']:.2f}, max {late['max']:.2f} ms,"
            f" {late['missed']} missed"
        )
    lines += [
        f"pictures: {len(result['pictures'])} in {result['round']}/pictures",
        f"report: {result['report']}",
    ]
    return "\n".join(lines)
