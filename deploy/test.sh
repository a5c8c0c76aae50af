#!/bin/bash
# Everything that must be green before a change lands; CI runs exactly this. For one part of it: deploy/test.sh STEP...
#
#   style   layering of the source tree, clang-format
#   tidy    clang-tidy on the sources that changed last; for all: deploy/tidy.sh
#   suite   all tests, once: optimised, with assertions
#   asan    the tests of modules under AddressSanitizer and UndefinedBehaviorSanitizer, gRPC, HTTP and client among them
#   tsan    jobs, store and access under ThreadSanitizer
#   fuzz    the fuzz targets over their corpora
#
# Too slow for each change, so only when named:
#
#   tsan-http   the HTTP listener under ThreadSanitizer, ten minutes on two processors
#
# Sanitizers see our modules only: Debian's gRPC is not instrumented, and generated code is not ours.
# Every step runs, even if an earlier one failed; the exit code is 0 if all passed.
set -uo pipefail

# shellcheck source-path=SCRIPTDIR
source "$(dirname "${BASH_SOURCE[0]}")/steps.sh" || exit

readonly ALL_STEPS=(style tidy suite asan tsan fuzz) SLOW_STEPS=(tsan-http)
readonly LOGS=build/test-logs

# run_tests STEP PRESET [WHICH]: the log keeps what the summary quotes. A hung test is ended by its own time limit.
run_tests() {
  "${WITHOUT_ASLR[@]}" ctest --preset "$2" --parallel "$(nproc)" --no-tests=error --output-log "$LOGS/$1.log" "${@:3}"
}
WITHOUT_ASLR=()

# Processor seconds of everything that this script has run and waited for.
processor_seconds() {
  local fields
  read -ra fields <"/proc/$$/stat"  # the name in field 2 is one word: this is bash
  echo $(((fields[15] + fields[16]) / $(getconf CLK_TCK)))
}

# What took longest to build, by ninja's log: wall seconds, preset, file.
slowest_files() {
  local log
  for log in build/*/.ninja_log; do
    [[ -f $log ]] || continue
    awk -F '\t' -v preset="$(basename "$(dirname "$log")")" \
      'NR > 1 { took[$4] = ($2 - $1) / 1000 } END { for (file in took) printf "%7.1f  %-6s %s\n", took[file], preset, file }' "$log"
  done | sort --numeric-sort --reverse | head -n 20
}

style() {
  python3 tests/layering/layering_test.py &&
    find core server client proto/depthtween tests \( -name '*.h' -o -name '*.cc' \) -print0 |
    xargs -0 clang-format --dry-run --Werror &&
    echo "clang-format: nothing to change"
}

tidy() {
  deploy/tidy.sh --recent 4
}

suite() {
  configure dev && build dev && run_tests suite dev
}

asan() {
  configure asan && build asan && UBSAN_OPTIONS=print_stacktrace=1 run_tests asan asan
}

# sanitize_threads STEP TEST...
sanitize_threads() {
  local tests=("${@:2}")
  # GCC 12's runtime has no room for the many random bits of addresses that newer kernels use. Where a container forbids
  # to switch them off, the kernel is left as it is.
  if setarch --addr-no-randomize true 2>/dev/null; then local WITHOUT_ASLR=(setarch --addr-no-randomize); fi
  configure tsan && build tsan "${tests[@]}" &&
    TSAN_OPTIONS="suppressions=$PWD/deploy/cmake/thread-sanitizer.supp" \
      run_tests "$1" tsan -R "^($(IFS='|' && echo "${tests[*]}"))\$"
}

tsan() { sanitize_threads tsan server_jobs_test server_store_test server_access_test; }
tsan-http() { sanitize_threads tsan-http server_http_test; }

fuzz() {
  local targets
  mapfile -t targets < <(sed -nE 's/^depthtween_(http_)?fuzz_target\(([a-z_]+).*\)$/\2_fuzz/p' tests/fuzz/CMakeLists.txt)
  configure fuzz && build fuzz "${targets[@]}" && run_tests fuzz fuzz -L fuzz
}

main() {
  local steps=("$@") step failed=0 start processor summary=
  ((${#steps[@]})) || steps=("${ALL_STEPS[@]}")
  for step in "${steps[@]}"; do
    if [[ " ${ALL_STEPS[*]} ${SLOW_STEPS[*]} " != *" $step "* ]]; then
      say "there is no step '$step'; the steps are: ${ALL_STEPS[*]}, and when named ${SLOW_STEPS[*]}"
      exit 2
    fi
  done
  deploy/install-packages.sh build test || exit
  mkdir -p "$LOGS" && rm -f "$LOGS"/*.log "$LOGS"/*.txt

  for step in "${steps[@]}"; do
    printf '\n== %s\n' "$step"
    start=$SECONDS processor=$(processor_seconds)
    local verdict=passed closing=
    "$step" || verdict=FAILED
    [[ $verdict == passed ]] || failed=$((failed + 1))
    [[ -f $LOGS/$step.log ]] && closing=$(grep 'tests passed, .* out of' "$LOGS/$step.log" | tail -n 1)
    summary+=$(printf '%-6s %-6s %5d s, processor %5d s  %s' "$step" "$verdict" $((SECONDS - start)) \
      $(($(processor_seconds) - processor)) "$closing")$'\n'
  done

  slowest_files >"$LOGS/slowest-files.txt"
  printf '\n== summary, also in %s beside the slowest files\n' "$LOGS/summary.txt"
  printf '%s' "$summary" | tee "$LOGS/summary.txt"
  if ((failed)); then
    echo "deploy/test.sh: $failed of ${#steps[@]} steps FAILED, after $SECONDS s"
    exit 1
  fi
  echo "deploy/test.sh: all ${#steps[@]} steps passed, in $SECONDS s"
}

main "$@"
