"""Steps of a session on a real bus, each of which is asserted by a test of its own.

The session is a process on the bus. It stores what a step found, or the error of the step, as soon
as the step has ended:

    with Steps(folder) as steps:
        steps("pressed", press, 30.0)          # an error ends this step only
        steps["listed"] = scan()               # an error ends the session

The test module reads the steps by their names, after the session has ended. A step that failed
fails the tests that ask for it, with its error; if none does, it fails the last test of the module.
The first step that was not reached fails with the error of the session, the others with one line.

    @pytest.fixture(scope="module")
    def found(tmp_path_factory, vcan):
        yield from found_by(vcan, tmp_path_factory.mktemp("press"), 90, SESSION)
"""

import json
import os
import sys
import time
import traceback
from pathlib import Path

FILE = "steps.jsonl"


class Steps:
    """The steps of a session, one line each in the file FILE of a folder."""

    def __init__(self, folder):
        self._file, self._found = Path(folder) / FILE, {}
        self._file.touch()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._write({"end": "".join(traceback.format_exception(*error)) if error[0] else None})

    def __call__(self, name, do, *arguments):
        """Runs a step. Returns what it found, or None if it failed."""
        since = time.monotonic()
        try:
            self[name] = do(*arguments)
        except Exception:
            self._write({"step": name, "error": traceback.format_exc()})
        print(f"{name}: {time.monotonic() - since:.1f} s", file=sys.stderr, flush=True)
        return self._found.get(name)

    def __setitem__(self, name, found):
        self._write({"step": name, "found": found})
        self._found[name] = found

    def __getitem__(self, name):
        return self._found[name]

    def _write(self, line):
        with self._file.open("a") as file:
            file.write(json.dumps(line, default=str) + "\n")


class Found:
    """What the steps of a session found, by name. `folder` is the folder of the session."""

    def __init__(self, folder, status=0, said=""):
        self.folder, file = folder, folder / FILE
        text = file.read_text() if file.exists() else ""
        # A session that is killed may leave half a line.
        lines = [json.loads(line) for line in text.splitlines(keepends=True) if line[-1] == "\n"]
        self._steps = {line["step"]: line for line in lines if "step" in line}
        self._read = set()  # names of the steps that tests asked for
        error = next((line["end"] for line in lines if "end" in line), said[-3000:])
        self._died = status != 0 or bool(error)
        last = next(reversed(self._steps), "its start")
        self._end = f"the session ended with status {status} after {last}"
        self._error = "\n" + (error or said[-3000:])  # not told yet

    def __getitem__(self, name):
        self._read.add(name)
        if name not in self._steps:
            if not self._died:
                raise KeyError(name)
            error, self._error = self._error, ""
            fail(f"{name} was not reached: {self._end}{error}")
        step = self._steps[name]
        if "error" in step:
            fail(f"{name}: {step['error']}")
        return step["found"]

    def expect_end(self):
        """Fails if the session died and no test has said so, or if a step failed that no test has
        asked for, although all tests of the module ran."""
        if self._died and self._error:
            fail(self._end + self._error)
        whole = not self._died and "FORCEAXIS_SOME_TESTS" not in os.environ
        for name, step in self._steps.items():
            if whole and "error" in step and name not in self._read:
                fail(f"{name}: {step['error']}")


def run(vcan, folder, seconds, session, *arguments):
    """Runs a session, at most `seconds`, with a folder to write to and further arguments."""
    try:
        done = vcan([sys.executable, session, folder, *arguments], seconds)
    except TimeoutError as error:  # of the whole guest
        return Found(folder, "unknown", str(error))
    print(done.stderr)
    return Found(folder, done.returncode, done.stdout + done.stderr)


def found_by(*arguments):
    """For a fixture: the result of run(), whose end is expected after the last test."""
    found = run(*arguments)
    yield found
    found.expect_end()


def fail(text):
    import pytest  # not in a session, where it would only cost time

    pytest.fail(text, pytrace=False)
