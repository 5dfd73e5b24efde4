"""The kept inputs of the fuzzers: corpus/NAME.hex, one a line, replayed by ctest in every build.

usage: python3 tests/firmware/fuzz/corpus.py unpack NAME FOLDER
           the kept inputs as files, as libFuzzer wants them
       python3 tests/firmware/fuzz/corpus.py keep NAME
           keeps the shortest inputs of build/fuzz/NAME that reach all that those reach together

What a fuzzer has found, and was mended, is added to the file by hand: `xxd -p -c 0 FILE`.
"""

import hashlib
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
BUILD = HERE.parents[2] / "build" / "fuzz"


def kept(name):
    return HERE / "corpus" / f"{name}.hex"


def inputs(name):
    file = kept(name)
    return [bytes.fromhex(line) for line in file.read_text().split()] if file.exists() else []


def unpack(name, folder):
    for data in inputs(name):
        (Path(folder) / hashlib.sha1(data).hexdigest()).write_bytes(data)


def keep(name):
    with tempfile.TemporaryDirectory() as merged:
        words = [BUILD / name / name, "-set_cover_merge=1", "-max_len=256", merged]
        subprocess.run([*words, BUILD / name / "corpus"], check=True, capture_output=True)
        found = {file.read_bytes() for file in Path(merged).iterdir()}
    lines = sorted((data.hex() for data in found if data), key=lambda line: (len(line), line))
    kept(name).parent.mkdir(exist_ok=True)
    kept(name).write_text("".join(line + "\n" for line in lines))
    print(f"{name}: {len(lines)} inputs, {kept(name).stat().st_size} bytes")


def main(arguments):
    if len(arguments) == 3 and arguments[0] == "unpack":
        unpack(*arguments[1:])
    elif len(arguments) == 2 and arguments[0] == "keep":
        keep(arguments[1])
    else:
        print(__doc__)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
