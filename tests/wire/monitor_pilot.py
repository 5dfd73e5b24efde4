"""Drives the monitor headless, and reads what it shows."""

import asyncio
import time

from forceaxis.bus.monitor import AxisPanel, Monitor


def panel_text(app, axis):
    panel = app.query_one(f"#axis-{axis}", AxisPanel)
    return f"{panel.border_title}\n{panel.border_subtitle}\n{panel.render()}"


def chart_text(app):
    return str(app.query_one("#chart").render())


def head_text(app):
    return str(app.query_one("#head").render())


async def settle(pilot, condition, seconds=8.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        await pilot.pause(0.05)
        if condition():
            return
    raise AssertionError("did not come within the time")


def run_monitor(source, watch, steps, size=(120, 40), **options):
    """The app headless, driven by `steps(app, pilot)`."""

    async def session():
        app = Monitor(source, watch, **options)
        async with app.run_test(size=size) as pilot:
            await steps(app, pilot)

    try:
        asyncio.run(asyncio.wait_for(session(), 25))
    finally:
        source.close()
