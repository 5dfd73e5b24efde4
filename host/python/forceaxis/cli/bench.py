"""`forceaxis bench`: measure the speed of the simulator."""

import sys
from dataclasses import replace
from pathlib import Path

import click

from forceaxis.bench import bench
from forceaxis.bench import growth as bench_growth
from forceaxis.bench import link as bench_link
from forceaxis.bench.requirement import Requirement
from forceaxis.cli.common import Folder, Verb, as_json, print_result


@click.command(
    name="bench",
    cls=Verb,
    epilog="""forceaxis bench --case A --tool forceaxis --tool odeint
    forceaxis bench --check
    forceaxis bench --growth --out out/growth
    forceaxis bench --link""",
)
@click.option(
    "--case",
    "cases",
    multiple=True,
    type=click.Choice(["A", "B", "full"]),
    help="Model to measure. Default: all. Repeatable.",
)
@click.option(
    "--tool",
    "tools",
    multiple=True,
    type=click.Choice(["forceaxis", "forceaxis+firmware", "odeint", "mujoco", "scipy"]),
    help="Simulator to measure. Default: all that are installed. Repeatable.",
)
@click.option("--repeat", type=click.IntRange(1, 1000), default=10, show_default=True)
@click.option(
    "--sweeps", is_flag=True, help="Also measure sweeps: runs per second, and time per event."
)
@click.option(
    "--link",
    "links",
    is_flag=True,
    help="Measure only the rate of the lock-step over LCM and SocketCAN, relative to two programs "
    "that only exchange messages. The exit status is 1 if a promised rate is missed.",
)
@click.option(
    "--growth",
    is_flag=True,
    help="Measure only how CPU time and peak memory grow with the number of states, of events and "
    "of runs of a sweep.",
)
@click.option("--out", type=Folder(), help="Folder for growth.png and growth.json of --growth.")
@click.option(
    "--check",
    is_flag=True,
    help="Measure everything but --link and --growth; the exit status is 1 if a promised ratio is "
    "missed. All ratios compare CPU times of this run.",
)
@as_json
def bench_(
    cases: tuple[str, ...],
    tools: tuple[str, ...],
    repeat: int,
    sweeps: bool,
    links: bool,
    growth: bool,
    out: Path | None,
    check: bool,
    as_json: bool,
) -> None:
    """Measure the speed of the simulator. The programs odeint, MuJoCo and SciPy are measured for
    comparison if these programs are installed.

    The command prints how many times faster than real time one thread simulates 2 s of a force
    loop. It also prints the error of the contact force. The reference is an independent integration
    with extended precision. Run it on an idle machine.
    """
    if links:
        rates = bench_link.run(min(repeat, 10))
        checks = bench_link.check(rates)
        lines = [*map(rates_line, rates), *map(check_line, checks)]
        print_result({"link": rates, "checks": checks}, as_json, lambda: "\n".join(lines))
        sys.exit(not all(c.held for c in checks))
    if out and not growth:
        raise click.UsageError("expected --out together with --growth, which writes there")
    if growth:
        measured = bench_growth.run(bench_growth.GrowthPlan(), min(repeat, 10))
        if out:
            bench_growth.write(measured, out)
        print_result(measured, as_json, lambda: growth_text(measured))
        return
    if check and (cases or tools):
        raise click.UsageError(
            "expected --check without --case and --tool, because --check runs all cases with all "
            "tools"
        )
    result = bench.run(cases or bench.CASES, tools or bench.TOOLS, repeat, sweeps or check, check)
    if check:
        result = replace(result, checks=bench.check(result))
    print_result(result, as_json, lambda: bench_text(result))
    if not all(c.held for c in result.checks or ()):
        sys.exit(1)


def check_line(requirement: Requirement) -> str:
    """Return one text line about a speed requirement: the measured value, and whether the
    requirement is satisfied."""
    return f"{'held' if requirement.held else 'NOT HELD':12} {requirement.check}"


