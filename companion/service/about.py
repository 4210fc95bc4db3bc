"""Description of the vehicle for operators' pages, from the configuration."""

from companion import __version__
from companion.arms.model import Propellers
from companion.config.companion_config import CompanionConfig
from companion.config.locations import names_in
from companion.config.operator_config import OperatorConfig
from companion.config.trajectory_files import NAMES
from companion.protocol.about import About, AboutFence, AboutRoom


def about_of(config: CompanionConfig, session: str) -> About:
    """Return the description of the vehicle that this run of the service publishes."""
    fence, room, arms = config.fence, config.room, config.arms
    propellers = arms.model().propellers if arms is not None else Propellers()
    return About(
        session=session,
        vehicle=(config.operator or OperatorConfig()).vehicle,
        body=config.mocap.body,
        version=__version__,
        fence=AboutFence(x_m=fence.x_m, y_m=fence.y_m, top_m=fence.top_m),
        room=AboutRoom(x_m=room.x_m, y_m=room.y_m, z_m=room.z_m),
        takeoff_height_m=config.flight.takeoff_height_m,
        footprint_m=propellers.centre_m + propellers.radius_m,
        controllers=() if config.law.on_ground else tuple(dict.fromkeys(("etnn", *names_in("controllers")))),
        motions=tuple(names_in("arms")) if arms is not None else (),
        curves=NAMES,
        separation_order=config.separation.order,
        arms=arms.model_dump(mode="json") if arms is not None else None,
    )
