"""The two example files of a split deployment, and what both sides must agree on."""

import re
from pathlib import Path

from companion.config.companion_config import CompanionConfig, agreed_of, load_config
from companion.config.controller_config import controller_path

CONFIG = Path(__file__).resolve().parents[2] / "config"


def vehicle_and_ground(folder: Path) -> tuple[CompanionConfig, CompanionConfig]:
    """Return both, with the vehicle's [law] table uncommented."""
    key = folder / "law.key"
    key.write_text("0123456789abcdef\n")
    key.chmod(0o600)
    texts = [
        (CONFIG / name).read_text().replace("/etc/dauam/law.key", str(key)) for name in ("lab.toml", "ground.toml")
    ]
    of_law = re.search(r"(?m)^# \[law\]\n(?:# .*\n)+", texts[0])
    assert of_law is not None
    texts[0] = texts[0].replace(of_law[0], re.sub(r"(?m)^# ", "", of_law[0]))
    paths = folder / "lab.toml", folder / "ground.toml"
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text)
    return load_config(paths[0]), load_config(paths[1])


def test_the_two_examples_connect(tmp_path: Path) -> None:
    vehicle, ground = vehicle_and_ground(tmp_path)
    assert vehicle.law.on_ground
    assert ground.law.on_ground
    assert agreed_of(vehicle) == agreed_of(ground)
    assert vehicle.law.link.port == ground.law.link.port
    assert controller_path(ground.control.controller).exists()


def test_what_only_one_side_has_need_not_be_equal(tmp_path: Path) -> None:
    vehicle, _ = vehicle_and_ground(tmp_path)
    assert vehicle.arms is not None
    other = vehicle.model_copy(
        update={
            "arms": vehicle.arms.model_copy(update={"port": "/dev/none", "baud": 57_600}),
            "mocap": vehicle.mocap.model_copy(update={"host": "127.0.0.1", "delay_s": 0.004}),
            "fence": vehicle.fence.model_copy(update={"top_m": 9.0}),
        }
    )
    assert agreed_of(vehicle) == agreed_of(other)


def test_a_vehicle_with_other_arms_does_not_agree(tmp_path: Path) -> None:
    vehicle, ground = vehicle_and_ground(tmp_path)
    assert ground.arms is not None
    other = ground.model_copy(update={"arms": ground.arms.model_copy(update={"stands_at_m": 0.5})})
    differing = {key for key, value in agreed_of(other).items() if agreed_of(vehicle)[key] != value}
    assert differing == {"arms, by their digest"}
