"""Build and test, the cheapest and sharpest tests first. The last line is "N passed, M failed".

usage: tools/test [--quick | --all]

  --quick  format, style, gates, unit tests, half of the million frames: after every change
           (90 s at most)
  (none)   all that decides whether a change is good (12 minutes)
  --all    that, and what needs longer: sanitizers, more seeds, whole sweeps, fuzzers; at the end,
           whether each promise of docs/guide/proofs.md is held by tests that passed (60 minutes).
           Of the modules with long tests, it runs all that hold a promise, and half of the others,
           which the commit draws; FORCEAXIS_WHOLE=1 runs all of them.

A skipped test is a failed test here, and so is a program that ends without its result. A test that
runs in wall time on real buses and fails is tried a second time, with the others of its stage for
seven minutes at most; what both tries printed is shown, and the second tries are named above the
last line. Before them, a table has the seconds of each folder beside the recorded ones
(tools/durations.py).
"""

import contextlib
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import durations
import junit
import promises

ROOT = Path(__file__).resolve().parent.parent
sys.path.append(str(ROOT / "tests/support"))
import draws  # noqa: E402

BUILD = ROOT / "build"
PYTHON = ROOT / ".venv/bin/python"
# One thread of OpenBLAS for each worker: with two threads each, two workers take 1.5 times as long,
# because the threads wait for each other in loops.
# All tests of a run draw by the commit with which the run began, even if another commit follows.
ENVIRONMENT = os.environ | {"OPENBLAS_NUM_THREADS": "1", "FORCEAXIS_DRAW": draws.word()}
# A scheduling class that runs only on an idle CPU and is interrupted at once. With nice alone, a
# process would keep the CPU to the end of its time slice.
IDLE = ("chrt", "--idle", "0")
FUZZ_S, FUZZ_ALL_S = 4, 20
SECOND_S = 420  # in which the second tries of a stage have to end


class Tally:
    """What passed and failed, and how long each test took."""

    def __init__(self):
        self.passed = self.failed = 0
        self.second_tries = []  # (name of a test that failed once, what became of its second try)
        self.seconds = []  # (duration in s, name) of each test
        self.files = []  # (JUnit file, that of the second try or None)
        self.begin = time.monotonic()
        self.lock = threading.Lock()  # two threads write the counts

    def count(self, stage, begin, passed, failed):
        with self.lock:
            self.passed += passed
            self.failed += failed
        seconds = time.monotonic() - begin
        print(f"{stage}: {passed} passed, {failed} failed, {seconds:.0f} s", flush=True)

    def read(self, stage, begin, xml, status, second=None):
        """Counts the tests of a JUnit file; a program's bad end that no failed test explains is
        one more. `second`: the JUnit file of the second try of those that failed."""
        self.files.append((xml, second))
        results = junit.outcomes(xml)
        again = junit.outcomes(second) if second else {}
        if second and not again:
            late = [name for name, (_, passed) in results.items() if not passed]
            self.second_tries += [(name, f"did not end within {SECOND_S} s") for name in late]
        for name, (seconds, passed) in again.items():
            self.second_tries.append((name, "passed" if passed else "failed again"))
            results[name] = (seconds + results.get(name, (0.0, False))[0], passed)
        failed = sum(not passed for _, passed in results.values())
        self.seconds += [(seconds, name) for name, (seconds, _) in results.items()]
        if not results or (status != 0 and failed == 0 and not again):
            print(f"{stage}: ended with status {status} after {len(results)} tests", flush=True)
            failed += 1
        self.count(stage, begin, sum(passed for _, passed in results.values()), failed)

    def end(self, table=True):
        if table:
            measured = {}
            for xml, _ in self.files:
                measured |= durations.by_folder(xml)
            print("\n".join(durations.report(measured, durations.load())))
        print("slowest")
        for seconds, name in sorted(self.seconds, reverse=True)[:10]:
            print(f"  {seconds:6.1f} s  {name}")
        print(f"second tries: {len(self.second_tries)}")
        for name, then in self.second_tries:
            print(f"  {name}: failed, then {then}")
        minutes, seconds = divmod(round(time.monotonic() - self.begin), 60)
        print(f"{minutes} min {seconds} s")
        print(f"{self.passed} passed, {self.failed} failed")
        return 1 if self.failed else 0


def build(tally, preset, target):
    """Configures and builds; one that fails is one failed test."""
    begin = time.monotonic()
    for command in (
        ["cmake", "--preset", preset],
        ["cmake", "--build", "--preset", preset, "--target", target, "--", "--quiet"],
    ):
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
        if done.returncode:
            print(done.stdout + done.stderr)
            tally.count(f"build {preset}", begin, 0, 1)
            return


def ctest(tally, preset, *selection):
    begin, xml = time.monotonic(), BUILD / f"ctest-{preset}.xml"
    xml.unlink(missing_ok=True)
    command = ["ctest", "--preset", preset, "--output-junit", xml, *selection]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        print("\n".join(x for x in done.stdout.splitlines() if not re.search(r" Passed ", x)))
    tally.read(f"ctest {preset}", begin, xml, done.returncode)


