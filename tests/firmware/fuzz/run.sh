#!/usr/bin/env bash
# Runs each fuzzer of this folder for SECONDS with the address and undefined-behaviour sanitizers,
# from the inputs of corpus/NAME.hex on.
#
# usage: tests/firmware/fuzz/run.sh [SECONDS [NAME...]]      (60 s, every *_fuzz.c and *_fuzz.cpp)
#
# Status 1 if one finds something: its input and the line that replays it are printed.
set -euo pipefail
cd "$(dirname "$0")/../../.."

seconds=${1:-60}
shift || true
names=("$@")
[ ${#names[@]} -gt 0 ] || for f in tests/firmware/fuzz/*_fuzz.c*; do names+=("$(basename "${f%.*}")"); done

mkdir -p build/fuzz/messages build/fuzz/objects
# With the assertions of the firmware.
flags=(-O1 -g -Itests/firmware/asserted -I. -Wall -Wextra -Werror -fno-omit-frame-pointer
  -fsanitize=address,undefined,fuzzer -fno-sanitize-recover=all)
# Everything but the ports.
mapfile -t firmware < <(find firmware -name '*.c' -not -path 'firmware/port/*' | sort)
firmware+=(tests/firmware/asserted/failed.c)
# Once for all fuzzers of it, and apart from the gateway's C++.
# Two folders may have a file of the same name.
rm -f build/fuzz/objects/*
for f in "${firmware[@]}"; do
  object=${f%.c}
  clang -std=c11 "${flags[@]}" -c "$f" -o "build/fuzz/objects/${object//\//_}.o"
done
build() {
  if [ -e "tests/firmware/fuzz/$1.c" ]; then
    clang -std=c11 "${flags[@]}" "tests/firmware/fuzz/$1.c" build/fuzz/objects/*.o -o "$2"
  elif [ "$1" = mbap_fuzz ]; then
    clang++ -std=c++20 "${flags[@]}" "tests/firmware/fuzz/$1.cpp" host/modbus/frames.cpp \
      host/gateway/modbus_self.cpp build/fuzz/objects/*.o -o "$2"
  else
    /usr/bin/lcm-gen -x --cpp-hpath build/fuzz/messages host/lcm/*.lcm
    clang++ -std=c++20 "${flags[@]}" -isystem build/fuzz/messages "tests/firmware/fuzz/$1.cpp" \
      host/lcm/assembly.cpp host/lcm/command_message.cpp \
      build/fuzz/objects/tests_firmware_asserted_failed.o -o "$2"
  fi
}
status=0
for name in "${names[@]}"; do
  folder=build/fuzz/$name
  mkdir -p "$folder/corpus"
  build "$name" "$folder/$name"
  python3 tests/firmware/fuzz/corpus.py unpack "$name" "$folder/corpus"
  if "$folder/$name" "$folder/corpus" -max_total_time="$seconds" -max_len=1024 -timeout=10 \
      -artifact_prefix="$folder/" -print_final_stats=1 >"$folder/log" 2>&1; then
    runs=$(sed -n 's/stat::number_of_executed_units: *//p' "$folder/log")
    echo "fuzz $name: $runs inputs in $seconds s, nothing found"
  else
    status=1
    echo "fuzz $name: FOUND something; replay: $folder/$name $(ls -t "$folder"/crash-* "$folder"/timeout-* "$folder"/leak-* 2>/dev/null | head -1)"
    tail -40 "$folder/log"
  fi
done
exit $status
