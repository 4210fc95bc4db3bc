#!/bin/bash
# Starts the service under a real systemd, on a computer that need not run one: installs it into a throw-away copy of this
# system, boots that in a container, and flies the mocks there. Two minutes; nothing of it stays.
#
#   sudo systemd/try.sh
#
# Wants the packages systemd-container and python3-venv, and Python 3.11 outside of home folders (PYTHON=..., if python3
# is not that one). Exit code 0: everything was as docs/install.md says.
set -euo pipefail

source=$(cd "$(dirname "$0")/.." && pwd)

outside() {
    # shellcheck disable=SC2064 # the folder of now
    work=$(mktemp -d) && trap "umount -lR '$work'; rmdir '$work'" EXIT
    mount -t tmpfs tmpfs "$work"
    system=$work/system
    mkdir "$work/written" "$work/overlay" "$system"
    mount -t overlay overlay -o "lowerdir=/,upperdir=$work/written,workdir=$work/overlay" "$system"
    mount --bind "$source" "$system$source"
    mount --bind /dev "$system/dev"
    mount -t proc proc "$system/proc"

    # The mocks instead of a room; without arms, whose servo bus is no serial port here.
    install -d "$system/etc/dauam"
    sed '/^\[arms\]/,$d' "$source/config/demo.toml" > "$system/etc/dauam/companion.toml"
    printf '\n[operator]\nembedded = true\n\n[records]\nfolder = "/var/lib/dauam/flights"\n' >> "$system/etc/dauam/companion.toml"
    chroot "$system" env PYTHON="${PYTHON:-python3}" "$source/systemd/install.sh"
    chroot "$system" "$source/systemd/install.sh" law --no-venv
    chroot "$system" "$source/systemd/install.sh" broker
    umount "$system/proc" "$system/dev"

    install -m 755 "$source/systemd/try.sh" "$system/opt/try.sh"
    # The mocks stand for a room and a vehicle, which no busy computer holds up.
    cat > "$system/etc/systemd/system/mock.service" << 'END'
[Service]
CPUSchedulingPolicy=fifo
CPUSchedulingPriority=40
ExecStart=/opt/dauam/bin/mock-autopilot --config /opt/dauam/config/mock.toml
WorkingDirectory=/opt/dauam
END
    cat > "$system/etc/systemd/system/try.service" << 'END'
[Unit]
After=basic.target
[Service]
Type=oneshot
TimeoutStartSec=300
StandardOutput=file:/try.log
StandardError=inherit
ExecStart=/bin/bash -c '/opt/try.sh inside && touch /try.good; systemctl poweroff --force --force'
END
    printf '[Unit]\nRequires=basic.target\nWants=try.service\n' > "$system/etc/systemd/system/try.target"
    # Leave to ask for the time, as a real computer gives it; the service drops it like every other.
    timeout 330 systemd-nspawn -D "$system" --register=no --keep-unit --private-network --capability=CAP_SYS_TIME \
        -b systemd.unit=try.target < /dev/null > "$work/console" 2>&1 || true
    cat "$system/try.log"
    if [ ! -e "$system/try.good" ]; then
        tail -5 "$work/console"
        echo "try: FAILED"
        exit 1
    fi
    echo "try: all as it should be"
}

step() { echo "== $*"; }
# must TEXT COMMAND...: the command must succeed.
must() {
    if "${@:2}"; then
        echo "   ok: $1"
    else
        echo "   NOT SO: $1"
        journalctl --no-pager -u dauam-companion -o short-monotonic | tail -40
        exit 1
    fi
}
shows() { systemctl show -p "$1" --value dauam-companion; }
logged() { journalctl --no-pager -u dauam-companion -o cat | grep -q -- "$1"; }
companion() { /usr/local/bin/companion "$@" --config /etc/dauam/companion.toml; }
# within SECONDS COMMAND...: it succeeds at last.
within() {
    local end=$((SECONDS + $1))
    until "${@:2}"; do
        [ $SECONDS -lt $end ] || return 1
        sleep 0.2
    done
}
restarted() { [ "$(shows NRestarts)" = "$1" ] && [ "$(shows ActiveState)" = active ]; }
serves_again() { (exec 3<> /dev/tcp/127.0.0.1/1883) 2> /dev/null; }
phase() { [ "$(shows StatusText)" = "$1" ]; }
unlocked() { ! grep -q "^CapEff:.*[1-9a-f]" "/proc/$(shows MainPID)/status"; }

