#!/bin/bash
# Starts the service under a real systemd, on a computer that need not run one: installs it into a throw-away copy of this
# system, boots that in a container, and flies the mocks there. Four minutes; nothing of it stays.
#
#   sudo systemd/try.sh [vehicle|page|law|broker]...
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
    chroot "$system" "$source/systemd/install.sh" page --no-venv
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
    cat > "$system/etc/systemd/system/try.service" << END
[Unit]
After=basic.target
[Service]
Type=oneshot
TimeoutStartSec=300
StandardOutput=file:/try.log
StandardError=inherit
ExecStart=/bin/bash -c '/opt/try.sh inside $* && touch /try.good; systemctl poweroff --force --force'
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
        journalctl --no-pager -u dauam-companion -u dauam-page -o short-monotonic | tail -40
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
powerless() { ! grep -q "^CapEff:.*[1-9a-f]" "/proc/$1/status"; }

law_says() { grep -q -- "$1" <(systemctl show -p StatusText --value dauam-law); }
law_restarted() { [ "$(systemctl show -p NRestarts --value dauam-law)" -ge 1 ]; }
refused() { ! "$@"; }
handed_over() { grep -q "^handed over" <(shows StatusText); }

the_law() {
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

page() { systemctl show -p "$1" --value dauam-page; }
page_restarted() { [ "$(page NRestarts)" = 1 ]; }
confined() { powerless "$(page MainPID)" && [ "$(ps -o user=,ni= -p "$(page MainPID)" | xargs)" = "dauam 10" ]; }
# Log in, open the page's WebSocket, command something that the vehicle refuses; print what is heard.
page_commands() {
    /opt/dauam/bin/python - << 'END'
import json, urllib.request
from websockets.sync.client import connect
headers = {"Origin": "http://127.0.0.1:8080", "Content-Type": "application/json"}
login = urllib.request.Request("http://127.0.0.1:8080/login", b'{"password": "beside the net"}', headers)
cookies = urllib.request.urlopen(login, timeout=10).headers.get_all("set-cookie")
headers = {"Cookie": "; ".join(one.partition(";")[0] for one in cookies)}
with connect("ws://127.0.0.1:8080/ws", origin="http://127.0.0.1:8080", additional_headers=headers) as page:
    while (heard := json.loads(page.recv(10)))["type"] != "state":
        pass
    page.send(json.dumps({"type": "command", "ref": 1, "vehicle": heard["vehicle"], "verb": "hold"}))
    while (heard := json.loads(page.recv(10)))["type"] not in {"reply", "error"}:
        pass
    print(heard["type"], heard.get("answer"), heard.get("text"))
END
}
page_refused() { page_commands 2> /dev/null | grep "^reply refused the vehicle is on the ground"; }

the_page() {
    step "the page"
    systemctl start dauam-companion
    must "the vehicle is there" within 20 phase standby
    echo "beside the net" | /usr/local/bin/companion page-password /etc/dauam/page.hash
    chown root:dauam /etc/dauam/page.hash
    chmod 640 /etc/dauam/page.hash
    sed -i 's|^# password_file = "/etc/dauam/page.hash" |password_file = "/etc/dauam/page.hash" |' /etc/dauam/page.toml
    must "it begins" systemctl start dauam-page
    must "it takes the password, shows the vehicle and passes a command on" within 20 page_refused
    must "it is nobody's but dauam's, without a capability, and goes after a flight" confined
    must "it can write nothing" refused nsenter -t "$(page MainPID)" -m touch /etc/dauam/written
    kill -9 "$(page MainPID)"
    must "systemd begins it anew" within 20 page_restarted
    must "it takes the password again" within 20 page_refused
    must "stop" systemctl stop dauam-page dauam-companion
    must "it ended as it should" [ "$(page Result)" = success ]
}

the_vehicle() {
    step "the unit as installed, hardened as it is"
    must "it says itself that it is ready" systemctl start dauam-companion
    must "it finds the vehicle" within 20 phase standby
    must "its control loop runs at FIFO 50" grep -q "FIFO" <(chrt -p "$(shows MainPID)")
    must "it has no capability" powerless "$(shows MainPID)"
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
}

the_broker() {
    [ -x /usr/sbin/mosquitto ] || return 0
    step "mosquitto with our drop-in"
    must "it begins" systemctl start mosquitto
    kill -9 "$(systemctl show -p MainPID --value mosquitto)"
    must "it comes back" within 10 serves_again
}

inside() {
    systemctl start mock
    for each in "$@"; do
        "the_$each"
    done
}

if [ "${1:-}" = inside ]; then
    inside "${@:2}"
elif [ "$(id -u)" != 0 ]; then
    echo "try: this boots a container: say sudo systemd/try.sh" >&2
    exit 2
elif ! command -v systemd-nspawn > /dev/null; then
    echo "try: systemd-nspawn is missing: say sudo apt-get install systemd-container" >&2
    exit 2
elif [ "${1:-}" = alone ]; then
    outside "${@:2}"
else
    for each in "$@"; do
        [[ $each =~ ^(vehicle|page|law|broker)$ ]] || { echo "try: '$each' is unknown; it is: vehicle, page, law, broker" >&2; exit 2; }
    done
    [ $# -gt 0 ] || set -- vehicle page law broker
    exec unshare --mount "$0" alone "$@"
fi
