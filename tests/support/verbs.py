"""The command line without a process of its own, for tests that are not about the process: what
Python and NumPy cost to start is most of what a verb costs."""

import contextlib
import io
import os
import subprocess
import sys
import traceback

from forceaxis.cli.main import main


class _Output(io.TextIOWrapper):
    """A standard stream that is no terminal and keeps what is written, as bytes or text."""

    def __init__(self):
        super().__init__(io.BytesIO(), encoding="utf-8", write_through=True)

    def text(self):
        return self.buffer.getvalue().decode()


def forceaxis(*arguments, cwd=".", stdin=""):
    """`forceaxis ARGUMENTS` in this process; returns what subprocess.run() would."""
    argv = ["forceaxis", *map(str, arguments)]
    out, err, status = _Output(), _Output(), 0
    before, folder = (sys.argv, sys.stdin), os.getcwd()
    sys.argv, sys.stdin = argv, io.TextIOWrapper(io.BytesIO(stdin.encode()), encoding="utf-8")
    os.chdir(cwd)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                main()
            except SystemExit as end:
                status = end.code or 0
            except BaseException:
                traceback.print_exc()
                status = 1
    finally:
        os.chdir(folder)
        sys.argv, sys.stdin = before
    return subprocess.CompletedProcess(argv, status, out.text(), err.text())
