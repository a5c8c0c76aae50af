#!/usr/bin/env bash
# What it is worth to move depth to colour: recordings upsampled with depth as it lies, moved, and moved with the clock
# measured too; scored on depth frames that were left out, which are moved likewise. Prints Markdown.
#
# Usage: tests/bench/registration.sh [DATA] [CLIP...]    DATA: folder with clips/ (default: $DEPTHTWEEN_DATA, else ../shared/data)
#        DEPTHTWEEN_CORE names the program (default: build/release/bin/depthtween-core)
set -euo pipefail
cd "$(dirname "$0")/../.."
data=${1:-${DEPTHTWEEN_DATA:-../shared/data}}
shift || true
[ $# -gt 0 ] || set -- clips/cup clips/door_small
core=${DEPTHTWEEN_CORE:-build/release/bin/depthtween-core}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

echo "| clip | depth frames | registration, clock | depth was beside colour by | method | RMSE mm | MAE mm | edge band mm |"
echo "|---|---|---|---|---|---:|---:|---:|"
for clip in "$@"; do
  for every in 4 8; do
    for how in "none stamps" "estimate stamps" "estimate estimate"; do
      read -r registration clock <<<"$how"
      rm -rf "$work/result"
      "$core" upsample "$data/$clip" -o "$work/result" --key-every "$every" --register "$registration" --clock "$clock" \
        >"$work/log" 2>&1
      if ! "$core" evaluate "$work/result" --reference "$data/$clip" --baselines hold,linear,flow-warp --json \
        >"$work/scores.json" 2>"$work/log"; then
        echo "| $clip | 1 in $every | $registration, $clock | | not scored: no left-out depth frame meets a colour frame | | | |"
        continue
      fi
      python3 - "$clip" "$every" "$registration, $clock" "$work/result/report.json" "$work/scores.json" <<'PY'
import json, sys
clip, every, how, report, scores = sys.argv[1:]
estimate = json.load(open(report))["registration"]["estimate"]
beside = estimate["reason"] or f"{estimate['moves_px']:.1f} px (+-{estimate['moves_sigma_px']:.1f})"
for method in json.load(open(scores))["methods"]:
    whole, band = method["regions"]["all"], method["regions"]["edge_band"]
    print(f"| {clip} | 1 in {every} | {how} | {beside} | {method['name']} | {whole['rmse_mm']:.1f} "
          f"| {whole['mae_mm']:.1f} | {band['rmse_mm']:.1f} |")
PY
    done
  done
done
