"""The table of fault flights."""

from tests.flights.faults.rows import Row
from tests.flights.faults.table_arms import ARM_FAULTS
from tests.flights.faults.table_flight import FLIGHT
from tests.flights.faults.table_link import LINK
from tests.flights.faults.table_mocap import MOCAP
from tests.flights.faults.table_traffic import TRAFFIC

VIRTUAL: tuple[Row, ...] = MOCAP + FLIGHT + ARM_FAULTS + LINK + TRAFFIC
