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
        *finish_lines(result),
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


def finish_lines(result: dict[str, Any]) -> list[str]:
    """The finish predicted and found by further scans, and the concrete used; nothing without such a scan."""
    predicted, achieved = result.get("predicted"), result.get("achieved", [])
    if not achieved:
        return []
    runs = [result, *result.get("resprays", [])]
    used, rows = 0.0, []
    if predicted is not None:
        rows.append(_finish_row("predicted", predicted, predicted["pumped_m3"]))
    for number, (found, run) in enumerate(zip(achieved, runs, strict=False)):
        used += run["concrete_m3"]["pumped"]
        rows.append(_finish_row(f"sprayed again, {number}" if number else "achieved", found, used))
    first = achieved[0]
    return [
        f"Finish of {first['area_m2']:.1f} m2 in patches, from a second scan",
        table(
            ["", f"within {first['tolerance_mm']:.0f} mm [%]", "too thin by [mm]", "std [mm]", "pumped [m3]"],
            rows,
        ),
    ]


def _finish_row(name: str, found: dict[str, Any], pumped: float) -> list[str]:
    return [
        name,
        f"{100 * found['within_tolerance']:.1f}",
        f"{found['thinnest_mm']:.0f}",
        f"{found['finish_std_mm']:.1f}",
        f"{pumped:.2f}",
    ]
