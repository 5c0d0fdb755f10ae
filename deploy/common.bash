# SPDX-License-Identifier: Apache-2.0
# Sourced by the scripts of this folder. Everything they say goes to stderr.

# shellcheck disable=SC2034  # used by who sources this
root_dir=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd)

say() { printf '%s\n' "== $*" >&2; }

# die CODE MESSAGE...: exit codes as of the programs (2 usage, 3 configuration).
die() {
  local code=$1
  shift
  printf '%s\n' "${0##*/}: $*" >&2
  exit "$code"
}

# as_root COMMAND...: by root itself or by sudo, which may ask for a password on a terminal only.
as_root() {
  if [[ $(id -u) -eq 0 ]]; then
    "$@"
  elif [[ -t 0 ]]; then
    sudo "$@"
  else
    sudo -n "$@"
  fi
}

may_become_root() {
  [[ $(id -u) -eq 0 ]] || { command -v sudo >/dev/null && { [[ -t 0 ]] || sudo -n true 2>/dev/null; }; }
}

# give_back DIR...: what `sudo deploy/...` made in the source tree belongs to who called sudo.
give_back() {
  local dir
  [[ $(id -u) -eq 0 && -n ${SUDO_UID:-} ]] || return 0
  for dir in "$@"; do
    [[ ! -e $dir ]] || chown -R "$SUDO_UID:${SUDO_GID:-$SUDO_UID}" "$dir"
  done
}

# Compilers at once: one per core, as far as memory goes (the optimizer's sources take 1.5 GB each).
build_jobs() {
  local cores memory_gb
  cores=$(nproc)
  memory_gb=$(awk '/^MemAvailable/ {print int($2 / 1048576)}' /proc/meminfo)
  local by_memory=$((memory_gb * 2 / 3))
  echo $((by_memory < 1 ? 1 : by_memory < cores ? by_memory : cores))
}
