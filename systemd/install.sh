#!/bin/sh
# Installs the companion on this computer; `make install` calls it. Again does no harm: it brings everything up to date
# and leaves your configuration alone. docs/install.md says what is where.
#
#   systemd/install.sh [vehicle|room|law|page|broker] [--root DIR] [--no-venv]
#
#   vehicle     the flight service, for the onboard computer (if nothing is said)
#   room        the mocap bridge, for the room's workstation
#   law         the control law on the ground, for the room's workstation (docs/split.md)
#   page        the live page, for either computer (docs/page.md)
#   broker      a drop-in for Debian's mosquitto, for the computer that runs the broker
#   --root DIR  puts everything below DIR, as it would be below /: to look at it without touching the system
#   --no-venv   leaves the Python packages out
set -eu
umask 022

part=vehicle root='' venv=yes
while [ $# -gt 0 ]; do
    case $1 in
        vehicle | room | law | page | broker) part=$1 ;;
        --no-venv) venv=no ;;
        --root)
            [ $# -gt 1 ] || { echo "install: --root wants a folder" >&2; exit 2; }
            shift
            mkdir -p "$1"
            root=$(cd "$1" && pwd)
            ;;
        *)
            echo "install: '$1' is unknown; it is: install.sh [vehicle|room|law|page|broker] [--root DIR] [--no-venv]" >&2
            exit 2
            ;;
    esac
    shift
done

source=$(cd "$(dirname "$0")/.." && pwd)
python=${PYTHON:-python3}

say() { echo "install: $*"; }
refuse() {
    echo "install: $*" >&2
    exit 1
}
# put MODE FILE PLACE: always ours, brought up to date. keep MODE FILE PLACE: yours as soon as it is there.
put() {
    install -D -m "$1" "$source/$2" "$root$3"
    say "wrote $root$3"
}
keep() {
    if [ -e "$root$3" ]; then
        say "left $root$3 as it is"
    else
        put "$@"
    fi
}
# Whether there is a systemd to be told; never with --root.
systemd_runs() { [ -z "$root" ] && [ -d /run/systemd/system ]; }

[ -n "$root" ] || [ "$(id -u)" = 0 ] || refuse "this writes to /etc and /opt: say 'sudo make install', or try --root DIR first"
for each in dauam-companion dauam-law; do
    if systemd_runs && systemctl is-active --quiet "$each"; then
        refuse "the service runs, perhaps in flight; land, then: sudo systemctl stop $each"
    fi
done

make_user() {
    put 644 systemd/dauam-sysusers.conf /etc/sysusers.d/dauam.conf
    systemd-sysusers ${root:+--root="$root"} dauam.conf
    say "user dauam is there, in group dialout"
}

