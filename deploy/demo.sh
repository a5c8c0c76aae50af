#!/bin/bash
# The main job from nothing: builds Depthtween, renders a recording (colour at 240 fps, depth at 30 fps), starts a
# server, has it upsample the recording, and shows what came back beside the baselines and the exact truth.
#
#   deploy/demo.sh [OUTPUT_FOLDER]      the default is demo-output, in the root of the repository
#
# Asks nothing; may be run again. Needs Debian 12, and root or sudo if packages are missing.
set -euo pipefail

OUTPUT=demo-output
if (($#)); then OUTPUT=$(realpath --canonicalize-missing "$1"); fi
# shellcheck source-path=SCRIPTDIR
source "$(dirname "${BASH_SOURCE[0]}")/steps.sh"

readonly OUTPUT BIN=build/release/bin
readonly FRAMES=65  # eight intervals: 0.27 s of motion, 9 depth maps

SERVER_PID=
SERVER_DATA=

# However this script ends, it stops the server and deletes the server's data: the result has been fetched by then.
stop_server() {
  if [[ -n $SERVER_PID ]]; then
    kill "$SERVER_PID" 2>/dev/null || true
    wait "$SERVER_PID" 2>/dev/null || true
    SERVER_PID=
  fi
  if [[ -n $SERVER_DATA ]]; then rm -rf "$SERVER_DATA"; fi
  SERVER_DATA=
}
trap stop_server EXIT
trap 'exit 130' INT
trap 'exit 143' TERM

step() { printf '\n== %s\n' "$*"; }

# Starts the server on a free port of the loopback interface; sets ADDRESS once it is healthy.
start_server() {
  SERVER_DATA=$(mktemp -d "$OUTPUT/server.XXXXXX")
  local port_file=$SERVER_DATA/port log=$OUTPUT/server.log
  "$BIN/depthtween-server" serve --data-dir "$SERVER_DATA/data" --listen 127.0.0.1:0 --port-file "$port_file" \
    >"$log" 2>&1 </dev/null &
  SERVER_PID=$!
  for _ in {1..300}; do
    if [[ -s $port_file ]]; then
      ADDRESS=127.0.0.1:$(<"$port_file")
      if "$BIN/depthtween-server" healthcheck --server "$ADDRESS" 2>/dev/null; then
        echo "healthy on $ADDRESS, process $SERVER_PID, log in $log"
        return
      fi
    fi
    kill -0 "$SERVER_PID" 2>/dev/null || break
    sleep 0.1
  done
  say "the server did not start; the end of $log:"
  tail -n 20 "$log" >&2
  exit 1
}

step "Packages"
deploy/install-packages.sh build
echo "all there"

step "Build"
configure release
build release depthtween-core depthtween-server depthtween
echo "programs in $BIN"

mkdir -p "$OUTPUT"

step "A recording: colour at 240 fps, depth at 30 fps with the noise of a real sensor"
"$BIN/depthtween-core" synth kick -o "$OUTPUT/recording" --frames "$FRAMES" --color-fps 240 --depth-fps 30 --force

step "A server"
start_server

step "The job: upload, upsample, fetch"
JOB_START=$SECONDS
"$BIN/depthtween" submit "$OUTPUT/recording" --server "$ADDRESS" --wait -o "$OUTPUT/result" --force
echo "the job took $((SECONDS - JOB_START)) s"

step "The server stops"
stop_server
echo "stopped; what it stored is deleted"

step "Pictures"
for preview in preview.png preview.mp4; do
  "$BIN/depthtween-core" preview "$OUTPUT/result" --sequence "$OUTPUT/recording" -o "$OUTPUT/$preview"
done

step "Ours beside the baselines, against the exact truth"
"$BIN/depthtween-core" evaluate "$OUTPUT/result" --reference "$OUTPUT/recording" --baselines hold,linear,flow-warp |
  tee "$OUTPUT/table.txt"

cat <<END

Done in $((SECONDS / 60)) min $((SECONDS % 60)) s.
  frames    $(realpath "$OUTPUT/result/depth")   ($FRAMES depth maps, 240 a second)
  picture   $(realpath "$OUTPUT/preview.png")
  video     $(realpath "$OUTPUT/preview.mp4")
  table     $(realpath "$OUTPUT/table.txt")
END
