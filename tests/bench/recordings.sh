#!/usr/bin/env bash
# Ours beside hold, linear and flow-warp on recordings and rendered sequences that lie beside the project; those that are absent are
# left out. Prints Markdown.
#
# Usage: tests/bench/recordings.sh [DATA]   DATA: folder with real/ and synthetic/ (default: $DEPTHTWEEN_DATA, else ../shared/data)
#        DEPTHTWEEN_CORE names the program (default: build/bench/bin/depthtween-core, built by tests/bench/speed.sh)
set -euo pipefail
cd "$(dirname "$0")/../.."
data=${1:-${DEPTHTWEEN_DATA:-../shared/data}}
core=${DEPTHTWEEN_CORE:-build/bench/bin/depthtween-core}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
while read -r sequence every; do
  [ -f "$data/$sequence/rgb.txt" ] || { echo "($sequence is not here)" >&2; continue; }
  out=$work/$(basename "$sequence")
  "$core" upsample "$data/$sequence" -o "$out" --key-every "$every" >/dev/null 2>&1
  "$core" evaluate "$out" --reference "$data/$sequence" --baselines hold,linear,flow-warp --json >"$out.json" 2>/dev/null
  echo "$sequence" "$every" "$out.json"
done <<'LIST' >"$work/list"
synthetic/dev_kick 1
synthetic/dev_bounce 1
synthetic/dev_flag 1
real/hands 8
real/table 4
real/rotation 4
LIST
python3 - "$work/list" <<'PY'
import json, math, sys
print("| sequence | keep 1 in | method | RMSE mm | MAE mm | edge band mm | interior mm | complete % |")
print("|---|---|---|---|---|---|---|---|")
ratios = {}
for line in open(sys.argv[1]):
    sequence, every, path = line.split()
    rows = json.load(open(path))["methods"]
    for row in rows:
        regions = row["regions"]
        print(f"| {sequence} | {every} | {row['name']} | {regions['all']['rmse_mm']:.1f} | {regions['all']['mae_mm']:.2f} | {regions['edge_band']['rmse_mm']:.1f} | {regions['interior']['rmse_mm']:.1f} | {100 * row['completeness']:.1f} |")
    by = {row["name"]: row["regions"] for row in rows}
    ratios.setdefault(sequence.split("/")[0], []).append(
        tuple(by["ours"][part][key] / by["flow-warp"][part][key] for part, key in (("all", "rmse_mm"), ("all", "mae_mm"), ("edge_band", "rmse_mm"))))
print()
for group, values in ratios.items():
    means = [math.exp(sum(math.log(v[i]) for v in values) / len(values)) for i in range(3)]
    print(f"Geometric mean of ours / flow-warp, {group}: RMSE {means[0]:.3f}, MAE {means[1]:.3f}, edge band {means[2]:.3f}")
PY
