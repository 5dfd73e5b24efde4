"""A Dask scheduler and two workers on this computer."""

import contextlib
import json
import subprocess
import sys
import time
from pathlib import Path

BIN = Path(sys.executable).parent


@contextlib.contextmanager
def started(folder):
    """Yields the address of the scheduler and the processes of the workers, which are not restarted
    when they end. `folder` is an empty folder for their files."""
    where = folder / "scheduler.json"
    quiet = {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    here = ["--no-dashboard", "--host", "127.0.0.1", "--scheduler-file", where]
    dask = BIN / "dask"
    processes = [subprocess.Popen([dask, "scheduler", "--port", "0", *here], **quiet)]
    try:
        single = ["--nthreads", "1", "--no-nanny", *here]
        processes += [subprocess.Popen([dask, "worker", *single], **quiet) for _ in range(2)]
        deadline = time.monotonic() + 60
        while not where.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        address = json.loads(where.read_text())["address"]
        from distributed import Client

        with Client(address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        yield address, processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()
