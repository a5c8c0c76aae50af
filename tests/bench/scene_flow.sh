#!/usr/bin/env bash
# Scene flow: ours beside re-implemented ideas, on the library's scenes and on pairs and rendered sequences that lie beside
# the project; those that are absent are left out. Prints Markdown.
#
# Usage: tests/bench/scene_flow.sh [DATA]
#   DATA  folder with multiview/, sceneflow/ and synthetic/ (default: $DEPTHTWEEN_DATA, else ../shared/data)
#   DEPTHTWEEN_BENCHMARK names the program (default: build/bench/bin/depthtween-benchmark, preset bench)
# Needs NumPy and Pillow for the pairs (tests/bench/scene_flow_pairs.py).
set -euo pipefail
cd "$(dirname "$0")/../.."
data=${1:-${DEPTHTWEEN_DATA:-../shared/data}}
benchmark=${DEPTHTWEEN_BENCHMARK:-build/bench/bin/depthtween-benchmark}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mapfile -t sequences < <(tests/bench/scene_flow_pairs.py "$data" "$work/pairs")
for sequence in dev_kick dev_bounce dev_flag; do
  [ ! -f "$data/synthetic/$sequence/rgb.txt" ] || sequences+=("$data/synthetic/$sequence")
done
"$benchmark" "${sequences[@]}" -o "$work/report" --tables sceneflow --size 256x212 >&2
grep -v '^!\[' "$work/report/report.md" | cat -s