def rates_line(r: bench_link.LinkRates) -> str:
    """Return one text line about the lock-step of firmware and plant over a transport. The line has
    the ticks per second, and the messages per second of the transport alone (ping-pong)."""
    return (
        f"{r.link:12} {r.ticks_per_s:,.0f} ticks/s ({r.real_time:.1f} x real time), "
        f"{r.share:.0%} of a raw ping-pong's {r.raw_per_s:,.0f}/s; six axes "
        f"{r.six_axes_ticks_per_s:,.0f} ticks/s ({r.six_axes_real_time:.1f} x); "
        f"{r.repeated} records repeated"
    )


def growth_text(growth: bench_growth.Growth) -> str:
    """Return a table of the time and memory that each tool needed for each size of the task. The
    table has the CPU time and the additional peak memory."""
    lines = []
    for name, unit in (("states", "tick"), ("events", "tick"), ("runs", "run")):
        lines.append(f"{name:>9}  tool         us/{unit:5} CPU time     added memory")
        lines += [
            f"{p.size:9,}  {p.tool:10} {p.unit_us:10.3f} {p.cpu_s:9.4f} s {p.added_MiB:12.1f} MiB"
            for p in growth.points
            if p.growth == name
        ]
    lines.append("All points are measured; none is extrapolated.")
    lines += [f"{'missing':12} {tool}: {why}" for tool, why in growth.missing.items()]
    return "\n".join(lines + load_lines(growth.load))


def load_lines(load: float) -> list[str]:
    """If other programs used the computer during the measurement, return one text line with a
    warning. Otherwise return no text line."""
    return [f"{'load':12} {load:.1f}: the machine was not idle"] if load > 0.5 else []


def bench_text(result: bench.BenchResult) -> str:
    """Return the text about a benchmark: a table of the measured models, and one text line for each
    other result."""
    lines = [
        "case  tool                x real time   us/tick   spread   ratio   force error   events"
    ]
    for r in result.results:
        error = "unknown" if r.force_error_N is None else f"{r.force_error_N:.1e} N"
        ratio = "" if r.times_forceaxis is None else f"{r.times_forceaxis:.3g}"
        events = "" if r.events is None else r.events
        lines.append(
            f"{r.case:4}  {r.tool:18} {r.real_time_factor:12,.0f} "
            f"{r.tick_ns / 1e3:9.3f} {r.spread:8.0%} {ratio:>7}   {error:>11} {events:>8}"
        )
    for sweep in result.sweeps or ():
        lines.append(
            f"{sweep.sweep:12} {sweep.runs} runs: {sweep.runs_per_s_core:,.0f} runs/s per core, "
            f"{sweep.runs_per_s_two_threads:,.0f} runs/s on two threads "
            f"({sweep.two_thread_ratio:.2f} x one; CPU time {sweep.two_thread_cpu:.2f} x)"
        )
    if cost := result.scaling:
        lines.append(
            f"{'scaling':12} {cost.events_least} to {cost.events_most} events: "
            f"{cost.run_us:.0f} us + {cost.event_us:.2f} us per event, R^2 {cost.r_squared:.4f}, "
            f"worst {cost.worst_deviation:.0%} off the line"
        )
    for analysis in result.linear or ():
        text = f"{analysis.work}: {1e3 * analysis.seconds:.3g} ms"
        if analysis.control_seconds:
            text += (
                f", python-control {1e3 * analysis.control_seconds:.3g} ms, "
                f"{analysis.control_seconds / analysis.seconds:.1f} times as long; they differ by "
                f"{analysis.difference:.1e}"
            )
        lines.append(f"{'linear':12} {text}")
    lines += [f"{'missing':12} {tool}: {why}" for tool, why in result.missing.items()]
    lines += load_lines(result.load)
    return "\n".join([*lines, *map(check_line, result.checks or ())])


VERBS = (bench_,)
