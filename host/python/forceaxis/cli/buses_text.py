"""Texts that `forceaxis monitor --once` and `forceaxis recording` print on a terminal."""

import time

from forceaxis.bus.log_tables import ExportSummary
from forceaxis.bus.monitor_state import AxisSnapshot, Snapshot
from forceaxis.bus.recordings import LogSummary
from forceaxis.cli.common import aligned


def snapshot_text(shown: Snapshot) -> str:
    """Return the states of the axes at one time as text, with one text line for each axis."""
    lines = []
    for number, a in shown.axes.items():
        force = "-"
        if a.force_N is not None:
            force = f"{a.force_N:.2f} N"
            if a.target_force_N is not None:
                force += f" of {a.target_force_N:.2f} N"
        elif a.force_cnt is not None:
            force = f"{a.force_cnt:.2f} counts of the force reading"
        head = f"axis {number}: "
        if a.silent:
            since = "" if a.age_s is None or a.drive_state is None else f" for {a.age_s:.1f} s"
            stopped = ", stopped by NMT" if a.node == "stopped" else ""
            head += f"SILENT{since}{stopped}, was "
        parts = [
            a.drive_state or "no state",
            a.mode or "mode -",
            "no fault" if a.fault in (None, "none") else f"FAULT {a.fault}",
            f"force {force}",
            position_text(a),
            f"output {'-' if a.output_V is None else format(a.output_V, '.3f')} V",
            *([] if a.silent else [f"{a.rate_per_s:.0f}/s"]),
            f"lost {a.lost}",
        ]
        if a.limit_reason not in (None, "none"):
            parts.insert(3, f"limit {a.limit_reason}")
        if a.objects_mismatch:
            parts.append(a.objects_mismatch)
        lines.append(head + ", ".join(parts))
    if shown.trouble:
        lines.append(shown.trouble)
    return "\n".join(lines)


def position_text(a: AxisSnapshot) -> str:
    if a.position_unit == "count":
        return f"encoder {'-' if a.position_cnt is None else a.position_cnt} count"
    value = "-" if a.position is None else f"{a.position:.6g}"
    return f"position {value} {a.position_unit}"


def log_text(summary: LogSummary) -> str:
    """Return the summary of a log as text: one text line about the whole log, and a table of its
    channels."""
    rows: list[tuple[str, ...]] = [("channel", "type", "messages", "per s", "lost", "doubled", "")]
    for name, row in summary.channels.items():
        rate = "" if row.rate_per_s is None else f"{row.rate_per_s:.1f}"
        bad = f"{row.undecodable} of another type" if row.undecodable else ""
        more = f"{row.runs} runs" if (row.runs or 0) > 1 else ""
        counts = ["" if n is None else str(n) for n in (row.lost, row.doubled)]
        notes = ", ".join(t for t in (bad, more) if t)
        rows.append((name, row.type or "?", str(row.count), rate, *counts, notes))
    lines = aligned(rows, (0, 1, 6))
    start = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(summary.start_wall_us / 1e6))
    lines.append(f"{summary.messages} messages, {summary.span_s:.3f} s from {start}")
    return "\n".join(line.rstrip() for line in lines)


def export_text(summary: ExportSummary) -> str:
    """Return the text about an export of a message log. The text names the written tables, and the
    channels and messages that were not exported."""
    lines = []
    for table in summary.tables:
        lines.append(f"{' '.join(table.files):44} {table.rows} rows, {len(table.columns)} columns")
    if summary.not_exported:
        lines.append(f"left out     {', '.join(summary.not_exported)}")
    if summary.undecodable:
        lines.append(
            f"left out     {summary.undecodable} messages that are damaged or of another type"
        )
    return "\n".join(lines)
