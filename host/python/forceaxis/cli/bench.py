"""`forceaxis bench`: measure the speed of the simulator."""

import json
import sys

import click

from forceaxis.cli.common import Verb, as_json


@click.command(
    name="bench",
    cls=Verb,
    epilog="""forceaxis bench --case A --tool forceaxis --tool odeint
    forceaxis bench --check
    forceaxis bench --link""",
)
@click.option(
    "--case", "cases", multiple=True, type=click.Choice(["A", "B", "full"]), help="Default: all."
)
@click.option(
    "--tool",
    "tools",
    multiple=True,
    type=click.Choice(["forceaxis", "forceaxis+firmware", "odeint", "mujoco", "scipy"]),
    help="Default: all that are installed. Repeatable, like --case.",
)
@click.option("--repeat", type=click.IntRange(1, 1000), default=10, show_default=True)
@click.option("--sweeps", is_flag=True, help="Also sweeps: runs per second, time per event.")
@click.option("--linear", is_flag=True, help="Also the linear analysis and `advise`.")
@click.option(
    "--link",
    "links",
    is_flag=True,
    help="Only the rate of the lock-step over LCM and SocketCAN, relative to two programs that "
    "only exchange messages. The exit status is 1 if a promised rate is missed.",
)
@click.option(
    "--check",
    is_flag=True,
    help="Measure everything; the exit status is 1 if a promised ratio is missed.",
)
@as_json
def bench_(
    cases: tuple[str, ...],
    tools: tuple[str, ...],
    repeat: int,
    sweeps: bool,
    linear: bool,
    links: bool,
    check: bool,
    as_json: bool,
) -> None:
    """Measure the speed of the simulator. The programs odeint, MuJoCo and SciPy are measured for
    comparison if they are installed.

    The verb prints how many times faster than real time one thread simulates 2 s of a force loop,
    and the error of the contact force against an independent integration with extended precision.
    Run it on an idle machine.
    """
    from forceaxis.bench import bench
    from forceaxis.bench import link as bench_link

    if links:
        rows = bench_link.run(min(repeat, 10))
        checks = bench_link.check(rows)
        if as_json:
            found = [{"check": text, "held": held} for text, held in checks]
            click.echo(json.dumps({"link": rows, "checks": found}))
        else:
            click.echo("\n".join(bench_link.describe(rows)))
            for text, held in checks:
                click.echo(f"{'held' if held else 'NOT HELD':12} {text}")
        sys.exit(not all(held for _, held in checks))
    if check and (cases or tools):
        raise click.UsageError("expected --check without --case and --tool; it runs everything")
    result = bench.run(
        cases or bench.CASES, tools or bench.TOOLS, repeat, sweeps or check, linear or check
    )
    if check:
        checks = bench.check(result)
        result["checks"] = [{"check": text, "held": held} for text, held in checks]
    if as_json:
        click.echo(json.dumps(result, allow_nan=False))
    else:
        click.echo(bench.describe(result))
        for text, held in checks if check else ():
            click.echo(f"{'held' if held else 'NOT HELD':12} {text}")
    if check and not all(held for _, held in checks):
        sys.exit(1)


VERBS = (bench_,)
