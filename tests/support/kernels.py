"""The kernels of OpenBLAS that this processor executes, and a process under each.

As a program: prints as JSON which kernels run and the limits and figures of some loops.
    python tests/support/kernels.py MODEL...
"""

import ctypes
import json
import os
import sys
from dataclasses import asdict
from pathlib import Path

# Kernel -> what the processor must have, as /proc/cpuinfo says it.
NEEDS = {
    "Haswell": {"avx2", "fma"},
    "SkylakeX": {"avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl"},
    "Nehalem": {"sse4_2"},
    "Prescott": {"pni"},
}
SYMBOLS = [f"{start}openblas_get_corename{end}" for start in ("scipy_", "") for end in ("64_", "")]


def executed():
    """The kernels of NEEDS whose instructions this processor has."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    flags = set(next((line for line in lines if line.startswith("flags")), "").split())
    return [name for name, needs in NEEDS.items() if needs <= flags]


def environment(kernel):
    """Of a process whose OpenBLAS takes a kernel, with the cache sizes that it finds itself."""
    found = {n: v for n, v in os.environ.items() if not n.startswith("OPENBLAS_")}
    return found | {"OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": "1"}


def running():
    """The kernel of each OpenBLAS that this process has loaded, by its own word."""
    names = []
    maps = Path("/proc/self/maps").read_text().splitlines()
    for path in sorted({line.split()[-1] for line in maps if "openblas" in line}):
        library = ctypes.CDLL(path)
        for symbol in SYMBOLS:
            if hasattr(library, symbol):
                ask = getattr(library, symbol)
                ask.restype = ctypes.c_char_p
                names.append(ask().decode())
                break
    return names


def digits(models):
    """{model, timing, law: [limit, crossings, figures and margins at 0.4 of the limit]}."""
    from forceaxis.linear import loops, over

    found = {}
    for name in models:
        for timing in loops.TIMINGS:
            for law in ({}, {"law": "pi", "integral_rad_per_s": 8.0}):
                loop = loops.force_loop(name, timing=timing, **law)
                limit = loop.limit()
                row = [limit.gain, [(c.gain, c.frequency_hz) for c in limit.crossings]]
                if limit.gain:
                    gain = 0.4 * limit.gain
                    row += [asdict(over.figures(loop, gain)), asdict(loop.margins(gain))]
                found[f"{name}, {timing}, {law.get('law', 'p')}"] = row
    return found


if __name__ == "__main__":
    import scipy.linalg  # noqa: F401  loads its own OpenBLAS beside NumPy's

    print(json.dumps({"running": running(), "digits": digits(sys.argv[1:])}))
