#!/usr/bin/env bash
# Speed and memory of the pipeline: seconds per 8-frame interval beside OpenCV's DIS flows in the same run (the time
# table of `depthtween-benchmark`, on `kick`), and the peak resident memory of `depthtween-core upsample` on clips of
# 4 and of 64 intervals.
#
# Usage: tests/bench/speed.sh [ROUNDS]      Builds into build/bench. About 5 minutes on 2 cores.
set -euo pipefail
cd "$(dirname "$0")/../.."
rounds=${1:-7}
build=build/bench
cmake --preset bench >/dev/null
ninja -C "$build" depthtween-core depthtween-benchmark >/dev/null
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
"$build/bin/depthtween-benchmark" -o "$work/report" --tables time --scenes kick --rounds "$rounds" >/dev/null 2>&1
grep -v '^!\[' "$work/report/report.md" | cat -s
echo "| intervals | peak resident memory, MiB |"
echo "|---|---|"
for intervals in 4 64; do
  "$build/bin/depthtween-core" synth kick -o "$work/seq$intervals" --frames $((8 * intervals + 1)) --size 256x212 --no-truth >/dev/null 2>&1
  python3 - "$build/bin/depthtween-core" "$work/seq$intervals" "$work/out$intervals" "$intervals" <<'PY'
import resource, subprocess, sys
core, sequence, out, intervals = sys.argv[1:]
subprocess.run([core, "upsample", sequence, "-o", out, "--threads", "2"], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
print(f"| {intervals} | {resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024:.1f} |")
PY
done