# The programs: /opt/dauam is a Python environment, with config/ of this checkout beside it.
make_programs() {
    install -d -m 755 "$root/opt/dauam"
    rm -rf "$root/opt/dauam/config"
    cp -r "$source/config" "$root/opt/dauam/config"
    chmod -R u=rwX,go=rX "$root/opt/dauam/config"
    say "wrote $root/opt/dauam/config"
    if [ "$venv" = no ]; then
        say "left the Python packages out"
        return
    fi
    "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || refuse "'$python' is older than Python 3.11: say PYTHON=python3.12"
    case $("$python" -c 'import os, sys; print(os.path.realpath(sys.executable))') in
        /home/* | /root/*) refuse "'$python' is in a home folder, which the service does not see: say PYTHON=/usr/bin/python3" ;;
    esac
    say "installing Python packages into $root/opt/dauam, a minute ..."
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    # The builder too in its locked version, and built from a copy: nothing of root's stays in the checkout.
    sed -n '/^setuptools==/,/# via/p' "$source/requirements-dev.lock" > "$work/builder.lock"
    mkdir "$work/source"
    for each in companion mock_autopilot pyproject.toml README.md LICENSE; do
        cp -r "$source/$each" "$work/source/"
    done
    "$python" -m venv "$root/opt/dauam"
    pip() { "$root/opt/dauam/bin/python" -m pip --quiet --disable-pip-version-check "$@"; }
    pip install --require-hashes -r "$source/requirements.lock" -r "$work/builder.lock"
    pip install --no-deps --no-build-isolation --force-reinstall "$work/source"
    (cd / && "$root/opt/dauam/bin/python" -m companion.compiled.library)
    # Called from any folder, it looks for config/ beside its packages.
    packages=$("$root/opt/dauam/bin/python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
    ln -sfn ../../../config "$packages/config"
    install -d -m 755 "$root/usr/local/bin"
    ln -sf /opt/dauam/bin/companion "$root/usr/local/bin/companion"
    say "wrote $root/opt/dauam/bin/companion, and a link to it in $root/usr/local/bin"
}

# A first configuration: the example, and the folders the service may write to.
make_config() {
    file=$root/etc/dauam/companion.toml
    if [ -e "$file" ]; then
        say "left $file as it is"
        return
    fi
    install -d -m 755 "$root/etc/dauam"
    sed -e 's|^port = "/dev/serial/by-id/.*"|port = "/dev/dauam-arms"|' \
        -e 's|^# folder = "flights"  |folder = "/var/lib/dauam/flights"  |' \
        -e 's|^# state_folder = "[^"]*"  |state_folder = "/var/lib/dauam"  |' "$source/config/lab.toml" > "$file.new"
    for each in 'port = "/dev/dauam-arms"' 'folder = "/var/lib/dauam/flights"' 'state_folder = "/var/lib/dauam"'; do
        grep -q "^$each" "$file.new" || refuse "config/lab.toml has no line for $each: take it as it is in the repository"
    done
    chmod 644 "$file.new"
    mv "$file.new" "$file"
    say "wrote $file: measure and set what is marked in it"
}

# The same for the ground's law.
make_ground_config() {
    file=$root/etc/dauam/ground.toml
    if [ -e "$file" ]; then
        say "left $file as it is"
        return
    fi
    install -d -m 755 "$root/etc/dauam"
    sed -e 's|^# folder = "flights"  |folder = "/var/lib/dauam/flights"  |' "$source/config/ground.toml" > "$file.new"
    grep -q '^folder = "/var/lib/dauam/flights"' "$file.new" || refuse "config/ground.toml has no line for the folder of records: take it as it is in the repository"
    chmod 644 "$file.new"
    mv "$file.new" "$file"
    say "wrote $file: set the vehicle's address, and what is measured"
}

if [ "$part" != broker ]; then
    make_user
    make_programs
fi
if [ "$part" = law ]; then
    make_ground_config
elif [ "$part" = page ]; then
    keep 644 config/page.toml /etc/dauam/page.toml
elif [ "$part" != broker ]; then
    make_config
fi
case $part in
    vehicle)
        put 644 systemd/dauam-companion.service /etc/systemd/system/dauam-companion.service
        keep 644 systemd/dauam-companion.service.d/network.conf /etc/systemd/system/dauam-companion.service.d/network.conf
        put 644 systemd/99-dauam-u2d2.rules /etc/udev/rules.d/99-dauam-u2d2.rules
        ;;
    room) put 644 systemd/dauam-mocap-bridge.service /etc/systemd/system/dauam-mocap-bridge.service ;;
    law) put 644 systemd/dauam-law.service /etc/systemd/system/dauam-law.service ;;
    page) put 644 systemd/dauam-page.service /etc/systemd/system/dauam-page.service ;;
    broker) put 644 systemd/mosquitto.service.d/dauam.conf /etc/systemd/system/mosquitto.service.d/dauam.conf ;;
esac

if systemd_runs; then
    systemctl daemon-reload
    if [ "$part" = vehicle ]; then
        udevadm control --reload
        udevadm trigger --subsystem-match=tty
    fi
    say "systemd and udev have read them"
else
    say "no systemd was told (none runs here, or --root)"
fi
case $part in
    vehicle) next="edit /etc/dauam/companion.toml, then: sudo systemctl enable --now dauam-companion" ;;
    room) next="edit /etc/dauam/companion.toml, then: sudo systemctl enable --now dauam-mocap-bridge" ;;
    law) next="edit /etc/dauam/ground.toml, copy the vehicle's key to /etc/dauam/law.key, then: sudo systemctl enable --now dauam-law" ;;
    page) next="edit /etc/dauam/page.toml, set a password (docs/install.md), then: sudo systemctl enable --now dauam-page" ;;
    broker) next="see config/mosquitto/ for the broker's own files, then: sudo systemctl restart mosquitto" ;;
esac
say "done; next: $next"
