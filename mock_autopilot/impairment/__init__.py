"""A link impairment for any UDP or TCP port: loss, bursts, delay, jitter, reordering, rate; seeded.

Other people's programs use it as `python -m mock_autopilot.impairment`, docs/mock.md.
"""

from mock_autopilot.impairment.direction import Counts, ImpairedDirection
from mock_autopilot.impairment.model import CLEAN, CUT, Impairment
from mock_autopilot.impairment.sentences import Directions, ImpairmentError, parse, parse_directions
from mock_autopilot.impairment.stream import ImpairedStream
from mock_autopilot.impairment.tcp_relay import TcpRelay, tcp_relay
from mock_autopilot.impairment.udp_relay import RelayError, UdpRelay, udp_relay

__all__ = [
    "CLEAN",
    "CUT",
    "Counts",
    "Directions",
    "ImpairedDirection",
    "ImpairedStream",
    "Impairment",
    "ImpairmentError",
    "RelayError",
    "TcpRelay",
    "UdpRelay",
    "parse",
    "parse_directions",
    "tcp_relay",
    "udp_relay",
]