law_says() { grep -q -- "$1" <(systemctl show -p StatusText --value dauam-law); }
law_restarted() { [ "$(systemctl show -p NRestarts --value dauam-law)" -ge 1 ]; }
refused() { ! "$@"; }
handed_over() { grep -q "^handed over" <(shows StatusText); }

law_on_the_ground() {
    step "the law on the ground"
    must "a key" /usr/local/bin/companion law-key /etc/dauam/law.key
    chown root:dauam /etc/dauam/law.key
    chmod 640 /etc/dauam/law.key
    printf '\n[law]\nruns_on = "ground"\n[law.link]\nkey_file = "/etc/dauam/law.key"\n' >> /etc/dauam/companion.toml
    cp /etc/dauam/companion.toml /etc/dauam/ground.toml
    systemctl start dauam-companion
    must "the vehicle is there" within 20 phase standby
    must "without a law it does not arm" refused companion arm
    must "the law says itself that it is ready" systemctl start dauam-law
    must "it meets the vehicle" within 20 law_says "the vehicle is there"
    must "it runs at FIFO 50" grep -q "FIFO" <(chrt -p "$(systemctl show -p MainPID --value dauam-law)")
    must "arm" companion arm
    must "takeoff" companion takeoff
    must "it flies the vehicle" law_says "flies the vehicle"
    kill -9 "$(systemctl show -p MainPID --value dauam-law)"
    must "PX4 lands" within 10 handed_over
    must "systemd begins the law anew" within 20 law_restarted
    must "it meets the vehicle again" within 40 law_says "the vehicle is there"
    must "stop" systemctl stop dauam-law dauam-companion
}

inside() {
    systemctl start mock
    step "the unit as installed, hardened as it is"
    must "it says itself that it is ready" systemctl start dauam-companion
    must "it finds the vehicle" within 20 phase standby
    must "its control loop runs at FIFO 50" grep -q "FIFO" <(chrt -p "$(shows MainPID)")
    must "it has no capability" unlocked
    for helper in $(pgrep -P "$(shows MainPID)"); do
        must "helper $helper has no real-time priority" grep -q "SCHED_OTHER" <(chrt -p "$helper")
    done
    must "preflight" companion preflight
    step "kill -9 in flight"
    must "arm" companion arm
    must "takeoff" companion takeoff
    kill -9 "$(shows MainPID)"
    must "systemd begins it anew" within 20 restarted 1
    must "it commands nothing" within 20 phase standby
    must "the flight's record is there" compgen -G "/var/lib/dauam/flights/*.mcap"
    sleep 15 # PX4 lands by itself
    step "systemctl stop in flight"
    must "arm" companion arm
    must "takeoff" companion takeoff
    must "stop" systemctl stop dauam-companion
    must "it landed first" logged "land -> disarmed"
    must "it ended as it should" [ "$(shows Result)" = success ]
    step "a service that hangs on the ground"
    systemctl start dauam-companion
    must "it finds the vehicle" within 20 phase standby
    kill -STOP "$(shows MainPID)"
    must "the watchdog sees it and begins it anew" within 30 restarted 1
    must "by its signal" logged "watchdog"
    must "stop" systemctl stop dauam-companion
    law_on_the_ground
    if [ -x /usr/sbin/mosquitto ]; then
        step "mosquitto with our drop-in"
        must "it begins" systemctl start mosquitto
        kill -9 "$(systemctl show -p MainPID --value mosquitto)"
        must "it comes back" within 10 serves_again
    fi
}

if [ "${1:-}" = inside ]; then
    inside
elif [ "$(id -u)" != 0 ]; then
    echo "try: this boots a container: say sudo systemd/try.sh" >&2
    exit 2
elif ! command -v systemd-nspawn > /dev/null; then
    echo "try: systemd-nspawn is missing: say sudo apt-get install systemd-container" >&2
    exit 2
elif [ "${1:-}" = alone ]; then
    outside
else
    exec unshare --mount "$0" alone
fi
