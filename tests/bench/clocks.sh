#!/usr/bin/env bash
# Clocks estimated from the images beside the truth, on the library's own scenes: 10 s at 240 and 30 frames a second,
# through the sensor model, 192x160. Then, if recordings lie beside the project, what the stamps, pairing by index and
# an estimate are worth on real/rotation (stamps of two unsynchronised cameras). Prints Markdown.
#
# Usage: tests/bench/clocks.sh [DATA] [SCENE...]    DATA: folder with real/ (default: $DEPTHTWEEN_DATA, else ../shared/data)
#        DEPTHTWEEN_CORE names the program (default: build/release/bin/depthtween-core)
#        DEPTHTWEEN_SCENES names a folder that keeps the rendered scenes: rendering takes minutes
set -euo pipefail
cd "$(dirname "$0")/../.."
data=${1:-${DEPTHTWEEN_DATA:-../shared/data}}
shift || true
[ $# -gt 0 ] || set -- pan turntable bounce kick still
core=${DEPTHTWEEN_CORE:-build/release/bin/depthtween-core}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
scenes=${DEPTHTWEEN_SCENES:-$work}

echo "| scene | planted ms, ppm | estimated ms | error ms | estimated ppm | error ppm | row us |"
echo "|---|---|---|---:|---|---:|---|"
for scene in "$@"; do
  [ -f "$scenes/$scene/rgb.txt" ] ||
    "$core" synth "$scene" -o "$scenes/$scene" --frames 2401 --size 192x160 --no-truth >/dev/null 2>"$work/log"
  while read -r offset drift; do
    # A clock changes nothing but stamps: one rendering serves all clocks, stamped as `synth --time-offset-ms
    # --drift-ppm` does it.
    clip=$work/planted
    rm -rf "$clip"
    mkdir "$clip"
    cp -rl "$scenes/$scene"/{rgb,depth,rgb.txt,camera.json} "$clip" 2>/dev/null || cp -r "$scenes/$scene"/{rgb,depth,rgb.txt,camera.json} "$clip"
    awk -v offset="$offset" -v drift="$drift" \
      '/^#/ { print; next } { printf "%.9f %s\n", 1e-3 * offset + (1 + 1e-6 * drift) * $1, $2 }' "$scenes/$scene/depth.txt" >"$clip/depth.txt"
    "$core" sync "$clip" --json >"$work/estimate.json" 2>"$work/log"
    python3 - "$scene" "$offset" "$drift" "$work/estimate.json" <<'PY'
import json, sys
scene, offset, drift, path = sys.argv[1], float(sys.argv[2]), float(sys.argv[3]), sys.argv[4]
e = json.load(open(path))
if not e["trusted"]:
    print(f"| {scene} | {offset:g}, {drift:g} | {e['reason']} | | | | |")
else:
    ms, sigma = 1e-6 * e["offset_ns"], 1e-6 * e["offset_sigma_ns"]
    print(f"| {scene} | {offset:g}, {drift:g} | {ms:.3f} ± {sigma:.3f} | {ms - offset:+.3f} | {e['drift_ppm']:.0f} ± {e['drift_sigma_ppm']:.0f} | {e['drift_ppm'] - drift:+.0f} | {1e-3 * e['row_time_ns']:.1f} ± {1e-3 * e['row_time_sigma_ns']:.1f} |")
PY
  done <<'LIST'
0 0
4 3000
-15 500
40 -1000
LIST
done

rotation=$data/real/rotation
[ -f "$rotation/rgb.txt" ] || { echo "(real/rotation is not here)" >&2; exit 0; }
echo
"$core" sync "$rotation" 2>"$work/log" | sed 's/^/real\/rotation: /'
echo
echo "| real/rotation, 1 depth frame in 4 | RMSE mm | edge band mm | interior mm | truth frames |"
echo "|---|---:|---:|---:|---:|"
for clock in stamps index estimate; do
  "$core" upsample "$rotation" -o "$work/$clock" --key-every 4 --clock "$clock" >/dev/null 2>"$work/log"
  "$core" evaluate "$work/$clock" --reference "$rotation" --json >"$work/scores.json" 2>"$work/log"
  python3 - "$clock" "$work/scores.json" <<'PY'
import json, sys
report = json.load(open(sys.argv[2]))
regions = report["methods"][0]["regions"]
print(f"| --clock {sys.argv[1]} | {regions['all']['rmse_mm']:.2f} | {regions['edge_band']['rmse_mm']:.1f} | {regions['interior']['rmse_mm']:.2f} | {len(report['frames'])} |")
PY
done