def pytest(tally, stage, expression, *options, prefix=(), twice=False):
    """One run of pytest. `twice`: what failed is tried a second time, alone. A second try that did
    not end as a whole is none."""
    begin, xml = time.monotonic(), BUILD / f"pytest-{stage.replace(' ', '-')}.xml"
    second = xml.with_suffix(".second.xml")
    cache = xml.with_suffix(".cache")  # each stage has its own, because stages run at the same time
    for old in (xml, second):
        old.unlink(missing_ok=True)
    shutil.rmtree(cache, ignore_errors=True)
    base = [*prefix, PYTHON, "-m", "pytest", "-m", expression, "-o", f"cache_dir={cache}", *options]
    # Its lines would mix with those of another stage that runs at the same time.
    quiet = {"capture_output": bool(prefix), "text": True}
    done = subprocess.run([*base, f"--junitxml={xml}"], cwd=ROOT, env=ENVIRONMENT, **quiet)
    if prefix and done.returncode:
        print(done.stdout + done.stderr, end="")
    # Exit status 1: the run was complete, and some of its tests failed.
    tried_again = (
        twice and done.returncode == 1 and any(not p for _, p in junit.outcomes(xml).values())
    )
    if tried_again:
        print(f"pytest {stage}: what failed is tried a second time", flush=True)
        # By the signal of Ctrl-C, so that fixtures end what they began.
        limit = ["timeout", "--foreground", "--signal=INT", "--kill-after=30", str(SECOND_S)]
        again = [*limit, *base, "--last-failed", "--last-failed-no-failures=none"]
        ended = subprocess.run([*again, f"--junitxml={second}"], cwd=ROOT, env=ENVIRONMENT)
        if ended.returncode not in (
            0,
            1,
        ):  # the test that was interrupted is there as one that passed
            second.unlink(missing_ok=True)
    tally.read(f"pytest {stage}", begin, xml, done.returncode, second if tried_again else None)


# Files in the order of their names, in which the longest files are not the last ones.
PARALLEL = ("-n", "2", "--dist", "loadfile", "--no-loadscope-reorder")

DRAWN = {"": (), "long-": ("--long-drawn",)}  # options by the beginning of the name of a stage


def fuzz(tally, seconds, prefix=()):
    begin = time.monotonic()
    done = subprocess.run(
        [*prefix, ROOT / "tests/firmware/fuzz/run.sh", str(seconds)], capture_output=True, text=True
    )
    print(done.stdout + done.stderr, end="")
    fuzzers = [f.stem for f in sorted((ROOT / "tests/firmware/fuzz").glob("*_fuzz.c*"))]
    xml = BUILD / "fuzz.xml"
    found = r"^fuzz {}: .*nothing found$"
    clean = {f: bool(re.search(found.format(f), done.stdout, re.M)) for f in fuzzers}
    junit.write(xml, "fuzz", clean)
    tally.read("fuzz", begin, xml, done.returncode)


def check_promises(tally):
    """Each promise of docs/guide/proofs.md is held by tests that ran and passed."""
    begin, rows = time.monotonic(), promises.load()
    lines = promises.faults(rows, promises.known()) + promises.unproven(rows, tally.files)
    for line in lines:
        print(f"promises: {line}", flush=True)
    tally.count("promises", begin, len(rows), len(lines))


def beside(tally, stages, fuzz_s):
    """What runs beside the tests of real buses, in the time that those leave: one process, where a
    compiler would be one on every core and make them late."""
    fuzz(tally, fuzz_s, IDLE)
    for prefix, expression in stages.items():
        pytest(tally, f"{prefix}beside", f"beside and {expression}", *DRAWN[prefix], prefix=IDLE)


@contextlib.contextmanager
def meanwhile(tally, work):
    """Runs work() in a thread beside the block, to its end."""

    def run():
        begin = time.monotonic()
        try:
            work()
        except Exception as error:  # otherwise the end of the thread would not be noticed
            print(f"beside: {error!r}", flush=True)
            tally.count("beside", begin, 0, 1)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        thread.join()


def main(arguments):
    if arguments not in ([], ["--quick"], ["--all"]):
        print(__doc__)
        return 0 if arguments in (["-h"], ["--help"]) else 2
    tally = Tally()
    if arguments == ["--quick"]:
        ctest(tally, "release", "-L", "quick", "-j2")
        pytest(tally, "quick", "quick", *PARALLEL)
        return tally.end(table=False)
    ctest(tally, "release", "-j2")
    pytest(tally, "parallel", "not alone and not beside and not long", *PARALLEL)
    stages, fuzz_s = {"": "not long"}, FUZZ_S
    if arguments == ["--all"]:
        stages, fuzz_s = stages | {"long-": "long"}, FUZZ_ALL_S
        # Tests compare the traces of these builds with those of the release build.
        build(tally, "debug-plain", "trace_hash")
        build(tally, "debug", "ctest_programs")
        ctest(tally, "debug", "-j2")
        pytest(tally, "long", "long and not alone and not beside", *PARALLEL, *DRAWN["long-"])
    # Each of the two threads begins its long stage as soon as its short stage has ended.
    with meanwhile(tally, lambda: beside(tally, stages, fuzz_s)):
        for prefix, expression in stages.items():
            pytest(tally, f"{prefix}alone", f"alone and {expression}", *DRAWN[prefix], twice=True)
    if arguments == ["--all"]:
        check_promises(tally)
    return tally.end()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
