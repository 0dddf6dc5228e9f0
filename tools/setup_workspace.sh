#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Makes .venv, builds the workspace with colcon, writes env.sh and compiles modules and kernels;
# does nothing when all is current.
# Usage: tools/setup_workspace.sh [requirements file …]   (extra sets: requirements-dev.txt)
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
workspace=$PWD

fail() {
  printf '%s\n' "$1" >&2
  exit 1
}

# Leave an environment of this workspace that is already sourced: the set-up starts from outside.
outside() { # a PATH-like variable without the entries of this workspace
  printf '%s' "${1:-}" | tr ':' '\n' | { grep -v -e "^$workspace/" -e '^$' || true; } | paste -sd: -
}
unset VIRTUAL_ENV PYTHONHOME PYTHONDONTWRITEBYTECODE
PATH=$(outside "$PATH")
PYTHONPATH=$(outside "${PYTHONPATH:-}")
AMENT_PREFIX_PATH=$(outside "${AMENT_PREFIX_PATH:-}")
export PATH PYTHONPATH AMENT_PREFIX_PATH

ros_prefix() { # prefix of a sourced ROS 2 that holds rclpy
  local prefix
  local IFS=:
  for prefix in ${AMENT_PREFIX_PATH:-}; do
    if [ -e "$prefix/share/rclpy/package.xml" ] && [ -e "$prefix/setup.bash" ]; then
      printf '%s' "$prefix"
      return
    fi
  done
}

is_python_3_12() {
  [ "$("$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null)" = 3.12 ]
}

find_python() {
  local candidate
  for candidate in python3.12 python3 python; do
    if command -v "$candidate" >/dev/null && is_python_3_12 "$candidate"; then
      command -v "$candidate"
      return
    fi
  done
  if command -v pyenv >/dev/null; then
    for candidate in "$(pyenv root)"/versions/3.12*/bin/python3.12; do
      if [ -x "$candidate" ] && is_python_3_12 "$candidate"; then
        printf '%s' "$candidate"
        return
      fi
    done
  fi
  if command -v uv >/dev/null && candidate=$(uv python find 3.12 2>/dev/null); then
    printf '%s' "$candidate"
    return
  fi
}

install_packages() { # with uv, in a third of pip's time; where that fails, with pip, which says why
  local pip=(.venv/bin/python -m pip install --quiet --disable-pip-version-check)
  "${pip[@]}" uv==0.13.9 &&
    env ${PIP_FIND_LINKS:+UV_FIND_LINKS="$PIP_FIND_LINKS"} \
      ${PIP_INDEX_URL:+UV_DEFAULT_INDEX="$PIP_INDEX_URL"} \
      .venv/bin/uv pip install --quiet --system-certs --python .venv/bin/python "$@" 2>/dev/null ||
    "${pip[@]}" "$@"
}

ros=$(ros_prefix)
requirements=(requirements.txt requirements-logs.txt requirements-web.txt requirements-pdf.txt requirements-fleet.txt requirements-bench.txt)
venv_options=()
if [ -n "$ros" ]; then
  [ "${ROS_DISTRO:-jazzy}" = jazzy ] ||
    fail "ROS 2 $ROS_DISTRO is sourced; this workspace needs Jazzy: source it, or start from a shell without ROS."
  venv_options=(--system-site-packages)
else
  requirements+=(requirements-ros.txt)
fi
requirements+=("$@")

stamp=.venv/.workspace_requirements
mkdir -p .venv
touch .venv/COLCON_IGNORE
touch "$stamp"
# A set once installed stays wanted, so that "make demo" after "make test" installs nothing anew.
mapfile -t wanted < <({ sed -n 's/^set: //p' "$stamp"; printf '%s\n' "${requirements[@]}"; } | sort -u)
place=$(printf 'workspace: %s\nros: %s' "$workspace" "$ros")
current=$(
  printf '%s\n' "$place"
  printf 'set: %s\n' "${wanted[@]}"
  cat "${wanted[@]}"
)
if [ "$(sed -n '1,2p' "$stamp")" != "$place" ] || ! .venv/bin/python -c '' 2>/dev/null; then
  python=$(find_python)
  [ -n "$python" ] ||
    fail 'Python 3.12 was not found on PATH, in pyenv or in uv. Get it with "apt install python3.12-venv", "pyenv install 3.12" or "uv python install 3.12".'
  echo 'Setting up .venv (once; about a minute) …'
  "$python" -m venv --clear "${venv_options[@]}" .venv
  touch .venv/COLCON_IGNORE
  rm -rf build install log
fi
if [ ! -e "$stamp" ] || [ "$(cat "$stamp")" != "$current" ]; then
  echo 'Installing the packages that are required …'
  install_packages "${wanted[@]/#/-r}"
  printf '%s\n' "$current" > "$stamp"
fi

sources=$(cat src/*/setup.py src/imu_workbench/imu_workbench/commands/__init__.py src/*/setup.cfg src/*/package.xml; ls src/*/launch src/*/config 2>/dev/null || true)
built=install/.workspace_sources
if [ ! -e "$built" ] || [ "$(cat "$built")" != "$sources" ]; then
  echo 'Building the workspace with colcon …'
  # shellcheck disable=SC1090,SC1091
  (
    . .venv/bin/activate
    colcon --log-base log build --symlink-install --base-paths src \
      --event-handlers console_cohesion- desktop_notification- status- > build.log 2>&1 ||
      { cat build.log >&2; exit 1; }
    rm -f build.log
  )
  printf '%s\n' "$sources" > "$built"
fi

{
  echo '# Written by tools/setup_workspace.sh: puts .venv, the workspace and ROS on the path (bash, zsh).'
  echo "_workspace='$workspace'"
  echo "_ros='$ros'"
  cat <<'EOF'
case $- in *u*) _nounset=1; set +u ;; *) _nounset= ;; esac
if [ -n "$ZSH_VERSION" ]; then _shell=zsh; else _shell=bash; fi
[ -z "$_ros" ] || . "$_ros/setup.$_shell"
. "$_workspace/.venv/bin/activate"
. "$_workspace/install/local_setup.$_shell"
case ":$AMENT_PREFIX_PATH:" in
  *":$_workspace/.venv:"*) ;;
  *) export AMENT_PREFIX_PATH="${AMENT_PREFIX_PATH:+$AMENT_PREFIX_PATH:}$_workspace/.venv" ;;
esac
[ -z "$_nounset" ] || set -u
unset _workspace _ros _shell _nounset
EOF
} > "env.sh.$$"
mv "env.sh.$$" env.sh # at once: another make may be reading it

# Modules and kernels are compiled here rather than while a user waits for a first answer.
kernels=$(grep -rlE --include='*.py' '@(njit|inline)' src | sort | xargs cat src/imu_recording/imu_recording/jit.py | sha256sum)
compiled=install/.workspace_compiled
if [ "$(cat "$compiled" 2>/dev/null)" != "$kernels"$'\n'"$current" ]; then
  echo 'Compiling modules and numerical kernels …'
  [ "$(head -n 1 "$compiled" 2>/dev/null)" = "$kernels" ] ||
    find src -type d -path '*/__pycache__/kernels-*' -prune -exec rm -rf {} +  # of earlier versions
  # shellcheck disable=SC1091
  (
    . ./env.sh
    PYTHONDONTWRITEBYTECODE='' python -m imu_workbench.precompile
  )
  printf '%s\n' "$kernels" "$current" > "$compiled"
fi
