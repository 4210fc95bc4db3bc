#!/bin/sh
# Takes away what install.sh put there, whichever part it was; `make uninstall` calls it. Configuration, records and the
# user who owns them stay.
#
#   systemd/uninstall.sh [--root DIR]
set -eu

root=''
if [ $# = 2 ] && [ "$1" = --root ] && [ -d "$2" ]; then
    root=$(cd "$2" && pwd)
elif [ $# -gt 0 ]; then
    echo "uninstall: it is: uninstall.sh [--root DIR], and DIR must be there" >&2
    exit 2
fi

say() { echo "uninstall: $*"; }
systemd_runs() { [ -z "$root" ] && [ -d /run/systemd/system ]; }

if [ -z "$root" ] && [ "$(id -u)" != 0 ]; then
    echo "uninstall: this writes to /etc and /opt: say 'sudo make uninstall'" >&2
    exit 1
fi
if systemd_runs; then
    for unit in dauam-companion dauam-law; do
        if systemctl is-active --quiet $unit; then
            echo "uninstall: the service runs, perhaps in flight; land, then: sudo systemctl stop $unit" >&2
            exit 1
        fi
    done
    for unit in dauam-companion dauam-law dauam-mocap-bridge dauam-page; do
        if systemctl cat $unit > /dev/null 2>&1; then
            systemctl disable --quiet --now $unit
        fi
    done
fi

for each in \
    /etc/systemd/system/dauam-companion.service \
    /etc/systemd/system/dauam-law.service \
    /etc/systemd/system/dauam-mocap-bridge.service \
    /etc/systemd/system/dauam-page.service \
    /etc/systemd/system/mosquitto.service.d/dauam.conf \
    /etc/udev/rules.d/99-dauam-u2d2.rules \
    /etc/sysusers.d/dauam.conf \
    /usr/local/bin/companion \
    /opt/dauam; do
    if [ -e "$root$each" ] || [ -h "$root$each" ]; then
        rm -r "$root$each"
        say "removed $root$each"
    fi
done
if systemd_runs; then
    systemctl daemon-reload
    udevadm control --reload
fi

for each in /etc/dauam /etc/systemd/system/dauam-companion.service.d /var/lib/dauam; do
    if [ -e "$root$each" ]; then
        say "left $root$each: yours"
    fi
done
say "the user dauam stays; with everything of yours it goes by: sudo rm -r /etc/dauam /var/lib/dauam; sudo userdel dauam"
