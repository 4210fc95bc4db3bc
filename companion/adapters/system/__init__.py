"""Services of the operating system: clock, disk, systemd, watchdog timer, lock."""
