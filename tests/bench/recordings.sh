#!/usr/bin/env bash
# Ours beside the baselines on recordings and rendered sequences that lie beside the project; those that are absent are
# left out. Prints Markdown.
#
# Usage: tests/bench/recordings.sh [DATA] [BASELINES]
#   DATA       folder with real/ and synthetic/ (default: $DEPTHTWEEN_DATA, else ../shared/data)
#   BASELINES  as for `depthtween-benchmark` (default: hold,linear,flow-warp)
#   DEPTHTWEEN_BENCHMARK names the program (default: build/bench/bin/depthtween-benchmark, preset bench)
set -euo pipefail
cd "$(dirname "$0")/../.."
data=${1:-${DEPTHTWEEN_DATA:-../shared/data}}
benchmark=${DEPTHTWEEN_BENCHMARK:-build/bench/bin/depthtween-benchmark}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
sequences=()
for sequence in synthetic/dev_kick synthetic/dev_bounce synthetic/dev_flag real/hands:8 real/table:4 real/rotation:4; do
  if [ -f "$data/${sequence%:*}/rgb.txt" ]; then
    sequences+=("$data/$sequence")
  else
    echo "(${sequence%:*} is not here)" >&2
  fi
done
"$benchmark" "${sequences[@]}" -o "$work" --tables depth --scenes none --baselines "${2:-hold,linear,flow-warp}" >&2
grep -v '^!\[' "$work/report.md" | cat -s
