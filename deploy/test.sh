#!/bin/bash
# Everything that must be green before a change lands; CI runs exactly this. For one part of it: deploy/test.sh STEP...
#
#   style   layering of the source tree, clang-format
#   suite   all tests, once: optimised, with assertions
#   asan    core, jobs and store under AddressSanitizer and UndefinedBehaviorSanitizer
#   tsan    jobs and store under ThreadSanitizer
#   fuzz    the fuzz targets over their corpora
#
# Sanitizers see our modules only: Debian's gRPC is not instrumented, and generated code is not ours.
# Every step runs, even if an earlier one failed; the exit code is 0 if all passed.
set -uo pipefail

# shellcheck source-path=SCRIPTDIR
source "$(dirname "${BASH_SOURCE[0]}")/steps.sh" || exit

readonly ALL_STEPS=(style suite asan tsan fuzz)
readonly LOGS=build/test-logs

# run_tests STEP PRESET [WHICH]: the log keeps what the summary quotes. A hung test is ended by its own time limit.
run_tests() {
  "${WITHOUT_ASLR[@]}" ctest --preset "$2" --parallel "$(nproc)" --no-tests=error --output-log "$LOGS/$1.log" "${@:3}"
}
WITHOUT_ASLR=()

style() {
  python3 tests/layering/layering_test.py &&
    find core server client proto/depthtween tests \( -name '*.h' -o -name '*.cc' \) -print0 |
    xargs -0 clang-format --dry-run --Werror &&
    echo "clang-format: nothing to change"
}

suite() {
  configure dev && build dev && run_tests suite dev
}

asan() {
  configure asan && build asan && UBSAN_OPTIONS=print_stacktrace=1 run_tests asan asan
}

tsan() {
  # GCC 12's runtime has no room for the many random bits of addresses that newer kernels use. Where a container forbids
  # to switch them off, the kernel is left as it is.
  if setarch --addr-no-randomize true 2>/dev/null; then local WITHOUT_ASLR=(setarch --addr-no-randomize); fi
  configure tsan && build tsan server_jobs_test server_store_test &&
    run_tests tsan tsan -R '^server_(jobs|store)_test$'
}

fuzz() {
  local targets
  mapfile -t targets < <(sed -n 's/^depthtween_fuzz_target(\([a-z_]*\) .*)$/\1_fuzz/p' tests/fuzz/CMakeLists.txt)
  configure fuzz && build fuzz "${targets[@]}" && run_tests fuzz fuzz -L fuzz
}

main() {
  local steps=("$@") step failed=0 start summary=
  ((${#steps[@]})) || steps=("${ALL_STEPS[@]}")
  for step in "${steps[@]}"; do
    if [[ " ${ALL_STEPS[*]} " != *" $step "* ]]; then
      say "there is no step '$step'; the steps are: ${ALL_STEPS[*]}"
      exit 2
    fi
  done
  deploy/install-packages.sh build test || exit
  mkdir -p "$LOGS" && rm -f "$LOGS"/*.log "$LOGS"/summary.txt

  for step in "${steps[@]}"; do
    printf '\n== %s\n' "$step"
    start=$SECONDS
    local verdict=passed closing=
    "$step" || verdict=FAILED
    [[ $verdict == passed ]] || failed=$((failed + 1))
    [[ -f $LOGS/$step.log ]] && closing=$(grep 'tests passed, .* out of' "$LOGS/$step.log" | tail -n 1)
    summary+=$(printf '%-6s %-6s %5d s  %s' "$step" "$verdict" $((SECONDS - start)) "$closing")$'\n'
  done

  printf '\n== summary\n%s' "$summary" | tee "$LOGS/summary.txt"
  if ((failed)); then
    echo "deploy/test.sh: $failed of ${#steps[@]} steps FAILED, after $SECONDS s"
    exit 1
  fi
  echo "deploy/test.sh: all ${#steps[@]} steps passed, in $SECONDS s"
}

main "$@"
