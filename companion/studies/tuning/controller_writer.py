"""A tuned set of gains as a controller file, with what it departs in from the print, and how it was found."""

from companion.studies.tuning.gain_space import gain_fields

_HEAD = """\
# {title}
#
# Same equations as the paper; what departs from its print, and why (docs/control.md):
#
# - filter_eps, zeta, rho: the printed filter is unstable with the printed compensation. Here rho / filter_eps =
#   {damping:.3g} exceeds k + s = {needed:.3g}.
# - power_regularisation: the fractional powers have unbounded slope at 0; with the attitude's lag that is a limit cycle
#   of some centimetres, and every swing of it an event.
# - boundary_layer_mps: sgn(y_2) changes by 2 (sigma + kappa/delta) at every sign change, and each would be an event.
# - gamma_v0, gamma_v1: the printed 100 closes an adaptation loop faster than the vehicle's attitude can follow.
# - prediction: the commands already sent and the attitude measured now say where the vehicle will be when a new command
#   begins to act; without it nothing that is precise is stable on a real attitude loop.
# - observer_radps, observer_trend, push_share: what the rotors do not explain of the motion is a push that goes on and
#   changes: the prediction knows it, and a share of it is taken off the command.
# - past_filter: a share of the reference's acceleration, which is known, does not come late out of the command filter.
# - the gains: found by
#       {command}
#   which also checked them on seeds and trajectories that it had never flown.
law = "etnn"
description = "{description}"

[gains]
"""
_TAIL = """
[prediction]
enabled = true
lead_s = {lead_s:.3g}         # beyond the known delays, s
thrust_lead_s = {thrust_lead_s:.3g}  # s
observer_radps = {observer_radps:.3g}
observer_trend = {observer_trend:.3g}

[error_limits]
mean_m = 0.05
max_m = 0.20
"""
_UNITS = {
    "filter_eps": "s",
    "sigma": "m/s^2",
    "boundary_layer_mps": "m/s",
    "k": "1/s",
    "push_share": "of the observed push",
}


def controller_toml(values: dict[str, float], title: str, description: str, command: str) -> str:
    """The file's text; `values` are `gain_space.rounded` ones."""
    fields = gain_fields(values)
    damping, needed = fields.filter_loop()
    lines = [
        f"{name} = {_number(getattr(fields, name))}{f'  # {_UNITS[name]}' if name in _UNITS else ''}"
        for name in type(fields).model_fields
        if name in fields.model_fields_set
    ]
    head = _HEAD.format(title=title, description=description, command=command, damping=damping, needed=needed)
    return head + "\n".join(lines) + "\n" + _TAIL.format(**values)


def _number(value: object) -> str:
    if hasattr(value, "tolist"):
        return "[" + ", ".join(f"{number:.3g}" for number in value.tolist()) + "]"
    return f"{value:.3g}"
