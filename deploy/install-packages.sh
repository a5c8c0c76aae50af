#!/bin/bash
# Installs the Debian packages of the named sections of apt-packages.txt: deploy/install-packages.sh build test
#
# Asks nothing, and does nothing at all, not even refresh the package lists, when every package is there.
# Needs root, or sudo when something is missing.
set -euo pipefail

LIST=$(dirname "${BASH_SOURCE[0]}")/apt-packages.txt

say() { echo "install-packages: $*" >&2; }

# The packages of section [$1], one a line.
packages_of() {
  awk -v section="[$1]" '/^\[/ { here = ($0 == section); next } here && NF && !/^#/' "$LIST"
}

is_installed() {
  [[ $(dpkg-query --show --showformat='${db:Status-Status}' "$1" 2>/dev/null) == installed ]]
}

# Node may come from a source other than Debian, whose npm package conflicts with it: either program will do.
is_provided_otherwise() {
  case $1 in
    nodejs) command -v node >/dev/null ;;
    npm) command -v npm >/dev/null ;;
    *) return 1 ;;
  esac
}

as_root() {
  if ((EUID == 0)); then
    "$@"
  elif command -v sudo >/dev/null; then
    sudo "$@"
  else
    say "needs root to install packages: run it as root, or install sudo"
    return 1
  fi
}

apt() {
  # A machine that has just started may be installing updates: wait for them.
  as_root env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=300 -o Dpkg::Use-Pty=0 -qq "$@" </dev/null
}

main() {
  if (($# == 0)); then
    say "name the sections to install: $(sed -n 's/^\[\(.*\)\]$/\1/p' "$LIST" | tr '\n' ' ')"
    exit 2
  fi
  local section package missing=()
  for section in "$@"; do
    if [[ -z $(packages_of "$section") ]]; then
      say "$LIST has no section [$section]"
      exit 2
    fi
    while read -r package; do
      is_provided_otherwise "$package" || is_installed "$package" || missing+=("$package")
    done < <(packages_of "$section")
  done
  ((${#missing[@]})) || return 0

  if ! command -v apt-get >/dev/null; then
    say "this is not Debian. What is needed, by its names in Debian 12: ${missing[*]}"
    exit 1
  fi
  say "installing ${missing[*]}"
  apt update
  apt install --no-install-recommends "${missing[@]}"
}

main "$@"
